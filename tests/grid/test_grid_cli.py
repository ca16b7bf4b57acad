"""`curiobench grid` from the command line."""

import json
import re

import pytest


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--methods", "sac"], "the grid has no tasks: name some by --tasks"),
        (["--tasks", "stack2", "--methods", "sac", "--jobs", "0"], "jobs is 0; it must be at least 1"),
        (["--tasks", "stack2", "--methods", "sac", "--retries", "-1"], "retries is -1"),
        (["--tasks", "stack2", "--methods", "sac", "--address", "auto"], "--address needs --launcher ray"),
    ],
)
def test_bad_input_takes_one_line_and_starts_nothing(cli, tmp_path, arguments, message):
    code, out, err = cli("grid", *arguments, "--out", tmp_path / "grid")
    assert (code, out) == (2, "")
    assert re.fullmatch(r"curiobench: [^\n]+\n", err)
    assert message in err
    assert not (tmp_path / "grid").exists()


def test_a_folder_that_cannot_be_written(cli, tmp_path):
    (tmp_path / "file").touch()
    code, _, err = cli("grid", "--tasks", "stack2", "--methods", "sac", "--out", tmp_path / "file")
    assert code == 2
    assert re.fullmatch(r"curiobench: cannot write to \S+: (File exists|Not a directory)\n", err)


def test_a_dry_run_shows_states_and_commands_and_starts_nothing(cli, tmp_path):
    out_folder = tmp_path / "a grid"
    flags = ["--tasks", "stack2", "--methods", "sac,mihm", "--seeds", "2", "--dry-run"]
    code, out, err = cli("grid", *flags, "--out", out_folder)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[::2] == [f"stack2-{name}: waiting" for name in ("sac-0", "mihm-0", "sac-1", "mihm-1")]
    assert lines[3].startswith("  curiobench train --task stack2 --method mihm --seed 0 --preset laptop")
    assert lines[3].endswith(f"--out '{out_folder}/stack2-mihm-0' --resume")
    assert not out_folder.exists()


def test_a_grid_of_one_real_cell(cli, tmp_path):
    folder = tmp_path / "a grid"
    options = "epochs=1,cycles=1,worlds=2,updates=2,batch-size=8,episodes-per-goal=1"
    flags = ["--tasks", "stack2", "--methods", "sac", "--seeds", "1", "--preset", "smoke", "--options", options]
    code, out, err = cli("grid", *flags, "--out", folder)
    assert (code, err) == (0, ""), out
    assert re.search(r"stack2-sac-0: finished, \d/4 goals learned", out)
    assert f"all 1 cells are finished; `curiobench table '{folder}'` shows them" in out
    recorded = json.loads((folder / "stack2-sac-0" / "config.json").read_text())["command"]
    assert recorded[:4] == ["curiobench", "train", "--task", "stack2"]
    code, out, _ = cli("grid", *flags, "--out", folder)
    assert code == 0
    assert "started" not in out
