"""A first rig for a URDF or MJCF file: all keys, and what they mean beside them."""

from __future__ import annotations

import json
import os
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import yaml

from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.envs import yaml12
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.mjcf import Stated, read_stated
from mpge_bench.envs.model import Model
from mpge_bench.files import whole
from mpge_bench.rig.folder import kind_of

#: What a rig says of a URDF file, which has neither: m/s², s.
_GRAVITY, _TIMESTEP = (0.0, 0.0, -9.81), 0.001
_HEAD = """\
# A rig says what the simulator believes of the machine. Units are SI, angles rad. Written by `rig new`; lines marked ? are guesses: look at them first.
# All of it, and what a recording looks like: docs/recordings.md
"""
_BASES = {
    "fixed": "base: fixed                  # ? or free: the base moves in space; it needs mass, and `ground` below if there is one to touch",
    "free": "base: free                   # or fixed: the base is bolted down",
}
_TIMES = """\
timestep: {timestep!r:<19}# s, the simulator's physics step; smaller is more exact and slower
record_period: 0.01          # ? s, from row to row of your recordings; their time column is what counts
"""
_MODES = """\
# How each joint is driven, and so what its column u_JOINT holds:
#   {mode: torque}           a torque, N m (a force, N, of a joint that slides)
#   {mode: position, kp: 20.0, kd: 0.5, servo_period: 0.001}
#                            a target angle, rad (m); torque = kp (u - q) - kd dq, anew every servo_period s
#                            (kd and servo_period may be left out: no damping, anew at every physics step)
#   {mode: passive}          it has no motor; there is no u_JOINT, or it is ignored
"""
_GUESSED = "joints:                      # ? torque: the robot file says of none how it is driven"
_GROUNDS = {
    "fixed": "# ground: {friction: 0.8, restitution: 0.0}   # with a free base: a plane at z = 0 to touch; take the # away if there is one",
    "free": "ground: {friction: 0.8, restitution: 0.0}     # ? the plane at z = 0 that it touches; without this line it touches nothing",
}
_REST = """\
# noise: {q: 0.0005, dq: 0.005}                # what is known of the sensors: one standard deviation, rad (m) and rad/s (m/s); if not said, it is estimated
# effects:                                     # what else the simulator is to believe in, such as friction; docs/recordings.md
#   - {effect: viscous_friction, target: JOINT, damping: 0.2}
# certain: [gravity, mass_scale:LINK]          # what was measured well: effects, on everything or on one joint or link, that are not looked for
"""


def write_template(robot: Path, out: Path) -> Rig:
    """Write a rig for the URDF or MJCF file `robot` to `out`, where nothing may be yet, and read it back.

    The base is fixed where there is a joint to move. What the file says of motors is taken from it, of an MJCF file gravity and the step, too; where it says
    of no joint that it has a motor, all have.

    Raises:
        UserError: if there is no robot that a rig can be of, or `out` is there or cannot be written to.
    """
    if out.exists():
        raise UserError(f"{out}: is there already; remove it, or choose another file with --out")
    model = Model(robot)
    if not model.joints:
        # A body that floats: refused here if it has no mass.
        Model(robot, floating=True)
    stated = read_stated(robot) if kind_of(robot) == "mjcf" else _stated_by_urdf(model)
    text = template(model, os.path.relpath(robot.resolve(), out.resolve().parent), stated)
    with whole(out) as partial:
        partial.write_text(text, "utf-8")
        try:
            read_rig(partial)
        except UserError as error:
            raise UserError(str(error).replace(str(partial), str(robot))) from error
    return read_rig(out)


def template(model: Model, robot: str, stated: Stated) -> str:
    """The rig's text; `robot` is the path of the model's file as the rig is to have it."""
    base = "fixed" if model.joints else "free"
    motors = stated.motors or dict.fromkeys(model.joints, (0.0, 0.0))
    gravity = f"gravity: [{', '.join(f'{value!r}' for value in stated.gravity)}]"
    lines = [
        _HEAD + f"{f'robot: {_quoted(robot)}':<28} # URDF or MJCF file, relative to this one",
        _BASES[base],
        f"{gravity:<28} # m/s², in the base's frame (of a free base, the world's)",
        _TIMES.format(timestep=stated.timestep) + _MODES + ("joints: {}" if not model.joints else "joints:" if stated.motors else _GUESSED),
        *(f"  {_quoted(joint)}: {_mode(motors.get(joint))}" for joint in model.joints),
        _GROUNDS[base],
    ]
    return "\n".join(lines) + "\n" + _REST


def _stated_by_urdf(model: Model) -> Stated:
    """What a URDF file says: which joints its <transmission> or <ros2_control> elements drive."""
    root = ET.fromstring(model.text())
    named = {joint.get("name", "") for joint in root.findall("transmission/joint")}
    named |= {joint.get("name", "") for joint in root.findall("ros2_control/joint") if joint.find("command_interface") is not None}
    return Stated(_GRAVITY, _TIMESTEP, {joint: (0.0, 0.0) for joint in model.joints if joint in named})


def _mode(motor: tuple[float, float] | None) -> str:
    """Settings of a joint with this motor: gains of its servo, zeros for a torque, None for no motor."""
    if motor is None:
        return "{mode: passive}"
    kp, kd = motor
    return f"{{mode: position, kp: {kp!r}, kd: {kd!r}}}" if kp else "{mode: torque}"


def _quoted(text: str) -> str:
    """`text` as YAML has it: bare where it is read back the same, else in quotes."""
    bare = re.fullmatch(r"[A-Za-z_][\w./-]*", text) and yaml12.load(text) == text == yaml.safe_load(text)
    return text if bare else json.dumps(text, ensure_ascii=False)
