"""Single effects as they begin, each held against the recordings in the simulator itself.

Where a mismatch changes the motion wholly, as a late motor does in a controller's loop, the linearised simulator, which goes along the recorded motion, ranks
what is there below what is not. A start that by itself explains most of what the simulator misses from recorded states is followed up whatever that says.
"""

from __future__ import annotations

from mpge_bench.diagnosis.choose.exported import ExportedMisses
from mpge_bench.diagnosis.choose.points import best_of_each, cost_of
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.problem import Model

#: What is said to be cut short where time is up.
_STAGE = "effects as they begin"


def as_begun(trials: Trials) -> list[Model]:
    """Models of one effect, roughly fitted from the starts that leave least of what the simulator misses, if that is little enough; in no order."""
    if trials.cut_short(_STAGE):
        return []
    settings, misses = trials.settings, ExportedMisses(trials.problem, trials.problem.recordings, most=trials.settings.restarts)
    starts = [start for candidate in trials.candidates for start in candidate.starts]
    missed = trials.side_by_side(_STAGE, ExportedMisses.in_a_row, (misses,), [trials.problem.rig.joined((), start) for start in starts])
    most = settings.begun_leaves * cost_of(misses.in_a_row(()))
    costs = [(cost_of(one), (start,)) for one, start in zip(missed, starts, strict=False)]
    followed = best_of_each((cost, effects) for cost, effects in costs if cost < most)[: settings.restart_fits[0]]
    return trials.refined(trials.fitter, [trials.fitter.at(effects) for effects in followed])
