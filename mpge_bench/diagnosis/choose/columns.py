"""By how much each candidate changes the prediction as chosen effects do, in the simulator linearised about a model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy import optimize

from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.fit.told import spanned, unit_length
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of

Array = npt.NDArray[np.float64]

#: Share of a length below which nothing but rounding is left.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Twin:
    """The chosen model with another effect in the place of one of its own, or of several.

    Attributes:
        effects: of the whole model, the other effect last and at one of its starts, as large as is best.
        replaced: the effects that it stands for.
        distance: between the two models' predictions at the other's best parameters, standard deviations of what the chosen one leaves.
        change: by which the replaced effects move the prediction, in the same units.
        at_least: whether they may be farther apart: what came so near is a sum of what the other effect does with several values of its parameters.
        model: of these effects, fitted to the end; None where the linearised simulator alone has been asked.
    """

    effects: tuple[Effect, ...]
    replaced: tuple[Effect, ...]
    distance: float
    change: float
    at_least: bool = False
    model: Model | None = field(default=None, compare=False, repr=False)


class Columns:
    """By what effects change the prediction of the simulator linearised about the `chosen` model."""

    def __init__(self, trials: Trials, chosen: Model) -> None:
        self._trials, self._chosen, self._fitter = trials, chosen, trials.problem.fitter(chosen.effects)
        # Nuisances take part, but each standard deviation of one costs as much as one of a reading's noise: what goes beyond their limits is not theirs.
        nuisances = self._fitter.nuisances.forgiven(chosen.effects).reshape(-1, chosen.fit.residuals.size)
        self._nuisances = np.concatenate((nuisances, np.eye(len(nuisances))), axis=1)
        #: Standard deviations of what the chosen model leaves.
        self._scale = max(1.0, chosen.train) ** 0.5

    def in_place_of(self, replaced: tuple[Effect, ...], only: str | None = None) -> Iterator[Twin]:
        """Each candidate, or the one whose label is given, in the place of all the effects `replaced`."""
        chosen, fitter = self._chosen, self._fitter
        others = tuple(other for other in chosen.effects if not any(other is effect for effect in replaced))
        (own,) = self._flat(fitter.predictor.change(chosen.effects) - fitter.predictor.change(others))
        taken = spanned(unit_length(np.concatenate((self._flat(_columns_of(chosen, others)), self._nuisances))))
        left = own - (own @ taken.T) @ taken
        for candidate in self._trials.candidates:
            if candidate.label in chosen.key or any(candidate.contains(effect) for effect in replaced) or only not in (None, candidate.label):
                continue
            if not candidate.adds_to(others):
                # There is a rotor in an elastic drive already.
                continue
            if candidate.is_of_all and any(other.name == candidate.name for other in others):
                # What acts on all alike is the sum of what acts on each.
                continue
            columns = self._flat(fitter.columns(candidate, others))
            length = np.linalg.norm(columns, axis=1, keepdims=True)
            columns = columns - (columns @ taken.T) @ taken
            # What others make up for but for rounding is nothing of its own.
            columns = np.where(np.linalg.norm(columns, axis=1, keepdims=True) > _ROUNDING * length, columns, 0.0)
            # What is in proportion to its parameters is at its best any sum of its starts; what is not is near one of them.
            options = [columns] if not candidate.kind.is_bent() else list(columns[:, None])
            distances = [remainder(left, option, one_sided=candidate.kind.is_one_sided()) for option in options]
            best = int(np.argmin(distances))
            start = self._sized(candidate, columns, left) if candidate.measure else candidate.starts[best]
            is_sum, change = len(options[best]) > len(parameters_of(start)), float(np.linalg.norm(own)) / self._scale
            is_same = self._is_the_same(candidate, replaced)
            yield Twin((*others, start), replaced, 0.0 if is_same else distances[best] / self._scale, change, is_sum and not is_same)

    def _sized(self, candidate: Candidate, columns: Array, wanted: Array) -> Effect:
        """The start of a `candidate` that comes nearest to what is `wanted`, as large as is best to first order.

        From .3 N m a fit of a bias of -1.46 stuck at -1.42, far from the noise, and a wave as long as there are was said in its place.
        """
        power = np.maximum((columns**2).sum(1), _ROUNDING**2)
        shares = columns @ wanted / power
        if candidate.kind.is_one_sided():
            shares = np.maximum(shares, 0.0)
        best = int(np.argmax(shares**2 * power))
        return candidate.part(self._trials.problem.rig, candidate.starts[best], float(shares[best])) if shares[best] else candidate.starts[best]

    def _is_the_same(self, candidate: Candidate, replaced: tuple[Effect, ...]) -> bool:
        """Whether a `candidate` is the one effect `replaced`, since the joint is all that moves: what simulators make of parts of a step tells nothing."""
        modes = self._trials.problem.rig.modes.values()
        if len(replaced) > 1 or len(modes) > 1 or "position" in modes:
            return False
        return candidate.kind.on_all_is == replaced[0].name or replaced[0].on_all_is == candidate.name

    def beyond(self, difference: Array) -> float:
        """Length of what of a `difference` between predictions neither the model's parameters nor nuisances make up."""
        (wanted,) = self._flat(difference)
        return remainder(wanted, np.concatenate((self._flat(self._chosen.fit.jacobian), self._nuisances)))

    def _flat(self, columns: Array) -> Array:
        return np.pad(columns.reshape(-1, self._chosen.fit.residuals.size), ((0, 0), (0, len(self._nuisances))))


def remainder(own: Array, columns: Array, *, one_sided: bool = False) -> float:
    """Length of what of `own`, shape (readings,), the `columns`, shape (columns, readings), cannot make up; with `one_sided`, in no negative amounts."""
    unit = unit_length(columns).T
    if one_sided:
        return float(optimize.nnls(unit, own)[1])
    return float(np.linalg.norm(own - unit @ np.linalg.lstsq(unit, own, rcond=1e-6)[0]))


def _columns_of(chosen: Model, effects: Sequence[Effect]) -> Array:
    """Derivatives of the prediction of `chosen` by the parameters of some of its `effects`."""
    belongs = [any(one is effect for effect in effects) for one in chosen.effects for _ in parameters_of(one)]
    return np.asarray(chosen.fit.jacobian[np.array(belongs, bool)])
