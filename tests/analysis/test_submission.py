"""Submissions: good ones pass, and one that breaks a rule fails that line and no other."""

import shutil
from functools import partial

import pytest
from lawful import (
    COMMIT,
    EPOCHS,
    OUTSIDE,
    edit_json,
    edit_options,
    edit_rows,
    edit_versions,
    lengthen,
    rewrite,
    sign,
    write_lawful,
)

from curiobench.analysis import load, submission
from curiobench.analysis import publish as publish_module
from curiobench.analysis.frames import read_results
from curiobench.analysis.publish import publish
from curiobench.analysis.rules import submit_check
from curiobench.analysis.submission import PRESETS_ONLY, Submission


@pytest.fixture(scope="module")
def lawful(tmp_path_factory):
    """Folder of runs that keep every rule; not to be altered."""
    folder = tmp_path_factory.mktemp("lawful") / "runs"
    write_lawful(folder)
    return folder


@pytest.fixture
def runs(lawful, tmp_path):
    """A copy of `lawful` to break."""
    return shutil.copytree(lawful, tmp_path / "runs")


@pytest.fixture(scope="module")
def published(lawful, tmp_path_factory):
    """A published set of `lawful`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(publish_module, "derive", lambda folder: None)
        out = tmp_path_factory.mktemp("published") / "v7"
        publish([lawful], out)
    return out


def verdicts(folder, against=PRESETS_ONLY):
    """Findings that are neither pass nor skip, by property."""
    _, findings = submit_check([folder], against)
    return {f.property: (f.verdict, f.detail) for f in findings if f.verdict not in ("pass", "skip")}


def skipped(folder, against=PRESETS_ONLY):
    return {finding.property for finding in submit_check([folder], against)[1] if finding.verdict == "skip"}


def test_lawful_runs_pass_everything(runs, published):
    assert verdicts(published) == {}
    assert skipped(runs) == {"task and robot are the reference's", "versions are the reference's"}


def test_options_younger_than_the_published_set_are_no_difference(runs, published):
    older = shutil.copytree(published, published.parent / "older")
    for path in (older / "configs").glob("*.json"):
        edit_json(path, lambda record: (record["config"].pop("starts"), record["config"]["sac"].pop("network")))
    sign(older)
    assert verdicts(runs, str(older)) == {}


def test_a_run_is_judged_by_its_own_config_where_one_of_its_name_was_left_out(runs, tmp_path):
    other = shutil.copytree(first(runs), tmp_path / "others" / first(runs).name)
    (other / "result.json").unlink()
    edit_options(other, seed=99)
    submission = Submission(read_results([tmp_path / "others", runs]))
    assert submission.records[other.name]["config"]["seed"] == 0


def first(folder):
    return folder / "stack2-sac-0"


def every(folder, method="sac"):
    return sorted(folder.glob(f"stack2-{method.replace(':', '_')}-*"))


def each(change, method="sac", start=0):
    """Change every run of a method, or those from a seed on."""
    return lambda folder: [change(path) for path in every(folder, method)[start:]]


def in_rows(change, file="evaluations.csv"):
    """Change the rows of the first run."""
    return lambda folder: edit_rows(first(folder) / file, change)


def with_success(success, unsatisfied):
    """Change the success of one goal at one evaluation of the first run."""

    def change(rows):
        place = rows["epoch"].eq(1) & rows["goal"].eq("a on b")
        rows.loc[place, ["success", "success_unsatisfied"]] = success, unsatisfied
        return rows

    return in_rows(change)


def few_updates(folder):
    in_rows(lambda rows: rows.assign(updates=rows["epoch"] * 10), "progress.csv")(folder)
    edit_json(first(folder) / "result.json", lambda result: result.update(updates=10 * EPOCHS))


REPLAY = {"capacity": 20_000, "relabel_share": 0.8, "balance_goals": True}  # options are missing
COMPLETE, OPTIONS = "every folder holds one whole run", "options, apart from the method's own"


@pytest.mark.parametrize(
    ("mutate", "broken", "message"),
    [
        (lambda f: (first(f) / "result.json").unlink(), COMPLETE, "stack2-sac-0 is partial"),
        (lambda f: edit_versions(first(f), task_version=2), "version of the tasks", "version 2, not 1 (stack2-sac-0)"),
        (lambda f: edit_versions(first(f), evaluation_seed=1), "seed of the test episodes", "1, not 20260"),
        (
            lambda f: [edit_versions(path, evaluation_seed=0) for path in f.iterdir()],
            "seed of the test episodes",
            "0, not 20260",
        ),
        (
            lambda f: rewrite(first(f), satisfied={"000": 22, "100": 3}),
            "starts of the test episodes",
            "'all apart' holds at the start of 22 of 25 test episodes, not 23 (stack2-sac-0)\n'all close' holds",
        ),
        (lambda f: rewrite(first(f), episodes=10), "test episodes of a goal", "10 episodes of a goal, not 25"),
        (
            in_rows(lambda rows: rows.replace({"goal": {"a on b": "b below a"}})),
            "goals",
            "goal 'b below a', 110 in layer 2, is not one of the task's (stack2-sac-0)\ngoal 'a on b'",
        ),
        (
            in_rows(lambda rows: rows[rows["epoch"] != 5]),
            "evaluations when they are due",
            "no evaluation after epoch 5 (stack2-sac-0)",
        ),
        (
            each(lambda path: edit_options(path, "sac", gamma=0.9)),
            OPTIONS,
            "sac.gamma is 0.9, not 0.95 (stack2-sac-0, ",
        ),
        (each(lambda path: edit_options(path, turbo=True)), OPTIONS, "'turbo' is not an option"),
        (each(lambda path: edit_options(path, replay=REPLAY)), OPTIONS, "replay.satisfied_cap is missing, not 0.2"),
        (
            lambda f: rewrite(first(f), steps=1000),
            "steps and updates as the options say",
            "1000 steps after epoch 1, not 128000",
        ),
        (few_updates, "steps and updates as the options say", "10 updates after epoch 1, not 2400"),
        (with_success(0.5, 0.5), "success in whole episodes", "'a on b' after epoch 1: 0.5 of 25 episodes"),
        (with_success(0.2, 0.4), "success in whole episodes", "0.2 of 25 episodes, 0.4 of 25"),
        (each(shutil.rmtree, start=2), "3 seeds or more of each method", "stack2 gripper sac: 2 of 3"),
        (
            lambda f: shutil.copy(first(f) / "progress.csv", f / "stack2-sac-1"),
            "numbers of its own in every run",
            "the same progress as stack2-sac-0 (stack2-sac-1)",
        ),
        (
            each(lambda path: edit_versions(path, method_sha256=None), OUTSIDE),
            "digest of a method that is not built in",
            f"no SHA-256 of {OUTSIDE}'s file is recorded (",
        ),
        *(
            (
                lambda f, change=change: change(first(f), git_commit=f"{COMMIT}-dirty"),
                "unaltered code",
                "made by an altered copy of commit 0123456789ab (stack2-sac-0)",
            )
            for change in (edit_versions, lengthen)
        ),
    ],
)
def test_what_breaks_a_rule_fails_its_line_only(runs, mutate, broken, message):
    mutate(runs)
    found = verdicts(runs)
    assert {name: verdict for name, (verdict, _) in found.items()} == {broken: "FAIL"}
    assert message in found[broken][1]


def test_faults_that_fail_two_lines(runs):
    each(lambda path: edit_options(path, evaluate_every=2))(runs)
    each(lambda path: edit_versions(path, method_sha256="cd" * 32), OUTSIDE, start=2)(runs)
    found = verdicts(runs)
    assert found["evaluations when they are due"][1].startswith("an unplanned evaluation after epoch 1 (stack2-sac-0,")
    assert "evaluate_every is 2, not 1" in found[OPTIONS][1]
    assert found["digest of a method that is not built in"] == ("FAIL", f"2 different files define {OUTSIDE}")


def test_runs_before_task_versions_were_written_down_are_of_the_first(runs):
    for path in runs.iterdir():
        edit_versions(path, task_version=None, evaluation_seed=None)
    assert verdicts(runs) == {}
    assert "seed of the test episodes" in skipped(runs)


def test_what_is_the_methods_own_may_differ(runs):
    for path in every(runs):
        edit_options(path, preset="mine", method_config={"depth": 3}, hybrid={}, machine={"threads": 8})
    assert set(verdicts(runs)) == {OPTIONS}  # which no preset "mine" can be held against


@pytest.mark.parametrize(
    ("mutate", "property_", "message"),
    [
        (lambda path: edit_versions(path, git_commit=None), "commit on record", "only the version is known, 1.0"),
        (lambda path: edit_versions(path, torch="9.9+cu1"), "versions are the reference's", "torch 9.9+cu1, not 1.0"),
        (lambda path: edit_options(path, device="cuda"), "device and threads are the reference's", "device is 'cuda'"),
    ],
)
def test_what_may_change_last_bits_is_a_warning(runs, published, mutate, property_, message):
    for path in every(runs):
        mutate(path)
    (name, (verdict, detail)), *others = verdicts(runs, str(published)).items()
    assert (name, verdict, others) == (property_, "warn", [])
    assert message in detail


def test_another_task_than_the_sets_is_compared_with_its_preset(lawful, published, tmp_path):
    for path in every(lawful):
        edit_options(shutil.copytree(path, tmp_path / "fetch" / path.name), robot="fetch", worlds=32)
    found = verdicts(tmp_path / "fetch", str(published))
    assert found["task and robot are the reference's"][0] == "warn"
    assert "worlds is 32, not 64" in found[OPTIONS][1]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("cycles", "many"),
        ("updates", 10**400),
        ("evaluate_every", 0),
        ("episodes_per_goal", {"a": 1}),
        ("worlds", None),
    ],
)
def test_options_that_make_no_sense_fail_and_do_not_stop_it(runs, name, value):
    for path in every(runs):
        edit_options(path, **{name: value})
    assert OPTIONS in verdicts(runs)


def test_many_faults_are_counted(runs):
    for number, path in enumerate(every(runs)):
        edit_options(path, "sac", **{f"option{number}{letter}": 1 for letter in "abcdefgh"})
    assert verdicts(runs)[OPTIONS][1].endswith("\nand 22 more")


@pytest.fixture
def check(cli):
    return partial(cli, "submit-check")


def test_command(runs, published, check):
    code, out, err = check(runs, "--against", published)
    assert (code, err) == (0, "")
    title, *lines = out.splitlines()
    assert title == f"8 runs of sac, {OUTSIDE}, compared with {published}"
    assert len(lines) == 18
    assert {line.split()[0] for line in lines} == {"pass"}
    edit_versions(first(runs), task_version=2)
    code, out, err = check(runs, "--against", published)
    assert (code, err) == (1, "curiobench: the submission fails 1 of 18 properties\n")
    assert "\nFAIL  version of the tasks\n      version 2, not 1 (stack2-sac-0)\n" in out


@pytest.mark.parametrize(("sets", "against"), [([], "the presets"), (["v2", "v3"], "v3")])
def test_the_newest_set_is_compared_with_by_default(runs, published, monkeypatch, check, sets, against):
    monkeypatch.setattr(submission, "available", lambda: sets)
    monkeypatch.setattr(submission, "load", lambda name: load(published))
    assert check(runs)[1].splitlines()[0].endswith(f"compared with {against}")


def test_command_without_a_run(tmp_path, check):
    code, out, _ = check(tmp_path / "none", "--against", "presets")
    title, first_line, fault, *others = out.splitlines()
    assert (code, title) == (1, "0 runs of no method, compared with the presets")
    assert first_line == "FAIL  every folder holds one whole run"
    assert fault.startswith(f"      {tmp_path / 'none'} does not exist")
    assert {line.split()[0] for line in others[::2]} == {"skip"}
