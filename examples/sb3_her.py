"""stable-baselines3's SAC with hindsight replay on a task of curiobench, tested as curiobench tests its own agents.

    python examples/sb3_her.py stack2 --minutes 6 --out runs/sb3-stack2.csv

Episodes start biased, as in the paper's later epochs. Needs the extras `train` and `sb3`.
"""

import argparse
import csv
import time
from pathlib import Path

import gymnasium
import stable_baselines3
import torch

from curiobench.evaluation import Evaluator
from curiobench.tasks import TASKS, task_spec


class BiasedStarts(gymnasium.Wrapper):
    """Episodes that start with stacks and held blocks, like those of a training run."""

    def reset(self, *, seed=None, options=None):
        return self.env.reset(seed=seed, options={"biased": True, **(options or {})})


class Policy:
    """A model of stable-baselines3 as `Evaluator` asks for it."""

    def __init__(self, model):
        self.model = model

    def act(self, observation, achieved_goal, desired_goal, deterministic=False):
        seen = {"observation": observation, "achieved_goal": achieved_goal, "desired_goal": desired_goal}
        return self.model.predict(seen, deterministic=deterministic)[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", choices=TASKS)
    parser.add_argument("--minutes", type=float, default=6.0, help="of training; tests are not counted")
    parser.add_argument("--tests", type=int, default=6, help="tests, evenly over that time")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("sb3.csv"), help="file with one row per test and goal")
    options = parser.parse_args()
    torch.set_num_threads(1)
    model = stable_baselines3.SAC(
        "MultiInputPolicy",
        BiasedStarts(gymnasium.make(task_spec(options.task).gym_id)),
        replay_buffer_class=stable_baselines3.HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        learning_starts=1000,
        gamma=0.95,
        learning_rate=1e-3,
        batch_size=256,
        policy_kwargs={"net_arch": [256, 256]},
        seed=options.seed,
    )
    evaluator, trained, steps = Evaluator(options.task, "gripper", episodes_per_goal=25), 0.0, 0
    with open(options.out, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["minutes", "steps", "updates", "goal", "layer", "success"])
        for test in range(1, options.tests + 1):
            while trained < 60 * options.minutes * test / options.tests:
                start = time.perf_counter()
                model.learn(1000, reset_num_timesteps=False)
                trained += time.perf_counter() - start
                steps += 1000
            for row in evaluator.evaluate(Policy(model)).rows():
                head = [f"{trained / 60:.2f}", steps, model._n_updates]
                writer.writerow([*head, row["goal"], row["layer"], row["success"]])
            file.flush()


if __name__ == "__main__":
    main()
