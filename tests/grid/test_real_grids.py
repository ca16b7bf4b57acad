"""`curiobench grid` with real training: killed at random moments, or on a cluster that loses a machine, same rows."""

import os
import random
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import tiny_runs

pytestmark = pytest.mark.slow

FLAGS = shlex.split(
    "--tasks stack2 --methods sac,icm+hm --seeds 1 --preset smoke "
    "--options epochs=14,cycles=3,worlds=8,updates=6,batch-size=32,episodes-per-goal=3,sac.hidden=16,"
    "replay.capacity=100"  # which overflows
)


@pytest.fixture(scope="module")
def start():
    """Starts a grid in a folder; none is left running when the tests are over."""
    processes = []

    def call(out: Path, *flags: str, epochs: str = "epochs=14") -> subprocess.Popen:
        usual = [word.replace("epochs=14", epochs) for word in FLAGS]
        command = [sys.executable, "-m", "curiobench", "grid", *usual, "--out", str(out), *flags]
        processes.append(
            subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
            )
        )
        return processes[-1]

    yield call
    for process in processes:
        process.kill()


def finish(process: subprocess.Popen) -> str:
    output = process.communicate(timeout=1200)[0]
    assert process.returncode == 0, output
    return output


def numbers(out: Path) -> dict[str, object]:
    """What two grids must agree in, by folder of the finished runs."""
    return {path.parent.name: tiny_runs.numbers(path.parent) for path in sorted(out.glob("*/result.json"))}


def sizes(out: Path) -> int:
    return sum(path.stat().st_size for path in out.glob("*/progress.csv"))


def wait_for_rows(process: subprocess.Popen, out: Path, more: int = 1) -> bool:
    """Wait until the runs have written; False where the grid has ended before."""
    before = sizes(out)
    while sizes(out) < before + more:
        if process.poll() is not None:
            return False
        time.sleep(0.05)
    return True


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, start):
    """What a grid that nobody disturbs ends with."""
    out = tmp_path_factory.mktemp("undisturbed") / "grid"
    assert "all 2 cells are finished" in finish(start(out, "--jobs", "1"))
    found = numbers(out)
    assert found.keys() == {"stack2-sac-0", "stack2-icm+hm-0"}
    return found


def test_ten_kills(tmp_path, undisturbed, start):
    """The grid's process group dies; every second time every process of its cells, too, before they can checkpoint."""
    moments, out = random.Random(0), tmp_path / "grid"
    kills = 0
    while kills < 10:
        process = start(out, "--jobs", "2")
        assert wait_for_rows(process, out), "finished before it was killed often enough"
        time.sleep(moments.uniform(0, 0.5))
        cells = [int(pid) for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for pid in cells if kills % 2 else ():
            os.kill(pid, signal.SIGKILL)
        kills += 1
    finish(start(out, "--jobs", "2"))
    assert numbers(out) == undisturbed


def test_a_grid_with_more_epochs_extends_its_finished_runs(tmp_path, undisturbed, start):
    out = tmp_path / "grid"
    finish(start(out, "--jobs", "2", epochs="epochs=5,machine.keep-replay=true"))
    output = finish(start(out, "--jobs", "2"))
    assert output.count("started at epoch 6 of 14") == 2
    assert numbers(out) == undisturbed


def test_a_cluster_that_loses_a_node(tmp_path, undisturbed, start):
    """Two Ray nodes on this machine, one killed while it trains."""
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    small = {"num_cpus": 1, "object_store_memory": 80_000_000}
    cluster = Cluster(initialize_head=True, head_node_args={**small, "include_dashboard": False})
    second, out = cluster.add_node(**small), tmp_path / "grid"
    try:
        process = start(out, "--launcher", "ray", "--address", cluster.address)
        while len(list(out.glob("*/progress.csv"))) < 2:
            assert process.poll() is None, process.communicate()[0]
            time.sleep(0.05)
        cluster.remove_node(second, allow_graceful=False)
        output = finish(process)
    finally:
        cluster.shutdown()
    assert "its worker went away" in output
    assert numbers(out) == undisturbed
