"""Tables: numbers that can be worked out by hand, their notes, and the paper's numbers beside ours."""

import csv

import pytest
from synthetic import known

from curiobench.analysis.formats import comma_separated, terminal
from curiobench.analysis.frames import read_results
from curiobench.analysis.paper import LEARNED, PAPER_GOALS, flat_paper_table, paper_tables
from curiobench.analysis.samples import task_samples
from curiobench.analysis.tables import Column, Estimate, Table, method_tables, summarise


def summaries(results):
    return summarise(task_samples(results))


def tables(results):
    return method_tables(summaries(results))


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
    assert Table("", (column,), tuple({"x": value} for value in clear)).best(Column("x", "x")) is None  # no contest


def test_each_task_has_its_own_notes(make_runs, tmp_path):
    """Two tasks with unequal seeds: notes of one do not depend on the other."""
    make_runs(methods=("sac", "mihm"), success=known)
    make_runs(tasks=("stack3",), methods=("sac",), seeds=2, options={"updates": 7}, success=known)
    make_runs(tasks=("stack3",), methods=("mihm",), seeds=1, options={"updates": 7}, success=known)
    results = read_results([tmp_path / "runs"])
    notes = {table.title: table.notes for table in tables(results)}
    assert notes["stack2: learned goals"] == (
        "gripper, laptop preset: 4 epochs, 4,000 steps a run",
        "before training: 0.0 of 4 goals",
        "[ ] 95 % bootstrap interval over seeds",
        "3 seeds are too few to conclude: intervals of fewer than 10 are much too narrow",
    )
    assert notes["stack2: success"][1] == "before training: success 0.00"
    one = "P of 0 or 1 has no interval; with so few seeds, one in 10 comparisons of equals gives it"
    assert notes["stack2: success"][-1] == one
    assert notes["stack3: learned goals"][0] == "gripper, laptop preset with updates=7: 4 epochs, 4,000 steps a run"
    assert notes["stack3: success"][3:] == (
        "1 seed of mihm: no interval, and nothing to conclude about the method",
        "2 seeds of sac are too few to conclude: intervals of fewer than 10 are much too narrow",
        "not compared: that takes two seeds each, and runs of sac of the same length",
    )


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
    rows = list(csv.DictReader(comma_separated(flat_paper_table(made)).splitlines()))
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
