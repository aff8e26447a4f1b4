"""Effects that would change the prediction just as a chosen one does: they may be what it is taken for.

They are worked out for all candidates, from the columns of the simulator linearised about the chosen model, so that they do not depend on what there was time
to fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.score import is_better
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.envs.effects import CATALOGUE, Effect
from mpge_bench.envs.effects.vector import parameters_of

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Twin:
    """The chosen model with another effect in the place of one of its own.

    Attributes:
        effects: of the whole model, the other effect last and at one of its starts.
        replaced: the effect that it stands for.
        distance: between the two models' predictions at the other's best parameters, standard deviations of what the chosen one leaves.
    """

    effects: tuple[Effect, ...]
    replaced: Effect
    distance: float


def twins(trials: Trials, chosen: Model) -> tuple[Twin, ...]:
    """The chosen model with each candidate in the place of each of its effects, the nearest first."""
    found: list[Twin] = []
    named = [one for one in chosen.effects if one.named]
    if not named:
        return ()
    fitter = trials.problem.fitter(chosen.effects)
    # Nuisances take part, but each standard deviation of one costs as much as one of a reading's noise: what goes beyond their limits is not theirs.
    nuisances = fitter.nuisances.forgiven(chosen.effects).reshape(-1, chosen.fit.residuals.size)
    nuisances = np.concatenate((nuisances, np.eye(len(nuisances))), axis=1)

    def flat(columns: Array) -> Array:
        return np.pad(columns.reshape(-1, chosen.fit.residuals.size), ((0, 0), (0, len(nuisances))))

    for effect in named:
        others = [other for other in chosen.effects if other is not effect]
        (own,) = flat(fitter.predictor.change(chosen.effects) - fitter.predictor.change(others))
        beside = np.concatenate((flat(_columns_of_others(chosen, effect)), nuisances))
        for candidate in trials.candidates:
            if candidate.label in chosen.key or _contains(candidate, effect):
                continue
            columns = flat(fitter.columns(candidate, others))
            # What is in proportion to its parameters is at its best any sum of its starts; what is not is near one of them.
            options = [columns] if not candidate.kind.is_bent() else list(columns[:, None])
            distances = [remainder(own, np.concatenate((option, beside))) for option in options]
            best = int(np.argmin(distances))
            found.append(Twin((*others, candidate.starts[best]), effect, distances[best] / max(1.0, chosen.train) ** 0.5))
    return tuple(sorted(found, key=lambda one: one.distance))


def plainest(trials: Trials, chosen: Model) -> Model:
    """Of `chosen` and the models that these recordings cannot tell from it, the plainest that predicts as well."""
    settings, problem = trials.settings, trials.problem
    near = [one for one in twins(trials, chosen) if one.distance < settings.apart and plainness(one.effects[-1]) < plainness(one.replaced)]
    for twin in sorted(near, key=lambda one: plainness(one.effects[-1]))[: settings.twins]:
        if trials.cut_short("the plainest of equals"):
            break
        model = trials.add(trials.converged(*trials.polished([twin.effects])[0])[0])
        if not is_better(problem, model, chosen) and trials.no_worse(model, trials.nominal):
            return model
    return chosen


def plainness(effect: Effect) -> tuple[bool, int, int, int]:
    """Less of plainer effects: sensors are blamed last, few numbers come before many, a joint's own physics before bodies' and the world's.

    What is still equal goes by the catalogue's order.
    """
    names = list(CATALOGUE)
    return effect.on == "sensor", len(parameters_of(effect)), ("joint", "link", "world", "sensor").index(effect.on), names.index(effect.name)


def remainder(own: Array, columns: Array) -> float:
    """Length of what of `own`, shape (readings,), the `columns`, shape (columns, readings), cannot make up."""
    length = np.sqrt((columns**2).sum(1, keepdims=True))
    unit = (columns / np.where(length > 0, length, 1.0)).T
    return float(np.linalg.norm(own - unit @ np.linalg.lstsq(unit, own, rcond=1e-6)[0]))


def _columns_of_others(chosen: Model, effect: Effect) -> Array:
    """Derivatives of the prediction by the parameters of the other effects of `chosen`."""
    belongs = [one is not effect for one in chosen.effects for _ in parameters_of(one)]
    return np.asarray(chosen.fit.jacobian[np.array(belongs, bool)])


def _contains(candidate: Candidate, effect: Effect) -> bool:
    """Whether `candidate` is a richer form of `effect`, which can do all that it does."""
    return effect.name in candidate.kind.contains and candidate.target == effect.target
