"""A rig says what its file says, or in one line what is wrong with the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.hypotheses.candidates import candidate_targets
from mpge_bench.diagnosis.predict.torques import joint_torques
from mpge_bench.envs import ROBOTS
from mpge_bench.envs.effects import (
    CATALOGUE,
    Armature,
    CoulombFriction,
    DcMotor,
    Delay,
    Effect,
    JointSpring,
    Lag,
    PositionServo,
    TorqueGain,
    UnknownTorque,
    ViscousFriction,
)
from mpge_bench.envs.effects.vector import bounds_of, parameters_of, with_parameters
from mpge_bench.envs.errors import UserError

from ..conftest import ARM, record, write_rig

TORQUE = {"mode": "torque"}


def refusal(path: Path) -> str:
    """The one line with which the rig in the file is refused; it begins with the file's path."""
    with pytest.raises(UserError) as error:
        read_rig(path)
    said = str(error.value)
    assert "\n" not in said
    return said


def test_a_rig_is_what_its_file_says(tmp_path: Path) -> None:
    joints = {"shoulder": {"mode": "position", "kp": 20, "kd": 0.5, "servo_period": 0.002}, "elbow": {"mode": "passive"}}
    spring = {"effect": "joint_spring", "target": "elbow", "stiffness": 2.0}
    rig = read_rig(write_rig(tmp_path, joints=joints, gravity=[0, 1, -9], noise={"q": 0.001}, effects=[spring], timestep=0.002, record_period=0.02))
    assert (rig.joints, rig.driven, dict(rig.modes)) == (("shoulder", "elbow"), ("shoulder",), {"shoulder": "position", "elbow": "passive"})
    assert (rig.timestep, rig.record_period, rig.gravity, rig.noise) == (0.002, 0.02, (0.0, 1.0, -9.0), {"q": 0.001})
    servo, losses = PositionServo("shoulder", 20, 0.5, 0.002), (ViscousFriction("shoulder", 0.3), ViscousFriction("elbow", 0.05))
    assert rig.nominal == (servo, *losses, JointSpring("elbow", 2.0))
    gain, rub = TorqueGain("shoulder", 0.5), CoulombFriction("elbow", 0.1)
    assert rig.chain([rub, gain])[:2] == (servo, gain)


def test_a_rig_may_be_a_robot_of_the_benchmark_by_its_name_or_by_a_pairs(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text("task: hopper\nnoise: {q: 0.001}\n")
    rig, hopper = read_rig(tmp_path / "rig.yaml"), ROBOTS["hopper"]
    assert not rig.is_tree
    assert (rig.robot, rig.joints, rig.driven, rig.ground) == (hopper, hopper.joints, tuple(hopper.actuators), True)
    assert (rig.record_period, rig.world().timestep) == (hopper.dt, hopper.timestep)
    corrected = rig.corrected([TorqueGain("thigh_joint", 0.5)], "nothing")
    assert corrected == {"task": "hopper", "noise": {"q": 0.001}, "effects": [{"effect": "torque_gain", "target": "thigh_joint", "gain": 0.5}]}
    (tmp_path / "rig.yaml").write_text("task: broken_hopper\n")
    assert read_rig(tmp_path / "rig.yaml").robot == hopper
    (tmp_path / "rig.yaml").write_text("task: hoper\n")
    assert "unknown task 'hoper'" in refusal(tmp_path / "rig.yaml")


def test_a_rig_is_certain_of_effects_on_all_or_on_one_thing_and_keeps_that(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path, certain=["gravity", "delay:elbow"]))
    assert rig.is_certain("gravity", ["world"])
    assert [rig.is_certain("delay", [target]) for target in ("elbow", "shoulder")] == [True, False]
    # All motors late by the same would be that one, too.
    assert rig.is_certain("delay", ["*"])
    assert rig.is_certain("delay", ["shoulder", "elbow"])
    assert not rig.is_certain("lag", ["*"])
    assert rig.corrected([], "arm.urdf")["certain"] == ["gravity", "delay:elbow"]


def test_the_grounds_friction_is_that_of_the_contact(tmp_path: Path) -> None:
    """Times the link's own where the robot's file gives some."""
    for contact, friction in (("", 0.4), ('<contact><lateral_friction value="0.5"/></contact>', 0.2)):
        shape = '<collision><geometry><sphere radius="0.1"/></geometry></collision></link>\n<link name="lower">'
        path = write_rig(tmp_path, base="free", ground={"friction": 0.4, "restitution": 0.1})
        whole = ARM.replace('<link name="base"/>', '<link name="base"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1"/></inertial></link>')
        (tmp_path / "arm.urdf").write_text(whole.replace('</link>\n<link name="lower">', contact + shape))
        rig = read_rig(path)
        assert (rig.model.friction("upper"), rig.model.restitution("upper")) == pytest.approx((friction, 0.1))
        assert rig.columns["q"] == ("x", "y", "z", "qx", "qy", "qz", "qw", "q_shoulder", "q_elbow")
        assert (rig.layout.nq, rig.layout.nv, rig.world().floating) == (9, 8, True)


def test_what_a_rig_need_not_say(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path, timestep=None, record_period=None))
    assert (rig.timestep, rig.record_period, rig.gravity, rig.noise) == (0.001, 0.01, (0.0, 0.0, -9.81), {})


def test_numbers_may_be_written_as_in_yaml_1_2(tmp_path: Path) -> None:
    path = write_rig(tmp_path)
    path.write_text(path.read_text().replace("timestep: 0.001", "timestep: 5e-4") + "noise: {q: 1e-3, dq: 2.E-2}\n")
    rig = read_rig(path)
    assert (rig.timestep, rig.noise) == (5e-4, {"q": 1e-3, "dq": 0.02})


def test_a_joints_losses_become_effects(tmp_path: Path) -> None:
    path = write_rig(tmp_path)
    (tmp_path / "arm.urdf").write_text(ARM.replace('damping="0.3"', 'friction="0.2"').replace('damping="0.05"', 'damping="0"'))
    assert read_rig(path).nominal == (CoulombFriction("shoulder", 0.2),)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"robot": None}, "no key 'robot'"),
        ({"joints": None}, "no key 'joints'"),
        ({"gravty": [0, 0, -9.81]}, "unknown key 'gravty'; a rig has base, certain, effects, gravity"),
        ({"robot": 3}, "robot is 3; give the path"),
        ({"robot": "nowhere.urdf"}, "nowhere.urdf: not a readable URDF or MJCF file"),
        ({"base": "loose"}, "base is 'loose'; choose fixed or free"),
        ({"ground": 0.8}, "ground is 0.8; give numbers of at least 0, such as {friction: 0.8"),
        ({"ground": {"friction": -1}}, "ground is .*give numbers of at least 0"),
        ({"ground": {"stiffness": 1}}, "ground is .*give numbers of at least 0"),
        ({"task": "hopper"}, "unknown key 'joints'; a rig of a robot of the benchmark has certain, effects, noise, task"),
        ({"timestep": 0}, "timestep is 0; give a number of seconds, at least 1e-06"),
        ({"timestep": 5e-324}, "timestep is 5e-324; give a number of seconds"),
        ({"timestep": "1 ms"}, "timestep is '1 ms'; give a number of seconds"),
        ({"timestep": True}, "timestep is True"),
        ({"record_period": -0.01}, "record_period is -0.01"),
        ({"gravity": -9.81}, "gravity is -9.81; give three numbers"),
        ({"gravity": [0, 0, float("nan")]}, r"gravity is \[0, 0, nan\]; give three numbers"),
        ({"noise": {"q": 0}}, "noise is .*give positive numbers"),
        ({"noise": {"u": 0.1}}, "noise is .*give positive numbers"),
        ({"noise": [0.1]}, "noise is .*give positive numbers"),
        ({"joints": ["shoulder", "elbow"]}, "joints is .*give each recorded joint and its mode"),
        ({"joints": {"shoulder": TORQUE, "elbow": TORQUE, "wrist": TORQUE}}, "joint 'wrist' is not in arm.urdf, which has shoulder, elbow"),
        ({"joints": {"shoulder": TORQUE, "elbow": TORQUE, 3: TORQUE}}, "joint 3 is not in arm.urdf"),
        ({"joints": {"shoulder": TORQUE}}, "joint 'elbow' of arm.urdf is not among the recorded joints"),
        ({"joints": {"shoulder": TORQUE, "elbow": "torque"}}, "joint elbow is 'torque'; give its mode, such as elbow: {mode: torque}"),
        ({"joints": {"shoulder": TORQUE, "elbow": {"mode": "velocity"}}}, "joint elbow has mode 'velocity'; choose torque, position or passive"),
        ({"joints": {"shoulder": TORQUE, "elbow": {"mode": ["torque"]}}}, r"joint elbow has mode \['torque'\]"),
        ({"joints": {"shoulder": TORQUE, "elbow": {}}}, "joint elbow has mode None"),
        ({"joints": {"shoulder": TORQUE, "elbow": {"mode": "torque", "kp": 3}}}, "joint elbow in torque mode takes nothing more; got kp"),
        ({"joints": {"shoulder": TORQUE, "elbow": {"mode": "torque", 1: 3, "a": 2}}}, "takes nothing more; got 1, a"),
        ({"joints": {"shoulder": TORQUE, "elbow": {"mode": "position"}}}, "joint elbow in position mode takes kd, kp, servo_period; got nothing"),
        ({"joints": {"shoulder": TORQUE, "elbow": {"mode": "position", "kp": "stiff"}}}, "position_servo on elbow: kp = stiff"),
        ({"effects": {"effect": "torque_gain"}}, "effects is .*give a list"),
        ({"effects": ["torque_gain"]}, r"effects\[0\]: an effect is a mapping"),
        ({"effects": [{"effect": "torque_gain", "target": "elbow"}]}, r"effects\[0\]: effect torque_gain takes gain, target; got target"),
        ({"effects": [{"effect": "torque_gain", "target": "wrist", "gain": 1.0}]}, "effect torque_gain: no joint 'wrist'; the model has shoulder, elbow"),
        ({"effects": [{"effect": "mass_scale", "target": "hand", "factor": 1.0}]}, "no link 'hand'"),
        ({"certain": "gravity"}, r"certain is 'gravity'; give a list of effects, such as \[gravity"),
        ({"certain": ["weight"]}, "certain has 'weight'; an effect is one of air_drag, "),
        ({"certain": [3]}, "certain has 3; an effect is one of"),
        ({"certain": ["mass_scale:hand"]}, "certain has 'mass_scale:hand'; what effects act on is one of elbow, lower, shoulder, upper"),
    ],
)
def test_what_is_wrong_with_a_rig_is_one_line(tmp_path: Path, changes: dict[str, Any], says: str) -> None:
    path = write_rig(tmp_path, **changes)
    with pytest.raises(UserError, match=says):
        read_rig(path)
    assert refusal(path).startswith(str(tmp_path))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (b"", "a rig is a YAML mapping with robot, joints, ...; this is NoneType"),
        (b"- robot", "this is list"),
        (b"robot: [", "not a readable rig"),
        (b"robot: a\n  b: c: d", "not a readable rig"),
        (b"\xff\xfe\x00\x01", "not a readable rig"),
        (b"robot: !!python/object/apply:os.getcwd []", "not a readable rig"),
        (b"? [a]\n: b", "not a readable rig"),
    ],
)
def test_what_is_no_yaml_mapping_is_one_line(tmp_path: Path, text: bytes, says: str) -> None:
    path = tmp_path / "rig.yaml"
    path.write_bytes(text)
    assert says in refusal(path)
    assert refusal(path).startswith(str(path))


def test_what_is_no_file_is_one_line(tmp_path: Path) -> None:
    assert "not a readable rig" in refusal(tmp_path / "nowhere.yaml")
    assert "not a readable rig" in refusal(tmp_path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('damping="0.3"', 'damping="some"'),
        ('damping="0.3"', 'damping="-1"'),
        ('mass value="0.8"', 'mass value="big"'),
        ('iyy="0.01" izz="0.002"', 'iyy="0.01" izz="0.03"'),
        ('iyy="0.01" izz="0.002"', 'iyy="0.01" izz="-0.002"'),
        ('<child link="upper"/><axis xyz="0 1 0"/>', '<child link="upper"/><axis xyz="0 0 0"/>'),
        ('<child link="upper"/><axis xyz="0 1 0"/>', '<child link="upper"/><axis xyz="0 1"/>'),
    ],
)
def test_what_is_wrong_with_the_robots_file_is_one_line(tmp_path: Path, old: str, new: str) -> None:
    path = write_rig(tmp_path)
    assert old in ARM
    (tmp_path / "arm.urdf").write_text(ARM.replace(old, new))
    assert refusal(path).startswith(str(tmp_path))


@st.composite
def effects(draw: st.DrawFn, rig: Rig) -> Effect:
    """Any effect of the catalogue on anything in the rig that it can act on."""
    # The arm has no shapes, no ground and no rotors.
    contact = {"contact_compliance", "contact_friction", "ground_height", "ground_tilt", "restitution"}
    name = draw(st.sampled_from(sorted(set(CATALOGUE) - contact - {"link_size", "reflected_inertia", "rotor_scale"})))
    kind = CATALOGUE[name]
    values: dict[str, Any] = {}
    points = draw(st.integers(1, 4))
    for parameter, bound in kind.parameters.items():
        # PyBullet's dynamics functions fail on links of a few kg m², for rounding alone.
        low, high = max(bound.low, 1e-3 if bound.low >= 0 else -0.5), min(bound.high, 0.5)
        number, count = st.floats(low, high), bound.size or points
        values[parameter] = draw(number if bound.size == 1 else st.lists(number, min_size=count, max_size=count, unique=True).map(sorted).map(tuple))
    if kind is UnknownTorque:
        values["signal"] = draw(st.sampled_from(["q", "dq", "command"]))
    target = draw(st.sampled_from(candidate_targets(rig, name)))
    if kind.on == "pair":
        values["other"] = draw(st.sampled_from([joint for joint in rig.joints if joint != target]))
    return kind(target, **values)


@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_corrected_rig_is_a_rig_with_more_effects(rig: Rig, data: st.DataObject) -> None:
    once, twice = (tuple(data.draw(st.lists(effects(rig), max_size=3))) for _ in range(2))
    path = rig.path.parent / "corrected.yaml"
    path.write_text(yaml.safe_dump(rig.corrected(once, rig.model.path.name)))
    corrected = read_rig(path)
    assert corrected.chain() == rig.chain(once)
    assert (corrected.joints, corrected.modes, corrected.timestep, corrected.gravity) == (rig.joints, rig.modes, rig.timestep, rig.gravity)
    path.write_text(yaml.safe_dump(corrected.corrected(twice, rig.model.path.name)))
    assert read_rig(path).chain() == corrected.chain(twice)


def test_an_effect_stands_in_the_place_of_what_the_rig_says_of_the_same(tmp_path: Path) -> None:
    listed = [Delay("elbow", 0.03), Delay("elbow", 0.01), TorqueGain("elbow", 0.8), UnknownTorque("elbow", "q", (0.0, 1.0), (0.0, 0.1))]
    rig = read_rig(write_rig(tmp_path, effects=[ViscousFriction("elbow", 0.2).to_dict(), *(effect.to_dict() for effect in listed)]))
    # What the rig lists goes before what its model says; delays add up, gains have one value, curves are beside each other.
    assert rig.nominal == (ViscousFriction("shoulder", 0.3), ViscousFriction("elbow", 0.2), *listed)
    assert rig.own(Delay("elbow", 0.02)) == Delay("elbow", 0.04)
    assert rig.own(TorqueGain("elbow", 0.5)) == TorqueGain("elbow", 0.8)
    assert rig.own(Delay("shoulder", 0.02)) is None
    assert rig.own(listed[3]) is None
    less = [ViscousFriction("elbow", 0.1), Delay("elbow", 0.02)]
    assert rig.chain(less) == (less[1], listed[2], ViscousFriction("shoulder", 0.3), less[0], listed[3])
    assert rig.joined([less[0]], ViscousFriction("elbow", 0.5), Delay("elbow", 0.5)) == (
        less[0], *listed[:2], ViscousFriction("elbow", 0.5), Delay("elbow", 0.5),
    )  # fmt: skip
    assert rig.absent([*less, TorqueGain("shoulder", 0.9)]).tolist() == [0.2, 0.04, 1.0]


def test_a_rig_with_an_empty_list_of_effects_can_be_corrected(tmp_path: Path) -> None:
    path = write_rig(tmp_path)
    path.write_text(path.read_text() + "effects:\n")
    assert read_rig(path).corrected([TorqueGain("elbow", 0.5)], "arm.urdf")["effects"] == [{"effect": "torque_gain", "target": "elbow", "gain": 0.5}]


@settings(deadline=None, max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_parameters_are_replaced_in_order_and_within_bounds(rig: Rig, data: st.DataObject) -> None:
    effect = data.draw(effects(rig).filter(lambda effect: not isinstance(effect, UnknownTorque | DcMotor)))
    values = parameters_of(effect)
    assert with_parameters(effect, values) == effect
    low, high = bounds_of(effect)
    assert all(a <= value <= b for a, value, b in zip(low, values, high, strict=True))
    assert parameters_of(with_parameters(effect, [value + 1e9 for value in values])) == high
    assert parameters_of(with_parameters(effect, [value - 1e9 for value in values])) == low


def test_effects_act_on_what_they_can_act_on(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path, joints={"shoulder": TORQUE, "elbow": {"mode": "passive"}}))
    assert candidate_targets(rig, "torque_gain") == ("shoulder",)
    assert candidate_targets(rig, "viscous_friction") == ("shoulder", "elbow")
    assert candidate_targets(rig, "sensor_bias") == ("shoulder", "elbow")
    assert candidate_targets(rig, "payload") == ("upper", "lower")
    assert candidate_targets(rig, "gravity") == ("world",)
    # There is but one motor, which is all.
    assert candidate_targets(rig, "delay") == ("shoulder",)
    # Where there is no motor there is no rotor, unless the rig says so.
    assert candidate_targets(rig, "armature") == ("shoulder",)
    assert candidate_targets(replace(rig, nominal=(Armature("elbow", 0.01),)), "armature") == ("shoulder", "elbow")


def test_what_acts_on_all_motors_is_the_same_on_each(tmp_path: Path) -> None:
    rig = read_rig(write_rig(tmp_path))
    assert candidate_targets(rig, "lag") == ("shoulder", "elbow", "*")
    assert candidate_targets(rig, "torque_gain") == ("shoulder", "elbow")
    alike, each = [Lag("*", 0.03)], [Lag("shoulder", 0.03), Lag("elbow", 0.03)]
    assert rig.chain(alike) == rig.chain(each)
    # One joint's own comes beside it.
    assert rig.chain([Delay("*", 0.02), Delay("elbow", 0.01)])[:3] == (Delay("shoulder", 0.02), Delay("elbow", 0.02), Delay("elbow", 0.01))
    one, other = record(rig, alike), record(rig, each)
    assert np.array_equal(one.q, other.q)
    assert not np.allclose(one.q, record(rig).q, rtol=0, atol=1e-3)
    corrected = rig.path.parent / "corrected.yaml"
    corrected.write_text(yaml.safe_dump(rig.corrected(alike, rig.model.path.name)))
    assert read_rig(corrected).own(Lag("*", 0.01)) == alike[0]
    # Without a motor there is nothing to be late.
    passive = read_rig(write_rig(tmp_path, joints={"shoulder": TORQUE, "elbow": {"mode": "passive"}}))
    assert passive.chain(alike)[0] == each[0]
    assert each[1] not in passive.chain(alike)


def test_what_does_not_act_on_all_motors_is_refused_there(tmp_path: Path) -> None:
    path = write_rig(tmp_path, effects=[{"effect": "torque_gain", "target": "*", "gain": 0.9}])
    assert "no joint '*'" in refusal(path)


ADDING = sorted(name for name, kind in CATALOGUE.items() if kind.adds)
#: A whole number of steps, so that delays are exact; the same for all, as each is in units of its own.
PARTS = (0.004, 0.012)


@pytest.mark.parametrize("name", ADDING)
def test_two_that_add_up_are_one_of_their_sum(rig: Rig, name: str) -> None:
    kind, target = CATALOGUE[name], candidate_targets(rig, name)[-1]
    one, other, both = (kind(target, **dict.fromkeys(kind.parameters, (size,) * 3 if "vector" in kind.parameters else size)) for size in (*PARTS, sum(PARTS)))
    at = np.linspace(0, 2, 400)
    motion = np.stack([np.sin(3 * at), np.cos(2 * at)])

    def of(*effects: Effect) -> list[np.ndarray]:
        q, dq = motion.T.copy(), motion[::-1].T.copy()
        for effect in effects:
            effect.sense(q, dq, 1, 0.001)
        chain = [(effect, 1) for effect in effects if effect.on == "joint"]
        model = rig.changed(rig.joined((), *effects))
        pushed = sum((np.array(force) for _, force in model.forces), np.zeros(3))
        torques = joint_torques(chain, 0.05 * motion, motion, motion[::-1], 0.001, np.full(2, 0.1))
        return [q, dq, torques, pushed, np.array(model.inertial("lower")[1]), np.array(rig.rotors(rig.joined((), *effects)))]

    assert any(not np.array_equal(a, b) for a, b in zip(of(one), of(both), strict=True))
    for two, sum_of_them in zip(of(one, other), of(both), strict=True):
        # A late sensor's cubic between rows is not quite the motion.
        assert two == pytest.approx(sum_of_them, abs=1e-4 if name == "sensor_delay" else 1e-12)


def test_no_module_is_imported_because_a_rig_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "others_pairs.py").write_text("raise SystemExit('run')")
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "rig.yaml").write_text("task: others_pairs:PAIR\n")
    assert "pair 'others_pairs:PAIR' is in a module, which is not imported" in refusal(tmp_path / "rig.yaml")
