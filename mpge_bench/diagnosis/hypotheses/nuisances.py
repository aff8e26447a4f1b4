"""What simulators do differently, which is nobody's fault: nuisance parameters within limits, forgiven before anything is judged.

They are the error of the physics step, damping worked out implicitly, which acts like an inertia of damping × step, the turning point of dry friction, and
when within a physics step a motor with a hidden state gets its command, and a late sensor its reading.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import lsq_linear

from mpge_bench.diagnosis.predict.fast.recurrences import bounded
from mpge_bench.diagnosis.predict.windows import WindowPredictor
from mpge_bench.diagnosis.settings import HypothesisSettings
from mpge_bench.envs.effects import Armature, Delay, Effect, SensorDelay

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Forgiven:
    """What nuisances explain, taken away.

    Attributes:
        residuals: what is left, shape (windows, rows * channels).
        columns: of the nuisances, by standard deviations of each, shape (nuisances, windows, rows * channels).
        sizes: of the nuisances, in standard deviations, shape (nuisances,).
        inside: which of them are within their limits, shape (nuisances,).
    """

    residuals: Array
    columns: Array
    sizes: Array
    inside: npt.NDArray[np.bool_]

    @property
    def free(self) -> Array:
        """Columns of those that are within their limits."""
        return self.columns[self.inside]


class Nuisances:
    """The nuisance parameters of `predictor`, fitted on the windows marked in `train`, each in standard deviations.

    Nobody knows more of them beforehand than their limits: they lie as far from 0 as anything between these does in the root mean square.
    """

    def __init__(self, predictor: WindowPredictor, train: npt.NDArray[np.bool_]) -> None:
        self._predictor, self._train = predictor, train
        base, rig = predictor.linear.base, predictor.linear.rig
        settings = self.settings
        self._columns, self._limits = [predictor.project(predictor.halved_error) * _spread(settings.step_error)], [_in_spreads(settings.step_error)]
        for effect in rig.chain(base):
            if effect.implicit_damping > 0:
                column = predictor.change(rig.joined(base, Armature(effect.target, effect.implicit_damping * rig.timestep)))
                self._columns.append(column * _spread(settings.implicit_damping))
                self._limits.append(_in_spreads(settings.implicit_damping))

    @property
    def settings(self) -> HypothesisSettings:
        return self._predictor.linear.motion.settings.hypotheses

    def forgive(self, residual: Array, effects: Sequence[Effect], halved: Array | None = None, jacobian: Array | None = None) -> Forgiven:
        """`residual` without what nuisances explain of it within their limits.

        Args:
            residual: shape (windows, rows * channels).
            effects: of the model that leaves it.
            halved: how the prediction changes with half the physics step, if that is known better than from the linearised simulator.
            jacobian: if given, motors with a hidden state and late sensors are also forgiven a physics step of delay, and the parameters' answer to it. For
                judging, not for fitting: the parameters would be blurred by it.
        """
        columns, limits = self._of(effects)
        if halved is not None:
            columns[0] = halved * _spread(self.settings.step_error)
        delays = np.zeros((0, *residual.shape)) if jacobian is None else self.delays(effects)
        columns = np.concatenate((columns, delays))
        bounds = np.array([*limits, *[_in_spreads(self.settings.motor_step)] * len(delays)])
        known = np.ones(len(columns))
        if len(delays) and jacobian is not None:
            size = np.sqrt((jacobian**2).sum((1, 2), keepdims=True))
            columns = np.concatenate((columns, jacobian / np.where(size > 0, size, 1.0)))
            bounds = np.concatenate((bounds, np.tile([-np.inf, np.inf], (len(jacobian), 1))))
            known = np.concatenate((known, np.zeros(len(jacobian))))
        sizes = self._bounded(columns, residual, bounds, known, exact=len(delays) > 0)
        inside = (sizes > bounds[:, 0]) & (sizes < bounds[:, 1])
        return Forgiven(residual - np.tensordot(sizes, columns, 1), columns, sizes, inside)

    def forgiven(self, effects: Sequence[Effect]) -> Array:
        """How the prediction changes by one standard deviation of each nuisance that fits forgive, shape (nuisances, windows, rows * channels)."""
        return self._of(effects)[0]

    def _of(self, effects: Sequence[Effect]) -> tuple[Array, list[Array]]:
        """Columns, projected, and limits of what is forgiven beside `effects` in fits, both by standard deviations."""
        lead = self._friction_lead(effects)
        if lead is None:
            return np.array(self._columns), self._limits
        return np.array([*self._columns, lead]), [*self._limits, _in_spreads(self.settings.friction_lead)]

    def _bounded(self, columns: Array, residual: Array, bounds: Array, known: Array, *, exact: bool) -> Array:
        """Least squares within bounds on the train windows; `exact`, or by coordinate descent, which is enough for a handful of unknowns.

        Args:
            known: 1 of what lies about 0 by a standard deviation, beforehand, 0 of what may be anything, shape (columns,).
        """
        fitted = columns[:, self._train].reshape(len(columns), -1)
        gram, right = fitted @ fitted.T + np.diag(known), fitted @ residual[self._train].ravel()
        if exact:
            root = np.linalg.cholesky(gram + 1e-9 * np.trace(gram) / len(gram) * np.eye(len(gram)))
            return np.asarray(lsq_linear(root.T, np.linalg.solve(root, right), bounds.T).x)
        return bounded(gram, right, bounds, self.settings.descents)

    def _friction_lead(self, effects: Sequence[Effect]) -> Array | None:
        """How the prediction changes, projected, if dry friction turns round earlier than the velocity does; None if there is none."""
        predictor = self._predictor
        if not any(effect.rubs for effect, _ in predictor.linear.chain(effects)):
            return None
        earlier = predictor.project(predictor.propagate(predictor.torques(effects, early=True) - predictor.torques(effects)))
        return earlier * _spread(self.settings.friction_lead)

    def delays(self, effects: Sequence[Effect]) -> Array:
        """How the prediction changes, projected, if motors with a hidden state of their own got each command later and late sensors read later, one by one.

        By one standard deviation of each, shape (nuisances, windows, rows * channels). Only judging forgives them.
        """
        predictor, rig = self._predictor, self._predictor.linear.rig
        slow = {effect.target for effect in rig.chain(effects) if effect.remembers}
        slow -= {one.target for effect in effects if isinstance(effect, Delay) for one in effect.each(rig.driven)}
        now = predictor.torques(effects)
        later = [predictor.torques(rig.joined(effects, Delay(joint, rig.timestep))) - now for joint in sorted(slow)]
        changes = [predictor.propagate(one) for one in later]
        sensors = sorted(effect.target for effect in rig.chain(effects) if effect.looks_back is not None)
        seen = predictor.sensed(effects) if sensors else 0.0
        changes += [predictor.sensed(rig.joined(effects, SensorDelay(joint, rig.timestep))) - seen for joint in sensors]
        columns = [predictor.project(one) * _spread(self.settings.motor_step) for one in changes]
        return np.array(columns).reshape(len(columns), *self._columns[0].shape)


def _spread(limits: tuple[float, float]) -> float:
    """Root mean square of what lies anywhere within `limits`."""
    low, high = limits
    return math.sqrt((low**2 + low * high + high**2) / 3)


def _in_spreads(limits: tuple[float, float]) -> Array:
    """`limits` in standard deviations of what lies within them."""
    return np.divide(limits, _spread(limits))
