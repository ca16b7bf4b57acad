"""What a grid shows: rows that fit the terminal, and how long everything will take."""

import io
import re
import time

import pytest
from fake_grid import make_cells
from rich.console import Console

from curiobench.display import duration
from curiobench.grid.disk import Progress, State, read_progress
from curiobench.grid.overview import LiveGridView, PlainGridView, overview, status_line
from curiobench.grid.status import Status, grid_seconds_left, paces, seconds_left


@pytest.fixture
def statuses(tmp_path):
    """Forty cells of five epochs, of which three run and two are finished."""
    cells = make_cells(tmp_path, "--methods", "sac,icm+hm", "--seeds", "20", "--options", "epochs=5")
    statuses = [Status(cell) for cell in cells]
    now = time.time()
    for status in statuses[:2]:
        status.state, status.progress = State.FINISHED, Progress(5, 500.0, 4, 4, now)
    for status in statuses[2:5]:
        status.state, status.progress = State.RUNNING, Progress(2, 200.0, 1, 4, now)
    statuses[39].state = State.BROKEN
    return statuses


def drawn(renderable, width=80, height=24) -> list[str]:
    console = Console(file=io.StringIO(), width=width, height=height)
    console.print(renderable)
    return console.file.getvalue().splitlines()


def test_as_many_rows_as_fit_the_most_telling_first(statuses):
    lines = drawn(overview(statuses, 3, 24))
    assert len(lines) <= 23
    assert all(len(line) <= 80 for line in lines)
    assert [line.split()[:2] for line in lines[1:5]] == [
        ["stack2-sac-1", "running"],
        ["stack2-icm+hm-1", "running"],
        ["stack2-sac-2", "running"],
        ["stack2-icm+hm-19", "broken"],
    ]
    assert lines[1].split()[-3:] == ["2/5", "1/4", "0:05:00"]
    assert lines[-2].strip() == "… and 21 more: 19 waiting, 2 finished"
    # 3 × 3 and 34 × 5 epochs of 100 s are left, for three at a time
    assert re.fullmatch(r"2 of 40 cells finished, 3 running, 1 broken, 34 waiting, 1:39:\d\d left", lines[-1].strip())


def test_a_few_cells_keep_their_order_and_long_names_are_cut(tmp_path):
    cells = make_cells(tmp_path, "--methods", "curiobench.methods.icm:ICM+hm,sac", "--seeds", "1")
    statuses = [Status(cell) for cell in cells]
    lines = drawn(overview(statuses, 1, 24), width=60)
    assert all(len(line) <= 60 for line in lines)
    assert "…" in lines[1]
    assert lines[2].split()[:2] == ["stack2-sac-0", "waiting"]
    assert lines[-1].strip() == "0 of 2 cells finished, 2 waiting"


def test_time_left_of_cells_that_have_not_begun_is_that_of_their_like(statuses):
    now = time.time()
    statuses[0].progress = Progress(5, 50.0, 4, 4, now)
    assert seconds_left(statuses[6], paces(statuses), now) == pytest.approx(5 * (10 + 100 + 100) / 3)
    assert seconds_left(statuses[7], paces(statuses), now) == pytest.approx(500)
    assert seconds_left(statuses[2], paces(statuses), now + 30) == pytest.approx(270, abs=1)
    assert seconds_left(statuses[2], paces(statuses), now + 10_000) == pytest.approx(200, abs=1)
    assert seconds_left(Status(statuses[0].cell), {}, now) is None
    assert grid_seconds_left([Status(statuses[0].cell)], 1, now) is None
    assert grid_seconds_left(statuses[:2], 1, now) is None


@pytest.mark.parametrize(("seconds", "text"), [(None, "-"), (0, "0:00:00"), (3723.4, "1:02:03"), (360000, "100:00:00")])
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_a_log_gets_a_line_every_few_minutes(statuses, capsys, monkeypatch):
    now = time.monotonic()
    view = PlainGridView()
    view.show(statuses, 3)
    assert capsys.readouterr().out == ""
    monkeypatch.setattr("curiobench.grid.overview.time.monotonic", lambda: now + 301)
    view.show(statuses, 3)
    view.show(statuses, 3)
    assert capsys.readouterr().out[9:] == status_line(statuses, 3) + "\n"


def test_events_stand_above_the_live_rows(statuses, capsys, monkeypatch):
    for name, value in {"FORCE_COLOR": "1", "COLUMNS": "80", "LINES": "24"}.items():
        monkeypatch.setenv(name, value)
    view = LiveGridView()
    view.show(statuses, 3)
    view.event("stack2-sac-0: exit code 1; to be tried again\n    [/red] no markup")
    view.close()
    text = capsys.readouterr().out
    assert "[/red] no markup" in text
    assert "2 of 40 cells finished" in text


def test_progress_is_read_while_it_is_written(tmp_path):
    assert read_progress(tmp_path, Progress()) == Progress()
    (tmp_path / "evaluations.csv").write_text("epoch,goal\n0,a\n0,b\n5,a\n5,b\n")
    path = tmp_path / "progress.csv"
    path.write_text("epoch,goals_learned,seconds\n1,2,3.5\n2,,7.5\n3,1")
    progress = read_progress(tmp_path, Progress())
    assert (progress.epoch, progress.seconds, progress.learned, progress.goals) == (2, 7.5, 2, 2)
    path.write_text("epoch,")
    assert read_progress(tmp_path, progress).epoch == 0
    path.write_text("nonsense\n1\n")
    assert read_progress(tmp_path, progress) == progress
