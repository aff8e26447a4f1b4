"""What is said of a verdict is no more than was seen."""

from __future__ import annotations

from pathlib import Path

import pytest

from mpge_bench.diagnosis.pipeline import diagnose_files
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.verdict import words
from mpge_bench.diagnosis.verdict.result import Accuracy, Errors
from mpge_bench.diagnosis.verdict.words import quiet_lines
from mpge_bench.envs.effects import Armature, Gravity, MassScale, TorqueLimit

from ..conftest import write_case


@pytest.mark.parametrize(
    ("before", "step", "is_chance", "is_there", "says"),
    [
        (0.012, 0.001, False, None, ["mends", "p < 0.001", "0.012 rad", "0.01"]),
        (0.03, 0.03, True, True, ["cannot be told from", "0.03 rad", "physics step 0.03"]),
        (0.6, 0.02, True, None, ["cannot be told from", "0.6 rad", "more than both", "not as exact as they seem, or something acts there"]),
        (0.6, 0.02, True, True, ["more than both", "so it is from the best starting states: something acts there"]),
        (0.6, 0.02, True, False, ["more than both", "it is the noise: recorded states are not as exact"]),
    ],
)
def test_what_is_missed_beside_the_noise_is_not_called_the_noise_s(
    before: float, step: float, is_chance: bool, is_there: bool | None, says: list[str]
) -> None:
    """Of a held-out error sixty times the noise, with p < .001, it was said that the simulator predicts to within the noise."""
    fit = Accuracy(0.5, Errors(before, before, 0.01, "rad"), {})
    lines = quiet_lines("p < 0.001" if not is_chance else "p = 0.4", is_chance, fit, step, lambda: is_there, DEFAULT.verdict)
    assert len(lines) == (3 if "more than both" in says else 2)
    said = " ".join(lines)
    assert all(words in said for words in says)
    assert "to within the sensors' noise" not in said


def test_what_only_the_held_out_recording_shows_is_said(tmp_path: Path) -> None:
    rig = write_case(tmp_path, [TorqueLimit("hinge", 2.0)], loud=(0.5, 0.5, 0.5, 4.0))
    found = diagnose_files(rig, [str(tmp_path / "train_*.csv")], tmp_path / "report", jobs=1)
    assert found.data["verdict"] == "no_mismatch"
    assert "give that recording first" in found.summary[2]


def test_what_people_can_measure_they_are_asked_to_be_certain_of() -> None:
    """A measured servo was said to be in gravity of 6.5 m/s²: certain of gravity and load it has a rotor."""
    named = [Armature("hinge", 0.1), Gravity("world", (0.0, 0.0, -6.5)), MassScale("arm", 1.2)]
    assert "`certain: [gravity, mass_scale:arm]`" in words._measurable(named)
    assert not words._measurable(named[:1])


ANSWER = tuple(f"{kind}:{leg}" for kind in ("coulomb_friction", "armature") for leg in ("a", "b", "c", "d"))


@pytest.mark.parametrize(
    ("effects", "answer", "says"),
    [
        (ANSWER[:2], ANSWER, "coulomb_friction:a + coulomb_friction:b"),
        (ANSWER[:-1], ANSWER, "all this without armature:d"),
        ((*ANSWER[1:], "payload:a"), ANSWER, "all this with payload:a without coulomb_friction:a"),
        (ANSWER, ANSWER, "all this with other parameters"),
        (ANSWER, ("payload:a",), " + ".join(ANSWER)),
    ],
)
def test_a_model_of_many_effects_is_told_by_what_it_differs_in(effects: tuple[str, ...], answer: tuple[str, ...], says: str) -> None:
    assert words._told(effects, answer, DEFAULT.verdict) == says
