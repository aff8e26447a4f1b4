"""Whether an answer predicts windows that nobody looked at."""

from __future__ import annotations

import pytest

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.free.held_out import Left, left_of
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import ContactFriction, Gravity

from .conftest import Tossed
from .test_windows import measured, windows_of

HIDDEN = (ContactFriction("brick", 0.15), Gravity("world", (0.0, 0.0, -8.0)))


@pytest.fixture(scope="module")
def of_answers(tossed: Tossed) -> dict[str, Left]:
    """What the true effects leave, and one of them alone."""
    unseen = windows_of(*measured(tossed(HIDDEN, tosses=4, twist=True)), DEFAULT.free, 20)
    answers = {"right": HIDDEN, "without gravity": HIDDEN[:1], "without friction": HIDDEN[1:]}
    return {name: left_of(Workers(1), unseen, effects, DEFAULT) for name, effects in answers.items()}


def test_the_true_effects_leave_little(of_answers: dict[str, Left]) -> None:
    assert not of_answers["right"].is_much(DEFAULT)
    assert of_answers["right"].windows > 10


@pytest.mark.parametrize("missing", ["gravity", "friction"])
def test_where_an_effect_is_missing_much_is_left(of_answers: dict[str, Left], missing: str) -> None:
    """A ball's friction was missing beside gravity, which showed in a few windows alone, and all was said to be explained."""
    assert of_answers[f"without {missing}"].is_much(DEFAULT)
    assert of_answers[f"without {missing}"].missed > of_answers["right"].missed


def test_one_contact_in_ten_is_not_much() -> None:
    assert not Left(1, 0, 10).is_much(DEFAULT)
    assert Left(2, 0, 10).is_much(DEFAULT)
    assert not Left(0, 0, 0).is_much(DEFAULT)


def test_what_the_simulator_does_not_repeat_itself_is_not() -> None:
    """Of a walker whose lag was right a third of the windows were missed: its feet do not come down twice at the same moment."""
    assert not Left(14, 12, 40).is_much(DEFAULT)
    assert Left(30, 12, 40).is_much(DEFAULT)
