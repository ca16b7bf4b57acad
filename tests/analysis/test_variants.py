"""Options in which runs differ: they name variants, and what makes a comparison unfair is told."""

import pytest
from lawful import edit_json, edit_versions, lengthen

from curiobench.analysis.frames import read_results
from curiobench.analysis.variants import cautions, scale_of

ICM, SAC, MIHM = ({"methods": (name,), "seeds": 1} for name in ("icm", "sac", "mihm"))
GREEDY = {"sac.gamma": 0.9}
SMOKE = {"preset": "smoke", "batch_size": 256, "worlds": 32}


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (
            [SAC, MIHM, MIHM | {"options": {"sac.tau": 0.1, "method_config.hidden": 8}}],
            ["", "sac.tau=0.1, method.hidden=8", "sac.tau=0.2, method.hidden=128"],
        ),
        (  # a preset stands for its options
            [SAC, SAC | {"options": SMOKE}, SAC | {"options": SMOKE | {"robot": "fetch"}}],
            ["preset=laptop", "preset=smoke, robot=fetch", "preset=smoke, robot=gripper"],
        ),
        # but its name alone sets no run apart
        ([SAC, SAC | {"seeds": [1], "options": {"preset": "mine"}}], ["", ""]),
        ([MIHM, MIHM | {"options": {"hybrid.adaptive_tau": True}}], ["", "hybrid.adaptive_tau=True"]),
        # plain sac has no schedule of curiosity
        (
            [SAC | {"seeds": [1]}, MIHM, *(m | {"options": {"schedule_epochs": 7}} for m in (SAC, MIHM))],
            ["", "", "schedule_epochs=6", "schedule_epochs=7"],
        ),
    ],
)
def test_variants_name_the_options_that_differ(make_runs, tmp_path, made, expected):
    for number, options in enumerate(made):
        make_runs(**options, suffix=f"-{number}")
    assert list(read_results([tmp_path / "runs"]).runs["variant"]) == expected


def test_methods_from_outside_of_other_files_are_other_methods(make_runs, tmp_path):
    first, second = make_runs(methods=("pkg.mod:Mine",), seeds=2)
    edit_versions(first, method_sha256="a" * 64)
    edit_versions(second, method_sha256="b" * 64)
    variants = list(read_results([tmp_path / "runs"]).runs["variant"])
    assert variants == ["method_sha256=aaaaaaaa", "method_sha256=bbbbbbbb"]


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
            [ICM | {"options": GREEDY}, ICM | {"options": {"preset": "smoke"}, "suffix": "-smoke"}],
            [],
        ),
        (
            [ICM | {"options": GREEDY}, ICM | {"options": {"preset": "smoke"}, "suffix": "-smoke"}, SAC],
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


def test_versions_and_commits_that_differ_are_named(make_runs, tmp_path):
    first, second = make_runs(methods=("sac",), seeds=2)
    edit_versions(second, mujoco="9.9")
    edit_versions(first, git_commit="abcdef0123")
    lengthen(first, git_commit="12345678")
    assert cautions(read_results([tmp_path / "runs"]).runs) == [
        "runs of stack2 were made with mujoco 1.0 and 9.9",
        "runs of stack2 were made at 3 commits: abcdef0, 1234567, c0ffee",
    ]


def test_a_version_that_is_not_recorded_is_no_difference(make_runs):
    paths = make_runs(methods=("sac",), seeds=2)
    edit_versions(paths[0], torch=None, git_commit=None)
    assert cautions(read_results(paths).runs) == []


def test_the_scale_of_one_epoch(make_runs):
    runs = read_results(make_runs(methods=("sac",), seeds=1, epochs=1)).runs
    assert scale_of(runs) == "gripper, laptop preset: 1 epoch, 1,000 steps a run"
