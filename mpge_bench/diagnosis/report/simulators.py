"""A rig, corrected or not, in the formats of other simulators: URDF and MuJoCo's MJCF, as far as these can hold its physics."""

from __future__ import annotations

import importlib
import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.effects import Armature, ContactCompliance, Effect, JointSpring, Restitution
from mpge_bench.envs.effects.world import GROUND
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.model import Model

#: What `diagnose` writes beside its report, where it can.
MODELS = ("corrected.urdf", "corrected.xml")
#: Mass, kg, and inertia, kg m², of what has none, for MuJoCo, which takes no less than 1e-15.
_LEAST = 1e-12


@dataclass(frozen=True)
class Exported:
    """A model file.

    Attributes:
        text: of the file.
        left_out: what the rig has and the format cannot hold.
    """

    text: str
    left_out: tuple[Effect, ...]


def beside_report(rig: Rig, effects: Sequence[Effect], out: Path) -> dict[str, Exported]:
    """By name those of `MODELS` that `rig` with `effects` can be written to, to lie in `out`: the second where MuJoCo can read it; none of other rigs."""
    found = {}
    for name in MODELS:
        with suppress(UserError):
            found[name] = exported(rig, out / name, effects)
    return found


def exported(rig: Rig, path: Path, effects: Sequence[Effect] = ()) -> Exported:
    """`rig`, corrected by `effects`, as the file `path`, a URDF file or, ending in .xml, one in MuJoCo's format.

    Raises:
        UserError: for another ending, links in closed loops, where MuJoCo is needed and not installed, or does not take the mechanism.
    """
    if rig.robot and rig.robot.loops:
        raise UserError(f"{rig.path}: the {rig.robot.name}'s legs are closed loops, for which URDF has no place; it cannot be exported")
    if path.suffix == ".urdf":
        model = _believed(rig)
        left_out = _written(_chain(rig, effects), model)
        for mesh in model.meshes():
            mesh.set("filename", os.path.relpath(mesh.attrib["filename"], path.resolve().parent))
        return Exported(_told(ET.fromstring(model.text()), left_out), left_out)
    if path.suffix == ".xml":
        return _mjcf(rig, effects, path.resolve().parent)
    raise UserError(f"{path}: give a file that ends in .urdf, or in .xml for MuJoCo's format")


def _believed(rig: Rig) -> Model:
    """The model of `rig`, to be written to; a link of a robot of the benchmark rubs with the product of its coefficient and the ground's, as Bullet has it."""
    model = rig.model.copy()
    if rig.robot and rig.robot.friction is not None:
        for link in model.touching():
            model.set_friction(link, rig.robot.friction * model.friction(link))
    return model


def _chain(rig: Rig, effects: Sequence[Effect]) -> list[Effect]:
    """All that acts, in order; the rotors of a robot of the benchmark, too, which are built into its world, as large as `effects` say."""
    acting = rig.acting(effects)
    rotors = dict(rig.robot.armature) if rig.robot else {}
    others = []
    for one in acting:
        if type(one).own_rotor is Effect.own_rotor:
            others.append(one)
        else:
            rotors[one.target] = one.own_rotor(rotors[one.target])
    return [*others, *(Armature(joint, inertia) for joint, inertia in rotors.items() if inertia)]


def _written(effects: Sequence[Effect], model: Model) -> tuple[Effect, ...]:
    """Write `effects` into `model`; those that URDF has no place for."""
    return tuple(effect for effect in effects if not effect.to_urdf(model))


def _mjcf(rig: Rig, effects: Sequence[Effect], folder: Path) -> Exported:
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError as error:
        raise UserError("MuJoCo's format needs MuJoCo: pip install 'mpge_bench[mjcf]'") from error
    model = _believed(rig)
    if not rig.ground:
        model.strip_geometry()
    # MuJoCo heeds efforts, this simulator and most others do not.
    model.forget_efforts()
    further = _written(_chain(rig, effects), model)
    model.tell_mujoco()
    try:
        spec = mujoco.MjSpec.from_string(model.text().decode())
        # What carries a link along one axis of several may have no mass; MuJoCo asks for some.
        spec.compiler.boundmass, spec.compiler.boundinertia = _LEAST, _LEAST
        spec.compile()
    except ValueError as error:
        raise UserError(f"{rig.model.path}: MuJoCo does not take it ({one_line(error)})") from error
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.compiler.balanceinertia = False
    spec.option.timestep, spec.option.gravity = rig.timestep, rig.gravity
    for joint in rig.joints:
        spec.joint(joint).armature = model.armature.get(joint, 0.0)
        if joint in model.springs:
            JointSpring(joint, *model.springs[joint]).to_mjcf(spec)
        if rig.modes[joint] != "passive":
            spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    lost = _touched(mujoco, spec, model, rig.timestep) if rig.ground else ()
    left_out = (*(effect for effect in further if not effect.to_mjcf(spec)), *lost)
    root = ET.fromstring(spec.to_xml())
    for mesh in root.iter("mesh"):
        mesh.set("file", os.path.relpath(mesh.attrib["file"], folder))
    return Exported(_told(root, left_out), left_out)


def _touched(mujoco: Any, spec: Any, model: Model, timestep: float) -> tuple[Effect, ...]:
    """Lay ground into `spec`, which `model` was turned into, and let links touch it, but not each other; what of contact MuJoCo has no place for.

    As hard as its solver can be at that step. Of two coefficients of friction MuJoCo takes the larger, and ours stand in the links.
    """
    hard = [2 * timestep, 1.0]
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.worldbody.add_geom(name=GROUND, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], friction=[0, 0, 0], contype=0, conaffinity=1, solref=hard)
    lost: list[Effect] = []
    for link in model.touching():
        for shape in spec.body(link).geoms:
            shape.contype, shape.conaffinity, shape.solref = 1, 0, hard
            shape.friction = [model.friction(link), 0, 0]
        if model.restitution(link):
            lost.append(Restitution(link, model.restitution(link)))
        if (soft := model.compliance(link)) is not None:
            lost.append(ContactCompliance(link, *soft))
    return tuple(lost)


def _told(root: ET.Element, left_out: Sequence[Effect]) -> str:
    """The file with, where something is not in it, a line on that behind its outermost element's head."""
    if left_out:
        values = [{name: value for name, value in one.to_dict().items() if name not in ("effect", "target")} for one in left_out]
        said = ", ".join(
            f"{one.name} of {one.target} ({', '.join(f'{name} {value}' for name, value in own.items())})" for one, own in zip(left_out, values, strict=True)
        )
        root.insert(0, ET.Comment(f" Not held by this format: {said.replace('--', '- -')} "))
    return ET.tostring(root, encoding="unicode")
