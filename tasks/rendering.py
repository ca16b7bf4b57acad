"""Pictures of a world, without a screen."""

import mujoco
import numpy as np

from curiobench.tasks.scene import CAMERA

HEIGHT, WIDTH = 480, 640


class WorldRenderer:
    """Draws states of one compiled model from the overview camera; close it when done.

    Needs a working OpenGL: EGL or OSMesa without a screen (environment variable MUJOCO_GL).
    """

    def __init__(self, model: mujoco.MjModel, height: int = HEIGHT, width: int = WIDTH):
        self._model = model
        self._data = mujoco.MjData(model)
        self._renderer = mujoco.Renderer(model, height, width)

    def render(self, qpos: np.ndarray, camera: str = CAMERA) -> np.ndarray:
        """The picture `(height, width, 3)` uint8 of a world at positions `(nq,)`."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._renderer.update_scene(self._data, camera=camera)
        return self._renderer.render()

    def close(self) -> None:
        """Frees the OpenGL context; without it some drivers complain when the interpreter ends."""
        self._renderer.close()
