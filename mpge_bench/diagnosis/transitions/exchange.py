"""A rival of one hypothesis of a model in that one's place: what described a little worse when it was tried may describe better beside all found since."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mpge_bench.diagnosis.transitions.fit import Model
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.trials import Trials


def exchanged(trials: Trials, model: Model) -> Model:
    """The first that describes better of `model`, if that leaves something, with a rival in the place of one of its hypotheses; else `model`."""
    rivals = list(_rivals(trials, model))[: trials.settings.exchanged]
    # Most models have none, and whether something is left takes a replay of everything.
    if not rivals or not trials.is_lacking(model, trials.settings.exact_share):
        return model
    for one, rival, values in rivals:
        if trials.late("effects in each other's place"):
            break
        others, own = model.without(one)
        tried = trials.add(trials.fitted((*others, rival), (*own, values)))
        if trials.is_better(tried, model):
            return tried
    return model


def _rivals(trials: Trials, model: Model) -> Iterator[tuple[Hypothesis, Hypothesis, Sequence[float]]]:
    """A hypothesis of `model`, one that was fitted in its place beside those found before it, and its values there; the nearest rivals first."""
    seen = set()
    for fitted in sorted(trials.models.values(), key=lambda other: other.description):
        news = [place for place, one in enumerate(fitted.hypotheses) if one.key not in model.key]
        if len(news) != 1:
            continue
        rival = fitted.hypotheses[news[0]]
        before = fitted.key - {rival.key}
        for one in model.hypotheses:
            replaces = one.key not in before and before | {one.key} in trials.models and model.key - {one.key} | {rival.key} not in trials.models
            if replaces and (one.key, rival.key) not in seen:
                seen.add((one.key, rival.key))
                yield one, rival, fitted.values[news[0]]
