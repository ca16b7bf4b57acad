"""The composer task: observations, rewards, episodes and errors."""

import mujoco
import numpy as np
import pytest
from dm_control import composer

from curiobench.tasks import ROBOTS, TASKS, load, task_spec
from curiobench.tasks.goals import predicates
from curiobench.tasks.observation import euler_angles, rotation_matrices

LETTERS = "abcde"


@pytest.fixture(scope="module", params=ROBOTS)
def environment(request) -> composer.Environment:
    return load("stack3", request.param, random_state=0)


def test_every_task_loads_and_has_the_layout_of_its_blocks():
    for task in TASKS:
        n_blocks = task_spec(task).n_blocks
        timestep = load(task, task_spec(task).robots[0], random_state=0).reset()
        assert timestep.observation["observation"].shape == (10 + 15 * n_blocks,)
        assert timestep.observation["desired_goal"].shape == (3 * n_blocks * (n_blocks - 1) // 2,)
        assert f"block_{LETTERS[n_blocks - 1]}/position" in timestep.observation


def test_physics_options_are_the_papers(environment):
    option = environment.physics.model.opt
    assert option.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert option.solver == mujoco.mjtSolver.mjSOL_NEWTON
    assert option.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    assert option.impratio == 1
    assert option.noslip_iterations == 0


def test_blocks_and_table_are_the_papers(environment):
    model = environment.physics.model.ptr
    for letter in "abc":
        geom = model.geom(f"block_{letter}/block")
        assert model.body(geom.bodyid[0]).mass[0] == pytest.approx(2)
        np.testing.assert_allclose(geom.size, 0.025)
        np.testing.assert_allclose(geom.friction, [1, 0.005, 0.0001])
        assert geom.condim[0] == 3
        np.testing.assert_allclose(model.joint(f"block_{letter}/free/").damping, 0.01)
    np.testing.assert_allclose(model.geom("table").size, [0.25, 0.35, 0.2])
    np.testing.assert_allclose(model.geom("table").pos, [1.3, 0.75, 0.2])


def _object_velocity(physics, kind, name: str) -> np.ndarray:
    """Angular, then linear velocity of a named object in the world frame, from MuJoCo itself."""
    velocity = np.zeros(6)
    index = mujoco.mj_name2id(physics.model.ptr, kind, name)
    mujoco.mj_objectVelocity(physics.model.ptr, physics.data.ptr, kind, index, velocity, 0)
    return velocity


def test_observation_agrees_with_mujoco(environment):
    """Every part, against MuJoCo's own kinematics, while blocks tumble."""
    timestep = environment.reset()
    physics = environment.physics
    for k in range(3):
        start = physics.model.ptr.joint(f"block_{'abc'[k]}/free/").dofadr[0]
        physics.data.qvel[start : start + 6] = np.random.default_rng(k).uniform(-2, 2, 6)
    for _ in range(4):
        timestep = environment.step(np.array([0.5, -0.3, 0.2, 0.7]))
    seen = timestep.observation
    grip = "robot/grip" if "robot/grip" in _site_names(physics) else "robot/robot0:grip"
    grip_position = physics.data.site_xpos[mujoco.mj_name2id(physics.model.ptr, mujoco.mjtObj.mjOBJ_SITE, grip)]
    grip_velocity = _object_velocity(physics, mujoco.mjtObj.mjOBJ_SITE, grip)[3:]
    np.testing.assert_allclose(seen["hand/grip_position"], grip_position, atol=1e-6)
    np.testing.assert_allclose(seen["hand/grip_velocity"], grip_velocity * 0.04, atol=1e-6)
    for k, letter in enumerate("abc"):
        body = physics.model.ptr.geom(f"block_{letter}/block").bodyid[0]
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(physics.model.ptr, physics.data.ptr, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
        position = physics.data.xpos[body]
        np.testing.assert_allclose(seen[f"block_{letter}/position"], position, atol=1e-6)
        np.testing.assert_allclose(seen[f"block_{letter}/relative_position"], position - grip_position, atol=1e-6)
        np.testing.assert_allclose(seen[f"block_{letter}/angular_velocity"], velocity[:3] * 0.04, atol=1e-6)
        relative = (velocity[3:] - grip_velocity) * 0.04
        np.testing.assert_allclose(seen[f"block_{letter}/relative_velocity"], relative, atol=1e-6)
        angles = euler_angles(physics.data.xmat[body].reshape(3, 3))
        np.testing.assert_allclose(seen[f"block_{letter}/euler_angles"], angles, atol=1e-5)
        part = seen["observation"][10 + 15 * k : 25 + 15 * k]
        names = ("position", "relative_position", "euler_angles", "relative_velocity", "angular_velocity")
        np.testing.assert_array_equal(part, np.concatenate([seen[f"block_{letter}/{name}"] for name in names]))


def _site_names(physics) -> list[str]:
    return [physics.model.ptr.site(i).name for i in range(physics.model.nsite)]


def test_euler_angles_rebuild_the_rotation():
    quaternions = np.random.default_rng(0).normal(size=(200, 4))
    rotation = rotation_matrices(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))

    def about(axis: int, angle: np.ndarray) -> np.ndarray:
        i, j = [k for k in range(3) if k != axis]
        sign = -1 if axis == 1 else 1
        matrix = np.tile(np.eye(3), (len(angle), 1, 1))
        matrix[:, i, i] = matrix[:, j, j] = np.cos(angle)
        matrix[:, i, j], matrix[:, j, i] = -sign * np.sin(angle), sign * np.sin(angle)
        return matrix

    x, y, z = euler_angles(rotation).T
    np.testing.assert_allclose(about(0, x) @ about(1, y) @ about(2, z), rotation, atol=1e-12)


def test_euler_angles_in_gimbal_lock_are_finite():
    half = 0.5**0.5
    angles = euler_angles(rotation_matrices(np.array([[half, 0, half, 0], [half, 0, -half, 0]])))
    np.testing.assert_allclose(angles[:, 1], [np.pi / 2, -np.pi / 2], atol=1e-6)
    assert np.isfinite(angles).all()


def test_reward_is_one_exactly_where_the_goal_holds():
    environment = load("stack2", goal="all apart", random_state=1)
    timestep = environment.reset()
    bits = predicates(np.array([timestep.observation[f"block_{letter}/position"] for letter in "ab"]))
    np.testing.assert_array_equal(timestep.observation["achieved_goal"], bits)
    rewards = {goal: _first_reward(environment, goal) for goal in ("all apart", "all close", "a on b", "b on a")}
    assert sum(rewards.values()) == 1
    assert rewards["all apart"] == float(not bits.any())


def _first_reward(environment: composer.Environment, goal: str) -> float:
    environment.task.set_goal(goal)
    environment._random_state.seed(1)
    environment.reset()
    return environment.step(np.zeros(4)).reward


def test_goals_are_drawn_from_all_valid_ones_and_seeds_repeat():
    def goals(seed: int) -> list[str]:
        environment = load("stack2", random_state=seed)
        return [str(environment.reset().observation["desired_goal"]) for _ in range(40)]

    assert len(set(goals(0))) == 4
    assert goals(0) == goals(0) != goals(1)


def test_biased_starts_are_biased():
    environment = load("stack3", biased=True, random_state=0)
    lifted = [environment.reset().observation["observation"][12::15].max() > 0.43 for _ in range(60)]
    assert 0.4 < np.mean(lifted) < 0.9


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "stack9"}, "unknown task 'stack9': did you mean 'stack"),
        ({"robot": "feth"}, "unknown robot 'feth': did you mean 'fetch'"),
        ({"goal": "d on a"}, "no block 'd'"),
        ({"goal": [0, 1]}, "9 bits"),
    ],
)
def test_bad_names_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        load(**arguments)


def test_bad_actions_are_refused():
    environment = load("stack2", random_state=0)
    environment.reset()
    with pytest.raises(ValueError, match="nan in entry 0"):
        environment.step(np.array([np.nan, 0, 0, 0]))


def test_a_missing_arm_names_the_extra_to_install(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"pip install 'curiobench\[fetch\]'"):
        load(robot="fetch")
