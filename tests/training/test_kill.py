"""The real thing: kill -9 at random moments, resume, and end with the very numbers of an undisturbed run."""

import random
import shlex
import subprocess
import sys
import time

import pytest
from tiny_runs import numbers

FLAGS = shlex.split(
    "--task stack2 --preset smoke --epochs 20 --cycles 4 --worlds 16 --updates 10 --batch-size 64 "
    "--evaluate-every 2 --episodes-per-goal 5 --replay.capacity 300 --sac.hidden 16 --resume"
)


def start(path):
    command = [sys.executable, "-m", "curiobench", "train", *FLAGS, "--out", str(path)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.mark.slow
def test_ten_kills(tmp_path):
    moments = random.Random(0)
    undisturbed = start(tmp_path / "undisturbed")
    assert undisturbed.wait(timeout=300) == 0
    kills, path = 0, tmp_path / "killed"
    while not (path / "result.json").exists():
        process = start(path)
        # after the first epoch: before it there are imports, and time passes without a row to lose
        while kills < 10 and (line := process.stdout.readline()):
            if line.startswith("epoch"):
                time.sleep(moments.uniform(0, 1.2))
                process.kill()
                kills += 1
                break
        output = process.communicate(timeout=300)[0]
        assert process.returncode in (0, -9), output
    assert kills == 10
    assert numbers(path) == numbers(tmp_path / "undisturbed")
