"""`python -m curiobench`."""

from curiobench.cli import main

main()
