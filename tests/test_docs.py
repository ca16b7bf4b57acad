"""The Python examples in the README and the docs run as they stand."""

import csv
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "results").rglob("README.md")), *sorted((ROOT / "docs").rglob("*.md"))]


def examples() -> list:
    """Every ```python block, named by its page and number."""
    return [
        pytest.param(code, id=f"{page.name}-{number}")
        for page in PAGES
        for number, code in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL), start=1)
    ]


@pytest.mark.parametrize("code", examples())
def test_example_runs(code, tmp_path):
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_notebook_runs_from_a_clean_folder(tmp_path):
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    notebook = nbformat.read(ROOT / "docs" / "notebook.ipynb", as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.outputs for cell in code)  # readers see them without running anything
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    (table,) = code[-1].outputs
    assert "icm" in table["data"]["text/plain"]
    assert (tmp_path / "runs" / "notebook" / "result.json").exists()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page):
    for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
        assert (page.parent / link).exists(), link


@pytest.mark.parametrize("scores", ["docs/images/probe/stack2/scores.csv", "docs/images/probe/stack3/scores.csv"])
def test_scores_of_the_probes_are_those_that_were_written(scores):
    _, _, rest = (ROOT / "docs" / "probes.md").read_text().partition(f"<!-- scores: {scores} -->\n```\n")
    told = [line.rsplit(maxsplit=8)[:5] for line in rest.partition("```")[0].splitlines()[1:]]
    with open(ROOT / scores, newline="") as file:
        rows = sorted(csv.DictReader(file), key=lambda row: -float(row["controllability"]))
    names = ("lifting", "falling", "controllability")
    assert [[label.split()[0], *values] for label, *values in told] == [  # a label is a method and maybe a run
        [row["method"], row["epoch"], *(f"{float(row[name]):+.2f}" for name in names)] for row in rows
    ]
