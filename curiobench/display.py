"""Output of a run: lines on the terminal, and rows for trackers. It has no effect on the run."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from curiobench.terminal import draws
from curiobench.trackers import Trackers

if TYPE_CHECKING:
    from curiobench.config import RunConfig
    from curiobench.evaluation import Layers
    from curiobench.state import Counters


class Terminal(Console):
    """Standard output. If it is closed or its disk is full, output stops and the run goes on."""

    def say(self, text: str) -> None:
        """Print text as it is, its lines never broken."""
        self.print(Text(text), no_wrap=True, overflow="ignore", crop=False)

    def on_broken_pipe(self) -> None:
        """Rich's own would end the process."""
        self.quiet = True

    def __exit__(self, *exception: Any) -> None:
        """Rich writes here, what is printed and what is drawn live."""
        try:
            super().__exit__(*exception)
        except OSError:
            self.quiet = True


class Display:
    """Shows the progress of a run: one line per epoch, live lines on a terminal, and what trackers make of its rows."""

    def __init__(self, config: "RunConfig", folder: Path, first_epoch: int) -> None:
        """
        Args:
            config: of the run.
            folder: of the run.
            first_epoch: the first that is to come.
        """
        self._config = config
        self._console = Terminal()
        self._live = Live(console=self._console, refresh_per_second=4, transient=True) if draws() else None
        if self._live:
            self._live.start()
        self._learned = "-"
        self._rates = ""
        self._trackers = Trackers(config, folder, first_epoch, self.note)

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
        self._trackers.log(row)

    def note(self, text: str) -> None:
        """Print a line above the live ones."""
        self._console.say(text)

    def close(self) -> None:
        """Remove the live lines and close the trackers."""
        if self._live:
            self._live.stop()
        self._trackers.close()


def duration(seconds: float | None) -> str:
    """Hours, minutes and seconds, as 1:02:03; "-" where it is not known."""
    if seconds is None:
        return "-"
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}"
