"""The training loop. An epoch is a number of cycles; a cycle collects episodes, then updates the agent."""

import shutil
import traceback
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from curiobench import checkpoint
from curiobench.analysis.canvas import draw_learning_curve
from curiobench.config import RunConfig
from curiobench.display import Display
from curiobench.errors import Interrupted, RunFailed, StopRequest
from curiobench.evaluation import Evaluation, Evaluator, format_layers, last_evaluation, learned_by_layer
from curiobench.files import utf8, write_json
from curiobench.methods.plugins import error_line
from curiobench.methods.process import tune_process
from curiobench.run_folder import CHECKPOINT, REPLAY, RunFolder, read_record, read_rows
from curiobench.state import TrainingState, progress_row, result
from curiobench.trackers import check_installed
from curiobench.versions import versions


def train(config: RunConfig, out: Path, resume: bool = False, command: Sequence[str] = ()) -> None:
    """Train and evaluate an agent, and write everything to its run folder.

    Args:
        config: all options of the run.
        out: the run folder.
        resume: continue the run in the folder, if there is one.
        command: the command line, which is recorded.

    Raises:
        ValueError: before training: the folder is in use, finished, not writable or has other options, its checkpoint
            is damaged, or this machine lacks the memory, the device or an extra.
        RunFailed: NaN, a full disk, an error in a method. `error.log` in the folder has the traceback.
        Interrupted: on Ctrl-C or SIGTERM.
    """
    check_installed(config.machine.trackers)
    tune_process(config.torch_threads)
    with RunFolder(out, config, resume, command) as folder, StopRequest(once=True) as stop:
        try:
            run = TrainingRun(folder, config, stop)
        except BaseException as error:
            folder.withdraw()
            # torch raises RuntimeError where memory is short, a method MethodError, which is one
            if isinstance(error, OSError | MemoryError | RuntimeError):
                raise ValueError(f"cannot begin {out}: {error}") from error
            raise
        try:
            run.train()
        except Interrupted:
            raise
        except Exception as error:
            where = f"epoch {run.state.counters.epoch + 1}, cycle {run.state.counters.cycle + 1}"
            raise RunFailed(f"{out}: {where}: {error_line(error)}{_kept(out)}") from error
        finally:
            run.display.close()


class TrainingRun:
    """The training loop of one run folder."""

    def __init__(self, folder: RunFolder, config: RunConfig, stop: StopRequest) -> None:
        """Builds worlds, agent and replay, and restores the newest checkpoint; raises ValueError if it is damaged."""
        self.folder, self.config, self.stop = folder, config, stop
        self.state = TrainingState(config, folder.mapped_replay)
        self.evaluator = Evaluator(config.task, config.robot, config.episodes_per_goal, config.machine.threads)
        self._restore()
        first_epoch = self.state.counters.epoch + 1
        folder.lengthen()
        self.display = Display(config, folder.path, first_epoch)
        self.display.note(
            f"{folder.path}: {config.method} on {config.task}, seed {config.seed}, from epoch {first_epoch}"
        )
        if rows := read_rows(folder.path / "evaluations.csv"):
            self.display.evaluation(learned_by_layer(last_evaluation(rows)))
        if changed := _changed_versions(folder.path, config.method):
            self.display.note(f"resumed under other versions, numbers may differ: {changed}")

    def train(self) -> None:
        """Train the epochs that are left and write the result."""
        counters, config = self.state.counters, self.config
        if counters.steps == 0:
            self._evaluate(epoch=0)
        while counters.epoch < config.epochs:
            while counters.cycle < config.cycles:
                for _ in range(config.rollouts):
                    self.state.collect()
                self.state.learn()
                counters.cycle += 1
                self.display.cycle(counters)
                self._stop_if_asked()
            self._end_epoch()
        self._finish()

    def _end_epoch(self) -> None:
        """Evaluate and save if they are due, and write the epoch's row of progress.csv."""
        config = self.config
        epoch = self.state.counters.epoch + 1
        last = epoch == config.epochs
        evaluation = self._evaluate(epoch) if last or epoch % config.evaluate_every == 0 else None
        row = progress_row(self.state, evaluation)
        self.folder.append("progress.csv", [row])
        self.display.epoch(row)
        self.state.end_epoch()
        if last or epoch % config.machine.checkpoint_every == 0:
            self._save()

    def _evaluate(self, epoch: int) -> Evaluation:
        with self.state.counters.timed("evaluating"):
            evaluation = self.evaluator.evaluate(self.state.agent)
        head = {"epoch": epoch, "steps": self.state.counters.steps}
        rows = [head | row for row in evaluation.rows()]
        self.folder.append("evaluations.csv", rows)
        self.display.evaluation(learned_by_layer(rows))
        return evaluation

    def _stop_if_asked(self) -> None:
        if self.stop.count:
            self._save()
            message = f"stopped in epoch {self.state.counters.epoch + 1} after a checkpoint"
            raise Interrupted(f"{message}; continue {self.folder.path} with --resume", self.stop.number)

    def _save(self) -> None:
        path = self.folder.path / CHECKPOINT
        with self.state.counters.timed("checkpointing"):
            self.state.counters.note_memory()
            values = self.state.save(self.folder.path / REPLAY) | {"csv_sizes": self.folder.csv_sizes()}
            checkpoint.save(path, self.config.fingerprint(), self.state.agent.state_dict(), values)

    def _restore(self) -> None:
        """Restore the newest checkpoint, if any, and remove rows of the csv files that were written after it."""
        path = self.folder.path / CHECKPOINT
        saved = checkpoint.load(path, self.config.fingerprint())
        if saved is None:
            self.folder.truncate(dict.fromkeys(self.folder.csv_sizes(), 0))
            return
        agent, values = saved
        with checkpoint.errors_named(path):
            self.state.load(self.folder.path / REPLAY, agent, values)
            self.folder.truncate(values["csv_sizes"])

    def _finish(self) -> None:
        """Write result.json, print the table, draw the learning curve, and delete the replay unless it is kept."""
        rows = read_rows(self.folder.path / "evaluations.csv")
        write_json(self.folder.path / "result.json", result(self.state, rows))  # which marks the run as finished
        self.display.note(format_layers(learned_by_layer(last_evaluation(rows))))
        try:
            curve = draw_learning_curve(rows, self.folder.path / "learning_curve.png")
        except Exception as error:  # the run is finished, whatever goes wrong with its picture
            curve = f"not drawn: {error_line(error)}"
        self.display.note(f"learning curve: {curve}\nresult: {self.folder.path / 'result.json'}")
        shutil.rmtree(self.folder.mapped_replay, ignore_errors=True)
        if not self.config.machine.keep_replay:
            shutil.rmtree(self.folder.path / REPLAY, ignore_errors=True)


def _changed_versions(path: Path, method: str) -> str:
    """Versions that differ from those recorded when the run was started, as text; empty if none."""
    then, now = read_record(path).get("versions", {}), versions(method)
    return ", ".join(f"{name} {now[name]}, was {then[name]}" for name in now if then.get(name, now[name]) != now[name])


def _kept(out: Path) -> str:
    """Write the traceback to error.log, if possible. Returns the part of the message that says what is kept."""
    kept = "; the last checkpoint is kept" if (out / CHECKPOINT).exists() else ""
    with suppress(OSError):
        (out / "error.log").write_bytes(utf8(traceback.format_exc()))
        return f"{kept}; details in {out / 'error.log'}"
    return kept
