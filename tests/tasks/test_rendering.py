"""Pictures, and machines without OpenGL."""

import os
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import curiobench  # noqa: F401  (registers the environments)
from curiobench.tasks import opengl


@pytest.mark.parametrize("robot", ["gripper", "fetch"])
def test_pictures_show_the_scene(robot):
    environment = gym.make("curiobench/SemanticStack3-v0", robot=robot, render_mode="rgb_array")
    environment.reset(seed=0)
    picture = environment.render()
    environment.close()
    assert picture.shape == (480, 640, 3)
    red, green, blue = (picture.astype(int)[..., k] for k in range(3))
    for channel, others in ((red, (green, blue)), (green, (red, blue)), (blue, (red, green))):
        assert (channel - np.maximum(*others) > 40).sum() > 100  # a block of this colour is in sight


def test_pictures_have_the_size_and_the_camera_asked_for():
    kwargs = {"width": 96, "height": 64, "render_mode": "rgb_array"}
    env = gym.make("curiobench/SemanticStack2-v0", camera_name="overview", **kwargs)
    env.reset(seed=0)
    assert env.render().shape == (64, 96, 3)
    env.close()
    vector = gym.make_vec("curiobench/SemanticStack2-v0", num_envs=2, **kwargs)
    vector.reset(seed=0)
    first, second = vector.render()
    assert first.shape == (64, 96, 3)
    assert (first != second).any()
    vector.close()


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"camera_name": "overveiw"}, "unknown camera 'overveiw': did you mean 'overview'"),
        ({"width": 0}, "the width of a picture is 1 to 1920 pixels, got 0"),
        ({"height": 1441}, "the height of a picture is 1 to 1440 pixels, got 1441"),
        ({"render_mode": "ascii"}, "unknown render mode 'ascii'"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*render_mode.*")
def test_bad_input(kwargs, message):
    with pytest.raises(ValueError, match=message):
        gym.make("curiobench/SemanticStack2-v0", **kwargs)


_STEP_AND_DRAW = """
import numpy as np, curiobench, os
from curiobench.tasks import load
from curiobench.tasks.gym_env import SemanticStackEnv
env = SemanticStackEnv("stack2", render_mode="rgb_array")
env.reset(seed=0)
env.step(np.zeros(4))
load("stack2").reset()
try:
    env.render()
except ValueError as error:
    print(os.environ["MUJOCO_GL"], error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux draws without a screen")
@pytest.mark.parametrize("variables", [{}, {"MUJOCO_GL": "nothing"}])
def test_worlds_step_without_opengl_and_pictures_name_what_to_install(tmp_path, variables):
    for name in ("libEGL.so.1", "libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so", "libGL.so.1", "libOpenGL.so.0"):
        (tmp_path / name).touch()  # found first, and no library
    environment = {k: v for k, v in os.environ.items() if k not in ("MUJOCO_GL", "PYOPENGL_PLATFORM", "DISPLAY")}
    environment |= {"LD_LIBRARY_PATH": str(tmp_path)} | variables
    done = subprocess.run([sys.executable, "-c", _STEP_AND_DRAW], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    line, *more = done.stdout.splitlines()
    assert not more
    assert line.startswith("disabled pictures need OpenGL, and none works here")
    assert ("MUJOCO_GL=nothing:" in line) == ("nothing" in variables.values())
    assert "libegl1" in line
    assert "libosmesa6" in line
    assert "ignored" not in done.stderr  # by a half-made renderer, when it is thrown away


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has the choice")
@pytest.mark.parametrize(
    ("variables", "chosen"),
    [
        ({"MUJOCO_GL": "GLFW"}, "glfw"),
        ({"MUJOCO_GL": "off"}, "off"),
        ({"DISPLAY": ":0"}, None),
        ({"MUJOCO_GL": "nothing"}, "disabled"),
        ({"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "glx"}, "disabled"),
    ],
)
def test_the_users_choice_of_opengl_is_kept_where_it_works(monkeypatch, variables, chosen):
    for name in ("MUJOCO_GL", "PYOPENGL_PLATFORM", "DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    opengl.choose()
    assert os.environ.get("MUJOCO_GL") == chosen


def test_egl_without_a_device_is_none(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(opengl, "_egl_devices", lambda: 0)
    opengl.choose()
    assert os.environ["MUJOCO_GL"] == "disabled"
