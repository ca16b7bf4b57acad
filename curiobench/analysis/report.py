"""`curiobench report`: one HTML page about a set of runs, which needs no network, no torch and no MuJoCo."""

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from curiobench.analysis.frames import read_results
from curiobench.analysis.report_cells import cells_of
from curiobench.analysis.report_figures import pictures
from curiobench.analysis.report_goals import task_cards
from curiobench.analysis.report_options import options
from curiobench.analysis.report_runs import RUN_HEADINGS, run_rows
from curiobench.analysis.report_summary import summary, title_of
from curiobench.analysis.report_tables import tables
from curiobench.analysis.report_text import DEFINITIONS, citation
from curiobench.analysis.samples import LOGGED
from curiobench.files import replace_file
from curiobench.methods.specs import shown

if TYPE_CHECKING:
    from jinja2 import Template

    from curiobench.analysis.frames import Results

SECTIONS = (
    ("results", "Results"),
    ("figures", "Figures"),
    ("goals", "Goal by goal"),
    ("options", "Options"),
    ("runs", "Runs and commands"),
    ("method", "How the numbers are made"),
)
"""Anchors of the page and their names."""


def write_report(
    paths: Sequence[Path],
    out: Path,
    title: str | None = None,
    partial: bool = False,
    baseline: str | None = None,
    processes: int = 1,
) -> "Results":
    """Write a report on runs.

    Args:
        paths: run folders, folders of run folders, published sets.
        out: file to write; replaced if it is there.
        title: of the page; told from the data if None.
        partial: also take runs that are not finished.
        baseline: method that the others are compared with; sac, where there are runs of it, if None.
        processes: how many read and draw side by side; the page does not depend on it.

    Returns:
        The runs, and the faults found among them, which the page names too.

    Raises:
        ValueError: no run that can be used, no run of the baseline, or a file that cannot be written.
    """
    if out.is_dir():
        raise ValueError(f"cannot write {out}: it is a folder; name a file, such as {out / 'report.html'}")
    results = read_results(paths, partial, False, LOGGED, processes)
    if results.runs.empty:
        raise ValueError("; ".join(["no run to report on", *results.faults]))
    methods = list(dict.fromkeys(results.runs["method"]))
    if baseline and shown(baseline) not in methods:
        raise ValueError(f"no run is of the baseline {baseline!r}; there are {', '.join(methods)}")
    page = render(results, title, shown(baseline or "sac"), processes).encode()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        replace_file(out, lambda file: file.write(page))
    except OSError as error:
        raise ValueError(f"cannot write {out}: {error.strerror}") from None
    return results


def render(results: "Results", title: str | None = None, baseline: str = "sac", processes: int = 1) -> str:
    """The page as HTML; the same text for the same runs. Raises ValueError where there is nothing to draw."""
    return _template().render(**_contents(results, title, baseline, processes), **_inlined())


def _contents(results: "Results", title: str | None, baseline: str, processes: int) -> dict[str, Any]:
    """What the template shows; text as it is, for the template escapes it."""
    runs, opening = results.runs, summary(results)
    return {
        "title": title or title_of(results),
        "sections": SECTIONS,
        "summary": opening,
        "faults": results.faults,
        "baseline": baseline,
        "compared": runs["method"].nunique() > 1 and baseline in set(runs["method"]),
        "tables": tables(results, baseline, told=opening.warnings),
        "figures": pictures(results, processes),
        "tasks": task_cards(results),
        "options": options(runs),
        "methods": list(dict.fromkeys(cell.label for cell in cells_of(runs))),
        "runs": run_rows(runs),
        "run_headings": RUN_HEADINGS,
        "definitions": DEFINITIONS,
        "citation": citation(sorted({str(version) for version in runs["curiobench"] if version})),
    }


@cache
def _template() -> "Template":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("curiobench.analysis", "page")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined).get_template("page.html.j2")


@cache
def _inlined() -> dict[str, Any]:
    """Style and script of the page, and the digest that allows this script to run and no other."""
    from markupsafe import Markup

    style, script = ((files("curiobench.analysis") / "page" / name).read_text() for name in ("page.css", "page.js"))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return {"style": Markup(style), "script": Markup(script), "script_digest": digest}
