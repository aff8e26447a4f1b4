"""Source and target of each pair: they differ as the pair says, pass the environment checkers and repeat from their seeds."""

from __future__ import annotations

import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
import stable_baselines3.common.env_checker
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mpge_bench.envs import ROBOTS, SOURCE_IDS, TARGET_IDS, TASKS, RobotEnv, Task, get_task
from mpge_bench.envs.errors import UserError

CLOSED_FORMS = {name: task for name, task in TASKS.items() if task.has_action_transformation}
#: What the checkers may say of our spaces: observations have no bounds, and the pendulum's actions reach ±3, all as in Gym.
HARMLESS = (".*Box observation space (minimum|maximum) value is -?infinity", ".*symmetric and normalized")

RUN = """
import hashlib, gymnasium, numpy as np, mpge_bench.envs
for id in {ids}:
    env = gymnasium.make(id)
    env.action_space.seed(3)
    heard = [env.reset(seed=3)[0].tobytes()]
    for _ in range(60):
        observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        heard.append(observation.tobytes() + np.float64(reward).tobytes())
        if terminated or truncated:
            heard.append(env.reset()[0].tobytes())
    print(hashlib.sha256(b"".join(heard)).hexdigest())
"""


def step_both(task: Task, source: RobotEnv, target: RobotEnv, rng: np.random.Generator, *, transformed: bool) -> tuple[np.ndarray, np.ndarray]:
    """States that source and target reach from one random state under one random action, which may be transformed for the source."""
    robot = task.robot
    q, dq = robot.initial_state(rng)
    dq += rng.uniform(-1, 1, dq.size)
    action = rng.uniform(-1, 1, len(robot.actuators)).astype(np.float32).astype(float) * robot.action_limit
    executed = task.action_transformation(action[None])[0] if transformed else action
    reached = []
    for env, given_action in ((source, executed), (target, action)):
        env.world.set_state(q, dq)
        env.step(given_action)
        reached.append(np.concatenate((env.world.q, env.world.dq)))
    return reached[0], reached[1]


@pytest.mark.parametrize("task", TASKS.values(), ids=TASKS)
def test_source_and_target_move_differently(task: Task) -> None:
    rng, source, target = np.random.default_rng(0), task.source(), task.target()
    differences = [np.abs(np.subtract(*step_both(task, source, target, rng, transformed=False))).max() for _ in range(50)]
    assert np.median(differences) > 0.05


def test_the_pairs_known_in_closed_form() -> None:
    assert set(CLOSED_FORMS) >= {"biased_pendulum", "broken_hopper", "broken_cheetah"}
    assert "heavy_cheetah" not in CLOSED_FORMS
    with pytest.raises(ValueError, match=r"heavy_cheetah: .* not known in closed form"):
        TASKS["heavy_cheetah"].action_transformation(np.zeros((1, 6)))


@pytest.mark.parametrize("task", CLOSED_FORMS.values(), ids=CLOSED_FORMS)
def test_the_true_transformation_makes_the_source_move_as_the_target(task: Task) -> None:
    rng, source, target = np.random.default_rng(1), task.source(), task.target()
    for _ in range(200):
        in_source, in_target = step_both(task, source, target, rng, transformed=True)
        assert in_source.tobytes() == in_target.tobytes()


@settings(deadline=None)
@given(arrays(float, (4, 1), elements=st.floats(-10, 10)))
def test_the_biased_pendulum_adds_to_the_action(action: np.ndarray) -> None:
    expected = np.clip(np.clip(action, -3, 3) + 1.5, -3, 3)
    assert TASKS["biased_pendulum"].action_transformation(action) == pytest.approx(expected)


@settings(deadline=None)
@given(st.sampled_from(["broken_hopper", "broken_cheetah"]), st.data())
def test_the_broken_robots_lose_the_first_action(name: str, data: st.DataObject) -> None:
    action = data.draw(arrays(float, (4, len(TASKS[name].robot.actuators)), elements=st.floats(-2, 2)))
    expected = np.clip(action, -1, 1)
    expected[:, 0] = 0
    assert TASKS[name].action_transformation(action) == pytest.approx(expected)


@settings(deadline=None)
@given(st.sampled_from(sorted(CLOSED_FORMS)), st.data())
def test_the_transformation_keeps_to_the_action_range_row_by_row(name: str, data: st.DataObject) -> None:
    task = CLOSED_FORMS[name]
    limit = task.robot.action_limit
    action = data.draw(arrays(float, (5, len(task.robot.actuators)), elements=st.floats(-2 * limit, 2 * limit)))
    given_action = action.copy()
    transformed = task.action_transformation(action)
    assert np.array_equal(action, given_action)
    assert np.abs(transformed).max() <= limit
    assert np.array_equal(transformed, np.concatenate([task.action_transformation(row[None]) for row in action]))
    assert np.array_equal(transformed, task.action_transformation(np.clip(action, -limit, limit)))


def test_the_heavy_cheetah_weighs_20_kg() -> None:
    task = TASKS["heavy_cheetah"]
    source, target = task.source().world, task.target().world
    masses = [np.array([world.mass_of(link) for link in world.links]) for world in (source, target)]
    assert [mass.sum() for mass in masses] == pytest.approx([14.0, 20.0])
    assert masses[1] / masses[0] == pytest.approx(20 / 14)


def test_a_task_that_is_not_there_is_refused_with_the_list() -> None:
    assert get_task("broken_hopper") is TASKS["broken_hopper"]
    with pytest.raises(UserError, match=r"'brokenhopper'.*biased_pendulum, broken_hopper"):
        get_task("brokenhopper")


@pytest.mark.parametrize("name", [*SOURCE_IDS.values(), *TARGET_IDS.values()])
def test_the_registered_environments_pass_the_checkers(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for message in HARMLESS:
            warnings.filterwarnings("ignore", message)
        check_env(gymnasium.make(name).unwrapped)
        stable_baselines3.common.env_checker.check_env(gymnasium.make(name).unwrapped)


def test_the_ids_lead_to_source_and_target() -> None:
    assert SOURCE_IDS["half_cheetah"] == "mpge_bench/HalfCheetah-v0"
    assert TARGET_IDS["broken_hopper"] == "mpge_bench/BrokenHopper-v0"
    for robot, name in SOURCE_IDS.items():
        env = gymnasium.make(name).unwrapped
        assert type(env.robot) is type(ROBOTS[robot])
        assert env.world.effects == tuple(ROBOTS[robot].nominal)
    for task, name in TARGET_IDS.items():
        env = gymnasium.make(name).unwrapped
        assert type(env.robot) is type(TASKS[task].robot)
        assert set(TASKS[task].effects) <= set(env.world.effects)
    assert gymnasium.spec(SOURCE_IDS["hopper"]).max_episode_steps == 1000


def test_envs_imports_without_torch_and_without_a_word() -> None:
    code = "import mpge_bench.envs, sys; assert 'torch' not in sys.modules"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (process.returncode, process.stdout, process.stderr) == (0, "", "")


def test_a_seed_repeats_its_episodes_in_any_process() -> None:
    code = RUN.format(ids=[*SOURCE_IDS.values(), *TARGET_IDS.values()])
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split() for _ in range(2)]
    assert runs[0] == runs[1]
    assert len(set(runs[0])) == len(SOURCE_IDS) + len(TARGET_IDS)
