"""A look at what decides what becomes of a start: beside a model's own starts it predicts nonsense, and promises nothing, however right it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mpge_bench.diagnosis.free.windows import Windows
from mpge_bench.diagnosis.settings import ReplaySettings
from mpge_bench.diagnosis.transitions.choose import Search
from mpge_bench.diagnosis.transitions.fit import Model, effects_of, model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.trials import fitted_beside
from mpge_bench.envs.effects.vector import parameters_of


def promising(search: Search, windows: Windows, model: Model) -> Model | None:
    """`model` and that of what decides what becomes of starts which describes some `windows` best, each about its own starts; None where none does better."""
    starts = [(one, start) for one in search.hypotheses if one.kind.moves_starts and search.is_more(one, model) for start in one.starts]
    if not starts or search.late("looking for effects"):
        return None
    added = [((), ()), *(((one,), (tuple(parameters_of(start)),)) for one, start in starts)]
    some = windows.part(windows.heads(windows.settings.own_starts))
    found: list[Model] = search.each(_beside, (some, model, search.settings), added)  # type: ignore[assignment]
    best = min(found, key=lambda one: one.description)
    return best if search.is_better(best, found[0]) else None


def _beside(some: Windows, model: Model, settings: ReplaySettings, added: tuple[Sequence[Hypothesis], Sequence[Sequence[float]]]) -> Model:
    """`model` and hypotheses `added` to it, fitted from these parameters about the starts that are likeliest with all of them."""
    own = some.relinearised(effects_of((*model.hypotheses, *added[0]), (*model.values, *added[1])), anew=True)
    every = np.arange(len(own))
    if not model.hypotheses and not added[0]:
        return model_of(own, (), (), every, settings)
    return fitted_beside(own, model, every, settings, settings.iterations, added)
