"""What might be missing in a rig with a free base or contacts: the effects of the catalogue, as for transitions, with starts of the size of things here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.free.motion import Motion
from mpge_bench.diagnosis.free.simulator import Simulator
from mpge_bench.diagnosis.settings import DiagnosisSettings
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis, Scales, listed, moved_links
from mpge_bench.envs.effects import CATALOGUE, Scale
from mpge_bench.envs.effects.actuator import asked

Array = npt.NDArray[np.float64]


def hypotheses(simulator: Simulator, recordings: Sequence[Recording], motions: Sequence[Motion], settings: DiagnosisSettings) -> list[Hypothesis]:
    """All that are looked for in `recordings`."""
    rig = simulator.rig
    # What recordings of joints alone hardly tell from its twins is looked for where the benchmark's robots may have it.
    kinds = [kind for kind in CATALOGUE.values() if not kind.is_formula and (rig.robot or not kind.asks_states)]
    # A benchmark robot's other joints are its root, which no joint is.
    joints = rig.driven if rig.robot else rig.joints
    found = listed(kinds, rig.driven, joints, moved_links(rig.model), _scales(simulator, recordings, motions, settings), rig.model.touching())
    found = [one for one in found if not rig.is_certain(*one.key)]
    return [replace(one, absent=tuple(rig.absent(one.starts[:1]))) if rig.own(one.starts[0]) else one for one in found]


def _scales(simulator: Simulator, recordings: Sequence[Recording], motions: Sequence[Motion], settings: DiagnosisSettings) -> Scales:
    """How large things are."""
    rig, world, least = simulator.rig, simulator.world(()), settings.replay
    layout, model = rig.layout, rig.changed()
    states = np.concatenate([one.state for one in motions])
    turns, speeds = layout.q(states)[:, layout.nq - layout.joints :], layout.dq(states)[:, layout.nv - layout.joints :]
    accelerations = np.concatenate([np.diff(layout.dq(one.state), axis=0) for one in motions])[:, layout.nv - layout.joints :] / simulator.period
    commands = np.concatenate([one.u for one in recordings])
    low, high = world.room()
    # Without ground nothing has a shape.
    size, pull = float(np.max(high - low)) / 2 or least.least_length, float(np.linalg.norm(model.gravity or rig.gravity))
    touching = model.touching() if rig.ground else ()
    damping = model.take_losses() if rig.robot else {}
    plain = Scale(
        torque=least.least_torque,
        limit=least.least_torque,
        speed=least.least_motion,
        top_speed=least.least_motion,
        angle=least.least_motion,
        inertia=1.0,
        mass=1.0,
        length=size,
        period=simulator.period,
        # Of delays half of it is looked for: longer ones would ask for commands of before what windows remember, which are none.
        duration=min(2 * simulator.remembered * simulator.period, *(one.duration for one in recordings)),
        gravity=model.gravity or rig.gravity,
        step=simulator.step,
    )
    found: dict[str, Scale] = {}
    believed = _delivered(rig, *(dict(zip(rig.joints, values.T, strict=True)) for values in (commands, turns, speeds)))
    for column, joint in enumerate(rig.joints):
        inertia, servo, delivered = world.inertia_of(joint), rig.servo(joint), believed[joint]
        # What carries and brakes a joint without a motor is not known: at least what accelerates it.
        torque = max(_rms(delivered), inertia * _rms(accelerations[:, column]), settings.hypotheses.least_torque)
        found[joint] = replace(
            plain,
            torque=torque,
            limit=max(float(np.abs(delivered).max()), torque),
            speed=max(_rms(speeds[:, column]), least.least_motion),
            top_speed=max(float(np.abs(speeds[:, column]).max()), least.least_motion),
            angle=max(float(np.std(turns[:, column])), least.least_motion),
            inertia=inertia,
            damping=damping.get(joint, (0.0, 0.0))[0],
            rotor=rig.robot.armature.get(joint, 0.0) if rig.robot else 0.0,
            carried_rotor=rig.robot.carried.get(joint, 0.0) if rig.robot else 0.0,
            servo_period=simulator.period if rig.robot and rig.robot.servos else servo.servo_period if servo else 0.0,
        )
    links: dict[str, Scale] = {}
    for link in moved_links(model):
        mass, centre, _ = model.inertial(link)
        length = max(float(np.linalg.norm(centre)), least.least_length if rig.joints else size)
        rubs, bounces = (model.friction(link), model.restitution(link)) if link in touching else (0.0, 0.0)
        weight = max(mass * pull * length, least.least_motion)
        links[link] = replace(plain, mass=mass, length=length, torque=weight, friction=rubs, restitution=bounces)
    touched = next((one for one in links.values() if one.friction), plain)
    return Scales(found, links | {"*": touched}, replace(touched, length=size))


def _delivered(rig: Rig, commands: dict[str, Array], turns: dict[str, Array], speeds: dict[str, Array]) -> dict[str, Array]:
    """Torques that motors are believed to have delivered, 0 of joints that have none; all by joint, shapes (rows,)."""
    servos = rig.robot.servos if rig.robot else [servo for joint in rig.driven if (servo := rig.servo(joint))]
    driven = {joint: commands[joint] for joint in rig.driven}
    return dict.fromkeys(rig.joints, np.zeros(1)) | asked(servos, driven, turns, speeds, rig.timestep)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
