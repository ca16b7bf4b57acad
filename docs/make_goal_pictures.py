"""Draws a picture of every goal of stack2 and stack3, which reports show: `make goal-pictures`.

The pictures ship with the package, because a report needs neither MuJoCo nor a graphics driver. Blocks are placed so
that the goal holds, left to settle, checked, and seen from the front with their letters on them.
"""

from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from curiobench.tasks import BatchedStacking
from curiobench.tasks.goal_names import BLOCK_NAMES
from curiobench.tasks.goals import CLOSE_DISTANCE, GoalSpace, predicates
from curiobench.tasks.placements import BLOCK_SIZE
from curiobench.tasks.scene import BLOCK_REST_HEIGHT, TABLE_CENTRE

import mujoco  # isort: skip - after curiobench.tasks, which lets it draw without a screen

OUT = Path(__file__).parents[1] / "curiobench" / "analysis" / "goal_pictures"
TASKS = ("stack2", "stack3")
WIDTH, HEIGHT, QUALITY = 240, 180, 60
"""Pixels of a picture, twice what a report shows, and WebP's quality: some 1 kB each."""
OVERSAMPLING = 4
DISTANCE, AZIMUTH, ELEVATION = 0.60, 90.0, -30.0
"""Of the camera from the blocks (metres, degrees): it looks along y, so that x runs from left to right."""
FIELD_OF_VIEW = 25
"""From top to bottom (degrees)."""
CLOSE, APART = 0.061, 0.108
"""Distances at which blocks look close and, or farther, apart (metres)."""
MARGIN = 0.003
"""No pair is nearer than this to the limit of closeness (metres)."""
DRAWS = 300_000
SETTLING_STEPS = 25


def placement(space: GoalSpace, bits: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Centres `(n, 3)` in metres of a placement in which the goal `(n_bits,)` holds and can be seen, table height 0."""
    supports = {i: [] for i in range(space.n_blocks)}
    for pair in space.pairs:
        if bits[pair.on_ij]:
            supports[pair.i].append(pair.j)
        if bits[pair.on_ji]:
            supports[pair.j].append(pair.i)
    drawn = rng.uniform((-0.13, -0.07), (0.13, 0.07), (DRAWS, space.n_blocks, 2))
    drawn[: DRAWS // 2, :, 1] = 0  # in a row, where that is possible
    positions = np.zeros((DRAWS, space.n_blocks, 3))
    positions[..., :2] = drawn
    for _ in range(space.n_blocks):  # from the table upwards
        for block, below in supports.items():
            if below:
                positions[:, block] = positions[:, below].mean(axis=1) + (0, 0, BLOCK_SIZE)
    good = (predicates(positions) == bits).all(axis=1) & _possible(positions)
    return positions[good][np.argmin(_ugliness(positions[good], space, bits))]


def _possible(positions: np.ndarray) -> np.ndarray:
    """Whether no blocks of `(k, n, 3)` overlap and no pair is at the limit of closeness; `(k,)` bool."""
    first, second = np.triu_indices(positions.shape[1], k=1)
    offset = np.abs(positions[:, first] - positions[:, second])
    distance = np.linalg.norm(offset, axis=-1)
    return ((offset.max(axis=-1) > 0.999 * BLOCK_SIZE) & (np.abs(distance - CLOSE_DISTANCE) > MARGIN)).all(axis=1)


def _ugliness(positions: np.ndarray, space: GoalSpace, bits: np.ndarray) -> np.ndarray:
    """How far placements `(k, n, 3)` are from a centred row in alphabetical order, of clear distances; `(k,)`."""
    middle = (positions[..., :2].max(axis=1) + positions[..., :2].min(axis=1)) / 2
    total = (middle**2).sum(axis=-1) + (positions[..., 1] ** 2).sum(axis=1)
    for pair in space.pairs:
        offset = positions[:, pair.j] - positions[:, pair.i]
        beside = np.abs(offset[:, 2]) < 0.5 * BLOCK_SIZE
        distance = np.linalg.norm(offset, axis=-1)
        excess = distance - (CLOSE if bits[pair.close] else APART)
        total += beside * np.where((excess > 0) & ~bits[pair.close].astype(bool), 0.1, 1) * excess**2
        total += beside * np.maximum(0.05 - np.abs(offset[:, 0]), 0)  # one hides the other
        total += 1e-4 * (offset[:, 0] < -0.01)
    return total


def settled(worlds: BatchedStacking, positions: np.ndarray, goals: np.ndarray) -> np.ndarray:
    """Positions `(N, nq)` of the worlds after their blocks have come to rest; raises RuntimeError unless goals hold."""
    centre = np.array([TABLE_CENTRE[0], TABLE_CENTRE[1] - 0.2, BLOCK_REST_HEIGHT])  # away from the waiting hand
    worlds.place(np.arange(len(positions)), positions + centre)
    for _ in range(SETTLING_STEPS):
        seen, _ = worlds.step(np.zeros((len(positions), 4)))
    if not np.array_equal(seen.achieved_goal, goals):
        raise RuntimeError("blocks moved while they settled: a picture would show another goal")
    qpos = worlds.qpos.copy()
    qpos[:, worlds.model.joint("robot/hand_z").qposadr] += 1  # metres; out of the picture
    return qpos


def picture(renderer: mujoco.Renderer, data: mujoco.MjData, qpos: np.ndarray, blocks: np.ndarray) -> Image.Image:
    """The picture of a world at `(nq,)`, with letters on the fronts of blocks at centres `(n, 3)`."""
    model = renderer.model
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (TABLE_CENTRE[0], TABLE_CENTRE[1] - 0.2, BLOCK_REST_HEIGHT + 0.04)
    camera.distance, camera.azimuth, camera.elevation = DISTANCE, AZIMUTH, ELEVATION
    renderer.update_scene(data, camera=camera)
    image = Image.fromarray(renderer.render())
    font = ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans-Bold.ttf", 76)
    draw = ImageDraw.Draw(image)
    for name, block in zip(BLOCK_NAMES, blocks, strict=False):
        offset = blocks - block
        hidden = (offset[:, 1] < -0.01) & (np.abs(offset[:, 0]) < BLOCK_SIZE) & (np.abs(offset[:, 2]) < BLOCK_SIZE / 2)
        face = (0, 0, BLOCK_SIZE / 2) if hidden.any() else (0, -BLOCK_SIZE / 2, 0)
        draw.text(_project(renderer, block + face), name, "white", font, anchor="mm")
    return image.resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)


def _project(renderer: mujoco.Renderer, point: np.ndarray) -> tuple[float, float]:
    """Where a point `(3,)` in metres is in the picture, in pixels from the top left."""
    left, right = renderer.scene.camera  # a stereo pair; the picture is taken from between
    forward, up = np.array(left.forward), np.array(left.up)
    offset = point - (np.array(left.pos) + np.array(right.pos)) / 2
    depth = offset @ forward
    scale = 0.5 * renderer.height / (left.frustum_top / left.frustum_near) / depth
    return renderer.width / 2 + scale * (offset @ np.cross(forward, up)), renderer.height / 2 - scale * (offset @ up)


def draw_task(task: str) -> None:
    """Writes the pictures of a task, named by the goals' bits."""
    worlds = BatchedStacking(task, 1)
    space = worlds.goal_space
    worlds = BatchedStacking(task, len(space))
    rng = np.random.default_rng(0)
    qpos = settled(worlds, np.array([placement(space, bits, rng) for bits in space.goals]), space.goals)
    worlds.model.vis.global_.fovy = FIELD_OF_VIEW
    with mujoco.Renderer(worlds.model, OVERSAMPLING * HEIGHT, OVERSAMPLING * WIDTH) as renderer:
        data = mujoco.MjData(worlds.model)
        for goal, bits in enumerate(space.goals):
            image = picture(renderer, data, qpos[goal], worlds.block_positions[goal])
            image.save(OUT / f"{space.bit_string(bits)}.webp", quality=QUALITY, method=6)


if __name__ == "__main__":
    OUT.mkdir(exist_ok=True)
    for task in TASKS:
        draw_task(task)
        print(f"drawn: {task}", flush=True)
