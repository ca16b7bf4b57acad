"""SAC of stable-baselines3 with hindsight relabelling: `python examples/sb3_sac.py 2 50000` trains on two blocks for
50,000 steps. Needs the extra `sb3`. Its sibling sb3_her.py tests agents as curiobench tests its own."""

import sys

import torch
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.env_util import make_vec_env

BLOCKS, STEPS = map(int, sys.argv[1:] or (2, 50_000))
torch.set_num_threads(1)
model = SAC(
    "MultiInputPolicy",
    make_vec_env(f"curiobench:curiobench/SemanticStack{BLOCKS}-v0", n_envs=4, seed=0),
    replay_buffer_class=HerReplayBuffer,
    learning_starts=1000,
    gamma=0.95,
    learning_rate=1e-3,
    verbose=1,  # prints the success rate, which counts goals that held at the start
)
model.learn(STEPS)
