"""What describes windows as well as the answer, with another hypothesis in the place of one of its: it may be what the answer is taken for."""

from __future__ import annotations

from collections.abc import Sequence

from mpge_bench.diagnosis.free.search import FreeSearch
from mpge_bench.diagnosis.transitions.choose import plainness_of
from mpge_bench.diagnosis.transitions.fit import Model, Predictor, model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.screen import Columns, Look, columns_of, look, share_of
from mpge_bench.diagnosis.transitions.trials import fitted_beside


def twins(search: FreeSearch, chosen: Model) -> tuple[Model, ...]:
    """Models as good as `chosen`, about what starts change beside it, the plainest first.

    Every hypothesis is looked at in the place of each of the answer's: that does not depend on which the search had time to fit.
    """
    found: dict[object, Model] = {}
    replay = search.drafted(chosen)
    for place, one in enumerate(chosen.hypotheses):
        if search.late("telling twins apart"):
            break
        others = chosen.hypotheses[:place] + chosen.hypotheses[place + 1 :], chosen.values[:place] + chosen.values[place + 1 :]
        for tried in _drafted(search, replay, chosen, one, others):
            if search.late("telling twins apart"):
                break
            model = search.add(search.fitted(tried.hypotheses, tried.values))
            if search.is_equal(model, chosen):
                found[model.key] = model
    return tuple(sorted(found.values(), key=plainness_of))


def _drafted(
    search: FreeSearch, replay: Predictor, chosen: Model, one: Hypothesis, others: tuple[Sequence[Hypothesis], Sequence[Sequence[float]]]
) -> list[Model]:
    """The `others` with what promises to stand for `one`, each fitted to few windows, those that come near."""
    settings = search.settings
    before, whole = (model_of(replay, *model, search.glance, settings) for model in (others, (chosen.hypotheses, chosen.values)))
    # What has it in it and more is no other answer.
    more = [other for other in search.hypotheses if one.kind.name in other.kind.contains and other.targets == one.targets]
    options = [other for other in search.hypotheses if other.key not in chosen.key and other not in more]
    known: list[Columns] = search.each(columns_of, (replay, before, search.glance), options)  # type: ignore[assignment]
    least = settings.standing_for * share_of(whole, before, settings)
    refit = search.refit(replay, before, search.glance)
    looks = sorted((told for told in (look(before, columns, settings, refit) for columns in known) if told.gain > least), key=lambda told: -told.gain)
    tried: list[Look] = [told for plain in (True, False) for told in [other for other in looks if (other.hypotheses[0].size == 1) is plain][: settings.tried]]
    shared = (replay, model_of(replay, *others, search.few, settings), search.few, settings, settings.iterations)
    drafts: list[Model] = search.each(fitted_beside, shared, [(told.hypotheses, told.start) for told in tried])  # type: ignore[assignment]
    here = model_of(replay, chosen.hypotheses, chosen.values, search.few, settings)
    return [draft for draft in drafts if draft.missed < settings.near * here.missed]
