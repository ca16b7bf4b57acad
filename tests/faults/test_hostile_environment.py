"""Variables of other programs, and settings files that are broken, change nothing that is recorded or shown."""

import os
import subprocess
import sys
import tempfile

import pytest
from commands import GRID, call, files, reading
from tiny_runs import numbers

HOSTILE = {
    **{
        "LC_ALL": "C",
        "LANG": "tr_TR.UTF-8",
        "PYTHONUTF8": "0",
        "PYTHONCOERCECLOCALE": "0",
        "PYTHONIOENCODING": "ascii",
    },
    **{"TERM": "dumb", "NO_COLOR": "1", "TZ": "Mars/Phobos", "HOME": "/dev/null/home"},
    **{"MPLBACKEND": "nonsense", "MUJOCO_GL": "nonsense", "OMP_NUM_THREADS": "nonsense", "CUDA_VISIBLE_DEVICES": ""},
    "PYTHONHASHSEED": "7",
}
MATPLOTLIBRC = "backend: nonsense\nfont.size: thirty\nlines.linewidth: 30\naxes.facecolor: black\n"


def hostile(folder):
    """The environment, with a settings file of matplotlib's in a folder."""
    (folder / "matplotlibrc").write_text(MATPLOTLIBRC)
    return os.environ | HOSTILE


@pytest.mark.parametrize("command", reading("."))
def test_a_command_gives_the_same(cli, finished, tmp_path, monkeypatch, command):
    clean, strange = tmp_path / "clean", tmp_path / "strange"
    clean.mkdir()
    strange.mkdir()
    words = reading(finished)[command]
    monkeypatch.chdir(clean)
    code, out, _ = cli(*words)
    done = call(words, strange, hostile(strange))
    assert (done.returncode, done.stdout) == (code, out.encode("ascii", "replace")), done.stderr
    assert b"Traceback" not in done.stderr
    (strange / "matplotlibrc").unlink()
    assert files(strange) == files(clean)


def test_a_grid_trains_the_same(finished, tmp_path):
    done = call(GRID, tmp_path, hostile(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr
    assert numbers(tmp_path / "grid" / "stack2-sac-0") == numbers(finished)
    picture = tmp_path / "grid" / "stack2-sac-0" / "learning_curve.png"
    assert picture.read_bytes() == (finished / "learning_curve.png").read_bytes()


def test_without_a_place_for_compiled_code_it_is_compiled_anew():
    """As for a user without a home in a container, where the package belongs to root."""
    program = (
        "import numpy as np; from curiobench.methods.agents import fused; fused.centre(a := np.ones((1, 1, 2)), a)"
    )
    environment = os.environ | {"NUMBA_CACHE_LOCATOR_CLASSES": "IPythonCacheLocator"}  # which finds none here
    subprocess.run([sys.executable, "-c", program + "; print(a)"], env=environment, check=True)


def test_without_a_place_for_scratch_files_there_is_one_line(cli, finished, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    code, out, err = cli("report", finished, "--out", tmp_path / "report.html")
    assert (code, out, err.count("\n"), list(tmp_path.iterdir())) == (2, "", 1, [])
