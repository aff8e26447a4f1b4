"""MULTIPOLAR's families of Gymnasium's own environments: CartPole, Acrobot and LunarLander with parameters drawn at random, 100 seeded instances each."""

from __future__ import annotations

import importlib.util
from typing import Any

import gymnasium
from gymnasium.envs.classic_control import AcrobotEnv, CartPoleEnv

from mpge_bench.envs.errors import UserError
from mpge_bench.envs.families import draw

#: What is drawn, uniformly, by environment (Barekatain et al. 2019): names are those in Gymnasium's code.
CARTPOLE = {"masscart": (0.2, 20.0), "masspole": (0.1, 5.0), "length": (0.1, 3.0), "force_mag": (6.0, 13.0), "gravity": (6.0, 14.0)}
#: MULTIPOLAR draws the second link's length, too, but Gymnasium's equations of motion do without it.
ACROBOT = {
    "LINK_LENGTH_1": (0.3, 1.3),
    "LINK_MASS_1": (0.5, 1.5),
    "LINK_MASS_2": (0.5, 1.5),
    "LINK_COM_POS_1": (0.05, 0.95),
    "LINK_COM_POS_2": (0.05, 0.95),
    "LINK_MOI": (0.25, 1.5),
}
LUNAR_LANDER = {
    "MAIN_ENGINE_POWER": (10.0, 40.0),
    "SIDE_ENGINE_POWER": (0.5, 2.0),
    "SCALE": (25.0, 50.0),
    "INITIAL_RANDOM": (500.0, 1500.0),
    "SIDE_ENGINE_HEIGHT": (10.0, 20.0),
    "SIDE_ENGINE_AWAY": (8.0, 18.0),
}


def make_cartpole(instance: int = 0, render_mode: str | None = None) -> gymnasium.Env[Any, Any]:
    """Gymnasium's CartPole, instance 0 to 99; masses kg, `length` (as in Gymnasium half the pole's) m, force N, gravity m/s².

    Raises:
        UserError: if there is no such instance.
    """
    env = CartPoleEnv(render_mode=render_mode)
    for name, value in draw("multipolar_cartpole", CARTPOLE, instance).items():
        setattr(env, name, value)
    env.total_mass = env.masspole + env.masscart
    env.polemass_length = env.masspole * env.length
    return env


def make_acrobot(instance: int = 0, render_mode: str | None = None) -> gymnasium.Env[Any, Any]:
    """Gymnasium's Acrobot, instance 0 to 99; lengths and centres m, masses kg, inertia (of both links) kg m².

    Raises:
        UserError: if there is no such instance.
    """
    env = AcrobotEnv(render_mode=render_mode)
    for name, value in draw("multipolar_acrobot", ACROBOT, instance).items():
        setattr(env, name, value)
    return env


def make_lunar_lander(instance: int = 0, render_mode: str | None = None) -> gymnasium.Env[Any, Any]:
    """Gymnasium's LunarLander, instance 0 to 99. Needs Box2D: ``pip install 'mpge_bench[box2d]'``.

    Raises:
        UserError: if there is no such instance, or no Box2D.
    """
    values = draw("multipolar_lunar_lander", LUNAR_LANDER, instance)
    # Its parameters are constants of its module, so that every instance gets a module of its own.
    spec = importlib.util.find_spec("gymnasium.envs.box2d.lunar_lander") if importlib.util.find_spec("Box2D") else None
    if spec is None or spec.loader is None:
        raise UserError("LunarLander needs Box2D, which is not installed; get it by: pip install 'mpge_bench[box2d]'")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name, value in values.items():
        setattr(module, name, value)
    env: gymnasium.Env[Any, Any] = module.LunarLander(render_mode=render_mode)
    return env


#: Entry point and longest episode by name.
CLASSICS = {
    "multipolar_cartpole": (make_cartpole, 500),
    "multipolar_acrobot": (make_acrobot, 500),
    "multipolar_lunar_lander": (make_lunar_lander, 1000),
}
