"""What the tests of the physics share: MuJoCo as the other engine, and Gymnasium's own model files."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

from mpge_bench.envs.model import Model


def _in_mujoco(model: Model, *, timestep: float = 1e-4, gravity: Sequence[float] = (0.0, 0.0, -9.81)) -> Any:
    root = ET.fromstring(model.text())
    for link in root.findall("link"):
        # Inertias are given; a body without any must not get one from what is seen of it.
        for part in (*link.findall("visual"), *link.findall("collision")):
            link.remove(part)
        inertial = link.find("inertial")
        if inertial is not None and float(inertial.find("mass").attrib["value"]) == 0:  # type: ignore[union-attr]
            link.remove(inertial)
    settings = ET.SubElement(root, "mujoco")
    ET.SubElement(settings, "compiler", fusestatic="false", balanceinertia="false", discardvisual="true", boundmass="1e-9", boundinertia="1e-12")
    spec = mujoco.MjSpec.from_string(ET.tostring(root).decode())
    if model.floating:
        spec.worldbody.first_body().add_freejoint()
    spec.option.timestep, spec.option.integrator, spec.option.gravity = timestep, mujoco.mjtIntegrator.mjINT_RK4, gravity
    return spec.compile()


@pytest.fixture(scope="session")
def in_mujoco() -> Callable[..., Any]:
    """Compiles a `Model` in MuJoCo, without its shapes: in_mujoco(model, timestep=..., gravity=...) is a mujoco.MjModel."""
    return _in_mujoco


@pytest.fixture(scope="session")
def gyms_own(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Any]:
    """Compiles one of Gymnasium's model files: gyms_own("ant") is a mujoco.MjModel."""
    assets = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"

    def compiled(name: str) -> Any:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path_factory.mktemp("mujoco"))  # where it may leave a log
            return mujoco.MjModel.from_xml_path(str(assets / f"{name}.xml"))

    return compiled


def _put(model: Any, data: Any, joints: Sequence[str], q: np.ndarray, dq: np.ndarray) -> None:
    places, speeds = len(q) - len(joints), len(dq) - len(joints)
    if places:
        data.qpos[:3], data.qpos[3:7] = q[:3], q[[6, 3, 4, 5]]
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, data.qpos[3:7])
        data.qvel[:3], data.qvel[3:6] = dq[:3], turn.reshape(3, 3).T @ dq[3:6]
    for index, name in enumerate(joints):
        joint = model.joint(name)
        data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = q[places + index], dq[speeds + index]


@pytest.fixture(scope="session")
def put() -> Callable[..., None]:
    """Puts MuJoCo's data at the q and dq of a World: put(mj_model, mj_data, joints, q, dq)."""
    return _put
