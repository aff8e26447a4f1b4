"""What describes windows about as well as a model, with another hypothesis in the place of one of its: it may be what the model is taken for."""

from __future__ import annotations

from dataclasses import replace

from mpge_bench.diagnosis.transitions.choose import Search
from mpge_bench.diagnosis.transitions.fit import Model, Predictor, model_of
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.diagnosis.transitions.screen import Columns, Look, columns_of, look, share_of
from mpge_bench.diagnosis.transitions.trials import fitted_beside


def rivals(search: Search, model: Model) -> tuple[Model, ...]:
    """Those that come near, about what starts change beside `model`, the best first.

    Every hypothesis is looked at in the place of each of the model's: that does not depend on which the search had time to fit.
    """
    found: dict[object, Model] = {}
    replay = search.drafted(model)
    for one in model.hypotheses:
        if search.late("telling twins apart"):
            break
        for tried in _drafted(search, replay, model, one):
            if search.late("telling twins apart"):
                break
            rival = search.add(search.fitted(tried.hypotheses, tried.values))
            found[rival.key] = rival
    return tuple(sorted(found.values(), key=lambda one: one.description))


def _drafted(search: Search, replay: Predictor, chosen: Model, one: Hypothesis) -> list[Model]:
    """`chosen` with what promises to stand for `one`, each fitted to few windows, those that come near."""
    settings, others = search.settings, chosen.without(one)
    before, whole = (model_of(replay, *model, search.glance, settings) for model in (others, (chosen.hypotheses, chosen.values)))
    # What has it in it and more is no other answer.
    more = [other for other in search.hypotheses if one.kind.name in other.kind.contains and other.targets == one.targets]
    options = [other for other in search.hypotheses if other.key not in chosen.key and other not in more]
    # What was looked at beside another model is a little off, and costs nothing: drafts tell.
    unknown = [other for other in options if other.key not in search.columns]
    new: list[Columns] = search.each(columns_of, (replay, before, search.glance), unknown)  # type: ignore[assignment]
    known = [*new, *(search.columns[other.key] for other in options if other.key in search.columns)]
    refit = search.refit(replay, before, search.glance)
    # The others are not fitted without it: what they would make up for is no more to be explained.
    before = replace(before, residuals=refit.left_of(before.residuals))
    looks = sorted((look(before, columns, settings, refit) for columns in known), key=lambda told: -told.gain)
    # Beside what is missed by far nothing is in proportion, and all that looks promise is little.
    least = settings.standing_for * min(share_of(whole, before, settings), looks[0].gain if looks else 0.0)
    looks = [told for told in looks if told.gain > least]
    tried: list[Look] = [told for plain in (True, False) for told in [other for other in looks if (other.hypotheses[0].size == 1) is plain][: settings.tried]]
    shared = (replay, model_of(replay, *others, search.few, settings), search.few, settings, settings.iterations)
    drafts: list[Model] = search.each(fitted_beside, shared, [(told.hypotheses, told.start) for told in tried])  # type: ignore[assignment]
    here = model_of(replay, chosen.hypotheses, chosen.values, search.few, settings)
    drafts = sorted((draft for draft in drafts if draft.missed < settings.near * here.missed), key=lambda draft: draft.description)
    return drafts[: settings.tried]
