"""What every machine has, grown from recorded states: far from the noise starting states of windows hide so much that fits of many parameters go astray."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from mpge_bench.diagnosis.choose.exported import ExportedMisses
from mpge_bench.diagnosis.choose.joints import needed_as_used
from mpge_bench.diagnosis.choose.points import Effects, Point, fitted
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.hypotheses.candidates import key
from mpge_bench.diagnosis.settings import ChooseSettings
from mpge_bench.envs.effects import Effect

Kinds = Mapping[str, Sequence[Effect]]
#: What is said to be cut short where time is up.
STAGE = "fitting all joints at once"


def has_many_joints(trials: Trials) -> bool:
    """Whether friction and rotors on all joints are more than a search by single effects leads to: on fewer joints that names what each of them has."""
    return not trials.settings.are_few(2 * trials.problem.rig.joints)


def kinds_of(trials: Trials) -> dict[str, list[Effect]]:
    """What every machine has, by kinds: of each where it begins on all that it acts on."""
    kinds: dict[str, list[Effect]] = {}
    for one in trials.candidates:
        if one.kind.is_everywhere(trials.problem.scale(one.target)):
            kinds.setdefault(one.name, []).append(one.starts[0])
    return kinds


def together(trials: Trials, kinds: Kinds) -> Effects:
    """Of `kinds`, in their order, those that help beside what was taken in before, and of these the effects that their joints need.

    None where none helps, or where few joints need the first that does: single effects are the shorter way then.
    """
    misses = ExportedMisses(trials.problem, trials.problem.recordings, most=trials.settings.restarts)
    if misses(()) is None:
        return ()
    point = fitted(misses, trials.problem.settings.fit, 0, ())
    while not trials.cut_short(STAGE):
        richer = _richer(trials, misses, point, kinds)
        if richer is None:
            break
        if not point.effects and not _is_of_many(trials, richer):
            return ()
        point = richer
    return _without_needless(trials, misses, point).effects


def completed(trials: Trials, chosen: Model) -> Model | None:
    """`chosen`, of all joints, with what most joints have on the others, too, and without what they then do not need, fitted from recorded states.

    None where that predicts these no better, and of a model that is of few effects or near the noise: windows say more of such.
    """
    settings, effects = trials.settings, chosen.effects
    if not has_many_joints(trials) or settings.are_few(effects) or chosen.overall < settings.near or not all(effect.named for effect in effects):
        return None
    misses = ExportedMisses(trials.problem, trials.problem.recordings, most=settings.restarts)
    before = misses.in_a_row(effects)
    if before is None:
        return None
    present = Counter(effect.name for effect in effects)
    usual = [starts for name, starts in kinds_of(trials).items() if present[name] > settings.many * len(starts)]
    lacking = [one for starts in usual for one in starts if not key([one]) <= chosen.key]
    # However late it is: without it such a model is far off.
    point = _to_the_end(trials, misses, (*effects, *lacking))
    point = _without_needless(trials, misses, point)
    # What joints that are alike have need not be shown to be there as other physics has.
    if not point.cost < (1 - settings.material) * float(before @ before):
        return None
    return trials.as_it_is(point.effects)


def least_gain(effects: Sequence[Effect], settings: ChooseSettings) -> float:
    """Share of the sum of squares that a kind has to explain.

    What is off by a sensor's zero or a tilted base readily stands in for other physics; friction and rotors every joint has.
    """
    return settings.material if effects[0].on == "joint" else settings.coarse_material


def _richer(trials: Trials, misses: ExportedMisses, point: Point, kinds: Kinds) -> Point | None:
    """`point` with the first of `kinds` that it has not and that helps; None where none does."""
    present = {effect.name for effect in point.effects}
    for name in kinds:
        if name not in present and not trials.cut_short(STAGE):
            grown = _to_the_end(trials, misses, (*point.effects, *kinds[name]))
            if grown.cost < (1 - least_gain(kinds[name], trials.settings)) * point.cost:
                return grown
    return None


def _to_the_end(trials: Trials, misses: ExportedMisses, effects: Effects) -> Point:
    """`effects` fitted until that gains next to nothing: what was not fitted to the end leaves room for what is not there."""
    settings = trials.settings
    return fitted(misses, trials.problem.settings.fit, settings.convergences * settings.restart_evaluations, effects, trials.workers.each)


def _without_needless(trials: Trials, misses: ExportedMisses, point: Point) -> Point:
    """`point` without what it does not need, fitted anew."""
    while len(point.effects) > 1 and not trials.cut_short(STAGE):
        kept = needed_as_used(trials.problem.rig, point, trials.settings, trials.settings.material)
        if len(kept) == len(point.effects):
            break
        point = _to_the_end(trials, misses, kept)
    return point


def _is_of_many(trials: Trials, point: Point) -> bool:
    """Whether most joints need their part of a first kind, by as much as is asked far from the noise: by chance a little helps any of them."""
    settings = trials.settings
    return len(needed_as_used(trials.problem.rig, point, settings, settings.coarse_material)) >= settings.many * len(point.effects)
