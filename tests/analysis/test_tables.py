"""Tables: numbers that can be worked out by hand, the paper's beside them, and every way to write them."""

import csv
import io
import re

import pytest
from lawful import edit_json, edit_versions, lengthen
from synthetic import write_grid

from curiobench.analysis.formats import comma_separated, latex, markdown, terminal
from curiobench.analysis.frames import read_results
from curiobench.analysis.paper import LEARNED, PAPER_GOALS, flat_paper_table, paper_tables
from curiobench.analysis.samples import task_samples
from curiobench.analysis.tables import Column, Estimate, Table, flat_table, method_tables, run_table, summarise
from curiobench.analysis.variants import cautions


def known(task, method, seed, epoch, goal):
    """From the second epoch on, sac has learned one goal; mihm all, but for the last goal with seed 1."""
    if epoch < 2:
        return 0.0
    if method == "sac":
        return float(goal == 0)
    return 0.6 if (seed, goal) == (1, 3) else 1.0


@pytest.fixture
def results(make_runs):
    return read_results(make_runs(success=known), every_goal=False, progress=False)


def summaries(results):
    return summarise(task_samples(results))


def tables(results):
    return method_tables(summaries(results))


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_known_answers(results):
    sac, mihm = summaries(results)
    assert (sac.sample.method, list(sac.sample.runs["seed"]), sac.task.sizes) == ("sac", [0, 1, 2], {0: 4, 1: 2, 2: 2})
    one, all_ = sac.values, mihm.values
    keys = ("learned", "learned_1", "learned_2")
    assert [one[key].value for key in keys] == [1, 1, 0]
    assert [all_[key].value for key in keys] == pytest.approx([11 / 3, 2, 5 / 3])
    assert (all_["learned_1"].low, all_["learned_1"].high) == (2, 2)
    assert (all_["learned"].low, all_["learned"].high) == (3, 4)
    assert (one["success"].value, all_["success"].value) == pytest.approx((0.25, 2.9 / 3))
    # of twelve scores the middle six: of sac's nine zeros and three ones all are zero
    assert (one["middle_success"].value, all_["middle_success"].value) == (0, 1)
    # 0 until epoch 1, linear to epoch 2, then constant: 2.5 of 4 epochs
    assert (one["area"].value, all_["area"].value) == pytest.approx((0.25 * 0.625, 2.9 / 3 * 0.625))
    assert (sac.sample.reached.tolist(), mihm.sample.reached.tolist()) == ([], [2, 2, 2])
    assert (one["better"], all_["better"], all_["better_area"]) == (None, Estimate(1), Estimate(1))
    assert (all_["hours"], all_["memory"], all_["machine"]) == (0.04, 800, "Test CPU, 2 cores")


def test_hours_of_short_runs_have_four_digits(results):
    cost = tables(results)[2]
    assert "0.0400" in terminal([cost])
    results.runs["hours"] *= 10
    cost = tables(results)[2]
    assert "0.40 " in terminal([cost])


def test_some_seeds_reach_it_and_ties_count_half(make_runs):
    def success(task, method, seed, epoch, goal):
        return 1.0 if seed == 0 and epoch >= 3 else 0.5

    paths = make_runs(methods=("sac", "icm"), seeds=2, success=success)
    _, icm = summaries(read_results(paths))
    assert icm.sample.reached.tolist() == [3]
    assert icm.values["better"].value == 0.5
    assert "3.0 (1 of 2 seeds)" in terminal(method_tables([icm]))


def test_methods_are_compared_with_the_baseline_of_their_variant_or_else_length(make_runs, tmp_path):
    tau, long = {"options": {"sac.tau": 0.1}, "suffix": "-tau"}, {"epochs": 8, "suffix": "-long"}

    def compared(**options):
        """Method, epochs and variant of the samples that are compared, once these runs are there, too."""
        make_runs(success=known, **options)
        found = [s for s in summaries(read_results([tmp_path / "runs"])) if s.values["better"] is not None]
        return {(s.sample.method, s.sample.epochs[-1], s.sample.variant) for s in found}

    assert compared(methods=("sac", "mihm")) == {("mihm", 4, "")}
    assert compared(methods=("rnd",), **long) == {("mihm", 4, "")}
    notes = method_tables(summaries(read_results([tmp_path / "runs"])))[1].notes
    assert "rnd not compared: that takes two seeds each, and runs of sac of the same length" in notes
    assert compared(methods=("mihm",), **tau) == {("mihm", 4, "sac.tau=0.1"), ("mihm", 4, "sac.tau=0.2")}
    of_sac = {("mihm", 4, "sac.tau=0.1"), ("mihm", 4, "sac.tau=0.2"), ("rnd", 8, "")}
    assert compared(methods=("sac",), **long) == of_sac


ICM, SAC, MIHM = ({"methods": (name,), "seeds": 1} for name in ("icm", "sac", "mihm"))
SHORT = {"preset": "short", "sac.gamma": 0.9}


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (
            [SAC, MIHM | {"epochs": 8, "options": {"sac.gamma": 0.9}}],
            ["runs of stack2 differ in epochs (4 or 8), sac.gamma (0.9 or 0.95)"],
        ),
        (  # tau is in the variants
            [SAC, *(ICM | {"options": {"sac.tau": t, "sac.gamma": 0.9}, "suffix": f"-{t}"} for t in (0.1, 0.4))],
            ["runs of stack2 differ in sac.gamma (0.9 or 0.95)"],
        ),
        (  # runs of several presets are compared within each
            [ICM | {"options": SHORT}, ICM | {"options": {"preset": "smoke"}, "suffix": "-smoke"}],
            [],
        ),
        (
            [ICM | {"options": SHORT}, ICM | {"options": {"preset": "smoke"}, "suffix": "-smoke"}, SAC],
            ["runs of stack2 differ in sac.gamma (0.9 or 0.95)"],
        ),
        ([m | {"options": {"method_config": {"beta": b}}} for m, b in ((ICM, 0.2), (MIHM, 0.7))], []),
        (
            [SAC, ICM | {"complete": False, "epochs": 2}],
            ["runs that are not finished: 1; their last evaluation stands for their end"],
        ),
    ],
)
def test_differences_that_make_a_comparison_unfair_are_named(make_runs, tmp_path, made, expected):
    for options in made:
        make_runs(**options)
    assert cautions(read_results([tmp_path / "runs"], partial=True).runs) == expected


def test_options_that_a_run_lacks_are_those_that_reproduce_it(make_runs, tmp_path):
    run, _ = make_runs(methods=("sac",), seeds=2)
    edit_json(
        run / "config.json", lambda record: (record["config"].pop("starts"), record["config"]["sac"].pop("network"))
    )
    assert cautions(read_results([tmp_path / "runs"]).runs) == []


def test_bold_only_beyond_doubt():
    column = Column("x", "x", contest=True)

    def best(*values):
        return Table("", (column,), tuple({"x": value} for value in values)).best(column)

    assert best(Estimate(3, 2.5, 3.5), Estimate(2, 1, 2.4)) == 0
    assert best(Estimate(2, 1, 2.4), Estimate(3, 2.5, 3.5), Estimate(1, 0, 2)) == 1
    assert best(Estimate(3, 2.4, 3.5), Estimate(2, 1, 2.4)) is None  # they touch
    assert best(Estimate(3), Estimate(2, 1, 2.4)) is None  # one seed has no interval
    assert best(Estimate(3, 2, 4)) is None  # nothing to compare with
    clear = (Estimate(3, 2.5, 3.5), Estimate(2, 1, 2.4))
    for seeds, found in (((10, 10), 0), ((10, 9), None)):
        rows = tuple({"x": value, "seeds": n} for value, n in zip(clear, seeds, strict=True))
        assert Table("", (column,), rows).best(column) == found
    assert (
        Table("", (Column("x", "x"),), ({"x": Estimate(3, 3, 3)}, {"x": Estimate(1, 1, 1)})).best(Column("x", "x"))
        is None
    )


def test_bold_of_ten_seeds(make_runs):
    results = read_results(make_runs(seeds=10, success=known))
    made = tables(results)
    assert re.search(r"\x1b\[1m3\.9 \[3\.\d, 4\.0\]", terminal(made, colour=True))
    assert re.search(r"\| \*\*3\.9 \\\[3\.\d, 4\.0\\\]\*\* \|", markdown(made))
    assert re.search(r"\\textbf\{3\.9 \[3\.\d, 4\.0\]\}", latex(made))
    assert not any("too few" in note for table in made for note in table.notes)


def test_each_task_has_its_own_notes(make_runs, tmp_path):
    """Two tasks with unequal seeds: notes of one do not depend on the other."""
    make_runs(methods=("sac", "mihm"), success=known)
    make_runs(tasks=("stack3",), methods=("sac",), seeds=2, options={"updates": 7}, success=known)
    make_runs(tasks=("stack3",), methods=("mihm",), seeds=1, options={"updates": 7}, success=known)
    results = read_results([tmp_path / "runs"])
    notes = {table.title: table.notes for table in tables(results)}
    brackets = "[ ] 95 % bootstrap interval over seeds"
    three = "3 seeds are too few to conclude: intervals of fewer than 10 are much too narrow"
    assert notes["stack2: learned goals"] == (
        "gripper, short preset: 4 epochs, 4,000 steps a run",
        "before training: 0.0 of 4 goals",
        brackets,
        three,
    )
    assert notes["stack2: success"][1:] == (
        "before training: success 0.00",
        brackets,
        three,
        "P of 0 or 1 has no interval; with so few seeds, one in 10 comparisons of equals gives it",
    )
    assert notes["stack3: learned goals"][0] == "gripper, short preset with updates=7: 4 epochs, 4,000 steps a run"
    assert notes["stack3: success"][2:] == (
        brackets,
        "1 seed of mihm: no interval, and nothing to conclude about the method",
        "2 seeds of sac are too few to conclude: intervals of fewer than 10 are much too narrow",
        "not compared: that takes two seeds each, and runs of sac of the same length",
    )


def test_versions_and_commits_that_differ_are_named(make_runs, tmp_path):
    first, second = make_runs(methods=("sac",), seeds=2)
    edit_versions(second, mujoco="9.9")
    edit_versions(first, git_commit="abcdef0123")
    lengthen(first, git_commit="12345678")
    assert cautions(read_results([tmp_path / "runs"]).runs) == [
        "runs of stack2 were made with mujoco 1.0 and 9.9",
        "runs of stack2 were made at 3 commits: abcdef0, 1234567, c0ffee",
    ]


def test_terminal_and_markdown(results):
    text, marked = terminal(tables(results)), markdown(tables(results)).splitlines()
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
    assert "\x1b[1m3.7" not in terminal(tables(results), colour=True)  # of three seeds
    assert all(len(line) <= 60 for line in terminal([tables(results)[0]], width=60).splitlines())


@pytest.mark.parametrize("width", [10, 40, 80])
def test_a_narrow_terminal_loses_nothing(results, width):
    made = [*tables(results), run_table(results)]
    words = sorted(terminal(made).replace("─", " ").split())
    assert sorted(terminal(made, width).replace("─", " ").split()) == words


def test_latex_is_escaped_and_balanced(make_runs):
    paths = make_runs(methods=("sac", "a_b.c:D+hm"), success=known)
    results = read_results(paths)
    text = latex(tables(results))
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
    sac, mihm = rows_of(comma_separated(flat_table(summaries(results))))
    assert (mihm["task"], mihm["method"], mihm["seeds"], mihm["goals"]) == ("stack2", "mihm", "3", "4")
    assert float(mihm["learned"]) == pytest.approx(11 / 3)
    assert (float(mihm["learned_low"]), float(mihm["learned_high"])) == (3, 4)
    assert (sac["epochs_to_good"], sac["seeds_good"], sac["better"], sac["better_low"]) == ("", "0", "", "")
    assert (mihm["baseline"], float(mihm["better"]), float(mihm["hours"])) == ("sac", 1, 0.04)


def test_the_papers_numbers_are_the_papers():
    totals = {method: sum(counts) for method, counts in LEARNED.items()}
    assert PAPER_GOALS == (8, 21, 6)
    assert totals == {
        **{"sac": 1, "icm": 4, "rnd": 4, "dac": 9, "re3": 12, "mihm": 31},
        **{"icm+hm": 13, "rnd+hm": 14, "mi": 25, "decstr": 34, "mcher": 3},
    }


def test_tables_like_the_papers(make_runs, tmp_path):
    make_runs(tasks=("stack3",), methods=("sac", "mihm", "dac+hm"), success=lambda *args: float(args[1] == "mihm"))
    results = read_results([tmp_path / "runs"])
    made = paper_tables(summaries(results))
    assert [table.title for table in made] == [
        "Table 1, stack3: goals",
        "Table 2, stack3: learned goals, curiosity methods",
        "Table 3, stack3: learned goals, ablations",
        "Table 4, stack3: learned goals, other approaches",
    ]
    rows = [row for row in rows_of(comma_separated(flat_paper_table(made)))]
    assert [(row["table"], row["method"]) for row in rows] == [
        ("1", ""),
        *(("2", method) for method in ("sac", "icm", "rnd", "dac", "re3", "mihm")),
        *(("3", method) for method in ("icm+hm", "rnd+hm", "mi", "mihm")),
        *(("4", method) for method in ("mihm", "decstr", "mcher")),
    ]
    goals, sac, icm, *_, mihm = rows[:7]
    for row in (goals, mihm):
        assert [float(row[name]) for name in ("learned_1", "learned_2", "learned_3", "learned")] == [8, 21, 6, 35]
    assert [mihm[name] for name in ("paper_1", "paper_2", "paper_3", "paper")] == ["8", "21", "2", "31"]
    assert (sac["learned"], sac["paper"], icm["learned"], icm["paper"]) == ("0", "1", "", "4")
    assert (rows[-2]["learned"], rows[-2]["paper_3"], rows[-2]["paper"]) == ("", "5", "34")
    notes = made[-1].notes
    assert "not in the paper's tables, so not here: dac+hm" in notes
    assert "the paper trains 40 M steps, these runs 4,000" in notes
    assert not any("another task" in note for note in notes)


def test_the_papers_numbers_beside_another_task_are_marked(results):
    made = paper_tables(summaries(results))
    assert [column.heading for column in made[1].columns] == [
        *("method", "seeds", "1 layer", "2 layers", "total"),
        *("paper, stack3: 1 layer", "paper, stack3: 2 layers", "paper, stack3: 3 layers", "paper, stack3: total"),
    ]
    assert "the paper's numbers are of stack3, another task than stack2" in made[-1].notes
    with pytest.raises(ValueError, match="no run has a method of the paper's tables, which are sac, icm"):
        paper_tables([])


def test_a_line_a_run(make_runs, tmp_path):
    make_runs(tasks=("stack2", "stack3"), methods=("sac",), seeds=1, success=known)
    make_runs(methods=("mihm",), seeds=1, success=known, complete=False)
    results = read_results([tmp_path / "runs"], partial=True)
    lines = [re.split(r"  +", line.strip()) for line in terminal([run_table(results)]).splitlines()[2:]]
    assert lines[0] == ["run", "task", "method", "seed", "epoch", "1 layer", "2 layers", "3 layers", "total", "success"]
    assert lines[2] == ["stack2-sac-0", "stack2", "sac", "0", "4", "1/2", "0/2", "–", "1/4", "0.25"]
    assert lines[3] == ["stack2-mihm-0", "stack2", "mihm", "0", "4 of 8", "2/2", "2/2", "–", "4/4", "1.00"]
    assert lines[4][5:9] == ["1/8", "0/21", "0/6", "1/35"]
    row = rows_of(comma_separated(run_table(results, flat=True)))[1]
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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--baseline", "icm", "--like", "paper"], "--baseline is for the tables of methods, not for --like paper"),
        (["--baseline", "icm", "--each-run"], "--baseline is for the tables of methods, not for single runs"),
        (["--each-run", "--like", "paper"], "--like paper and --each-run are different tables"),
        (["--out", ""], "--out is empty"),
        (["--out="], "--out is empty"),
        (["--baseline", "icm"], "no run has the baseline 'icm'; the methods are sac, mihm"),
        (["--format", "html"], "invalid choice"),
        (["--out", "/dev/null/x"], "cannot write to /dev/null/x"),
    ],
)
def test_bad_input_of_the_command(cli, make_runs, tmp_path, arguments, message):
    make_runs(seeds=1)
    code, _, err = cli("table", tmp_path / "runs", *arguments)
    assert code == 2
    assert re.fullmatch(r"curiobench: [^\n]+\n", err)
    assert message in err


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
