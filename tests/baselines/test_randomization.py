"""Domain randomisation over effects."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpge_bench.baselines.presets import load_settings
from mpge_bench.baselines.randomization import RandomizationSettings, RandomizedEnv, Range
from mpge_bench.baselines.vector import Worlds
from mpge_bench.envs import ROBOTS
from mpge_bench.envs.errors import UserError

HOPPER = ROBOTS["hopper"]
GAIN = Range("torque_gain", "gain", 0.5, 1.2)


def after(env, steps=5):
    """The state some control steps after the present start, under full torque."""
    return [env.advance(np.ones(3), np.ones(3))[0] for _ in range(steps)][-1]


@given(low=st.floats(0.01, 2), width=st.floats(0, 2), seed=st.integers(0, 1000), distribution=st.sampled_from(["uniform", "log-uniform"]))
def test_every_joint_has_a_number_of_its_own_within_the_range(low, width, seed, distribution):
    found = Range("torque_gain", "gain", low, low + width, distribution=distribution).draw(HOPPER, np.random.default_rng(seed))
    assert [effect.target for effect in found] == list(HOPPER.actuators)
    gains = [effect.gain for effect in found]
    assert all(low * (1 - 1e-9) <= gain <= (low + width) * (1 + 1e-9) for gain in gains)
    assert len(set(gains)) == 3 or width < 1e-6


def test_half_is_as_likely_as_double_in_a_log_uniform_range():
    rng = np.random.default_rng(0)
    drawn = [Range("mass_scale", "factor", 0.5, 2.0, "torso", distribution="log-uniform").draw(HOPPER, rng)[0].factor for _ in range(2000)]
    assert np.mean(np.array(drawn) < 1) == pytest.approx(0.5, abs=0.03)


def test_units_are_the_robots_own():
    rng = np.random.default_rng(0)
    friction = Range("contact_friction", "coefficient", 1.5, 1.5, unit="nominal_friction")
    assert {effect.target: effect.coefficient for effect in friction.draw(HOPPER, rng)}["foot"] == pytest.approx(1.5 * 2.0)
    assert friction.draw(ROBOTS["inverted_pendulum"], rng) == [], "it has no ground"
    cheetah = ROBOTS["half_cheetah"]
    damping = {effect.target: effect.damping for effect in Range("viscous_friction", "damping", 0.01, 0.01, unit="actuator").draw(cheetah, rng)}
    assert damping == {joint: pytest.approx(0.01 * gear) for joint, gear in cheetah.actuators.items()}
    assert Range("delay", "seconds", 1.0, 1.0, unit="control_step").draw(cheetah, rng)[0].seconds == pytest.approx(0.05)
    alike = Range("torque_gain", "gain", 0.5, 1.2, draws="alike").draw(cheetah, rng)
    assert len(alike) == 6
    assert len({effect.gain for effect in alike}) == 1


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_shipped_ranges_suit_every_robot(robot):
    found = load_settings(RandomizationSettings, "randomization", "standard")
    effects = [effect for one in found.ranges for effect in one.draw(ROBOTS[robot], np.random.default_rng(0))]
    assert {effect.name for effect in effects} >= {"torque_gain", "mass_scale", "viscous_friction", "delay"}
    assert any(effect.name == "contact_friction" for effect in effects) == (ROBOTS[robot].friction is not None)


def test_worlds_move_differently_and_are_exchanged_at_an_episodes_start():
    worlds = Worlds(functools.partial(RandomizedEnv, HOPPER, [GAIN], 20), 3, seed=0)
    worlds.reset()
    first = [env.effects for env in worlds.envs]
    assert len(set(first)) == 3
    env = worlds.envs[0]
    env.reset(seed=1)
    assert env.effects == first[0], "not before its time"
    a = after(env)
    env.reset(seed=1)
    np.testing.assert_array_equal(after(env), a)
    for _ in range(10):
        after(env, 1)
    env.reset(seed=1)
    assert env.effects != first[0]
    assert np.abs(after(env) - a).max() > 1e-3, "the physics is another"


def test_an_episodes_seed_says_what_is_drawn():
    drawn = []
    for seed in (1, 1, 2):
        env = RandomizedEnv(HOPPER, [GAIN], 20)
        env.reset(seed=seed)
        drawn.append(env.effects)
    assert drawn[0] == drawn[1] != drawn[2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("torque_gian", "gain", 0.5, 1), "range of torque_gian: unknown effect; known: "),
        (("torque_gain", "factor", 0.5, 1), "range of torque_gain: it has no parameter 'factor'; it has gain"),
        (("torque_gain", "gain", 1, 0.5), "range of torque_gain: low is 1 and high 0.5; give low no larger than high"),
        (("torque_gain", "gain", 0, 1, "each", "own", "log-uniform"), "range of torque_gain: low is 0; a log-uniform range lies above 0"),
    ],
)
def test_wrong_ranges_are_one_line(arguments, message):
    with pytest.raises(UserError, match=message):
        Range(*arguments)


def test_a_number_outside_the_effects_bounds_is_one_line():
    with pytest.raises(UserError, match=r"effect torque_gain on thigh_joint: gain = .* is outside"):
        Range("torque_gain", "gain", 10, 20).draw(HOPPER, np.random.default_rng(0))


def test_wrong_settings_are_named_by_their_place():
    with pytest.raises(UserError, match="setting ranges of randomization is empty"):
        load_settings(RandomizationSettings, "randomization", "smoke", "", {"ranges": []})
    with pytest.raises(UserError, match=r"setting ranges\.draws is 'some'; choose one of: own, alike"):
        load_settings(
            RandomizationSettings, "randomization", "smoke", "", {"ranges": [{"effect": "delay", "parameter": "seconds", "low": 0, "high": 1, "draws": "some"}]}
        )
