"""Rotors stand for armature: they add up, and flywheels take over what acts on the joints that they turn with."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from mpge_bench.envs.errors import UserError
from mpge_bench.envs.model import Model
from mpge_bench.envs.robots.robot import MODELS

from .conftest import TREE, a_joint, a_link, in_file, model_of, numbers


def test_rotors_scale_and_add_up(tmp_path: Path) -> None:
    for floating, carried in ((False, False), (False, True), (True, False)):
        model = Model(model_of(tmp_path, *TREE), floating=floating)
        model.add_rotor("a", 0.3, carried=carried)
        model.add_rotor("a", 0.1, carried=carried)
        model.add_rotor("b", 0.5, carried=carried)
        other = model.copy()
        model.scale_rotor("a", 3.0)
        inertias = [inertia_of_rotor(one, name) for one in (model, other) for name in "ab"]
        assert inertias == pytest.approx([1.2, 0.5, 0.4, 0.5])
        with pytest.raises(UserError, match=r"joint 'c' has no rotor whose inertia could be scaled \(those with one: a, b\)"):
            model.scale_rotor("c", 2.0)


def inertia_of_rotor(model: Model, joint: str) -> float:
    """Of the rotor of `joint`, on the joint's side of the gear."""
    if joint in model.flywheels:
        return model.flywheels[joint]
    return numbers(in_file(model, f"link[@name='{joint}:rotor']/inertial/inertia"), "izz")[0] * model.rotors[joint] ** 2


def test_flywheels_take_the_joints_damping_and_end_stops_over() -> None:
    ant = Model(MODELS / "ant.urdf", floating=True)
    for name, inertia in (("hip_1", 1.0), ("ankle_3", 2.0)):
        ant.add_rotor(name, inertia)
    wheels = ET.fromstring(ant.take_flywheels())
    assert [one.get("name") for one in wheels.findall("joint")] == ["hip_1", "ankle_3"]
    for name, inertia, low in (("hip_1", 1.0, -0.5235988), ("ankle_3", 2.0, -1.22173)):
        wheel = wheels.find(f"joint[@name='{name}']")
        assert wheel is not None
        assert wheel.get("type") == "revolute"
        assert float(wheel.find("limit").attrib["lower"]) == low  # type: ignore[union-attr]
        assert float(wheel.find("dynamics").attrib["damping"]) == 1.0  # type: ignore[union-attr]
        assert float(wheels.find(f"link[@name='{name}']/inertial/inertia").attrib["izz"]) == inertia  # type: ignore[union-attr]
        left = in_file(ant, f"joint[@name='{name}']")
        assert left.get("type") == "continuous"
        assert left.find("limit") is None
        assert left.find("dynamics") is None
    assert in_file(ant, "joint[@name='hip_2']/limit") is not None


def test_flywheels_of_slides_leave_the_slide_without_an_end(tmp_path: Path) -> None:
    slide = a_joint("a", "base", "arm", '<limit lower="-0.2" upper="0.3" effort="1" velocity="1"/>', "prismatic")
    model = Model(model_of(tmp_path, a_link("base"), a_link("arm"), slide), floating=True)
    model.add_rotor("a", 0.5)
    wheel = ET.fromstring(model.take_flywheels()).find("joint[@name='a']")
    assert wheel is not None
    assert (wheel.get("type"), wheel.find("limit").attrib["upper"]) == ("prismatic", "0.3")  # type: ignore[union-attr]
    assert in_file(model, "joint[@name='a']").get("type") == "prismatic"
    limit = in_file(model, "joint[@name='a']/limit")
    assert float(limit.attrib["lower"]) > float(limit.attrib["upper"])
