"""Cells as jobs: on submitit's local executor, and on stand-ins for the commands of SLURM."""

import os
import re
import signal
import subprocess
import sys

import pytest
from commands import wait_for
from fake_grid import (
    FAKE,
    SLURM,
    Watching,
    make_cells,
    rows,
    run_on,
    set_up_fakes,
    start,
    starts,
    states,
    undisturbed,
)

from curiobench.cli.arguments import GridArguments
from curiobench.cli.parsing import parse_arguments
from curiobench.errors import StopRequest
from curiobench.grid.disk import State
from curiobench.grid.run import run_grid
from curiobench.grid.slurm_launcher import SlurmLauncher
from curiobench.run_folder import is_locked


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    monkeypatch.setenv("FAKE_SLURM", str(tmp_path / "slurm"))
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    for name in ("slurm", "bin"):
        (tmp_path / name).mkdir()
    from fake_slurm import install

    install(tmp_path / "bin")
    return tmp_path / "slurm"


def paced(tmp_path, pace=0.1, **behaviour):
    cells = make_cells(tmp_path / "grid", "--methods", "sac", "--seeds", "2", "--options", "epochs=30")
    set_up_fakes(cells, **{f"stack2_sac_{seed}": {"pace": pace, **behaviour} for seed in range(2)})
    cells[0].out.mkdir(exist_ok=True)
    return cells


def finish(cells, view=None, stop=None, cluster="Slurm"):
    return [*states(run_on(SlurmLauncher(None, SLURM, cells[0].out, FAKE, cluster), cells, view, stop)).values()]


@pytest.mark.slow
def test_the_local_executor_makes_the_rows_of_a_local_grid(tmp_path, capsys):
    cells = paced(tmp_path, pace=0.02, failures=1)
    assert finish(cells, cluster="Local") == [State.FINISHED] * 2
    assert rows(cells[0].out) == undisturbed(cells)
    assert "stack2-sac-0: exit code 1; to be tried again\n    Traceback:" in capsys.readouterr().out


@pytest.mark.slow
def test_after_a_kill_the_grid_waits_for_its_jobs_instead_of_submitting_others(cluster, tmp_path):
    cells = paced(tmp_path)
    grid = start(cells[0].out, "slurm", "--methods", "sac", "--seeds", "2", "--options", "epochs=30")
    wait_for(lambda: is_locked(cells[0].path) and (cells[0].out / "stack2-sac-1.job").exists())
    os.killpg(grid.pid, signal.SIGKILL)
    assert not cells[1].path.exists()  # it is queued
    assert finish(cells) == [State.FINISHED] * 2
    assert rows(cells[0].out) == undisturbed(cells)
    assert [len(starts(cell)) for cell in cells] == [1, 1]
    scripts = [path.read_text() for path in cluster.glob("*.script")]
    assert len(scripts) == 2
    for flag in ("--time=9", "--partition=cpu", "--no-requeue"):
        assert all(f"#SBATCH {flag}\n" in script for script in scripts)


@pytest.mark.slow
def test_a_stop_checkpoints_the_job_that_runs_and_empties_the_queue(cluster, tmp_path):
    cells, stop = paced(tmp_path), StopRequest()

    def stop_it(statuses):
        if statuses[0].progress.epoch >= 3 and not stop.count:
            stop._note(signal.SIGTERM, None)

    assert finish(cells, Watching(stop_it), stop) == [State.STOPPED] * 2
    assert "stopped after a checkpoint" in cells[0].log.read_text()
    assert not cells[1].path.exists()
    assert finish(cells) == [State.FINISHED] * 2
    assert rows(cells[0].out) == undisturbed(cells)
    assert [len(starts(cell)) for cell in cells] == [2, 1]


@pytest.mark.slow
def test_a_job_whose_time_is_up_goes_on_in_another(cluster, tmp_path, capsys):
    cells = paced(tmp_path)[:1]

    def end_its_time(statuses):
        if statuses[0].progress.epoch >= 3 and not (cluster / "told").exists():
            (cluster / "told").touch()
            job, training = (cluster / "1.job").read_text().split()[1], starts(cells[0])[0].split()[0]
            for process in (training, job):  # SLURM tells all processes of a job
                os.kill(int(process), signal.SIGUSR2)

    assert finish(cells, Watching(end_its_time)) == [State.FINISHED]
    assert rows(cells[0].out) == undisturbed(cells)
    assert [len(starts(cell)) for cell in cells] == [2]
    assert "stack2-sac-0: its worker went away" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ((), "needs --slurm time=MINUTES"),
        (("time=9", "nodes=2"), "slurm is 'nodes=2'; expected KEY=VALUE, once for each KEY of account, "),
        (("time=",), "slurm is 'time='; "),
        (("time=9", "time=8"), "slurm is 'time=8'; "),
        (("time=9",), "finds no srun here"),
    ],
)
def test_wrong_options_begin_nothing(flags, message, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    arguments = ["--tasks", "stack2", "--methods", "sac", "--launcher", "slurm", "--out", str(tmp_path / "grid")]
    for flag in flags:
        arguments += ["--slurm", flag]
    with pytest.raises(ValueError, match=re.escape(message)) as refused:
        run_grid(parse_arguments(GridArguments, "grid", arguments))
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "grid").exists()


def test_other_loggers_stay_as_they_are(tmp_path):
    """In a process of its own: submitit is imported once."""
    program = f"""
import logging
from pathlib import Path
from curiobench.grid.slurm_launcher import SlurmLauncher
class Handler(logging.Handler):
    def close(self): print("closed")
handler = Handler()
SlurmLauncher(None, ["time=9"], Path({str(tmp_path)!r}), cluster="Local")
print("open", flush=True)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[0] == "open"


def test_without_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "submitit", None)
    with pytest.raises(ValueError, match=r"needs the extra `slurm`: pip install 'curiobench\[slurm\]'"):
        SlurmLauncher(1, ["time=9"], tmp_path)
