"""Updates against stable-baselines3's SAC with HerReplayBuffer: same environment, batch size and hidden units.

Both draw relabelled batches from 40 random episodes and make their gradient steps. Ours is a Deep Sets network over
pairs of blocks, theirs a plain two-layer perceptron, which does fewer products.
"""

import gymnasium
import numpy as np
import pytest
import torch
from side_by_side import ratio, side_by_side

import curiobench  # noqa: F401  (registers the environments)
from curiobench.build import pair_layout
from curiobench.methods.agents.sac import SAC
from curiobench.methods.agents.settings import SACConfig
from curiobench.methods.process import tune_process
from curiobench.methods.reward import Batch
from curiobench.replay import EpisodeReplay, ReplayConfig
from curiobench.rollout import collect
from curiobench.tasks import BatchedStacking

EPISODES, UPDATES = 40, 10
SIZES = [("stack2", 512, 64), ("stack2", 256, 256), ("stack3", 512, 64), ("stack3", 256, 256)]
"""(task, batch, hidden units)"""


def our_updates(task: str, batch: int, hidden: int):
    """Ten updates of our agent, sampling included."""
    worlds = BatchedStacking(task, EPISODES, seed=0)
    space = worlds.goal_space
    agent = SAC(pair_layout(space), SACConfig(hidden=hidden), torch.Generator().manual_seed(0))
    replay = EpisodeReplay(ReplayConfig(), space.goals, 50, worlds.observation_size, 4, space.on_bits)
    rng = np.random.default_rng(0)
    worlds.reset(biased=True)
    episodes, _ = collect(worlds, agent, space.goals[rng.integers(len(space), size=EPISODES)])
    replay.add(episodes)
    agent.observe(episodes.observation, episodes.achieved_goal, episodes.achieved_goal)

    def run() -> None:
        for _ in range(UPDATES):
            agent.update(Batch.from_numpy(replay.sample(batch, rng)))

    return run


def their_updates(task: str, batch: int, hidden: int):
    """Ten gradient steps of stable-baselines3's SAC, sampling included."""
    sb3 = pytest.importorskip("stable_baselines3")
    model = sb3.SAC(
        "MultiInputPolicy",
        gymnasium.make(f"curiobench/SemanticStack{task[-1]}-v0"),
        replay_buffer_class=sb3.HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        learning_starts=10**9,
        batch_size=batch,
        policy_kwargs={"net_arch": [hidden, hidden]},
        seed=0,
    )
    model.learn(EPISODES * 50)
    return lambda: model.train(gradient_steps=UPDATES, batch_size=batch)


@pytest.mark.parametrize(("task", "batch", "hidden"), SIZES)
def test_updates_a_second(benchmark, capsys, task, batch, hidden):
    tune_process(1)
    ways = {"ours": our_updates(task, batch, hidden), "sb3": their_updates(task, batch, hidden)}
    seconds = benchmark.pedantic(side_by_side, args=(ways, 10), rounds=1)
    with capsys.disabled():
        print(
            f"\n  {task}, batch {batch}, hidden {hidden}: {ratio(seconds, 'sb3', 'ours'):.2f} × their updates a second"
        )
