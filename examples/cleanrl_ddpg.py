"""DDPG with hindsight relabelling in one file, as in CleanRL: `cleanrl_ddpg.py 2 150` plays 150 rounds of 32 episodes
with two blocks, and learns to bring them together or apart in a third of the episodes, but not to stack."""

import copy
import sys

import gymnasium
import numpy as np
import torch
from torch import nn

BLOCKS, ROUNDS = map(int, sys.argv[1:] or (2, 150))
N, T, UPDATES, BATCH, GAMMA, TAU, NOISE, HINDSIGHT = 32, 50, 60, 512, 0.95, 0.05, 0.2, 0.8
torch.set_num_threads(1)
torch.manual_seed(0)
rng = np.random.default_rng(0)
envs = gymnasium.make_vec(f"curiobench:curiobench/SemanticStack{BLOCKS}-v0", N, "vector_entry_point").unwrapped
PARTS = "observation", "achieved_goal", "desired_goal"
D, G, A = *(envs.single_observation_space[part].shape[0] for part in PARTS[:2]), envs.single_action_space.shape[0]
seen, achieved, desired, actions = (np.zeros((ROUNDS * N, T + 1, size), np.float32) for size in (D, G, G, A))


def inputs(e, t, goal):
    return torch.as_tensor(np.concatenate([((seen[e, t] - mean) / std).clip(-5, 5), achieved[e, t], goal], 1))


nets, mean, std = nn.ModuleDict(), np.zeros(D, np.float32), np.ones(D, np.float32)
for name, size, outputs in ("actor", D + 2 * G, A), ("critic", D + 2 * G + A, 1):
    nets[name] = nn.Sequential(nn.Linear(size, 256), nn.ReLU(), nn.Linear(256, 256), nn.ReLU(), nn.Linear(256, outputs))
targets = copy.deepcopy(nets)
adams = {name: torch.optim.Adam(net.parameters(), 1e-3) for name, net in nets.items()}
for done in range(N, ROUNDS * N + 1, N):
    rows, (new, _) = slice(done - N, done), envs.reset(seed=done, options={"biased": True})
    for t in range(T + 1):
        seen[rows, t], achieved[rows, t], desired[rows, t] = (new[part] for part in PARTS)
        if t < T:
            action = nets["actor"](inputs(rows, t, desired[rows, t])).tanh().data.numpy() + rng.normal(0, NOISE, (N, A))
            actions[rows, t] = np.where(rng.random((N, 1)) < NOISE, rng.uniform(-1, 1, (N, A)), action.clip(-1, 1))
            new, *_ = envs.step(actions[rows, t])
    mean, std = seen[:done].mean((0, 1)), seen[:done].std((0, 1)) + 0.01
    moved = np.flatnonzero((achieved[:done, 0] != achieved[:done, -1]).any(1))  # half of a batch is of these
    for _ in range(UPDATES):
        e, t = rng.integers(done, size=BATCH), rng.integers(T, size=BATCH)
        e[: BATCH // 2] = rng.choice(moved, BATCH // 2)
        goal = np.where(rng.random((BATCH, 1)) < HINDSIGHT, achieved[e, rng.integers(t + 1, T + 1)], desired[e, t])
        reward = torch.as_tensor(envs.compute_reward(achieved[e, t + 1], goal, {}))[:, None].float()
        now, then = inputs(e, t, goal), inputs(e, t + 1, goal)
        value = targets["critic"](torch.cat([then, targets["actor"](then).tanh()], 1)).detach()
        target = (reward + GAMMA * value).clamp(0, 1 / (1 - GAMMA))
        error = nets["critic"](torch.cat([now, torch.as_tensor(actions[e, t])], 1)) - target
        chosen = nets["actor"](now).tanh()
        score = nets["critic"](torch.cat([now, chosen], 1)) - chosen.square().mean()
        for name, loss in (("actor", -score.mean()), ("critic", error.square().mean())):
            adams[name].zero_grad()
            loss.backward()
            adams[name].step()
        for target, net in zip(targets.parameters(), nets.parameters(), strict=True):
            target.data.lerp_(net.data, TAU)
    held = (achieved == desired).all(2)[max(0, done - 20 * N) : done]
    print(f"round {done // N}: {held[~held[:, 0], -1].mean():.2f} of the goals that did not hold at the start")
