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
from mpge_bench.envs.effects import Effect, JointSpring
from mpge_bench.envs.errors import UserError, one_line
from mpge_bench.envs.model import Model

#: What `diagnose` writes beside its report, where it can.
MODELS = ("corrected.urdf", "corrected.xml")


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
        UserError: for another ending, a rig that is no mechanism of its own on a fixed base, where MuJoCo is needed and not installed, or does not take the
            mechanism.
    """
    if rig.robot or not rig.is_tree:
        raise UserError(f"{rig.path}: only rigs with a model file of their own, on a fixed base and without ground, can be exported")
    if path.suffix == ".urdf":
        model = rig.model.copy()
        left_out = _written(rig.chain(effects), model)
        _relative(model, path.resolve().parent)
        return Exported(_told(model.text().decode(), left_out), left_out)
    if path.suffix == ".xml":
        return _mjcf(rig, effects)
    raise UserError(f"{path}: give a file that ends in .urdf, or in .xml for MuJoCo's format")


def _written(effects: Sequence[Effect], model: Model) -> tuple[Effect, ...]:
    """Write `effects` into `model`; those that URDF has no place for."""
    return tuple(effect for effect in effects if not effect.to_urdf(model))


def _mjcf(rig: Rig, effects: Sequence[Effect]) -> Exported:
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError as error:
        raise UserError("MuJoCo's format needs MuJoCo: pip install 'mpge_bench[mjcf]'") from error
    model = rig.model.copy()
    # What is only seen or touched: nothing touches here. Efforts: MuJoCo heeds them, this simulator and most others do not.
    model.strip_geometry()
    model.forget_efforts()
    further = _written(rig.chain(effects), model)
    try:
        spec = mujoco.MjSpec.from_string(model.text().decode())
        spec.compile()
    except ValueError as error:
        raise UserError(f"{rig.model.path}: MuJoCo does not take it ({one_line(error)})") from error
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.compiler.balanceinertia = spec.compiler.fusestatic = False
    spec.option.timestep, spec.option.gravity = rig.timestep, rig.gravity
    for joint in rig.joints:
        spec.joint(joint).armature = model.armature.get(joint, 0.0)
        if joint in model.springs:
            JointSpring(joint, *model.springs[joint]).to_mjcf(spec)
        if rig.modes[joint] != "passive":
            spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    left_out = tuple(effect for effect in further if not effect.to_mjcf(spec))
    return Exported(_told(spec.to_xml(), left_out), left_out)


def _relative(model: Model, folder: Path) -> None:
    """Say where the meshes are as seen from `folder`."""
    for mesh in model.meshes():
        mesh.set("filename", os.path.relpath(mesh.attrib["filename"], folder))


def _told(text: str, left_out: Sequence[Effect]) -> str:
    """The file with a line on what is not in it, behind its outermost element's head."""
    if not left_out:
        return text
    root = ET.fromstring(text)
    values = [{name: value for name, value in one.to_dict().items() if name not in ("effect", "target")} for one in left_out]
    said = ", ".join(
        f"{one.name} of {one.target} ({', '.join(f'{name} {value}' for name, value in own.items())})" for one, own in zip(left_out, values, strict=True)
    )
    root.insert(0, ET.Comment(f" Not held by this format: {said.replace('--', '- -')} "))
    return ET.tostring(root, encoding="unicode")
