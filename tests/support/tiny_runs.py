"""A config that trains in about a second, and what two of its runs must agree in."""

from pathlib import Path

from curiobench.config import RunConfig
from curiobench.methods.agents.settings import SACConfig
from curiobench.replay import ReplayConfig
from curiobench.run_folder import read_rows
from curiobench.state import WALL_CLOCK

TINY = RunConfig(
    task="stack2",
    preset="smoke",
    epochs=3,
    cycles=2,
    worlds=4,
    rollouts=1,
    updates=2,
    batch_size=16,
    biased_from_epoch=1,
    curriculum="near",
    evaluate_every=2,
    episodes_per_goal=2,
    replay=ReplayConfig(capacity=18, satisfied_cap=0.2, relabelling="arrivals", pursued_share=0.25),
    sac=SACConfig(
        hidden=8,
        network="pair_attention",
        pairs="roles",
        features="near_field",
        detail_scale=0.1,
        actor_every=2,
        decay_updates=8,
    ),
)
"""Its replay overflows in the third epoch; the agent is the laptop preset's, in small."""


def numbers(path: Path) -> tuple[list[dict[str, str]], str]:
    """All rows of a run's csv files, without the wall-clock columns."""
    progress = [
        {name: value for name, value in row.items() if name not in WALL_CLOCK}
        for row in read_rows(path / "progress.csv")
    ]
    return progress, (path / "evaluations.csv").read_text()
