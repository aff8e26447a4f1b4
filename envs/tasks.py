"""The registry of source/target pairs, and how a pair is found by its name."""

from __future__ import annotations

import math
from pathlib import Path

from mpge_bench.envs.custom import import_task, read_task
from mpge_bench.envs.effects import (
    AttachedMass,
    Backlash,
    ContactFriction,
    CoulombFriction,
    DcMotor,
    Delay,
    Gravity,
    Lag,
    Latency,
    MassScale,
    TorqueBias,
    TorqueGain,
    TorqueLimit,
    ViscousFriction,
)
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.families import FAMILIES, INSTANCES
from mpge_bench.envs.mujoco_targets import GYMNASIUM
from mpge_bench.envs.robots import ROBOTS
from mpge_bench.envs.robots.minitaur import RESISTANCE, TORQUE_CONSTANT
from mpge_bench.envs.severity import AT, Severity
from mpge_bench.envs.task import Task

_MPGE = "Lee et al. 2022 (MPGE)"
_GARAT = "Desai et al. 2020 (GARAT)"
_OURS = "mpge_bench"

_PENDULUM, _HOPPER, _CHEETAH, _WALKER = (ROBOTS[name] for name in ("inverted_pendulum", "hopper", "half_cheetah", "walker"))
_ANT, _MINITAUR = ROBOTS["ant"], ROBOTS["minitaur"]
#: Current, A, and torque, N m, measured on the Minitaur's motor.
_CURRENT, _TORQUE = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0), (0.0, 1.0, 1.9, 2.45, 3.0, 3.25, 3.5)


def _force(action: float) -> float:
    return 100.0 * action


def _downward(gravity: float) -> tuple[float, float, float]:
    return (0.0, 0.0, -gravity)


def _sloping(degrees: float) -> tuple[float, float, float]:
    """Gravity along the axes of a ground that rises by `degrees` along x."""
    slope = math.radians(degrees)
    return (-9.81 * math.sin(slope), 0.0, -9.81 * math.cos(slope))


_GAIN = Severity(TorqueGain, "gain", "gain of the broken motors", "", 1.0, (0.5, 0.25, 0.0))
_MASS = Severity(MassScale, "factor", "factor of the mass", "", 1.0, (1.5, 2.0, 3.0))
_DELAY = Severity(Delay, "seconds", "delay of the motors", "s", 0.0, (0.01, 0.03, 0.06))
_LATENCY = Severity(Latency, "seconds", "latency of the commands", "s", 0.0, (0.01, 0.02, 0.04))
_LAG = Severity(Lag, "time_constant", "time constant of the motors", "s", 0.0, (0.01, 0.03, 0.06))
_PLAY = Severity(Backlash, "width", "play of the motors", "rad", 0.0, (0.05, 0.1, 0.2))
_LOAD = Severity(AttachedMass, "mass", "mass of the load", "kg", 0.0, (1.5, 3.0, 6.0))
_BIAS = Severity(TorqueBias, "torque", "bias of the action", "", 0.0, (0.75, 1.5, 2.25), _force)
_WEIGHT = Severity(Gravity, "vector", "gravity", "m/s²", 4.91, (6.5, 8.0, 9.81), _downward)
_SLOPE = Severity(Gravity, "vector", "slope of the ground", "°", 0.0, (3.0, 6.0, 10.0), _sloping)


def _grip(source: float, *ladder: float) -> Severity:
    return Severity(ContactFriction, "coefficient", "coefficient of friction", "", source, ladder)


TASKS: dict[str, Task] = {
    task.name: task
    for task in (
        Task(
            "biased_pendulum",
            _PENDULUM,
            (TorqueBias("slider", 150.0), TorqueLimit("slider", 300.0)),
            "1.5 (150 N) is added to the action, which is then clipped to its range ±3",
            _MPGE,
            track="headline",
            development=True,
            severity=_BIAS,
        ),
        Task(
            "broken_hopper",
            _HOPPER,
            (TorqueGain("thigh_joint", 0.0),),
            "the first of 3 actuators (thigh) is dead",
            _MPGE,
            track="headline",
            development=True,
            severity=_GAIN,
        ),
        Task(
            "broken_cheetah",
            _CHEETAH,
            (TorqueGain("bthigh_joint", 0.0),),
            "the first of 6 actuators (back thigh) is dead",
            _MPGE,
            track="headline",
            severity=_GAIN,
        ),
        Task(
            "heavy_cheetah",
            _CHEETAH,
            (MassScale("*", 20 / 14),),
            "total mass 14 → 20 kg, every link alike",
            f"{_MPGE}; {_GARAT}",
            "The papers' text says torso; their model file sets the total mass.",
            track="headline",
            severity=_MASS,
        ),
        Task("heavy_pendulum", _PENDULUM, (MassScale("pole", 100 / 4.89480204),), "the pole's mass 4.89 → 100 kg", _GARAT, track="headline", severity=_MASS),
        Task("heavy_hopper", _HOPPER, (MassScale("torso", 6 / 3.53429174),), "the torso's mass 3.53 → 6.0 kg", _GARAT, track="headline", severity=_MASS),
        Task(
            "high_friction_hopper",
            _HOPPER,
            (ContactFriction("foot", 2.2),),
            "the foot's friction 2.0 → 2.2",
            _GARAT,
            "At 2.0 the foot hardly ever slips in PyBullet, so that 2.2 changes next to nothing (in GARAT, too, most methods do well here). Its stronger"
            " twin is slippery_hopper.",
            track="control",
            severity=_grip(2.0, 2.2, 3.0, 5.0),
        ),
        Task("heavy_walker", _WALKER, (MassScale("torso", 10 / 3.53429174),), "the torso's mass 3.53 → 10.0 kg", _GARAT, track="headline", severity=_MASS),
        Task("ant_gravity", ROBOTS["light_ant"], (Gravity("world", _downward(9.81)),), "gravity -4.91 → -9.81 m/s²", _GARAT, track="physics", severity=_WEIGHT),
        Task(
            "minitaur_motor",
            _MINITAUR,
            tuple(DcMotor(motor, TORQUE_CONSTANT, RESISTANCE, 50.0, _CURRENT, _TORQUE) for motor in _MINITAUR.actuators),
            "torque linear in the current → the measured curve, with back-EMF and a voltage limit",
            _GARAT,
            track="headline",
        ),
        Task(
            "slippery_hopper",
            _HOPPER,
            (ContactFriction("foot", 0.4),),
            "the foot's friction 2.0 → 0.4",
            _OURS,
            "The stronger twin of high_friction_hopper.",
            severity=_grip(2.0, 0.8, 0.4, 0.2),
        ),
        Task("slippery_cheetah", _CHEETAH, (ContactFriction("*", 0.15),), "every link's friction 0.4 → 0.15: ice", _OURS, severity=_grip(0.4, 0.25, 0.15, 0.1)),
        Task(
            "rusty_hopper",
            _HOPPER,
            tuple(kind(joint, value) for joint in _HOPPER.actuators for kind, value in ((CoulombFriction, 15.0), (ViscousFriction, 4.0))),
            "every joint has 15 N m of dry friction and 4 N m s/rad of viscous friction more",
            _OURS,
        ),
        Task(
            "delayed_cheetah",
            _CHEETAH,
            tuple(Delay(joint, 0.03) for joint in _CHEETAH.actuators),
            "every motor delivers its command 30 ms late (a control step is 50 ms)",
            _OURS,
            track="physics",
            severity=_DELAY,
        ),
        Task(
            "weak_cheetah",
            _CHEETAH,
            tuple(TorqueGain(joint, 0.6) for joint in ("fthigh_joint", "fshin_joint", "ffoot_joint")),
            "the front leg's motors deliver 60%",
            _OURS,
            severity=Severity(TorqueGain, "gain", "gain of the weak motors", "", 1.0, (0.8, 0.6, 0.3)),
        ),
        Task(
            "tilted_cheetah",
            _CHEETAH,
            (Gravity("world", _sloping(6.0)),),
            "the ground rises by 6° along the track",
            _OURS,
            "z is measured along the normal of the ground, pitch from it.",
            track="physics",
            severity=_SLOPE,
        ),
        Task(
            "laggy_walker",
            _WALKER,
            tuple(Lag(joint, 0.03) for joint in _WALKER.actuators),
            "every motor follows its command with a time constant of 30 ms",
            _OURS,
            track="headline",
            severity=_LAG,
        ),
        Task(
            "loaded_walker",
            _WALKER,
            (AttachedMass("torso", 3.0, x=0.15, z=0.1),),
            "3 kg are fixed to the torso, 15 cm in front and 10 cm above its middle",
            _OURS,
            track="headline",
            severity=_LOAD,
        ),
        Task(
            "loose_walker",
            _WALKER,
            tuple(Backlash(joint, 0.1, 0.02) for joint in _WALKER.actuators),
            "every motor (rotor 0.02 kg m²) has a play of 0.1 rad",
            _OURS,
            severity=_PLAY,
        ),
        Task("lame_ant", _ANT, (TorqueGain("hip_1", 0.0), TorqueGain("ankle_1", 0.0)), "both motors of leg 1 are dead", _OURS, severity=_GAIN),
        Task(
            "late_minitaur",
            _MINITAUR,
            tuple(Latency(motor, 0.02) for motor in _MINITAUR.actuators),
            "target angles reach the motors' controllers 20 ms late (a control step is 10 ms)",
            _OURS,
            severity=_LATENCY,
        ),
        *(
            Task(
                name,
                ROBOTS[robot],
                (),
                "the whole simulator: Gymnasium's own robot in MuJoCo",
                "Gymnasium",
                "Nobody here wrote the target: masses, contact model, integrator and armature are Gymnasium's and MuJoCo's.",
                track="headline",
                simulator=GYMNASIUM[robot],
            )
            for name, robot in (("mujoco_hopper", "hopper"), ("mujoco_cheetah", "half_cheetah"), ("mujoco_walker", "walker"), ("mujoco_ant", "ant"))
        ),
    )
}


def get_task(name: str) -> Task:
    """The pair called `name`: a registered one, at another severity (``broken_hopper@0.25``) if need be, an instance of a family
    (``multipolar_hopper_17``), a user's own in a YAML file (``path/to/pair.yaml``) or in a module (``my_module:PAIR``).

    Raises:
        UserError: if there is none, or the user's own is not right.
    """
    if name in TASKS:
        return TASKS[name]
    family, _, instance = name.rpartition("_")
    if family in FAMILIES and instance.isascii() and instance.isdigit():
        return FAMILIES[family].task(int(instance))
    if name.endswith((".yaml", ".yml")):
        return read_task(Path(name))
    if ":" in name:
        return import_task(name)
    pair, at, value = name.partition(AT)
    if at and pair in TASKS:
        try:
            severity = float(value)
        except ValueError as error:
            raise UserError(f"{name}: {value!r} is not a number; give one, such as broken_hopper{AT}0.25") from error
        return TASKS[pair].at(severity)
    families = ", ".join(f"{family}_0 to _{INSTANCES - 1}" for family in FAMILIES)
    raise UserError(f"unknown task {name!r}; choose one of: {', '.join(TASKS)}, {families}; or give your own: path/to/pair.yaml or my_module:PAIR")


def stated_task(name: str) -> Task:
    """The pair that a file calls `name`: as `get_task`, but no module is imported because a file says so.

    Raises:
        UserError: if there is none, or it is in a module.
    """
    if ":" in name and not name.endswith((".yaml", ".yml")):
        raise UserError(f"pair {name!r} is in a module, which is not imported because a file says so; describe the pair in a YAML file")
    return get_task(name)
