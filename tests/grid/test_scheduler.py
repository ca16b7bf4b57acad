"""The grid's loop on fake cells: what is started, skipped, tried again and left alone."""

import fcntl
import os
import re
import sys

import pytest
from fake_grid import FAKE, Watching, make_cells, rows, run_on, schedule, set_up_fakes, starts, states, undisturbed

from curiobench.config import CONFIG_VERSION
from curiobench.files import write_json
from curiobench.grid.disk import State, cell_state
from curiobench.grid.launcher import LocalLauncher, tail
from curiobench.grid.scheduler import _TAKEN
from curiobench.run_folder import REPLAY, RUN_FORMAT, _lock


@pytest.fixture
def cells(tmp_path):
    """Two methods and two seeds, as fakes."""
    cells = make_cells(tmp_path / "grid")
    set_up_fakes(cells)
    return cells


def test_all_cells_are_trained_once_with_one_thread(cells, capsys):
    scheduler = schedule(cells)
    assert set(states(scheduler).values()) == {State.FINISHED}
    assert [len(starts(cell)) for cell in cells] == [1, 1, 1, 1]
    assert all(line.endswith(" 1") for cell in cells for line in starts(cell))
    assert list(states(scheduler)) == ["stack2-sac-0", "stack2-icm-0", "stack2-sac-1", "stack2-icm-1"]
    lines = capsys.readouterr().out.splitlines()
    assert all(re.match(r"\d\d:\d\d:\d\d stack2-", line) for line in lines)
    assert sum("started at epoch 1 of 5" in line for line in lines) == 4
    assert sum("finished, 1/3 goals learned" in line for line in lines) == 4


def test_a_broken_cell_is_tried_again_after_the_others(cells, capsys):
    set_up_fakes(cells, stack2_sac_0={"failures": 1})
    scheduler = schedule(cells, jobs=1)
    assert set(states(scheduler).values()) == {State.FINISHED}
    out = capsys.readouterr().out
    assert (
        "stack2-sac-0: exit code 1; to be tried again\n    Traceback:\n      in the middle\n    curiobench: no luck"
        in out
    )
    started = re.findall(r"(\S+): started", out)
    assert started == ["stack2-sac-0", "stack2-icm-0", "stack2-sac-1", "stack2-icm-1", "stack2-sac-0"]


@pytest.mark.parametrize("retries", [0, 2])
def test_a_cell_that_stays_broken_stops_no_other(cells, capsys, retries):
    set_up_fakes(cells, stack2_icm_0={"failures": 99, "code": 2, "message": "cannot use checkpoint-3.json: truncated"})
    scheduler = schedule(cells, retries=retries)
    assert sorted(states(scheduler).values()) == [State.BROKEN, *[State.FINISHED] * 3]
    broken = scheduler.statuses[1]
    assert broken.reason == "exit code 2: curiobench: cannot use checkpoint-3.json: truncated"
    assert len(starts(broken.cell)) == 1 + retries
    assert f"broken after {1 + retries} attempts" in capsys.readouterr().out


def test_a_folder_with_another_config_is_left_alone(cells, capsys):
    other = cells[0].config.to_json() | {"epochs": 9}
    cells[0].path.mkdir(parents=True)
    write_json(cells[0].path / "config.json", {"format": RUN_FORMAT, "config_version": CONFIG_VERSION, "config": other})
    before = (cells[0].path / "config.json").read_bytes()
    scheduler = schedule(cells)
    assert scheduler.statuses[0].state is State.CONFLICT
    assert list(cells[0].path.iterdir()) == [cells[0].path / "config.json"]
    assert (cells[0].path / "config.json").read_bytes() == before
    assert "stack2-sac-0: left alone: " in (out := capsys.readouterr().out)
    assert "has other options: epochs is 9 there, 5 was requested" in out
    assert sum(state is State.FINISHED for state in states(scheduler).values()) == 3


def test_a_shorter_run_is_extended_where_its_replay_is_kept(cells):
    cell = cells[0]
    shorter = cell.config.to_json() | {"epochs": 3}
    cell.path.mkdir(parents=True)
    write_json(cell.path / "config.json", {"format": RUN_FORMAT, "config_version": CONFIG_VERSION, "config": shorter})
    assert cell_state(cell) == (State.WAITING, "")
    write_json(cell.path / "result.json", {"epochs": 3})
    assert cell_state(cell) == (State.CONFLICT, f"{cell.path} has 3 epochs and no replay, so it cannot be lengthened")
    (cell.path / REPLAY).mkdir(parents=True)
    assert cell_state(cell) == (State.WAITING, "")
    with _lock(cell.path / ".lock"):
        assert cell_state(cell) == (State.ELSEWHERE, "")


def test_a_folder_with_a_method_that_is_not_built_in_is_a_conflict(cells):
    config = cells[1].config.to_json() | {"method": "os:system"}
    cells[0].path.mkdir(parents=True)
    write_json(
        cells[0].path / "config.json", {"format": RUN_FORMAT, "config_version": CONFIG_VERSION, "config": config}
    )
    state, reason = cell_state(cells[0])
    assert state is State.CONFLICT
    assert "method os:system is not built in" in reason


def test_a_waiting_cell_that_another_grid_takes_is_resumed_when_it_is_free(cells):
    set_up_fakes(cells, stack2_sac_0={"pace": 0.2})
    cells[3].path.mkdir(parents=True)
    lock = open(cells[3].path / ".lock", "w")  # noqa: SIM115 - closed in the middle
    seen = []

    def take(statuses):
        if statuses[0].state is State.RUNNING and not seen:
            fcntl.flock(lock, fcntl.LOCK_EX)
        seen.append(statuses[3].state)
        if statuses[3].state is State.ELSEWHERE:
            lock.close()

    scheduler = schedule(cells, jobs=1, view=Watching(take))
    assert set(states(scheduler).values()) == {State.FINISHED}
    assert seen.index(State.ELSEWHERE) < seen.index(State.RUNNING)
    assert [len(starts(cell)) for cell in cells] == [1, 1, 1, 1]


def test_a_start_race_is_no_failure(cells, capsys):
    """The folder is free when the grid looks, and taken when its process comes to lock it."""
    cells[0].path.mkdir(parents=True)
    held = []

    class Racing(LocalLauncher):
        def start(self, arguments, log):
            if not held:
                held.append(open(cells[0].path / ".lock", "w"))  # noqa: SIM115 - closed below
                fcntl.flock(held[0], fcntl.LOCK_EX)
            elif len(held) == 1 and "1" in arguments:
                held.append(None)
                held[0].close()
            return super().start(arguments, log)

    scheduler = run_on(Racing(1, FAKE), cells, retries=0, poll=0.02)
    assert set(states(scheduler).values()) == {State.FINISHED}
    assert "stack2-sac-0: runs elsewhere" in capsys.readouterr().out
    assert scheduler.statuses[0].failures == 0


def test_train_names_a_taken_folder_in_the_words_that_the_grid_expects(tmp_path):
    with _lock(tmp_path / ".lock"), pytest.raises(ValueError, match=_TAKEN):
        _lock(tmp_path / ".lock")


def test_a_program_that_cannot_be_started(cells, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/no/python")
    scheduler = schedule(cells, retries=0)
    assert {s.reason for s in scheduler.statuses} == {
        "cannot be started: [Errno 2] No such file or directory: '/no/python'"
    }


def test_a_cell_killed_by_somebody_else_is_resumed(cells, capsys):
    """Killed in the middle by a person or the kernel, it continues from its checkpoint."""
    set_up_fakes(cells, stack2_sac_0={"pace": 0.5})
    killed = []

    def kill(statuses):
        if not killed and statuses[0].progress.epoch >= 3:
            os.kill(int(starts(cells[0])[0].split()[0]), 9)
            killed.append(True)

    scheduler = schedule(cells, view=Watching(kill))
    assert "ended by signal 9 (Killed); to be tried again" in capsys.readouterr().out
    assert set(states(scheduler).values()) == {State.FINISHED}
    assert len(starts(cells[0])) == 2
    assert rows(cells[0].out) == undisturbed(cells)


def test_the_tail_of_a_log(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"--- before\nold\n")
    start = path.stat().st_size
    with open(path, "ab") as file:
        file.write(b"--- header\none\n\n\xfftwo\nthree")
    assert tail(path, start) == ["one", "\N{REPLACEMENT CHARACTER}two", "three"]
    assert tail(path, start, lines=1) == ["three"]
    assert tail(tmp_path / "none", 0) == []
