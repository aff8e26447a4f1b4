"""What was a little worse when it was tried takes the place of what was better then, where it describes better beside all found since."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.exchange import exchanged
from mpge_bench.diagnosis.transitions.fit import Model
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.envs.effects import MassScale, ReflectedInertia, TorqueGain

GAIN, RIVAL, MASS = (
    Hypothesis((one.target,), (one,), None, None)  # type: ignore[arg-type]
    for one in (TorqueGain("knee", 0.8), ReflectedInertia("knee", 1.1), MassScale("shin", 2.0))
)


def model(hypotheses: Sequence[Hypothesis], description: float) -> Model:
    return Model(tuple(hypotheses), tuple((1.0,) for _ in hypotheses), np.zeros((1, 1)), description)


def trials(fitted: Sequence[Model], description: float) -> Any:
    """The models `fitted` so far; what is fitted from now on describes with `description`."""
    found = SimpleNamespace(models={one.key: one for one in fitted}, settings=DEFAULT.replay, late=lambda stage: False, asked=[])

    def fit(hypotheses: Sequence[Hypothesis], values: Sequence[Sequence[float]]) -> Model:
        found.asked.append(([one.kind.name for one in hypotheses], [list(own) for own in values]))
        return model(hypotheses, description)

    found.fitted, found.add = fit, lambda one: found.models.setdefault(one.key, one)
    found.is_better = lambda one, other: one.description < other.description
    found.is_lacking = lambda one, share: True
    return found


def test_a_rival_is_fitted_beside_what_was_found_since() -> None:
    chosen = model((GAIN, MASS), -2.0)
    fitted = [model((), 0.0), model((GAIN,), -1.0), model((RIVAL,), -0.9), chosen]
    search = trials(fitted, -2.5)
    found = exchanged(search, chosen)
    assert found.key == {RIVAL.key, MASS.key}
    assert search.asked == [(["mass_scale", "reflected_inertia"], [[1.0], [1.0]])]
    assert search.models[found.key] is found
    # Once is enough.
    assert exchanged(search, chosen) is chosen
    assert len(search.asked) == 1


def test_a_rival_that_describes_no_better_stays_out() -> None:
    chosen = model((GAIN, MASS), -2.0)
    search = trials([model((GAIN,), -1.0), model((RIVAL,), -0.9), chosen], -1.9)
    assert exchanged(search, chosen) is chosen


def test_what_was_tried_beside_other_models_is_no_rival() -> None:
    chosen = model((GAIN, MASS), -2.0)
    # Nothing of the answer was ever fitted in its place.
    search = trials([chosen, model((RIVAL,), -0.9)], -3.0)
    assert exchanged(search, chosen) is chosen
    assert search.asked == []
