"""MULTIPOLAR's families of Gymnasium's own environments: what is drawn is what they use, and no instance disturbs another."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
import pytest

from mpge_bench.envs import FAMILY_IDS
from mpge_bench.envs.classic import ACROBOT, CARTPOLE, CLASSICS, LUNAR_LANDER, make_acrobot, make_cartpole, make_lunar_lander
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.families import draw

needs_box2d = pytest.mark.skipif(
    not all(importlib.util.find_spec(package) for package in ("Box2D", "pygame")), reason="LunarLander needs Box2D and pygame, which are not installed"
)
#: Of the facts page.
RANGES = {
    "multipolar_cartpole": {"masscart": (0.2, 20), "masspole": (0.1, 5), "length": (0.1, 3), "force_mag": (6, 13), "gravity": (6, 14)},
    "multipolar_acrobot": {
        "LINK_LENGTH_1": (0.3, 1.3), "LINK_MASS_1": (0.5, 1.5), "LINK_MASS_2": (0.5, 1.5),
        "LINK_COM_POS_1": (0.05, 0.95), "LINK_COM_POS_2": (0.05, 0.95), "LINK_MOI": (0.25, 1.5),
    },
    "multipolar_lunar_lander": {
        "MAIN_ENGINE_POWER": (10, 40), "SIDE_ENGINE_POWER": (0.5, 2), "SCALE": (25, 50),
        "INITIAL_RANDOM": (500, 1500), "SIDE_ENGINE_HEIGHT": (10, 20), "SIDE_ENGINE_AWAY": (8, 18),
    },
}  # fmt: skip
DRAWN = {"multipolar_cartpole": CARTPOLE, "multipolar_acrobot": ACROBOT, "multipolar_lunar_lander": LUNAR_LANDER}
LANDER = pytest.param("multipolar_lunar_lander", marks=needs_box2d)
NAMES = ["multipolar_cartpole", "multipolar_acrobot", LANDER]
QUANTITIES = [pytest.param(name, quantity, marks=needs_box2d if "lander" in name else ()) for name, ranges in RANGES.items() for quantity in ranges]


def parameters(name: str, env: gymnasium.Env[Any, Any]) -> dict[str, float]:
    """What the environment's own code takes for each drawn quantity."""
    if name == "multipolar_lunar_lander":
        return {quantity: type(env.unwrapped).step.__globals__[quantity] for quantity in RANGES[name]}
    return {quantity: getattr(env.unwrapped, quantity) for quantity in RANGES[name]}


def start(env: gymnasium.Env[Any, Any]) -> np.ndarray:
    """The first observation of seeded episodes under seeded actions."""
    env.action_space.seed(0)
    return np.asarray(env.reset(seed=0)[0])


def go_on(env: gymnasium.Env[Any, Any]) -> np.ndarray:
    """The next observation under a random action; where an episode ends, the first of the next."""
    observation, _, terminated, truncated, _ = env.step(env.action_space.sample())
    return np.asarray(env.reset()[0] if terminated or truncated else observation)


def motion(env: gymnasium.Env[Any, Any], steps: int = 60) -> np.ndarray:
    """Observations of random episodes."""
    return np.array([start(env), *(go_on(env) for _ in range(steps))])


def make(name: str, values: Mapping[str, float], monkeypatch: pytest.MonkeyPatch) -> gymnasium.Env[Any, Any]:
    """The environment with just these values."""
    monkeypatch.setattr("mpge_bench.envs.classic.draw", lambda family, ranges, instance: dict(values))
    return CLASSICS[name][0]()


def test_ranges_and_lengths_are_the_papers() -> None:
    assert DRAWN == RANGES
    assert {name: gymnasium.spec(FAMILY_IDS[name]).max_episode_steps for name in CLASSICS} == {
        "multipolar_cartpole": 500, "multipolar_acrobot": 500, "multipolar_lunar_lander": 1000,
    }  # fmt: skip


@pytest.mark.parametrize("name", RANGES)
def test_draws_lie_within_their_ranges_and_fill_them(name: str) -> None:
    drawn = [draw(name, DRAWN[name], instance) for instance in range(100)]
    for quantity, (low, high) in RANGES[name].items():
        values = np.array([values[quantity] for values in drawn])
        assert low <= values.min() < low + 0.1 * (high - low)
        assert high >= values.max() > high - 0.1 * (high - low)
        assert len(set(values)) == 100


def test_draws_are_the_same_in_any_process() -> None:
    code = (
        "import json; from mpge_bench.envs import classic; from mpge_bench.envs.families import draw;"
        "print(json.dumps([[draw(n, r, i) for i in range(100)] for n, r in"
        " (('multipolar_cartpole', classic.CARTPOLE), ('multipolar_acrobot', classic.ACROBOT), ('multipolar_lunar_lander', classic.LUNAR_LANDER))]))"
    )
    fresh = json.loads(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
    assert fresh == [[draw(name, ranges, instance) for instance in range(100)] for name, ranges in DRAWN.items()]


@pytest.mark.parametrize("name", NAMES)
def test_the_environment_takes_what_was_drawn(name: str) -> None:
    for instance in (0, 1, 42, 99):
        values = draw(name, DRAWN[name], instance)
        assert parameters(name, CLASSICS[name][0](instance)) == values
        assert parameters(name, gymnasium.make(FAMILY_IDS[name], instance=instance)) == values
    assert parameters(name, gymnasium.make(FAMILY_IDS[name])) == draw(name, DRAWN[name], 0)


@pytest.mark.parametrize("instance", range(0, 100, 11))
def test_the_cartpoles_derived_quantities_fit(instance: int) -> None:
    env: Any = make_cartpole(instance)
    assert env.total_mass == env.masscart + env.masspole
    assert env.polemass_length == env.masspole * env.length


@pytest.mark.parametrize("instance", range(0, 100, 11))
@pytest.mark.parametrize("action", [0, 1])
def test_the_cartpole_moves_by_the_drawn_quantities(instance: int, action: int) -> None:
    env: Any = make_cartpole(instance)
    values, angle = draw("multipolar_cartpole", CARTPOLE, instance), 0.1
    cart, pole, half, gravity = (values[key] for key in ("masscart", "masspole", "length", "gravity"))
    env.reset(seed=0)
    env.state = np.array([0.0, 0.0, angle, 0.0])
    (_, speed, _, spin), *_ = env.step(action)
    # Barto, Sutton & Anderson 1983, from rest; 20 ms.
    push = values["force_mag"] * (2 * action - 1)
    turn = (gravity * np.sin(angle) - np.cos(angle) * push / (cart + pole)) / (half * (4 / 3 - pole * np.cos(angle) ** 2 / (cart + pole)))
    assert spin == pytest.approx(0.02 * turn, rel=1e-5)
    assert speed == pytest.approx(0.02 * (push - pole * half * turn * np.cos(angle)) / (cart + pole), rel=1e-5)


@pytest.mark.parametrize(("name", "quantity"), QUANTITIES)
def test_every_drawn_quantity_alone_changes_the_motion(name: str, quantity: str, monkeypatch: pytest.MonkeyPatch) -> None:
    values = {key: low + 0.4 * (high - low) for key, (low, high) in RANGES[name].items()}
    low, high = RANGES[name][quantity]
    one, again, other = (
        motion(make(name, changed, monkeypatch), 150) for changed in (values, values, values | {quantity: low + 0.6 * (high - low)})
    )
    assert np.array_equal(one, again)
    assert np.abs(one - other).max() > 0.01


@pytest.mark.parametrize("name", NAMES)
def test_an_instance_repeats_and_no_two_move_alike(name: str) -> None:
    motions = [motion(CLASSICS[name][0](instance)) for instance in (0, 0, 1, 2, 50, 99)]
    assert np.array_equal(motions[0], motions[1])
    for index, one in enumerate(motions[1:], 1):
        for other in motions[1:index]:
            assert np.abs(one - other).max() > 0.01


@pytest.mark.parametrize("name", NAMES)
def test_two_instances_in_one_process_do_not_disturb_each_other(name: str) -> None:
    make_one: Callable[..., Any] = CLASSICS[name][0]
    alone = [motion(make_one(instance)) for instance in (3, 4)]
    both = [make_one(instance) for instance in (3, 4)]
    together = [[start(env)] for env in both]
    for _ in range(60):
        for env, heard in zip(both, together, strict=True):
            heard.append(go_on(env))
    assert [np.array_equal(one, other) for one, other in zip(alone, together, strict=True)] == [True, True]


@needs_box2d
def test_gymnasiums_own_lunar_lander_stays_as_it_is() -> None:
    import gymnasium.envs.box2d.lunar_lander as own

    before = {quantity: getattr(own, quantity) for quantity in LUNAR_LANDER}
    moved = motion(gymnasium.make("LunarLander-v3"))
    make_lunar_lander(7)
    assert {quantity: getattr(own, quantity) for quantity in LUNAR_LANDER} == before
    assert np.array_equal(motion(gymnasium.make("LunarLander-v3")), moved)
    assert before["MAIN_ENGINE_POWER"] == 13.0


@pytest.mark.parametrize(("name", "own"), [("multipolar_cartpole", "CartPole-v1"), ("multipolar_acrobot", "Acrobot-v1")])
def test_gymnasiums_own_classics_stay_as_they_are(name: str, own: str) -> None:
    before = motion(gymnasium.make(own))
    motion(CLASSICS[name][0](7))
    assert np.array_equal(motion(gymnasium.make(own)), before)


@pytest.mark.parametrize(("name", "maker"), [("cartpole", make_cartpole), ("acrobot", make_acrobot), ("lunar_lander", make_lunar_lander)])
@pytest.mark.parametrize("instance", [-1, 100])
def test_an_instance_out_of_range_is_refused(name: str, maker: Callable[..., Any], instance: int) -> None:
    with pytest.raises(UserError, match=rf"multipolar_{name} has no instance {instance}; choose one from 0 to 99") as error:
        maker(instance)
    assert "\n" not in str(error.value)


def test_without_box2d_the_lander_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "Box2D" else found(name, *rest))
    with pytest.raises(UserError, match=r"LunarLander needs Box2D.*pip install 'mpge_bench\[box2d\]'") as error:
        make_lunar_lander(3)
    assert "\n" not in str(error.value)
