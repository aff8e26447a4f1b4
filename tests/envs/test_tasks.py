"""Source and target of each pair: they differ as the pair says, pass the environment checkers and repeat from their seeds."""

from __future__ import annotations

import importlib.util
import json
import math
import subprocess
import sys
import warnings
import xml.etree.ElementTree as ET

import gymnasium
import numpy as np
import pytest
import stable_baselines3.common.env_checker
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mpge_bench.envs import FAMILIES, FAMILY_IDS, ROBOTS, SOURCE_IDS, TARGET_IDS, TASKS, RobotEnv, Task, get_task
from mpge_bench.envs.classic import CLASSICS
from mpge_bench.envs.effects import effect_from_dict
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots import Robot
from mpge_bench.envs.task import TRACKS
from mpge_bench.harness.mismatch import stored_mismatches

CLASSIC_IDS = {FAMILY_IDS[name] for name in CLASSICS}
HAS_BOX2D = all(importlib.util.find_spec(package) for package in ("Box2D", "pygame"))
LANDER = "mpge_bench/MultipolarLunarLander-v0"
#: Every id, LunarLander's among them where it can run.
IDS = [
    pytest.param(name, marks=pytest.mark.skipif(name == LANDER and not HAS_BOX2D, reason="LunarLander needs Box2D and pygame, which are not installed"))
    for name in (*SOURCE_IDS.values(), *TARGET_IDS.values(), *FAMILY_IDS.values())
]
#: All pairs, and some instances of each robot's family.
PAIRS = {**TASKS, **{f"{family}_{instance}": FAMILIES[family].task(instance) for family in FAMILIES for instance in range(5)}}
CLOSED_FORMS = {name: task for name, task in TASKS.items() if task.has_action_transformation}
#: What the checkers may say of our spaces: observations have no bounds, and the pendulum's actions reach ±3, all as in Gym.
HARMLESS = (".*Box observation space (minimum|maximum) value is -?infinity", ".*symmetric and normalized")

RUN = """
import hashlib, gymnasium, numpy as np, mpge_bench.envs
for id in {ids}:
    env = gymnasium.make(id)
    env.action_space.seed(3)
    heard = [env.reset(seed=3)[0].tobytes()]
    for _ in range({steps}):
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


def apart(robot: RobotEnv, other: RobotEnv, episodes: int = 3, steps: int = 200) -> float:
    """How far the observations of two environments get apart, each from its own first one, in random episodes that start alike."""
    rng, farthest = np.random.default_rng(0), 0.0
    for seed in range(episodes):
        first = [env.reset(seed=seed)[0] for env in (robot, other)]
        for _ in range(steps):
            action = rng.uniform(robot.action_space.low, robot.action_space.high)
            reached = [env.step(action) for env in (robot, other)]
            moved = [one[0] - start for one, start in zip(reached, first, strict=True)]
            farthest = max(farthest, float(np.abs(moved[0] - moved[1]).max()))
            if any(one[2] for one in reached):
                break
    return farthest


#: In PyBullet this one hardly shows, as its note says; `slippery_hopper` is there instead.
NEARLY_INVISIBLE = {"high_friction_hopper"}


@pytest.mark.parametrize("name", PAIRS)
def test_no_pairs_source_and_target_move_alike(name: str) -> None:
    task = PAIRS[name]
    distance = apart(task.source(), task.target())
    assert distance > (1e-6 if name in NEARLY_INVISIBLE else 0.05)


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_what_is_alike_moves_alike(robot: Robot) -> None:
    assert apart(RobotEnv(robot), RobotEnv(robot), episodes=2, steps=100) == 0


@pytest.mark.slow
def test_every_pair_differs_from_every_other_of_its_robot() -> None:
    found = [(name, task) for name, task in TASKS.items()]
    for index, (name, task) in enumerate(found):
        for other, another in found[:index]:
            if task.robot is another.robot:
                assert apart(task.target(), another.target(), episodes=1) > 1e-6, (name, other)


@pytest.mark.parametrize("name", [*CLOSED_FORMS, "heavy_cheetah", "heavy_walker", "loaded_walker"])
def test_source_and_target_part_in_one_step(name: str) -> None:
    task = TASKS[name]
    rng, source, target = np.random.default_rng(0), task.source(), task.target()
    differences = [np.abs(np.subtract(*step_both(task, source, target, rng, transformed=False))).max() for _ in range(50)]
    assert np.median(differences) > 0.05


def test_the_pairs_known_in_closed_form() -> None:
    assert set(CLOSED_FORMS) == {"biased_pendulum", "broken_hopper", "broken_cheetah", "weak_cheetah", "lame_ant"}
    for name in ("heavy_cheetah", "minitaur_motor", "late_minitaur", "multipolar_hopper_0"):
        task = get_task(name)
        with pytest.raises(ValueError, match=rf"{name}: .* not known in closed form"):
            task.action_transformation(np.zeros((1, len(task.robot.actuators))))


@pytest.mark.parametrize("task", CLOSED_FORMS.values(), ids=CLOSED_FORMS)
def test_the_true_transformation_makes_the_source_move_as_the_target(task: Task) -> None:
    rng, source, target = np.random.default_rng(1), task.source(), task.target()
    for _ in range(200):
        in_source, in_target = step_both(task, source, target, rng, transformed=True)
        if task.name == "weak_cheetah":  # whose 60% are rounded once in the source and once in the target
            assert in_source == pytest.approx(in_target, rel=1e-9, abs=1e-9)
        else:
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
@given(arrays(float, (4, 6), elements=st.floats(-2, 2)))
def test_the_weak_cheetahs_front_leg_gets_60_percent(action: np.ndarray) -> None:
    assert TASKS["weak_cheetah"].action_transformation(action) == pytest.approx(np.clip(action, -1, 1) * [1, 1, 1, 0.6, 0.6, 0.6])


@settings(deadline=None)
@given(arrays(float, (4, 8), elements=st.floats(-2, 2)))
def test_the_lame_ants_first_leg_gets_nothing(action: np.ndarray) -> None:
    # Gym's order of the legs is 4, 1, 2, 3.
    assert TASKS["lame_ant"].action_transformation(action) == pytest.approx(np.clip(action, -1, 1) * [1, 1, 0, 0, 1, 1, 1, 1])


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


@pytest.mark.parametrize(
    ("name", "link", "before", "after"),
    [
        ("heavy_hopper", "torso", 3.53, 6.0),
        ("heavy_walker", "torso", 3.534, 10.0),
        ("heavy_pendulum", "pole", 4.89, 100.0),
        ("loaded_walker", "torso", 3.534, 6.534),
    ],
)
def test_the_heavy_robots_weigh_what_the_papers_say(name: str, link: str, before: float, after: float) -> None:
    source, target = TASKS[name].source().world, TASKS[name].target().world
    assert source.mass_of(link) == pytest.approx(before, abs=0.005)
    assert target.mass_of(link) == pytest.approx(after, abs=0.005)
    assert [target.mass_of(other) for other in target.links if other != link] == [source.mass_of(other) for other in source.links if other != link]


def test_gravity_pulls_the_ants_as_garat_says() -> None:
    task, fallen = TASKS["ant_gravity"], []
    q, dq = task.robot.initial_state(np.random.default_rng(0))
    q[2], dq = 9.0, np.zeros(14)
    for env in (task.source(), task.target()):
        env.world.set_state(q, dq)
        env.step(np.zeros(8))
        fallen.append(env.world.dq[2] / task.robot.dt)
    assert fallen == pytest.approx([-4.91, -9.81], rel=1e-4)


@pytest.mark.parametrize(("name", "before", "after"), [("high_friction_hopper", 2.0, 2.2), ("slippery_hopper", 2.0, 0.4)])
def test_the_feets_friction_is_as_the_pair_says(name: str, before: float, after: float) -> None:
    hopper = TASKS[name].robot
    model = hopper.load()
    frictions = []
    for effects in ((), TASKS[name].effects):
        changed = model.copy()
        for effect in effects:
            effect.install(changed)
        contacts = {link.attrib["name"]: link.find("contact/lateral_friction") for link in ET.fromstring(changed.text()).findall("link")}
        frictions.append({link: float(contact.attrib["value"]) for link, contact in contacts.items() if contact is not None})
    assert (frictions[0].pop("foot"), frictions[1].pop("foot")) == (before, after)
    assert frictions[0] == frictions[1]


def test_the_tilted_cheetahs_ground_rises_by_six_degrees() -> None:
    (gravity,) = TASKS["tilted_cheetah"].effects
    x, y, z = gravity.vector
    assert math.hypot(x, y, z) == pytest.approx(9.81)
    assert math.degrees(math.atan2(-x, -z)) == pytest.approx(6.0)
    assert y == 0


def test_the_minitaurs_target_motor_has_the_facts_figures() -> None:
    motors = TASKS["minitaur_motor"].effects
    assert [motor.target for motor in motors] == list(ROBOTS["minitaur"].actuators)
    for motor in motors:
        assert (motor.torque_constant, motor.resistance, motor.voltage_limit) == (0.0954, 0.186, 50.0)
        assert motor.current == (0, 10, 20, 30, 40, 50, 60)
        assert motor.torque == (0, 1, 1.9, 2.45, 3.0, 3.25, 3.5)


def test_every_pair_says_what_and_whence_it_is_as_plain_data() -> None:
    for name, task in PAIRS.items():
        data = task.to_dict()
        assert data == json.loads(json.dumps(data))
        assert (data["name"], data["robot"]) == (name, task.robot.name)
        assert tuple(effect_from_dict(effect) for effect in data["effects"]) == task.effects  # type: ignore[attr-defined]
        assert task.summary
        assert task.citation
        assert task.address == name
    assert "slippery_hopper" in TASKS["high_friction_hopper"].note


def test_every_pair_has_the_track_that_the_protocol_gives_it() -> None:
    tracks = {track: {name for name, task in TASKS.items() if task.track == track} for track in TRACKS}
    papers = {name for name, task in TASKS.items() if "MPGE" in task.citation or "GARAT" in task.citation}
    assert tracks["control"] == {"high_friction_hopper"}
    assert tracks["physics"] == {"ant_gravity", "delayed_cheetah", "tilted_cheetah"}
    assert tracks["headline"] == papers - {"high_friction_hopper", "ant_gravity"} | {"laggy_walker", "loaded_walker"} | {
        name for name, task in TASKS.items() if task.simulator
    }
    assert {name for name, task in TASKS.items() if task.development} == {"broken_hopper", "biased_pendulum"}
    assert sum(map(len, tracks.values())) == len(TASKS)


def test_the_physics_track_is_what_actions_make_up_for_by_less_than_half() -> None:
    removable = {name: found.removable for name, found in stored_mismatches().items()}
    assert all(removable[name] < 0.5 for name, task in TASKS.items() if task.track == "physics")


def test_pairs_of_ones_own_have_neither_track_nor_development() -> None:
    for task in (Task("mine", ROBOTS["hopper"], TASKS["broken_hopper"].effects, "", ""), get_task("multipolar_hopper_3")):
        assert (task.track, task.development, task.severity) == ("", False, None)


def test_a_task_that_is_not_there_is_refused_with_the_list() -> None:
    assert get_task("broken_hopper") is TASKS["broken_hopper"]
    with pytest.raises(UserError, match=r"'brokenhopper'.*biased_pendulum, broken_hopper"):
        get_task("brokenhopper")


@pytest.mark.parametrize("name", ["", "multipolar_hopper", "multipolar_hopper_", "multipolar_hopper_x", "multipolar_ant_-1", "multipolar_cartpole_3"])
def test_a_family_is_followed_by_the_instances_number(name: str) -> None:
    with pytest.raises(UserError, match=r"unknown task .*multipolar_hopper_0 to _99") as error:
        get_task(name)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["multipolar_hopper_100", "multipolar_ant_4711"])
def test_an_instance_that_is_not_there_is_refused(name: str) -> None:
    with pytest.raises(UserError, match=rf"has no instance {name.rpartition('_')[2]}; choose one from 0 to 99"):
        get_task(name)


@pytest.mark.parametrize("name", IDS)
def test_the_registered_environments_pass_the_checkers(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    if name == LANDER:
        importlib.import_module("Box2D")  # which crashes where a warning of its own is an error
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for message in HARMLESS:
            warnings.filterwarnings("ignore", message)
        # Gymnasium's checker makes environments of every render mode; those of Gymnasium's own need a display for one.
        check_env(gymnasium.make(name).unwrapped, skip_render_check=name in CLASSIC_IDS)
        stable_baselines3.common.env_checker.check_env(gymnasium.make(name).unwrapped)


@pytest.mark.parametrize("name", IDS)
def test_the_registered_environments_can_be_looked_at(name: str) -> None:
    if name in CLASSIC_IDS:
        pytest.importorskip("pygame")
    env = gymnasium.make(name, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    picture = env.render()
    assert picture.dtype == np.uint8
    assert picture.ndim == 3
    assert picture.shape[2] == 3
    assert np.ptp(picture) > 20
    env.close()


def test_an_unknown_render_mode_is_refused() -> None:
    with pytest.raises(UserError, match="unknown render mode 'human'; there is rgb_array"):
        RobotEnv(ROBOTS["hopper"], render_mode="human")


def test_the_ids_lead_to_source_and_target() -> None:
    assert SOURCE_IDS["half_cheetah"] == "mpge_bench/HalfCheetah-v0"
    assert TARGET_IDS["broken_hopper"] == "mpge_bench/BrokenHopper-v0"
    for robot, name in SOURCE_IDS.items():
        env = gymnasium.make(name).unwrapped
        assert type(env.robot) is type(ROBOTS[robot])
        assert env.world.effects == (*ROBOTS[robot].servos, *ROBOTS[robot].nominal)
    for task, name in TARGET_IDS.items():
        env = gymnasium.make(name).unwrapped
        assert type(env.robot) is type(TASKS[task].robot)
        assert not TASKS[task].effects or set(TASKS[task].effects) <= set(env.world.effects)
    env = gymnasium.make(TARGET_IDS["broken_hopper"], severity=0.25).unwrapped
    assert env.effects == get_task("broken_hopper@0.25").effects
    assert gymnasium.spec(SOURCE_IDS["hopper"]).max_episode_steps == 1000
    for family, name in FAMILY_IDS.items():
        if family in FAMILIES:
            env = gymnasium.make(name, instance=7).unwrapped
            assert env.effects == FAMILIES[family].task(7).effects
            assert env.robot is FAMILIES[family].robot


def test_envs_imports_without_torch_and_without_a_word() -> None:
    code = "import mpge_bench.envs, sys; assert 'torch' not in sys.modules"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (process.returncode, process.stdout, process.stderr) == (0, "", "")


@pytest.mark.slow
def test_a_seed_repeats_its_episodes_in_any_process() -> None:
    names = [name for name in (*SOURCE_IDS.values(), *TARGET_IDS.values(), *FAMILY_IDS.values()) if name != LANDER or HAS_BOX2D]
    code = RUN.format(ids=names, steps=250)
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split() for _ in range(2)]
    assert runs[0] == runs[1]
    heard = dict(zip(names, runs[0], strict=True))
    # The light ant under full gravity is the ant; nothing else is anything else.
    assert heard.pop(TARGET_IDS["ant_gravity"]) == heard[SOURCE_IDS["ant"]]
    assert len(set(heard.values())) == len(heard)
