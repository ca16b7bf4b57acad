"""Presets: the scale and the agent of a run, by name and task. docs/presets.md says how they were found."""

from dataclasses import replace
from types import MappingProxyType

from curiobench.config import PRESET_NAMES, RunConfig
from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.replay import ReplayConfig
from curiobench.tasks.registration import check_name

_LAPTOP = RunConfig(
    preset="laptop",
    epochs=28,
    cycles=20,
    worlds=64,
    rollouts=1,
    updates=240,
    batch_size=256,
    starts="plain",
    biased_from_epoch=0,
    curriculum="near",
    schedule_epochs=28,
    evaluate_every=4,
    replay=ReplayConfig(relabelling="arrivals", pursued_share=0.25, satisfied_cap=0.2),
    hybrid=HybridConfig(popart_rate=3e-3),
    sac=SACConfig(
        gamma=0.95,
        decay_updates=28 * 20 * 240,
        temperature=0.02,
        entropy_in_targets=False,
        reward_window=1_000,
        actor_every=2,
        network="pair_attention",
        hidden=64,
        pairs="roles",
        features="near_field",
        detail_scale=0.1,
    ),
)

PRESETS = MappingProxyType(
    {
        # 40 M steps. DECSTR sums the gradients of 16 workers with a batch of 256 each; Adam does not see the factor
        # between that sum and the mean over one batch of 16 × 256
        "paper": RunConfig(preset="paper", worlds=16, rollouts=2, updates=30, batch_size=16 * 256),
        "laptop": _LAPTOP,
        "smoke": replace(
            _LAPTOP,
            preset="smoke",
            epochs=5,
            cycles=8,
            worlds=32,
            updates=20,
            schedule_epochs=5,
            evaluate_every=1,
            episodes_per_goal=10,
            replay=replace(_LAPTOP.replay, capacity=2_000),
            sac=replace(_LAPTOP.sac, decay_updates=5 * 8 * 20),
        ),
    }
)
"""Configs by name; task, method, seed and robot are each run's own. `preset` gives the one of a task."""

_BY_TASK = MappingProxyType(
    {
        ("laptop", "stack2"): {
            "epochs": 6,
            "cycles": 40,
            "updates": 60,
            "batch_size": 1024,
            "schedule_epochs": 6,
            "evaluate_every": 1,
            "replay": replace(_LAPTOP.replay, pursued_share=0.0),
            "sac": replace(_LAPTOP.sac, decay_updates=14_400),
        }
    }
)
"""Fields of a preset that are others for a task."""

PRESET_LINES = MappingProxyType(
    {
        "paper": "the paper's full scale: 500 epochs, 40 M steps; 9 to 15 days on one core",
        "laptop": "what plain SAC needs on one core: minutes for stack2, half an hour for stack3",
        "smoke": "a minute: shows that everything works, learns next to nothing",
    }
)
"""One line on each preset."""


def preset(name: str, task: str) -> RunConfig:
    """The config of a preset for a task. Raises ValueError where one of them is unknown."""
    check_name("preset", name, PRESET_NAMES)
    return replace(PRESETS[name], task=task, **_BY_TASK.get((name, task), {}))
