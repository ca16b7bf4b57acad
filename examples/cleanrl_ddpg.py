"""DDPG with hindsight relabelling (Andrychowicz et al. 2017) in one file, as in CleanRL: `python
examples/cleanrl_ddpg.py 2 300` trains on two blocks for 300 rounds of 32 episodes. Needs PyTorch, no extra."""

import copy
import sys

import gymnasium
import numpy as np
import torch
from torch import nn

BLOCKS, ROUNDS = map(int, sys.argv[1:])
N, T, UPDATES, BATCH, GAMMA, TAU, NOISE, HINDSIGHT = 32, 50, 40, 512, 0.95, 0.01, 0.2, 0.8
torch.manual_seed(0)
torch.set_num_threads(1)
rng = np.random.default_rng(0)
env_id = f"curiobench:curiobench/SemanticStack{BLOCKS}-v0"
envs = gymnasium.make_vec(env_id, num_envs=N, vectorization_mode="vector_entry_point").unwrapped
PARTS = "observation", "achieved_goal", "desired_goal"
D, G, _ = (envs.single_observation_space[part].shape[0] for part in PARTS)
A = envs.single_action_space.shape[0]


def network(inputs, outputs):
    return nn.Sequential(nn.Linear(inputs, 256), nn.ReLU(), nn.Linear(256, 256), nn.ReLU(), nn.Linear(256, outputs))


nets = nn.ModuleDict({"actor": nn.Sequential(network(D + G, A), nn.Tanh()), "critic": network(D + G + A, 1)})
targets = copy.deepcopy(nets)
adams = {name: torch.optim.Adam(net.parameters(), 1e-3) for name, net in nets.items()}
shapes = (T + 1, D), (T + 1, G), (T + 1, G), (T, A)
seen, achieved, desired, actions = (np.zeros((ROUNDS * N, *shape), np.float32) for shape in shapes)
for done in range(N, ROUNDS * N + 1, N):
    rows, (new, _) = slice(done - N, done), envs.reset(options={"biased": True})
    for t in range(T + 1):
        seen[rows, t], achieved[rows, t], desired[rows, t] = (new[part] for part in PARTS)
        if t < T:
            state = torch.as_tensor(np.concatenate([seen[rows, t], desired[rows, t]], 1))
            action = nets["actor"](state).detach().numpy() + rng.normal(0, NOISE, (N, A))
            actions[rows, t] = np.where(rng.random((N, 1)) < NOISE, rng.uniform(-1, 1, (N, A)), action.clip(-1, 1))
            new, *_ = envs.step(actions[rows, t])
    for _ in range(UPDATES):
        e, t = rng.integers(done, size=BATCH), rng.integers(T, size=BATCH)
        goal = np.where(rng.random((BATCH, 1)) < HINDSIGHT, achieved[e, rng.integers(t + 1, T + 1)], desired[e, t])
        reward = torch.as_tensor(envs.compute_reward(achieved[e, t + 1], goal, {}))[:, None].float()
        now, then = (torch.as_tensor(np.concatenate([seen[e, k], goal], 1)) for k in (t, t + 1))
        with torch.no_grad():
            value = targets["critic"](torch.cat([then, targets["actor"](then)], 1))
            target = (reward + GAMMA * value).clamp(0, 1 / (1 - GAMMA))
        error = nets["critic"](torch.cat([now, torch.as_tensor(actions[e, t])], 1)) - target
        chosen = nets["actor"](now)
        score = nets["critic"](torch.cat([now, chosen], 1)) - chosen.square().mean()
        for name, loss in (("actor", -score.mean()), ("critic", error.square().mean())):
            adams[name].zero_grad()
            loss.backward()
            adams[name].step()
        for target, net in zip(targets.parameters(), nets.parameters(), strict=True):
            target.data.lerp_(net.data, TAU)
    held = (achieved == desired).all(2)[max(0, done - 20 * N) : done]
    print(f"round {done // N}: {held[~held[:, 0], -1].mean():.2f} of the goals that did not hold at the start")
