"""Every way to write tables, and what `curiobench table` prints and writes."""

import csv
import re

import pytest
from synthetic import known, write_grid

from curiobench.analysis.formats import comma_separated, latex, make_tables, markdown, terminal
from curiobench.analysis.frames import read_results


def rows_of(text):
    return list(csv.DictReader(text.splitlines()))


def test_bold_of_ten_seeds(make_runs):
    _, made, _ = make_tables(read_results(make_runs(seeds=10, success=known)))
    assert re.search(r"\x1b\[1m3\.9 \[3\.\d, 4\.0\]", terminal(made, colour=True))
    assert re.search(r"\| \*\*3\.9 \\\[3\.\d, 4\.0\\\]\*\* \|", markdown(made))
    assert re.search(r"\\textbf\{3\.9 \[3\.\d, 4\.0\]\}", latex(made))
    assert not any("too few" in note for table in made for note in table.notes)


def test_terminal_and_markdown(results):
    _, made, _ = make_tables(results)
    text, marked = terminal(made), markdown(made).splitlines()
    learned = text.split("\n\n")[1].splitlines()
    assert learned[0].split("  ")[0] == "method"
    sac = ["sac", "3", "1.0 [1.0, 1.0]", "0.0 [0.0, 0.0]", "1.0 [1.0, 1.0]"]
    mihm = ["mihm", "3", "2.0 [2.0, 2.0]", "1.7 [1.0, 2.0]", "3.7 [3.0, 4.0]"]
    assert [re.split(r"  +", line.strip()) for line in learned[2:4]] == [sac, mihm]
    for row in (sac, mihm):
        assert re.sub(r"([][])", r"\\\1", f"| {' | '.join(row)} |") in marked
    assert "| --- | ---: | ---: | ---: | ---: |" in marked
    assert "3 seeds are too few to conclude" in text
    assert "\x1b" not in text
    assert "\x1b[1m3.7" not in terminal(made, colour=True)  # of three seeds
    assert all(len(line) <= 60 for line in terminal(made[:1], width=60).splitlines())


@pytest.mark.parametrize("width", [10, 40, 80])
def test_a_narrow_terminal_loses_nothing(results, width):
    made = [*make_tables(results)[1], *make_tables(results, each_run=True)[1]]
    words = sorted(terminal(made).replace("─", " ").split())
    assert sorted(terminal(made, width).replace("─", " ").split()) == words


def test_latex_is_escaped_and_balanced(make_runs):
    text = latex(make_tables(read_results(make_runs(methods=("sac", "a_b.c:D+hm"), success=known)))[1])
    assert r"a\_b.c:D+hm & 3 & 2.0 [2.0, 2.0]" in text
    assert r"95 \% bootstrap interval" in text
    assert r"P(final \textgreater{} sac)" in text
    for name in ("table", "tabular"):
        assert text.count(rf"\begin{{{name}}}") == text.count(rf"\end{{{name}}}") == 3
    assert text.count(r"\toprule") == text.count(r"\midrule") == text.count(r"\bottomrule") == 3
    fitted = text.replace(r"\width>\linewidth", "").replace("{%\n", "{\n")
    plain = re.sub(r"(?m)^%.*$|\\[%_$&#{}]|\\textgreater\{\}", "", fitted)
    assert not re.search(r"[%_$#<>]", plain)
    assert plain.count("{") == plain.count("}")
    names = [f"tab:stack2-{name}" for name in ("learned-goals", "success", "cost")]
    assert re.findall(r"\\label\{(.*?)\}", text) == names
    assert text.count(r"\resizebox") == 3
    for table in re.findall(r"\\begin\{tabular\}\{(\w+)\}(.*?)\\bottomrule", text, re.DOTALL):
        assert {line.count(" & ") + 1 for line in table[1].splitlines() if "&" in line} == {len(table[0])}


def test_csv_has_one_header_and_plain_numbers(results):
    sac, mihm = rows_of(comma_separated(make_tables(results)[2]))
    assert (mihm["task"], mihm["method"], mihm["seeds"], mihm["goals"]) == ("stack2", "mihm", "3", "4")
    assert float(mihm["learned"]) == pytest.approx(11 / 3)
    assert (float(mihm["learned_low"]), float(mihm["learned_high"])) == (3, 4)
    assert (sac["epochs_to_good"], sac["seeds_good"], sac["better"], sac["better_low"]) == ("", "0", "", "")
    assert (mihm["baseline"], float(mihm["better"]), float(mihm["hours"])) == ("sac", 1, 0.04)


def test_a_line_a_run(make_runs, tmp_path):
    make_runs(tasks=("stack2", "stack3"), methods=("sac",), seeds=1, success=known)
    make_runs(methods=("mihm",), seeds=1, success=known, complete=False)
    results = read_results([tmp_path / "runs"], partial=True)
    _, made, flat = make_tables(results, each_run=True)
    lines = [re.split(r"  +", line.strip()) for line in terminal(made).splitlines()[2:]]
    assert lines[0] == ["run", "task", "method", "seed", "epoch", "1 layer", "2 layers", "3 layers", "total", "success"]
    assert lines[2] == ["stack2-sac-0", "stack2", "sac", "0", "4", "1/2", "0/2", "–", "1/4", "0.25"]
    assert lines[3] == ["stack2-mihm-0", "stack2", "mihm", "0", "4 of 8", "2/2", "2/2", "–", "4/4", "1.00"]
    assert lines[4][5:9] == ["1/8", "0/21", "0/6", "1/35"]
    row = rows_of(comma_separated(flat))[1]
    assert (row["epoch"], row["epochs"], row["complete"], row["learned"], row["goals_3"]) == ("4", "8", "0", "4", "")


def test_command_warns_of_cells_and_fails_only_for_what_was_named(cli, make_runs, tmp_path):
    make_runs(methods=("sac",), success=known, grid=True)
    partial, *_ = make_runs(methods=("mihm",), seeds=1, complete=False)
    runs = tmp_path / "runs"
    names = [f"stack2-sac-{seed}" for seed in range(3)]
    write_grid(
        runs,
        [(name, "stack2", "sac", i) for i, name in enumerate(names)]
        + [(partial.name, "stack2", "mihm", 0), ("gone", "stack2", "icm", 0)],
    )
    code, out, err = cli("table", runs)
    assert code == 0
    assert "mihm" not in out
    assert err.splitlines() == [
        f"curiobench: {runs / 'gone'} is missing: the grid's stack2 icm seed 0",
        f"curiobench: {partial} is partial: it has no result.json; left out",
    ]
    code, out, err = cli("table", runs, "--partial", "--format", "csv")
    assert code == 0
    assert [row["method"] for row in rows_of(out)] == ["sac", "mihm"]
    code, out, err = cli("table", runs / "stack2-sac-0", partial, tmp_path / "none")
    assert code == 2
    assert "sac" in out
    message = f"{tmp_path / 'none'} does not exist; {partial} is partial: it has no result.json"
    assert err == f"curiobench: not in the table: {message}; left out\n"


def test_command_shows_a_single_run_as_it_is(cli, make_runs, tmp_path):
    (partial,) = make_runs(methods=("mihm",), seeds=1, complete=False)
    code, out, err = cli("table", partial)
    assert (code, err) == (0, "")
    assert "4 of 8" in out
    code, out, err = cli("table", tmp_path / "runs")
    assert (code, out) == (2, "")
    assert err.splitlines() == [
        f"curiobench: {partial} is partial: it has no result.json; left out",
        "curiobench: there is no run to show",
    ]


@pytest.mark.parametrize(("flags", "name"), [("", "table"), ("--like paper", "paper"), ("--each-run", "runs")])
def test_out_holds_every_format_and_what_it_was_made_from(cli, make_runs, tmp_path, flags, name):
    paths = make_runs(success=known)
    (paths[0] / "result.json").write_text("{")
    out = tmp_path / "tables"
    code, printed, _ = cli("table", tmp_path / "runs", "--out", out, *flags.split())
    assert code == 0
    assert sorted(path.name for path in out.iterdir()) == sorted(
        [f"{name}.csv", f"{name}.md", f"{name}.tex", f"{name}.txt", f"{name}_made_from.csv"]
    )
    assert (out / f"{name}.txt").read_text().startswith(printed.rstrip("\n"))
    for suffix in ("txt", "md", "tex"):
        assert "left out: " in (out / f"{name}.{suffix}").read_text()
    made_from = rows_of((out / f"{name}_made_from.csv").read_text())
    assert [row["run"] for row in made_from] == [path.name for path in paths[1:]]
    assert made_from[0]["command"].startswith("curiobench train --task stack2")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert cli("table", tmp_path / "runs", "--out", out, *flags.split())[0] == 0
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
