"""Videos of an agent, rendered off-screen."""

import re
import tempfile
from contextlib import closing
from pathlib import Path

import numpy as np

from curiobench.config import RunConfig
from curiobench.files import replace_file
from curiobench.methods.agents.agent import LearningAgent
from curiobench.rollout import play, policy
from curiobench.tasks import BatchedStacking
from curiobench.tasks.observation import CONTROL_TIMESTEP
from curiobench.tasks.rendering import WorldRenderer

SUFFIXES = (".mp4", ".gif", ".webp")


def film(
    agent: LearningAgent, config: RunConfig, goal: str, out: Path | None, run: Path, episodes: int = 1, seed: int = 0
) -> tuple[Path, int]:
    """Record episodes of the deterministic policy from plain starts, one after the other, in one video.

    Args:
        agent: the agent that acts.
        config: config of the agent's run.
        goal: desired goal of all episodes, in a form that `GoalSpace.parse` accepts.
        out: file to write; if None, an mp4 in the run folder, named after the goal.
        run: the run folder.
        episodes: number of episodes, at least 1.
        seed: seed of the starts.

    Returns:
        The file, and the number of episodes that ended in the goal.

    Raises:
        ValueError: the goal or file type is unknown, there is no episode, the extra `video` is missing, or the file
            cannot be written.
    """
    if episodes < 1:
        raise ValueError(f"episodes is {episodes}; it must be at least 1")
    if seed < 0:
        raise ValueError(f"seed is {seed}; it must be at least 0")
    try:
        import imageio.v3  # noqa: F401 - `_write` needs it, after all the work
    except ImportError:
        raise ValueError("videos need the extra `video`: pip install 'curiobench[video]'") from None
    worlds = BatchedStacking(config.task, 1, config.robot, seed=seed)
    bits = worlds.goal_space.parse(goal)
    name = worlds.goal_space.names[worlds.goal_space.index(bits)]
    out = out or run / f"{re.sub(r'[^a-z]+', '_', name)}.mp4"
    if out.suffix not in SUFFIXES:
        raise ValueError(f"cannot write {out}: a video is {' or '.join(SUFFIXES)}")
    frames, reached = [], 0
    with closing(WorldRenderer(worlds.model)) as renderer:
        for _ in range(episodes):
            observation, act = worlds.reset(goals=bits), policy(agent, deterministic=True)
            played = play(worlds, observation, act, lambda: frames.append(renderer.render(worlds.qpos[0]).copy()))
            reached += int(played.reward[0] > 0)
    _write(out, np.stack(frames))
    return out, reached


def _write(path: Path, frames: np.ndarray) -> None:
    """Write frames `(T, height, width, 3)` uint8."""
    from imageio.v3 import imwrite

    if path.suffix != ".mp4":
        options = {"duration": 1000 * CONTROL_TIMESTEP, "loop": 0}
    else:
        options = {"fps": round(1 / CONTROL_TIMESTEP), "macro_block_size": 16}
    try:
        content = imwrite("<bytes>", frames, extension=path.suffix, **options)
        if path.suffix == ".mp4" and b"moov" not in content:  # the index at the file's end is missing if ffmpeg failed
            raise OSError(f"ffmpeg wrote no complete video; is there space in {tempfile.gettempdir()}?")
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, lambda file: file.write(content))
    except OSError as error:
        why = (error.strerror or str(error)).splitlines()[0]  # imageio appends what ffmpeg printed
        raise ValueError(f"cannot write {path}: {why}") from None
