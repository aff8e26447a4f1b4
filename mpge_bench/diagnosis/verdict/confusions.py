"""What the answer was held against: models that are ruled out, and models that these recordings cannot tell from it."""

from __future__ import annotations

from scipy import stats

from mpge_bench.diagnosis.choose.choice import Choice
from mpge_bench.diagnosis.choose.columns import Twin
from mpge_bench.diagnosis.choose.exported import ExportedError
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.hypotheses.candidates import key, label
from mpge_bench.diagnosis.verdict.result import Confusion, Rival
from mpge_bench.envs.effects import CATALOGUE
from mpge_bench.envs.effects.vector import parameters_of


def rivals(choice: Choice, error_of: ExportedError) -> tuple[Rival, ...]:
    """The best of the other models that were tried.

    Args:
        error_of: effects, on the held-out recordings.
    """
    chosen, held = choice.chosen, choice.problem.validation
    found: dict[frozenset[str], Model] = {}
    for one in sorted([choice.nominal, *choice.models], key=lambda one: one.validation):
        if one.key != chosen.key and one.fit.residuals.shape == chosen.fit.residuals.shape:
            found.setdefault(one.key, one)
    result, least = [], error_of(chosen.effects)
    for one in list(found.values())[: choice.problem.settings.verdict.rivals]:
        behind = float((one.missed_beside(chosen) - chosen.missed_beside(one))[held].sum()) * chosen.fit.residuals.shape[-1] / 2 / max(1.0, chosen.validation)
        values = "; ".join(", ".join(f"{value:.4g}" for value in parameters_of(effect)) for effect in one.effects)
        error = error_of(one.effects)
        # What predicts unseen recordings as well is not ruled out by others.
        result.append(Rival(tuple(label(one.effects).split(" + ")), error, behind if error > least else min(behind, 0.0), values))
    return tuple(result)


def confusions(choice: Choice) -> tuple[tuple[Confusion, ...], dict[tuple[str, str], float]]:
    """Models that would be taken for the chosen one, and by its effects' names and targets the chance that each is there.

    None of the latter far from the noise, or of all joints at once.

    Put into the simulator with the same commands and noise, two models' predictions lie D standard deviations of the noise apart; by a likelihood ratio data of
    one are then taken for the other with probability Phi(-D / 2). Its odds add up over models: equals share alike. An effect is in doubt by those alone that
    have others in its place. What nothing is said to be taken for is not always there either, as concealed cases tell.
    """
    settings, chosen = choice.problem.settings.verdict, choice.chosen
    likely = [twin for twin in (*choice.twins, *choice.twins_of_two) if mistaken(twin) >= settings.confused]
    found = [Confusion((label(chosen.effects), label(twin.effects)), experiment(chosen.key, key(twin.effects))) for twin in likely]
    odds = {(effect.name, effect.target): 0.0 for effect in chosen.effects}
    for twin in choice.twins:
        chance = mistaken(twin)
        for effect in twin.replaced:
            odds[effect.name, effect.target] += chance / (1 - chance)
    is_known = not choice.is_far and choice.problem.settings.choose.are_few(chosen.effects)
    return tuple(found), {which: round(settings.sure / (1 + against), 3) for which, against in odds.items()} if is_known else {}


def mistaken(twin: Twin) -> float:
    """Probability that data of the chosen model would be taken for those of its `twin`."""
    return float(stats.norm.cdf(-twin.distance / 2))


def experiment(first: frozenset[str], second: frozenset[str]) -> str:
    """What would tell two models apart, given as sets of labels such as ``delay:elbow``; by what their effects say of each other."""
    names = [{part.split(":")[0] for part in labels} for labels in (first, second)]
    for one in sorted(names[0] - names[1] or names[0]):
        for other in sorted(names[1] - names[0] or names[1]):
            found = CATALOGUE[one].told_apart.get(other) or CATALOGUE[other].told_apart.get(one)
            if found:
                return found
    return "record again with larger and faster motion of the joints concerned, reversals and standstills included"
