"""Cells as tasks of a Ray cluster: what it takes over from the local grid, and what happens when a machine dies."""

import builtins
import os
import re
import signal
from pathlib import Path

import pytest
from fake_grid import FAKE, make_cells, rows, tell_fakes, undisturbed

from curiobench.errors import StopRequest
from curiobench.grid.disk import State
from curiobench.grid.overview import PlainView
from curiobench.grid.ray_launcher import RayLauncher
from curiobench.grid.scheduler import Scheduler
from curiobench.run_folder import is_locked

pytestmark = pytest.mark.slow
pytest.importorskip("ray")


@pytest.fixture
def cluster():
    """Two nodes of one CPU each on this machine; the first is the head."""
    import ray
    from ray.cluster_utils import Cluster

    small = {"num_cpus": 1, "object_store_memory": 80_000_000, "include_dashboard": False}
    cluster = Cluster(initialize_head=True, head_node_args=small)
    cluster.second = cluster.add_node(num_cpus=1, object_store_memory=80_000_000)
    yield cluster
    ray.shutdown()
    cluster.shutdown()


class Acting(PlainView):
    """Calls something once, when a condition on the states of the cells holds."""

    def __init__(self, condition, act):
        super().__init__()
        self.condition, self.act, self.done = condition, act, False

    def show(self, statuses, slots):
        if not self.done and self.condition(statuses):
            self.done = True
            self.act()


def run_on(launcher, cells, view, stop=None):
    cells[0].out.mkdir(parents=True, exist_ok=True)
    scheduler = Scheduler(cells, launcher, 1, view, stop or StopRequest(), 0.1, 0.5)
    try:
        scheduler.run()
    finally:
        launcher.close()
    return [status.state for status in scheduler.statuses]


def paced(tmp_path, epochs, pace, **behaviour):
    cells = make_cells(tmp_path / "grid", "--methods", "sac,icm", "--seeds", "2", "--options", f"epochs={epochs}")
    told = {cell.folder.replace("-", "_"): {"pace": pace} for cell in cells}
    tell_fakes(cells, **{name: values | behaviour.get(name, {}) for name, values in told.items()})
    return cells


def test_one_node_dies_in_the_middle(cluster, tmp_path, capsys):
    cells = paced(tmp_path, epochs=40, pace=0.2)
    view = Acting(
        lambda statuses: sum(status.progress.epoch >= 10 for status in statuses) == 2,
        lambda: cluster.remove_node(cluster.second, allow_graceful=False),
    )
    states = run_on(RayLauncher(None, cluster.address, FAKE), cells, view)
    assert states == [State.FINISHED] * 4
    assert rows(cells[0].out) == undisturbed(cells)
    assert sorted(len((cell.path / "starts").read_text().splitlines()) for cell in cells) == [1, 1, 1, 2]
    assert ": its worker went away" in capsys.readouterr().out


def test_a_cluster_of_its_own_stops_and_continues(tmp_path, capsys):
    cells = paced(tmp_path, epochs=50, pace=0.2, stack2_icm_1={"failures": 1})
    stop = StopRequest()
    view = Acting(
        lambda statuses: sum(status.progress.epoch >= 5 for status in statuses) == 2,
        lambda: stop._note(signal.SIGTERM, None),
    )
    states = run_on(RayLauncher(2, None, FAKE), cells, view, stop)
    assert sorted(states) == [State.STOPPED] * 2 + [State.WAITING] * 2
    assert not any(is_locked(cell.path) for cell in cells)
    tell_fakes(cells, stack2_icm_1={"failures": 1})
    assert run_on(RayLauncher(2, None, FAKE), cells, PlainView()) == [State.FINISHED] * 4
    assert rows(cells[0].out) == undisturbed(cells)
    out = capsys.readouterr().out
    assert "stack2-icm-1: exit code 1; to be tried again\n    Traceback:" in out


def test_a_killed_worker_takes_its_cell_down_and_the_cell_goes_on(tmp_path, capsys):
    cell = paced(tmp_path, epochs=30, pace=0.2)[0]
    tell_fakes([cell], stack2_sac_0={"pace": 0.2})

    def pids():
        return [int(line.split()[0]) for line in (cell.path / "starts").read_text().splitlines()]

    def kill_worker():
        fields = Path(f"/proc/{pids()[0]}/stat").read_text().rpartition(")")[2].split()
        os.kill(int(fields[1]), signal.SIGKILL)

    view = Acting(lambda statuses: statuses[0].progress.epoch >= 5, kill_worker)
    assert run_on(RayLauncher(1, None, FAKE), [cell], view) == [State.FINISHED]
    assert rows(cell.out) == undisturbed([cell])
    assert len(pids()) == 2
    assert "stopped after a checkpoint" in cell.log.read_text()
    assert "stack2-sac-0: its worker went away" in capsys.readouterr().out


def test_without_the_extra(monkeypatch):
    real = builtins.__import__

    def without_ray(name, *arguments, **keywords):
        if name == "ray":
            raise ImportError(name)
        return real(name, *arguments, **keywords)

    monkeypatch.setattr(builtins, "__import__", without_ray)
    with pytest.raises(ValueError, match=r"needs the extra `ray`: pip install 'curiobench\[ray\]'"):
        RayLauncher(1, None)


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("auto", "no Ray cluster at auto: "),
        ("127.0.0.1:9", "no Ray cluster at 127.0.0.1:9: "),
        ("here", "address is 'here'; expected auto, or a host and port"),
        ("ray://127.0.0.1:x", "expected auto, or a host and port"),
        ("127.0.0.1:99999", "no Ray cluster at 127.0.0.1:99999: "),
    ],
)
def test_no_cluster_there(address, message):
    with pytest.raises(ValueError, match=re.escape(message)) as refused:
        RayLauncher(1, address)
    assert "\n" not in str(refused.value)
