"""Fingerprints change with the physics and with nothing else, and the shipped policies carry today's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpge_bench import baselines
from mpge_bench.envs import ROBOTS, TASKS, RobotEnv, get_task
from mpge_bench.envs.effects import ContactFriction, Gravity, MassScale
from mpge_bench.envs.fingerprint import DECIMALS, fingerprint, motion
from mpge_bench.envs.robots import Robot
from mpge_bench.envs.robots.hopper import Hopper

POLICIES = Path(baselines.__path__[0]) / "policies"
#: The oldest code paths of numpy, OpenBLAS, MKL and glibc, which differ from the newest in the last bits; what a library does not know it passes over.
OLDEST = {
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR AVX2 FMA3",
    "OPENBLAS_CORETYPE": "Nehalem",
    "MKL_CBWR": "COMPATIBLE",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
}
#: What may be larger without a trace: 50 V for a motor that is fed with 16 V, and a place off the plane that a planar robot keeps to.
SILENT = {"voltage_limit", "y"}
#: A robot of each kind and pairs with a memory, a play, dry friction, gravity and sliding feet.
LOOKED_AT = ["heavy_pendulum", "rusty_hopper", "slippery_cheetah", "delayed_cheetah", "loose_walker", "ant_gravity", "late_minitaur"]
PRINT = f"""
import json
from mpge_bench.envs import TASKS
print(json.dumps({{name: TASKS[name].fingerprints() for name in {LOOKED_AT}}}))
"""


def larger(value: Any) -> Any:
    """A parameter, or each of several, larger by 1e-4 of itself; what is 0 becomes 1e-4."""
    if isinstance(value, tuple):
        return tuple(map(larger, value))
    return value * 1.0001 if value else 1e-4


class WellPaid(Hopper):
    """A hopper paid a little more for staying up."""

    healthy_reward = 1.0001


class Frail(Hopper):
    """A hopper whose episode ends where the hopper's own goes on."""

    def terminated(self, q: np.ndarray, dq: np.ndarray) -> bool:
        return True


class Blind(Hopper):
    """A hopper that does not see its last velocity."""

    def observation(self, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        return super().observation(q, dq * [1, 1, 1, 1, 1, 0])


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_it_is_16_hex_digits_and_repeats(robot: Robot) -> None:
    found = fingerprint(partial(RobotEnv, robot))
    assert len(found) == 16
    assert int(found, 16) >= 0
    assert found == fingerprint(partial(RobotEnv, robot))


def test_no_two_robots_or_pairs_share_one() -> None:
    robots = {name: fingerprint(partial(RobotEnv, robot)) for name, robot in ROBOTS.items()}
    pairs = {name: task.fingerprints()["pair"] for name, task in TASKS.items()}
    assert pairs.pop("ant_gravity") == robots["ant"]  # the light ant under full gravity is the ant
    assert len({*robots.values(), *pairs.values()}) == len(robots) + len(pairs)
    for name, task in TASKS.items():
        assert task.fingerprints()["robot"] == robots[task.robot.name], name


@pytest.mark.parametrize("name", [name for name, task in TASKS.items() if task.effects])
def test_every_parameter_of_every_effect_shows_from_a_ten_thousandth_on(name: str) -> None:
    task = TASKS[name]
    before = fingerprint(task.target)
    effect = task.effects[0]
    for parameter in effect.parameters.keys() - SILENT:
        changed = (replace(effect, **{parameter: larger(getattr(effect, parameter))}), *task.effects[1:])
        assert fingerprint(partial(RobotEnv, task.robot, changed)) != before, parameter


@pytest.mark.parametrize("link", ["torso", "thigh", "leg", "foot"])
def test_a_ten_thousandth_more_of_any_limb_shows(link: str) -> None:
    hopper = ROBOTS["hopper"]
    assert fingerprint(partial(RobotEnv, hopper, [MassScale(link, 1.0001)])) != fingerprint(partial(RobotEnv, hopper))


@pytest.mark.parametrize("other", [WellPaid(), Frail(), Blind()], ids=lambda robot: type(robot).__name__)
def test_reward_termination_and_observation_are_part_of_it(other: Robot) -> None:
    assert fingerprint(partial(RobotEnv, other)) != fingerprint(partial(RobotEnv, ROBOTS["hopper"]))


def test_friction_that_hardly_shows_shows_all_the_same() -> None:
    hopper = ROBOTS["hopper"]
    plain, rough = (motion(RobotEnv(hopper, effects)) for effects in ((), TASKS["high_friction_hopper"].effects))
    apart = np.abs(plain - rough)
    # Of 1,600 values some hundreds part, none by more than some hundredths; a dead motor moves nearly all, by units.
    assert 0.001 < apart.max() < 0.2
    assert (apart > 10.0**-DECIMALS).mean() < 0.25
    assert fingerprint(partial(RobotEnv, hopper, [ContactFriction("foot", 2.0)])) == fingerprint(partial(RobotEnv, hopper))


def test_what_changes_nothing_does_not_show() -> None:
    hopper = ROBOTS["hopper"]
    for effect in (Gravity("world", (0.0, 0.0, hopper.gravity)), MassScale("*", 1.0)):
        assert fingerprint(partial(RobotEnv, hopper, [effect])) == fingerprint(partial(RobotEnv, hopper))


def test_it_does_not_hang_on_what_the_world_did_before() -> None:
    env = RobotEnv(ROBOTS["half_cheetah"])
    fresh = fingerprint(partial(RobotEnv, ROBOTS["half_cheetah"]))
    env.reset(seed=5)
    for _ in range(50):
        env.step(np.ones(6))
    assert fingerprint(lambda: env) == fresh


@pytest.mark.parametrize("settings", [{}, OLDEST], ids=["as it is", "oldest code paths"])
def test_another_process_and_another_code_path_find_the_same(settings: dict[str, str]) -> None:
    environment = {**os.environ, **settings}
    process = subprocess.run([sys.executable, "-W", "ignore", "-c", PRINT], capture_output=True, text=True, check=True, env=environment)
    assert json.loads(process.stdout) == {name: TASKS[name].fingerprints() for name in LOOKED_AT}


def cards() -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for path in sorted(POLICIES.glob("*/*.json")):
        found.setdefault(path.parent.name, []).append(path)
    return found


def is_stale(card: dict[str, Any]) -> bool:
    """Whether the physics of a card that tells it is not today's: of source policies the robot's, of target policies the pair's, too."""
    if "fingerprints" in card:
        return bool(card["fingerprints"] != get_task(card["task"]).fingerprints())
    return bool(card["fingerprint"] != fingerprint(partial(RobotEnv, ROBOTS[card["robot"]])))


def test_a_card_of_other_physics_is_stale() -> None:
    told = TASKS["broken_hopper"].fingerprints()
    assert not is_stale({"robot": "hopper", "fingerprint": told["robot"]})
    assert is_stale({"robot": "walker", "fingerprint": told["robot"]})
    assert not is_stale({"robot": "hopper", "task": "broken_hopper", "fingerprints": told})
    assert is_stale({"robot": "hopper", "task": "heavy_hopper", "fingerprints": told})


@pytest.mark.parametrize("folder", cards())
def test_the_shipped_policies_learnt_under_todays_physics(folder: str) -> None:
    read = {path: json.loads(path.read_text()) for path in cards()[folder]}
    told = {path: card for path, card in read.items() if "fingerprint" in card or "fingerprints" in card}
    assert [path.name for path, card in told.items() if is_stale(card)] == [], "train these anew"
    if untold := [path.name for path in read if path not in told]:
        pytest.skip(f"{folder}: no fingerprint in {', '.join(untold)}; they were trained before there were any")
