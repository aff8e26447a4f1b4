"""A robot's motion as a short hash, so that policies and results can say by which physics they were made."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np

from mpge_bench.envs.env import RobotEnv
from mpge_bench.envs.robots.robot import Array

#: Short runs, each from a random state of its own: eight control steps outlive the longest delay of the shipped pairs, and are too few for chaos.
RUNS, STEPS = 8, 8
#: Largest speed, rad/s and m/s, added to each of the initial ones, so that feet slip and joints reach their end stops.
_PUSH = 1.0
#: Digits kept after the decimal point, of m, rad, m/s, rad/s and of rewards; see `fingerprint`.
DECIMALS = 5
#: Seed of states and actions. Another one, or another figure above, makes other fingerprints of everything.
_SEED = 2022


def fingerprint(make: Callable[[], RobotEnv]) -> str:
    """16 hex digits that tell the motion of the environment that `make` makes: a hash over `motion`, rounded to `DECIMALS`.

    It is to change with the physics and not with the machine. Another code path of the math libraries (no AVX2, AVX-512, FMA; glibc's, numpy's) moved
    values of the robots and pairs here by 1e-11 at most in runs so short, mostly by 1e-13 and less. A parameter of an effect that is larger by 1e-4 of
    itself moves the most moved value by 5e-5 (`high_friction_hopper`, whose foot hardly slips) to 1e-2. Rounding to 1e-5 stands between. That some value
    lies so near a rounding boundary that it falls to the other side on the other machine has, from the differences measured, a probability of 1e-5 for
    the Minitaur's pairs, 3e-6 for `loose_walker` and below 1e-6 for all else. (Decimals, not significant digits: those of a value near 0 are all rounding.)
    """
    values = np.round(motion(make()), DECIMALS) + 0.0  # no -0
    text = "\n".join(" ".join(f"{value:.{DECIMALS}f}" for value in row) for row in values.tolist())
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def motion(env: RobotEnv) -> Array:
    """q, dq, observation, reward and whether the episode ends, after each step of fixed random runs, shape (RUNS · STEPS, values).

    A run goes on where an episode would end. Actions are uniformly random.
    """
    robot, rows = env.robot, []
    for run in range(RUNS):
        rng = np.random.default_rng((_SEED, run))
        env.reset(seed=run)
        q, dq = env.world.q, env.world.dq
        env.world.set_state(q, dq + rng.uniform(-_PUSH, _PUSH, dq.size))
        for _ in range(STEPS):
            action = rng.uniform(-robot.action_limit, robot.action_limit, len(robot.actuators))
            observation, reward, ended, *_ = env.advance(action, action)
            rows.append(np.concatenate((env.world.q, env.world.dq, observation, (reward, ended))))
    return np.array(rows)
