"""What a run shows while it trains: a line an epoch, and live lines below them on a terminal."""

import sys
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from curiobench.config import RunConfig
from curiobench.learned_goals import Layers
from curiobench.state import Counters


class Display:
    """Prints a line when an epoch ends; on a terminal, keeps two more up to date in between."""

    def __init__(self, config: RunConfig) -> None:
        self._config = config
        self._console = Console(soft_wrap=True, highlight=False)
        terminal = sys.stdout.isatty()
        self._live = Live(console=self._console, refresh_per_second=4, transient=True) if terminal else None
        if self._live:
            self._live.start()
        self._learned = "-"
        self._rates = ""

    def evaluation(self, layers: Layers) -> None:
        """Called with the learned goals of every evaluation."""
        self._learned = " ".join(f"L{layer} {learned}/{goals}" for layer, (learned, goals) in layers.items())

    def cycle(self, counters: Counters) -> None:
        """Called after every cycle."""
        done = counters.epoch * self._config.cycles + counters.cycle
        left = sum(counters.seconds.values()) * (self._config.epochs * self._config.cycles / done - 1)
        steps = counters.steps / counters.seconds["collecting"]
        updates = counters.updates / (counters.seconds["sampling"] + counters.seconds["updating"])
        self._rates = f"{steps:,.0f} steps/s  {updates:,.1f} updates/s  {_duration(left)} left"
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

    def note(self, text: str) -> None:
        """Print a line above the live ones."""
        self._console.print(text, markup=False)

    def close(self) -> None:
        """Remove the live lines."""
        if self._live:
            self._live.stop()


def _duration(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}"
