"""What a run shows: lines on the terminal, TensorBoard logs and the learning curve. None of it changes the run."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

    from curiobench.config import RunConfig
    from curiobench.evaluation import Layers
    from curiobench.state import Counters


class _Terminal(Console):
    """Standard output. It falls silent, and nothing more, once nobody reads it any longer or its disk is full."""

    def __init__(self) -> None:
        super().__init__(soft_wrap=True, highlight=False)

    def on_broken_pipe(self) -> None:
        """Rich's own would end the process."""
        self.quiet = True

    def print(self, *objects: Any, **options: Any) -> None:
        """As `Console.print`."""
        try:
            super().print(*objects, **options)
        except OSError:
            self.quiet = True


class Display:
    """Shows the progress of a run: one line per epoch, live lines on a terminal, and a TensorBoard log if asked for.

    Where one of them fails, the run goes on without it.
    """

    def __init__(self, config: "RunConfig", folder: Path, first_epoch: int) -> None:
        """
        Args:
            config: of the run.
            folder: of the run.
            first_epoch: the first that is to come.
        """
        self._config = config
        self._log = _tensorboard(folder / "tensorboard", first_epoch) if config.machine.tensorboard else None
        self._console = _Terminal()
        terminal = sys.stdout.isatty()
        self._live = Live(console=self._console, refresh_per_second=4, transient=True) if terminal else None
        if self._live:
            self._live.start()
        self._learned = "-"
        self._rates = ""

    def evaluation(self, layers: "Layers") -> None:
        """Called with the learned goals of every evaluation."""
        self._learned = " ".join(f"L{layer} {learned}/{goals}" for layer, (learned, goals) in layers.items())

    def cycle(self, counters: "Counters") -> None:
        """Called after every cycle."""
        done = counters.epoch * self._config.cycles + counters.cycle
        left = sum(counters.seconds.values()) * (self._config.epochs * self._config.cycles / done - 1)
        steps = counters.steps / counters.seconds["collecting"]
        updates = counters.updates / (counters.seconds["sampling"] + counters.seconds["updating"])
        self._rates = f"{steps:,.0f} steps/s  {updates:,.1f} updates/s  {duration(left)} left"
        if self._live:
            where = f"epoch {counters.epoch + 1}/{self._config.epochs}  cycle {counters.cycle}/{self._config.cycles}"
            self._live.update(Text(f"{where}  learned {self._learned}\n{self._rates}"))

    def epoch(self, row: dict[str, Any]) -> None:
        """Called with every row of progress.csv."""
        rate = row["training_success_unsatisfied"]
        self.note(
            f"epoch {row['epoch']}/{self._config.epochs}  learned {self._learned}"
            f"  success {'-' if row['success'] is None else format(row['success'], '.2f')}"
            f"  in training {'-' if rate is None else format(rate, '.2f')}  {self._rates}"
        )
        try:
            self._write_log(row)
        except Exception as error:  # a full disk, or whatever TensorBoard does
            self._log = None
            self.note(f"no TensorBoard log any more: {error}")

    def _write_log(self, row: dict[str, Any]) -> None:
        if self._log:
            for name, value in row.items():
                if value is not None and name != "epoch":
                    self._log.add_scalar(name, value, row["epoch"])
            self._log.flush()

    def note(self, text: str) -> None:
        """Print a line above the live ones."""
        self._console.print(text, markup=False)

    def close(self) -> None:
        """Remove the live lines and close the log."""
        if self._live:
            self._live.stop()
        if self._log:
            self._log.close()


def duration(seconds: float | None) -> str:
    """Hours, minutes and seconds, as 1:02:03; "-" where it is not known."""
    if seconds is None:
        return "-"
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}"


def align(lines: Sequence[Sequence[str]], left: int) -> str:
    """Columns side by side, the first `left` of them flush left."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(w) if i < left else cell.rjust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    )


def check_tensorboard() -> None:
    """Raises ValueError where the extra `tensorboard` is missing."""
    try:
        import torch.utils.tensorboard  # noqa: F401
    except ImportError:
        raise ValueError("--machine.tensorboard needs the extra: pip install 'curiobench[tensorboard]'") from None


def _tensorboard(folder: Path, first_epoch: int) -> "SummaryWriter":
    """A log in a folder, which is created; rows from `first_epoch` on that a killed run left there are hidden."""
    from torch.utils.tensorboard import SummaryWriter  # seconds to import

    return SummaryWriter(str(folder), purge_step=first_epoch)
