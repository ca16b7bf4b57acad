"""Off-screen rendering of a world."""

import mujoco
import numpy as np

from curiobench.tasks.opengl import no_opengl
from curiobench.tasks.registration import check_name
from curiobench.tasks.scene import CAMERA

HEIGHT, WIDTH = 480, 640


class WorldRenderer:
    """Renders states of one compiled model. Call `close` when done.

    It needs a working OpenGL. Without a screen that is EGL or OSMesa (environment variable MUJOCO_GL).
    """

    def __init__(self, model: mujoco.MjModel, height: int = HEIGHT, width: int = WIDTH, camera: str = CAMERA):
        """Opens an OpenGL context.

        Args:
          model: the compiled model.
          height: height of an image, in pixels.
          width: width of an image, in pixels.
          camera: name of one of the model's cameras.

        Raises:
          ValueError: the camera is unknown, a size is out of range, or OpenGL does not work.
        """
        check_picture(model, height, width, camera)
        self._model, self._camera = model, camera
        self._data = mujoco.MjData(model)
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # every backend raises a different type of error
            raise ValueError(no_opengl()) from error

    def render(self, qpos: np.ndarray) -> np.ndarray:
        """The image `(height, width, 3)` uint8 of a world at positions `(nq,)`."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._renderer.update_scene(self._data, camera=self._camera)
        return self._renderer.render()

    def close(self) -> None:
        """Frees the OpenGL context. Without this call some drivers print errors when the interpreter exits."""
        self._renderer.close()


def check_picture(model: mujoco.MjModel, height: int, width: int, camera: str) -> None:
    """Raises ValueError if the camera is unknown, or the image does not fit into the model's off-screen buffer."""
    check_name("camera", camera, tuple(model.camera(index).name for index in range(model.ncam)))
    limits = model.vis.global_
    for name, size, limit in (("height", height, limits.offheight), ("width", width, limits.offwidth)):
        if not isinstance(size, int | np.integer) or not 1 <= size <= limit:
            raise ValueError(f"the {name} of a picture is 1 to {limit} pixels, got {size!r}")
