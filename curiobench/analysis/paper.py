"""The numbers of the paper, as it prints them: Han et al. (2023), doi 10.3389/fnbot.2023.1089270, Tables 1 to 4."""

from dataclasses import dataclass

PAPER_TASK = "stack3"
PAPER_GOALS = (8, 21, 6)
"""Table 1: goals of one, two and three layers."""

LEARNED = {
    "sac": (1, 0, 0),
    "icm": (4, 0, 0),
    "rnd": (4, 0, 0),
    "dac": (6, 3, 0),
    "re3": (7, 5, 0),
    "mihm": (8, 21, 2),
    "icm+hm": (7, 6, 0),
    "rnd+hm": (8, 6, 0),
    "mi": (8, 17, 0),
    "DECSTR": (8, 21, 5),
    "Multi-criteria HER": (3, 0, 0),
}
"""Tables 2 to 4: goals of one, two and three layers with a final success rate above 80 %, by method as we spell it."""

QUOTED = ("DECSTR", "Multi-criteria HER")
"""Methods that the paper compares with and curiobench does not have."""


@dataclass(frozen=True)
class PaperTable:
    """What a table of the paper is about."""

    number: int
    """In the paper."""
    about: str
    """Its subject."""
    methods: tuple[str, ...]
    """Its rows."""


PAPER_TABLES = (
    PaperTable(2, "curiosity methods", ("sac", "icm", "rnd", "dac", "re3", "mihm")),
    PaperTable(3, "ablations", ("icm+hm", "rnd+hm", "mi", "mihm")),
    PaperTable(4, "other approaches", ("mihm", *QUOTED)),
)
