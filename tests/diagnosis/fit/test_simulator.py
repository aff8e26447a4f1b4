"""Fits in the simulator itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.checks import measurements
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit import simulator
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Problem, problem
from mpge_bench.diagnosis.fit.simulator import _refined, nominal, polished
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.envs.effects import Backlash, Effect, JointElasticity, SensorDelay, TorqueLimit, ViscousFriction
from mpge_bench.envs.effects.vector import values_of

from ..conftest import asking_with, posed, write_case, write_rig


def _posed(folder: Path, *effects: Effect) -> Problem:
    return asking_with(write_case(folder, effects))


@pytest.mark.slow
def test_the_damping_of_an_elastic_joint_comes_out_right(tmp_path: Path) -> None:
    """A lightly damped motor forgets where it was within a second; taken to be where the recorded joint drives it, it would be damped twice as much."""
    truth = JointElasticity("hinge", 60.0, 0.06, 0.02)
    posed = _posed(tmp_path, truth)
    effects: tuple[Effect, ...] = (replace(truth, damping=0.12, stiffness=66.0),)
    for _ in range(3):
        model, _ = polished(posed, effects)
        effects = model.effects
    (found,) = effects
    assert isinstance(found, JointElasticity)
    values = np.array([found.stiffness, found.damping, found.motor_inertia])
    np.testing.assert_allclose(values, [60.0, 0.06, 0.02], rtol=0.2)
    assert np.abs((values - [60.0, 0.06, 0.02]) / model.standard_errors).max() < 3


@pytest.mark.slow
def test_a_late_sensor_comes_out_right_under_commands_that_jump(rig: Rig) -> None:
    """What it read before a window was known but from the smoothed recording, to twelve times the noise where the motor's torque jumped between two rows."""
    late, step, held = 0.024, 0.001, 30
    rng = np.random.default_rng(0)
    recordings = []
    for number in range(4):
        commands = np.repeat(rng.uniform(-1.0, 1.0, (14, 2)), 10 * held, 0)
        world = rig.world([], substeps=1)
        world.set_state(rng.uniform(-0.5, 0.5, 2), rng.uniform(-1, 1, 2))
        q, dq = world.roll(commands)
        at = np.arange(10, len(q) // 10) * 10
        # `roll` tells what is there after each step.
        past = at - round(late / step) - 1
        noise = rng.standard_normal((2, len(at), 2)) * [[[5e-4]], [[5e-3]]]
        recordings.append(Recording(rig.path.parent / f"{number}.csv", at * step, commands[at], q[past] + noise[0], dq[past] + noise[1]))
    both = (SensorDelay("shoulder", 0.02), SensorDelay("elbow", 0.02))
    measured = measurements(rig, recordings)
    posed = problem(measured, reference(rig, measured.recordings), 0.5)
    for _ in range(3):
        model, _ = polished(posed, both)
        both = model.effects  # type: ignore[assignment]
    assert [one.seconds for one in both] == pytest.approx([late, late], abs=2e-4)
    assert model.overall < 1.2


def test_starting_states_of_motors_are_unknowns(tmp_path: Path) -> None:
    posed = _posed(tmp_path, Backlash("hinge", 0.04, 0.02))
    assert posed.fitter([Backlash("hinge", 0.03, 0.02)]).predictor.flow.shape[-1] == 4
    assert posed.fitter([ViscousFriction("hinge", 0.03)]).predictor.flow.shape[-1] == 2
    # No model is better for having more of them: the same number of readings is left to judge it by.
    left = [posed.fitter([effect]).count.mean() for effect in (Backlash("hinge", 0.03, 0.02), ViscousFriction("hinge", 0.03))]
    assert abs(left[0] / left[1] - 1) < 0.1


def test_a_fit_is_never_worse_than_what_it_began_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the linearised simulator leads away, as it may with friction that falls with speed."""
    truth, away = ViscousFriction("hinge", 0.03), ViscousFriction("hinge", 3.0)
    posed, fit = _posed(tmp_path, truth), LinearFitter.fit
    held = polished(posed, (truth,), evaluations=1)[0]
    monkeypatch.setattr(LinearFitter, "fit", lambda self, effects, evaluations: fit(self, effects if evaluations == 1 else (away,), evaluations=1))
    model = polished(posed, (truth,))[0]
    assert model.train == pytest.approx(held.train)
    assert model.effects == held.effects


def test_a_step_too_far_is_halved(tmp_path: Path) -> None:
    """With derivatives a third of what they are, a step goes three times too far: a fit that stopped there would stay where it began."""
    posed = _posed(tmp_path, ViscousFriction("hinge", 0.03))
    fitter = posed.fitter([ViscousFriction("hinge", 0.02)])
    fit = fitter.fit([ViscousFriction("hinge", 0.02)], evaluations=1)
    wrong = replace(fit, jacobian=fit.jacobian / 3)
    stuck, found = _refined(posed, fitter, wrong, 1), _refined(posed, fitter, wrong, 1, halvings=2)
    assert stuck.effects == fit.effects
    assert values_of(found.effects)[0] == pytest.approx(0.03, rel=0.3)


def test_parameters_under_which_the_simulation_flies_apart_are_come_back_from(tmp_path: Path) -> None:
    """As far as absence is off them: of an arm's last link, damped less than that, the only effect that there was had been dropped for it."""
    posed = _posed(tmp_path, ViscousFriction("hinge", 0.03))
    fitter = posed.fitter()
    # Beyond 2 I / h = 165 N m s/rad each step makes the velocity larger.
    for far, value in ((200.0, 100.01), (500.0, 125.015), (1e4, None)):
        found = _refined(posed, fitter, replace(fitter.fit([ViscousFriction("hinge", 0.02)], evaluations=1), effects=(ViscousFriction("hinge", far),)), 0)
        assert np.isfinite(found.chi_square) == (value is not None)
        assert values_of(found.effects)[0] == pytest.approx(value or far)


def test_what_is_absent_without_end_is_gone_back_from_by_doubling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    posed, tried = _posed(tmp_path, ViscousFriction("hinge", 0.03)), []

    def apart(problem: Problem, fitter: LinearFitter, effects: tuple[Effect, ...], starts: object, before: object) -> None:
        tried.append(values_of(effects).tolist())

    monkeypatch.setattr(simulator, "_tried", apart)
    for effect in (TorqueLimit("hinge", 3.0), JointElasticity("hinge", 5.0, 0.1, 0.01)):
        assert simulator._begun(posed, posed.fitter(), (effect,)) is None
    assert tried == [[3.0], [6.0], [12.0], [5.0, 0.1, 0.01], [10.0, 0.05, 0.005], [20.0, 0.025, 0.0025]]


@pytest.mark.parametrize("own", [{"effect": "delay", "target": "elbow", "seconds": 0.02}, {"effect": "lag", "target": "elbow", "time_constant": 0.03}])
def test_a_rig_whose_motors_are_late_by_itself_is_tested_like_any(own: dict[str, object], tmp_path: Path) -> None:
    """A corrected rig with a late motor, diagnosed again, ended in a traceback: beside what is forgiven there were no parameters."""
    asked = posed(read_rig(write_rig(tmp_path, effects=[own])), seconds=2.0, noise=1e-4)
    model, _ = nominal(asked)
    assert model.effects == ()
    assert model.overall < 1.3
