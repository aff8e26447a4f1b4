"""The answer of a search in windows fitted to its end: where contacts make windows jerk, least squares stop short of it."""

from __future__ import annotations

import logging
from dataclasses import replace

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.free.search import FreeSearch
from mpge_bench.diagnosis.transitions.fit import Model, fitted
from mpge_bench.diagnosis.transitions.trials import ENDING

_log = logging.getLogger(__name__)


def ended(search: FreeSearch, model: Model, clock: Clock) -> Model:
    """The answer `model` settled, without what it does without, and fitted to its end, in a part of what `clock` keeps for the verdict, too.

    What is not at its end has intervals that leave out the truth, and something beside it that is none.
    """
    search.clock = clock.later(search.evidence.settings.free.ending)
    return search.acting(polished(search, search.needed(search.settled(model))))


def polished(search: FreeSearch, model: Model) -> Model:
    """`model`, which is settled, fitted on by short differences and short walks for as long as that gains.

    By long ones a fit stopped at a load of 2.974 kg, where 3 were there, and its intervals left these out.
    """
    free = search.evidence.settings.free
    fine = replace(search.settings, difference=free.fine, walks=free.fine_walks, walked=0.0)
    while model.hypotheses and search.is_smooth and not search.late(ENDING):
        found = fitted(search.replay, model.hypotheses, model.values, search.rows, fine, fine.iterations_polish, search.workers)
        _log.debug("polished %s: %.4g, %.3g", found.values, found.description, found.missed)
        gained = model.description - found.description
        if gained > 0:
            search.last = model = found
        if gained < search.settings.material:
            break
    return search.told(model)
