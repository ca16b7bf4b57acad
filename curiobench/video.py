"""Films of an agent at work, without a screen."""

import re
from pathlib import Path

import numpy as np

from curiobench.config import RunConfig
from curiobench.methods.sac import SAC
from curiobench.tasks import BatchedStacking
from curiobench.tasks.registration import EPISODE_STEPS
from curiobench.tasks.rendering import WorldRenderer
from curiobench.tasks.robots import CONTROL_TIMESTEP

SUFFIXES = (".mp4", ".gif")


def film(
    agent: SAC, config: RunConfig, goal: str, out: Path | None, run: Path, episodes: int = 1, seed: int = 0
) -> tuple[Path, int]:
    """Film episodes from plain starts, by the deterministic policy, one after the other.

    Args:
        agent: acts.
        config: of its run.
        goal: what it pursues; anything that `GoalSpace.parse` understands.
        out: file to write; an mp4 in the run folder, named after the goal, if None.
        run: the run folder.
        episodes: at least 1.
        seed: of the starts.

    Returns:
        The file, and how many episodes ended in the goal.

    Raises:
        ValueError: an unknown goal or file type, no episode, the extra `video` is missing, or no way to write.
    """
    if episodes < 1:
        raise ValueError(f"episodes is {episodes}; it must be at least 1")
    worlds = BatchedStacking(config.task, 1, config.robot, seed=seed)
    bits = worlds.goal_space.parse(goal)
    name = worlds.goal_space.names[worlds.goal_space.index(bits)]
    out = out or run / f"{re.sub(r'[^a-z]+', '_', name)}.mp4"
    if out.suffix not in SUFFIXES:
        raise ValueError(f"cannot write {out}: a video is {' or '.join(SUFFIXES)}")
    renderer = WorldRenderer(worlds.model)
    try:
        shots = [_episode(worlds, agent, bits, renderer) for _ in range(episodes)]
    finally:
        renderer.close()
    _write(out, np.concatenate([frames for frames, _ in shots]))
    return out, sum(success for _, success in shots)


def _episode(worlds: BatchedStacking, agent: SAC, goal: np.ndarray, renderer: WorldRenderer) -> tuple[np.ndarray, bool]:
    """Frames `(51, height, width, 3)` uint8 of one episode, and whether it ended in the goal."""
    seen = worlds.reset(goals=goal)
    frames = [renderer.render(worlds.qpos[0]).copy()]
    for _ in range(EPISODE_STEPS):
        seen, reward = worlds.step(
            agent.act(seen.observation, seen.achieved_goal, seen.desired_goal, deterministic=True)
        )
        frames.append(renderer.render(worlds.qpos[0]).copy())
    return np.stack(frames), bool(reward[0] > 0)


def _write(path: Path, frames: np.ndarray) -> None:
    try:
        import imageio.v3 as imageio
    except ImportError:
        raise ValueError("videos need the extra `video`: pip install 'curiobench[video]'") from None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".gif":
            imageio.imwrite(path, frames, duration=1000 * CONTROL_TIMESTEP, loop=0)
        else:
            imageio.imwrite(path, frames, fps=round(1 / CONTROL_TIMESTEP), macro_block_size=16)
    except OSError as error:
        raise ValueError(f"cannot write {path}: {error.strerror or error}") from None
