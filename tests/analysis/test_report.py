"""The HTML report: one file, well formed, nothing from outside, the tables' numbers, faults named, text escaped."""

import base64
import hashlib
import html
import re
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path

import pytest
from synthetic import NINE, write_runs

from curiobench.analysis import report
from curiobench.analysis.formats import markdown
from curiobench.analysis.frames import read_results
from curiobench.analysis.samples import task_samples
from curiobench.analysis.tables import method_tables, summarise
from curiobench.tasks.goals import goal_space

EVIL = "<script>alert('x')</script>\"&"
VOID = {"meta", "img"}


class Page(HTMLParser):
    """A page, taken apart; fails where elements are not closed in order."""

    def __init__(self, text: str):
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self._open.append(tag)
            self.texts.setdefault(tag, []).append("")

    def handle_endtag(self, tag):
        assert tag == self._open.pop()

    def handle_data(self, data):
        for tag in set(self._open):
            self.texts[tag][-1] += data

    def attributes(self, tag: str, name: str) -> list[str]:
        return [attributes[name] for found, attributes in self.tags if found == tag and name in attributes]


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    """Folder of nine methods × two seeds on three blocks."""
    folder = tmp_path_factory.mktemp("nine")
    write_runs(folder, tasks=("stack3",), methods=NINE, seeds=2)
    return folder


@pytest.fixture(scope="module")
def text(runs) -> str:
    """Their report."""
    out = runs / "report.html"
    report.write_report([runs], out)
    return out.read_text()


@pytest.fixture
def no_figures(monkeypatch):
    """Reports without figures, which take most of their time."""
    monkeypatch.setattr(report, "pictures", lambda results, processes: [])


def test_it_is_well_formed_and_below_three_megabytes(text):
    page = Page(text)
    assert page.texts["title"] == ["Curiosity methods on stack3"]
    assert len(page.texts["html"]) == len(page.texts["body"]) == len(page.texts["h1"]) == 1
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert len(text) < 3e6


def test_nothing_comes_from_outside(text):
    page = Page(text)
    assert {tag for tag, _ in page.tags} & {"link", "iframe", "object", "embed", "base", "form"} == set()
    sources = page.attributes("img", "src") + page.attributes("a", "href") + page.attributes("script", "src")
    assert sources
    assert all(source.startswith(("data:image/", "#")) for source in sources)
    anchors = {attributes.get("id") for _, attributes in page.tags}
    assert {href.removeprefix("#") for href in page.attributes("a", "href")} <= anchors
    assert not re.search(r"url\(|@import|fetch\(|XMLHttp|https?://", page.texts["style"][0] + page.texts["script"][0])
    for source in sources:
        if source.startswith("data:image/svg"):
            svg = base64.b64decode(source.partition(",")[2]).decode()
            assert all(href.startswith(("#", "data:image/png")) for href in re.findall(r'href="([^"]*)"', svg))


def test_only_its_own_script_may_run(text):
    page = Page(text)
    (script,) = page.texts["script"]
    (policy,) = [v for v in page.attributes("meta", "content") if "script-src" in v]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert policy.endswith(f"script-src 'sha256-{digest}'")
    assert not any(name.startswith("on") for _, attributes in page.tags for name in attributes)


def test_every_picture_has_a_text(text):
    images = [attributes for tag, attributes in Page(text).tags if tag == "img"]
    assert len(images) > 35
    assert all(len(image["alt"]) > 10 for image in images)


def test_every_goal_shows_every_method(text, runs):
    page = Page(text)
    space = goal_space(3)
    assert page.texts["h5"] == list(space.names)
    assert len(page.texts["article"]) == len(space)
    final = read_results([runs], every_goal=False).evaluations
    wanted = final.astype({"goal": str, "method": str}).groupby(["goal", "method"])["success"].mean()
    for name, card in zip(space.names, page.texts["article"], strict=True):
        for method in NINE:
            assert f"{method}{wanted[name, method]:.2f}" in card, (name, method)


def test_the_tables_are_those_of_the_table_command(text, runs):
    tables = method_tables(summarise(task_samples(read_results([runs]))))
    printed = [re.split(r"\s*\|\s*", line.replace("*", "").replace("\\", "")) for line in markdown(tables).splitlines()]
    rows = [line[1:-1] for line in printed if len(line) > 2 and line[1].partition(" ")[0] in ("method", *NINE)]
    shown = re.findall(r"<tr>(.*?)</tr>", text.partition('id="figures"')[0], re.DOTALL)
    cells = [re.findall(r"<(?:th|td)[^>]*>(.*?)</(?:th|td)>", row, re.DOTALL) for row in shown]
    assert len(rows) == 3 * (1 + len(NINE))
    assert [[html.unescape(re.sub(r"<[^>]*>", "", cell)) for cell in row] for row in cells] == rows


def test_the_command_of_every_run_is_there(text, runs):
    results = read_results([runs])
    assert Page(text).texts["code"] == list(results.runs["command"])


def test_summary_and_warnings_come_from_the_data(text):
    lead = Page(text).texts["p"][0]
    assert "stack3: 9 methods × 2 seeds, 18 runs, all complete." in lead
    assert "Gripper, laptop preset: 4 epochs, 4,000 steps a run." in lead
    assert "So few seeds do not rank them." in lead
    assert "on 2026-11-22 on Test CPU, 2 cores" in lead
    warning = next(part for part in Page(text).texts["div"] if part.startswith("Before you compare"))
    assert "2 seeds are too few" in warning
    assert "0.01 % of the paper's 40 M" in warning


@pytest.mark.parametrize(
    ("hours", "words"), [(1 / 3600, "less than a minute"), (0.5, "30 minutes"), (1.5, "1.5 hours")]
)
def test_the_summary_says_how_long_the_runs_took(make_runs, no_figures, hours, words):
    results = read_results(make_runs(methods=("sac",), seeds=1))
    page = Page(report.render(replace(results, runs=results.runs.assign(hours=hours)), title="Runs"))
    assert f" in {words} of work." in page.texts["p"][0]


def test_text_of_users_is_escaped(make_runs, no_figures):
    results = read_results(make_runs(methods=("sac",), seeds=1))
    cell = dict.fromkeys(("run", "method", "variant"), EVIL)
    altered = replace(
        results,
        runs=results.runs.assign(**cell, machine=EVIL, command=EVIL, git_commit=EVIL),
        evaluations=results.evaluations.assign(goal=EVIL, **cell),
        layers=results.layers.assign(**cell),
        faults=(EVIL,),
    )
    page = Page(report.render(altered, title=EVIL))
    assert len(page.texts["script"]) == 1
    assert page.texts["title"] == page.texts["h1"] == [EVIL]
    assert page.texts["code"][0] == EVIL
    assert sum(EVIL in text for text in page.texts["li"]) > 4


def test_faults_are_named_on_the_page_and_by_the_command(make_runs, tmp_path, no_figures, cli):
    make_runs(grid=True)
    folder, out = tmp_path / "runs", tmp_path / "new" / "page.html"
    make_runs(methods=("sac",), seeds=1, suffix="-again")
    (folder / "stack2-sac-1" / "result.json").unlink()
    (folder / "notes").mkdir()
    code, stdout, stderr = cli("report", folder, tmp_path / "nowhere", "--out", out)
    assert (code, stdout) == (2, f"{out}\n")
    *lines, last = stderr.splitlines()
    assert last == f"curiobench: not in the report: {tmp_path / 'nowhere'} does not exist"
    page = Page(out.read_text())
    assert len(lines) == 3
    assert {line.removeprefix("curiobench: ") for line in lines} <= set(page.texts["li"])
    assert any("4 folders missing, partial" in text for text in page.texts["summary"])


def test_one_run_alone(make_runs, tmp_path, no_figures):
    (run,) = make_runs(methods=("sac",), seeds=1)
    report.write_report([run], tmp_path / "page.html", title="Mine")
    page = Page((tmp_path / "page.html").read_text())
    assert page.texts["h1"] == ["Mine"]
    assert "stack2: 1 method × 1 seed, 1 run, complete." in page.texts["p"][0]
    assert "nan" not in page.texts["main"][0].lower()


def test_partial_runs_are_marked(make_runs, tmp_path, no_figures):
    make_runs(methods=("sac",), seeds=2)
    make_runs(methods=("icm",), seeds=2, complete=False)
    report.write_report([tmp_path / "runs"], tmp_path / "page.html", partial=True)
    page = Page((tmp_path / "page.html").read_text())
    assert any("that are not finished: 2" in line for line in page.texts["li"])
    assert page.texts["dd"].count("not finished: 4 of 8 epochs") == 2


def test_options_that_differ_and_options_that_do_not(make_runs, tmp_path, no_figures):
    make_runs(methods=("sac", "icm"), seeds=1)
    make_runs(methods=("icm",), seeds=1, options={"sac.tau": 0.125}, suffix="-tau")
    report.write_report([tmp_path / "runs"], tmp_path / "page.html")
    page = Page((tmp_path / "page.html").read_text())
    differing = next(table for table in page.texts["table"] if table.strip().startswith("runssac.tau"))
    assert re.search(r"sac\.tau=0\.125\s*0\.125\s", differing)
    shared = dict(zip(page.texts["dt"], page.texts["dd"], strict=True))
    assert shared["sac.gamma"] == "0.95"
    assert "sac.tau" not in shared


def test_a_task_of_too_many_goals_has_no_cards(make_runs, tmp_path, no_figures):
    make_runs(tasks=("stack4",), methods=("sac",), seeds=1, epochs=1)
    report.write_report([tmp_path / "runs"], tmp_path / "page.html")
    page = Page((tmp_path / "page.html").read_text())
    assert "article" not in page.texts
    assert any("too many to show one by one" in text for text in page.texts["p"])


@pytest.mark.parametrize("n_blocks", [2, 3])
def test_every_goal_has_a_picture(n_blocks):
    space = goal_space(n_blocks)
    folder = files("curiobench.analysis") / "goal_pictures"
    pictures = {file.name for file in folder.iterdir() if len(file.name) == space.n_bits + len(".webp")}
    assert pictures == {f"{space.bit_string(bits)}.webp" for bits in space.goals}
    for name in pictures:
        content = (folder / name).read_bytes()
        assert content[:4] + content[8:12] == b"RIFFWEBP"
        assert len(content) < 4_000
