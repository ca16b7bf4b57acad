"""The command line: exit codes, one line an error, help without heavy imports."""

import fcntl
import os
import pty
import re
import shutil
import struct
import subprocess
import sys
import termios
from contextlib import suppress
from pathlib import Path

import pytest
from commands import TRAIN, call
from tiny_runs import numbers

from curiobench.cli.commands import COMMANDS
from curiobench.methods.specs import BUILT_IN

SIMULATES = ("mujoco", "dm_control")
TRAINS = ("torch", "numba", "ray")


@pytest.mark.parametrize(
    ("commands", "names"),
    [
        (
            ["--help", "--version", "list", *(f"{name} --help" for name in COMMANDS)],
            [*SIMULATES, *TRAINS, "pandas", "matplotlib", "yaml"],
        ),
        (["table v2", "submit-check v2 --against v2", "report v2"], [*SIMULATES, *TRAINS]),
        (["check rnd"], [*SIMULATES, "matplotlib"]),
    ],
    ids=["help", "results", "check"],
)
def test_commands_import_only_what_they_need(tmp_path, commands, names):
    program = f"""
import sys
from curiobench.cli import main
for command in {commands}:
    sys.argv = ["curiobench", *command.split()]
    try: main()
    except SystemExit as ended: assert ended.code == 0, command
print(*set({names}) & set(sys.modules), file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "\n")


def test_help_of_a_command_shows_every_field_with_the_presets_defaults(cli):
    code, out, err = cli("train", "--preset", "smoke", "--help")
    assert (code, err) == (0, "")
    text = re.sub(r"[\s│]+", " ", out)
    for words in (
        "Seed of all random streams",
        "--sac.gamma",
        "Discount factor",
        "(default: 0.95)",
        "--machine.threads",
    ):
        assert words in text


def test_list_shows_all_that_can_be_trained(cli):
    code, out, _ = cli("list")
    assert code == 0
    for word in ("stack2", "35 goals", "gripper", "sac", "paper", "laptop", "smoke"):
        assert word in out
    lines = dict(line.split(maxsplit=1) for line in out.splitlines() if line.startswith("  "))
    assert {name: lines[name] for name in BUILT_IN} == {name: method.line for name, method in BUILT_IN.items()}
    assert lines["mihm"] == "mi under the hybrid policy mechanism (Han et al. 2023)"
    assert lines["NAME+hm"] == "a method that rewards, under the hybrid policy mechanism (Han et al. 2023)"
    assert "(Haarnoja et al. 2018)" in lines["sac"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["trian"], "unknown command 'trian': did you mean 'train'? the commands are list, train"),
        (["train", "--task", "stack9", "--out", "/tmp/none"], "unknown task 'stack9'"),
        (["train", "--worlds", "-3", "--out", "/tmp/none"], "worlds is -3"),
        (["evaluate", "/tmp/none"], "/tmp/none does not exist"),
        (["video", "/tmp/none", "--goal", "a on b"], "/tmp/none does not exist"),
        (["table"], "name at least one run folder"),
        (["table", "x", "--format", "html"], "invalid choice 'html'"),
        (["table", "x", "--formt", "html"], "Unrecognized options: --formt, html; perhaps you meant --format"),
    ],
)
def test_bad_input_takes_one_line_and_exit_code_2(cli, arguments, message):
    code, out, err = cli(*arguments)
    assert (code, out) == (2, "")
    assert re.fullmatch(r"curiobench: [^\n]+\n", err)
    assert message in err


@pytest.mark.parametrize("columns", [40, 80])
@pytest.mark.parametrize("command", ["--help", "list", *(f"{name} --help" for name in COMMANDS)])
def test_help_and_lists_fit_the_terminal(cli, monkeypatch, columns, command):
    monkeypatch.setenv("COLUMNS", str(columns))
    _, out, _ = cli(*command.split())
    assert all(
        len(line) <= columns for line in out.splitlines() if not line.startswith(("  curiobench train", "usage"))
    )


def test_a_command_to_paste_is_quoted(cli, finished, tmp_path):
    shutil.copytree(finished, tmp_path / "my run")
    _, _, err = cli("train", "--out", tmp_path / "my run", "--resume")
    assert f"`curiobench table '{tmp_path}/my run'` shows its result" in err


@pytest.mark.parametrize("command", ["table --help", "table v2"])
def test_terminals_without_colour_get_no_codes(command):
    shown = on_terminal({"TERM": "xterm", "NO_COLOR": None}, command)
    assert b"\x1b" in shown
    for variable in ({"NO_COLOR": "1"}, {"TERM": "dumb"}):
        plain = on_terminal({"TERM": "xterm"} | variable, command)
        assert b"\x1b" not in plain
        assert re.sub(rb"\x1b\[[\d;]*m", b"", shown).split() == plain.split()


def on_terminal(variables, command):
    """What a command shows on a terminal of 80 columns."""
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    environment = {name: value for name, value in (os.environ | variables).items() if value is not None}
    command = [sys.executable, "-m", "curiobench", *command.split()]
    with subprocess.Popen(command, stdout=its, stderr=its, env=environment):
        os.close(its)
        shown = b""
        with suppress(OSError):  # which Linux raises at the end
            while part := os.read(ours, 65536):
                shown += part
    os.close(ours)
    return shown


def test_evaluate_a_run(cli, finished):
    code, out, err = cli("evaluate", finished, "--goals", "--episodes", "1")
    assert (code, err) == (0, "")
    assert out.splitlines()[-1].split()[0] == "total"
    assert "a on b" in out


def test_train_from_the_command_line(finished, tmp_path):
    done = call((*TRAIN, "--out", "run"), tmp_path)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"run/learning_curve.png" in done.stdout
    assert numbers(tmp_path / "run") == numbers(finished)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["gif", "webp"])
def test_video(finished, tmp_path, suffix):
    out = tmp_path / f"film.{suffix}"
    done = call(("video", str(finished), "--goal", "a on b", "--episodes", "1", "--out", str(out)), tmp_path)
    assert done.returncode == 0
    assert done.stdout.startswith(f"{out}: ".encode())
    assert out.stat().st_size > 5_000


def test_a_closed_folder_takes_one_line(cli, tmp_path, monkeypatch):
    def closed(self):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "is_dir", closed)
    code, _, err = cli("report", tmp_path, "--out", tmp_path / "report.html")
    assert (code, err) == (2, f"curiobench: {tmp_path / 'report.html'}: Permission denied\n")


def test_a_message_is_one_line_that_a_terminal_does_not_obey(cli):
    code, _, err = cli("no\nsuch\x1b[31m")
    assert (code, err.count("\n"), "\x1b" in err) == (2, 1, False)
