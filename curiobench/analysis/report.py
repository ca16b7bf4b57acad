"""`curiobench report`: one HTML page about a set of runs, which needs no network, no torch and no MuJoCo."""

import base64
import hashlib
import re
import tempfile
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from curiobench.analysis.figures import FIGURES, draw_figures
from curiobench.analysis.formats import check_baseline
from curiobench.analysis.frames import Results, read_results
from curiobench.analysis.report_data import (
    RUN_HEADINGS,
    goal_cards,
    listed,
    option_tables,
    run_rows,
    sentences,
    table_data,
    warnings,
)
from curiobench.analysis.samples import LOGGED, task_samples
from curiobench.analysis.tables import method_tables, summarise
from curiobench.files import replace_file, utf8, writing_to

PIXELS_A_POINT = 4 / 3 * 1.25  # of a figure, which is at most a quarter larger than on paper

_COORDINATES = re.compile(rb'( (?:d|x|y|width|height)="|translate\()([^")]*)')
_LONG = re.compile(rb"-?\d+\.\d{2,}")
_UNSEEN = re.compile(rb'<metadata>.*?</metadata>|<!--.*?-->|\n\s*(?=\n)|(?<=<g) id="\w+_\d+"', re.DOTALL)
"""Invisible parts of an SVG, and the `id` of groups, to which nothing refers."""


def write_report(
    paths: Sequence[Path],
    out: Path,
    title: str | None = None,
    partial: bool = False,
    baseline: str | None = None,
    processes: int = 1,
) -> Results:
    """Write a report on the runs at paths, and return these, with the faults that the page names too.

    Args:
        paths: run folders, folders of run folders, published sets.
        out: file to write; replaced if it is there.
        title: of the page; made from the data if None.
        partial: also take runs that are not finished.
        baseline: method that the others are compared with; sac, where there are runs of it, if None.
        processes: how many read and draw side by side; the page does not depend on it.

    Raises ValueError if no run can be used, none has the baseline, or the file cannot be written.
    """
    if out.is_dir():
        raise ValueError(f"cannot write {out}: it is a folder; name a file, such as {out / 'report.html'}")
    results = read_results(paths, partial, False, LOGGED, processes)
    if results.runs.empty:
        raise ValueError("; ".join(["no run to report on", *results.faults]))
    page = utf8(render(results, title, check_baseline(results, baseline), processes))
    with writing_to(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        replace_file(out, lambda file: file.write(page))
    return results


def render(results: Results, title: str | None = None, baseline: str = "sac", processes: int = 1) -> str:
    """The page as HTML; the same text for the same runs. Raises ValueError where there is nothing to draw."""
    tasks = task_samples(results)
    samples = [sample for task in tasks for sample in task.samples]
    opening, methods = warnings(results, tasks), {sample.method for sample in samples}
    return _page().render(  # which escapes all texts
        title=title or f"Curiosity methods on {listed(task.task for task in tasks)}",
        sentences=sentences(results, tasks),
        warnings=opening,
        faults=results.faults,
        baseline=baseline,
        compared=len(methods) > 1 and baseline in methods,
        tables=[table_data(table, opening, samples) for table in method_tables(summarise(tasks, baseline), baseline)],
        figures=pictures(results, processes),
        tasks=[goal_cards(task) for task in tasks],
        options=option_tables(samples),
        methods=list(dict.fromkeys(sample.label for sample in samples)),
        runs=run_rows(samples),
        run_headings=RUN_HEADINGS,
        versions=sorted({str(version) for version in results.runs["curiobench"] if version}),
    )


@cache
def _page() -> Template:
    """The template with style, script, and the digest that allows this script to run and no other."""
    loader = PackageLoader("curiobench.analysis", "page")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    style, script = (
        (files("curiobench.analysis") / "page" / name).read_text("utf-8") for name in ("page.css", "page.js")
    )
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    environment.globals |= {"style": Markup(style), "script": Markup(script), "script_digest": digest}
    return environment.get_template("page.html.j2")


def pictures(results: Results, processes: int = 1) -> list[dict[str, Any]]:
    """All figures of the runs, as data URIs with captions; raises ValueError as `draw_figures`."""
    with tempfile.TemporaryDirectory(prefix="curiobench-report-") as folder:
        paths = draw_figures(results, Path(folder), formats=("svg",), processes=processes)
        return [_figure_entry(path) for path in paths]


def _figure_entry(path: Path) -> dict[str, Any]:
    """A figure for the template; `width` and `height` are the largest, in pixels."""
    content = _shortened(path.read_bytes())
    task, kind = re.fullmatch(rf"(.+)-({'|'.join(FIGURES)})(?:-[0-9]+)?", path.stem).groups()
    caption = f"{task}: {FIGURES[kind].caption}."
    sizes = {side: re.search(rb'<svg[^>]* %s="([\d.]+)' % side.encode(), content) for side in ("width", "height")}
    return {
        "source": f"data:image/svg+xml;base64,{base64.b64encode(content).decode()}",
        "caption": caption,
        "alt": f"{caption} The tables of this page hold the last values.",
        **{side: round(float(points[1]) * PIXELS_A_POINT) for side, points in sizes.items()},
    }


def _shortened(svg: bytes) -> bytes:
    """An SVG of matplotlib's with coordinates to a tenth of a point, a third smaller; no difference can be seen."""
    return _UNSEEN.sub(b"", _COORDINATES.sub(lambda found: found[1] + _LONG.sub(_short, found[2]), svg))


def _short(number: re.Match[bytes]) -> bytes:
    return (b"%.1f" % float(number[0])).removesuffix(b".0")
