"""What simulators do differently, which is nobody's fault: nuisance parameters within limits, forgiven before anything is judged.

They are the error of the physics step, damping worked out implicitly, which acts like an inertia of damping × step, the turning point of dry friction, and
when within a physics step a motor with a hidden state gets its command.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.optimize import lsq_linear

from mpge_bench.diagnosis.predict.fast.recurrences import bounded
from mpge_bench.diagnosis.predict.windows import WindowPredictor
from mpge_bench.diagnosis.settings import HypothesisSettings
from mpge_bench.envs.effects import Armature, Delay, Effect

Array = npt.NDArray[np.float64]


class Nuisances:
    """The nuisance parameters of `predictor`, fitted on the windows marked in `train`."""

    def __init__(self, predictor: WindowPredictor, train: npt.NDArray[np.bool_]) -> None:
        self._predictor, self._train = predictor, train
        base, rig = predictor.linear.base, predictor.linear.rig
        settings = self.settings
        self._columns, self._limits = [predictor.project(predictor.halved_error)], [settings.step_error]
        for effect in rig.chain(base):
            if effect.implicit_damping > 0:
                self._columns.append(predictor.change(rig.joined(base, Armature(effect.target, effect.implicit_damping * rig.timestep))))
                self._limits.append(settings.implicit_damping)

    @property
    def settings(self) -> HypothesisSettings:
        return self._predictor.linear.motion.settings.hypotheses

    def forgive(self, residual: Array, effects: Sequence[Effect], halved: Array | None = None, jacobian: Array | None = None) -> tuple[Array, Array]:
        """`residual` without what nuisances explain of it within their limits, and the columns of those that are within them.

        Args:
            residual: shape (windows, rows * channels).
            effects: of the model that leaves it.
            halved: how the prediction changes with half the physics step, if that is known better than from the linearised simulator.
            jacobian: if given, motors with a hidden state are also forgiven a physics step of delay, and the parameters' answer to it. For judging, not for
                fitting: the parameters would be blurred by it.
        """
        columns, bounds = self._of(effects)
        if halved is not None:
            columns[0] = halved
        delays = np.zeros((0, *residual.shape)) if jacobian is None else self._motor_delays(effects)
        if len(delays) and jacobian is not None:
            size = np.sqrt((jacobian**2).sum((1, 2), keepdims=True))
            columns = np.concatenate((columns, delays, jacobian / np.where(size > 0, size, 1.0)))
            bounds = np.concatenate((bounds, [self.settings.motor_step] * len(delays), [(-np.inf, np.inf)] * len(jacobian)))
        sizes = self._bounded(columns, residual, bounds, exact=len(delays) > 0)
        inside = (sizes > bounds[:, 0]) & (sizes < bounds[:, 1])
        return residual - np.tensordot(sizes, columns, 1), columns[inside]

    def doubts(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """How the prediction changes by one standard deviation of each nuisance, of those that are fitted beside `effects` and of those that are only judged.

        Nobody knows more of them than their limits: they lie as far from 0 as anything between these does in the root mean square.

        Returns:
            Both of shape (nuisances, windows, rows * channels).
        """
        columns, limits = self._of(effects)
        return columns * _spread(limits)[:, None, None], self._motor_delays(effects) * _spread(np.array(self.settings.motor_step))

    def _of(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Columns, projected, and limits, shape (nuisances, 2), of what is forgiven beside `effects`, motors' steps aside."""
        lead = self._friction_lead(effects)
        columns, limits = ([*self._columns], [*self._limits]) if lead is None else ([*self._columns, lead], [*self._limits, self.settings.friction_lead])
        return np.array(columns), np.array(limits)

    def _bounded(self, columns: Array, residual: Array, bounds: Array, *, exact: bool) -> Array:
        """Least squares within bounds on the train windows; `exact`, or by coordinate descent, which is enough for a handful of unknowns."""
        fitted = columns[:, self._train].reshape(len(columns), -1)
        gram, right = fitted @ fitted.T, fitted @ residual[self._train].ravel()
        if exact:
            root = np.linalg.cholesky(gram + 1e-9 * np.trace(gram) / len(gram) * np.eye(len(gram)))
            return np.asarray(lsq_linear(root.T, np.linalg.solve(root, right), bounds.T).x)
        return bounded(gram, right, bounds, self.settings.descents)

    def _friction_lead(self, effects: Sequence[Effect]) -> Array | None:
        """How the prediction changes, projected, if dry friction turns round earlier than the velocity does; None if there is none."""
        predictor = self._predictor
        if not any(effect.rubs for effect, _ in predictor.linear.chain(effects)):
            return None
        return predictor.project(predictor.propagate(predictor.torques(effects, early=True) - predictor.torques(effects)))

    def _motor_delays(self, effects: Sequence[Effect]) -> Array:
        """How the prediction changes, projected, if motors with a hidden state of their own got each command a physics step later, one by one."""
        predictor, rig = self._predictor, self._predictor.linear.rig
        slow = {effect.target for effect in rig.chain(effects) if effect.remembers}
        slow -= {effect.target for effect in effects if isinstance(effect, Delay)}
        now = predictor.torques(effects)
        later = [predictor.torques(rig.joined(effects, Delay(joint, rig.timestep))) - now for joint in sorted(slow)]
        return np.array([predictor.project(predictor.propagate(one)) for one in later]).reshape(len(later), *self._columns[0].shape)


def _spread(limits: Array) -> Array:
    """Root mean square of what lies anywhere within `limits`, shape (..., 2)."""
    low, high = limits[..., 0], limits[..., 1]
    return np.asarray(np.sqrt((low**2 + low * high + high**2) / 3))
