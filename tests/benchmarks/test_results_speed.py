"""Time and memory of the results side on 500 run folders of 500 evaluations × 35 goals.

    pytest tests/benchmarks/test_results_speed.py --benchmark-only -s

Each command is started as a user does, by the clock, three times, of which the fastest counts, as other work on the
machine only adds; the folders are in the page cache. Both read, and `figure` draws, on all cores: here on two.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from synthetic import write_run

METHODS = ("sac", "icm", "rnd", "dac", "re3", "mihm", "icm+hm", "rnd+hm", "mi", "dac+hm")
SEEDS = 50
EPOCHS = 499
"""With the evaluation before training, 500."""
SECONDS = 10
BYTES = 10**9
"""Of all processes together, each of which takes no more than the largest."""
CORES = 2


def success(task: str, method: str, seed: int, epoch: int, goal: int) -> float:
    return ((7 * epoch + 3 * goal + len(method)) % 26) / 25


@pytest.fixture(scope="module")
def many(tmp_path_factory) -> Path:
    """A folder of 500 run folders; the seeds of a method share their numbers, which reading does not know."""
    folder = tmp_path_factory.mktemp("many")
    for method in METHODS:
        first = folder / f"stack3-{method}-0"
        write_run(first, "stack3", method, 0, EPOCHS, success, {}, complete=True)
        record = json.loads((first / "config.json").read_text())
        for seed in range(1, SEEDS):
            other = shutil.copytree(first, folder / f"stack3-{method}-{seed}")
            record["config"]["seed"] = seed
            (other / "config.json").write_text(json.dumps(record))
    return folder


START = """
import os, subprocess, sys, time
started = time.perf_counter()
with open(sys.argv[1], "w") as file:
    process = subprocess.Popen(sys.argv[2:], stdout=file, stderr=file)
    _, status, usage = os.wait4(process.pid, 0)
seconds = time.perf_counter() - started
print(os.waitstatus_to_exitcode(status), seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024)
"""
"""Starts a command from a small process: a peak of memory begins with that of the process that forks."""


def run(words: list[str], output: Path) -> tuple[int, float, float, int]:
    """Exit code, wall-clock seconds, processor seconds of all its processes, and peak bytes of the largest of them."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    told = subprocess.check_output([sys.executable, "-c", START, output, *words], env=environment).split()
    return int(told[0]), float(told[1]), float(told[2]), int(told[3])


@pytest.fixture
def two_cores():
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[:CORES])
    yield
    os.sched_setaffinity(0, before)


@pytest.mark.parametrize("command", ["table", "figure"])
def test_500_runs_take_under_10_seconds_and_a_gigabyte(benchmark, many, tmp_path, command, two_cores):
    words = [sys.executable, "-m", "curiobench", command, str(many)]
    if command == "figure":
        words += ["--out", str(tmp_path / "figures")]
    measured = []
    benchmark.pedantic(lambda: measured.append(run(words, tmp_path / "output")), rounds=3, iterations=1)
    assert not any(code for code, *_ in measured), (tmp_path / "output").read_text()
    print()
    for _, wall, seconds, peak in measured:
        print(f"{command}: {wall:.1f} s by the clock, {seconds:.1f} s of processor time, {peak / 1e6:.0f} MB")
    assert min(wall for _, wall, *_ in measured) < SECONDS
    assert CORES * max(peak for *_, peak in measured) < BYTES
