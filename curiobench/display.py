"""What a run shows while it trains: a live line on a terminal, a line an epoch elsewhere."""

import time
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from curiobench.config import RunConfig
from curiobench.evaluation import Evaluation
from curiobench.training_state import Counters


class Display:
    """Prints a line when an epoch ends; on a terminal, keeps one line up to date in between."""

    def __init__(self, config: RunConfig) -> None:
        self._config = config
        self._console = Console(soft_wrap=True, highlight=False)
        terminal = self._console.is_terminal
        self._live = Live(console=self._console, refresh_per_second=4, transient=True) if terminal else None
        if self._live:
            self._live.start()
        self._learned = "-"
        self._before: tuple[float, int, int, int] | None = None
        self._rates = ""

    def evaluation(self, evaluation: Evaluation) -> None:
        """Remember the learned goals of each layer."""
        layers = evaluation.learned_by_layer().items()
        self._learned = " ".join(f"L{layer} {learned}/{goals}" for layer, (learned, goals) in layers)

    def cycle(self, counters: Counters) -> None:
        """Called after every cycle."""
        now = time.monotonic()
        done = counters.epoch * self._config.cycles + counters.cycle
        if self._before is None:
            self._before = (now, counters.steps, counters.updates, done)
            return
        started, steps, updates, cycles = self._before
        seconds = max(now - started, 1e-9)
        left = (self._config.epochs * self._config.cycles - done) * seconds / (done - cycles)
        steps_rate, updates_rate = (counters.steps - steps) / seconds, (counters.updates - updates) / seconds
        self._rates = f"{steps_rate:,.0f} steps/s  {updates_rate:,.1f} updates/s  {_duration(left)} left"
        if self._live:
            where = f"epoch {counters.epoch + 1}/{self._config.epochs}  cycle {counters.cycle}/{self._config.cycles}"
            self._live.update(Text(f"{where}  learned {self._learned}  {self._rates}"))

    def epoch(self, row: dict[str, Any]) -> None:
        """Called with every row of progress.csv."""
        rate = row["training_success_unsatisfied"]
        self.note(
            f"epoch {row['epoch']}/{self._config.epochs}  learned {self._learned}"
            f"  success {'-' if row['success'] is None else format(row['success'], '.2f')}"
            f"  in training {'-' if rate is None else format(rate, '.2f')}  {self._rates}"
        )

    def note(self, text: str) -> None:
        """Print a line above the live one."""
        self._console.print(text, markup=False)

    def close(self) -> None:
        """Remove the live line."""
        if self._live:
            self._live.stop()


def _duration(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}"
