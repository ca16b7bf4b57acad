"""Cells as tasks of a Ray cluster that the grid starts; test_real_grids.py has a cluster that loses a machine."""

import os
import re
import signal
import sys
from pathlib import Path

import pytest
from fake_grid import FAKE, Watching, make_cells, rows, run_on, set_up_fakes, starts, states, undisturbed

from curiobench.errors import StopRequest
from curiobench.grid.disk import State
from curiobench.grid.ray_launcher import RayLauncher
from curiobench.run_folder import is_locked

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def _installed():
    pytest.importorskip("ray")  # seconds to import


def paced(tmp_path, epochs, pace, **behaviour):
    cells = make_cells(tmp_path / "grid", "--methods", "sac,icm", "--seeds", "2", "--options", f"epochs={epochs}")
    set_up_fakes(cells, pace, **behaviour)
    return cells


def test_a_cluster_that_the_grid_starts_stops_and_continues(tmp_path, capsys):
    cells = paced(tmp_path, epochs=50, pace=0.2, stack2_icm_1={"failures": 1})
    stop = StopRequest()

    def stop_when_two_run(statuses):
        if not stop.count and sum(status.progress.epoch >= 5 for status in statuses) == 2:
            signal.raise_signal(signal.SIGINT)

    launcher = RayLauncher(2, None, FAKE)
    with stop:
        stopped = run_on(launcher, cells, Watching(stop_when_two_run), stop)
    assert sorted(states(stopped).values()) == [State.STOPPED] * 2 + [State.WAITING] * 2
    assert not any(is_locked(cell.path) for cell in cells)
    set_up_fakes(cells, stack2_icm_1={"failures": 1})
    assert set(states(run_on(RayLauncher(2, None, FAKE), cells)).values()) == {State.FINISHED}
    assert rows(cells[0].out) == undisturbed(cells)
    out = capsys.readouterr().out
    assert "stack2-icm-1: exit code 1; to be tried again\n    Traceback:" in out


def test_a_killed_worker_ends_its_cell_which_is_resumed(tmp_path, capsys):
    cell = paced(tmp_path, epochs=30, pace=0.2)[0]
    killed = []

    def kill_the_first_worker(statuses):
        if not killed and statuses[0].progress.epoch >= 5:
            killed.append(True)
            fields = Path(f"/proc/{starts(cell)[0].split()[0]}/stat").read_text().rpartition(")")[2].split()
            os.kill(int(fields[1]), signal.SIGKILL)

    view = Watching(kill_the_first_worker)
    assert states(run_on(RayLauncher(1, None, FAKE), [cell], view)) == {cell.folder: State.FINISHED}
    assert rows(cell.out) == undisturbed([cell])
    assert len(starts(cell)) == 2
    assert "stopped after a checkpoint" in cell.log.read_text()
    assert "stack2-sac-0: its worker went away" in capsys.readouterr().out


def test_without_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
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
