"""All parameters of the usual kinds at once, until nothing is gained: system identification as it is mostly done, without a choice of effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.concealed.compare import HORIZON, Learnt, with_effects
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.data.checks import measurements
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import Problem, problem
from mpge_bench.diagnosis.hypotheses.candidates import Candidate, candidates, scales
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.predict.windows import WindowPredictor
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.at_once import at_once
from mpge_bench.diagnosis.transitions.hypotheses import Hypothesis
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

#: Effects that are fitted, each on every joint or link that it can act on: inertial parameters (Atkeson, An and Hollerbach 1986) with the motors' rotors,
#: friction as most simulators have it, and the motors' gains, biases and delays.
USUAL = (
    "mass_scale",
    "com_offset",
    "inertia_scale",
    "armature",
    "viscous_friction",
    "coulomb_friction",
    "torque_gain",
    "torque_bias",
    "delay",
)
#: Fits, of which the best counts: one from where the rig is, the others from random places about it.
STARTS = 3
#: Of each fit, at most, 15 Levenberg-Marquardt iterations each; one that gains next to nothing is the last.
ROUNDS = 6
#: Standard deviations at which residuals are cut off, lest a simulation that flies apart decide.
WORST = 1e4


@dataclass(frozen=True)
class RecordedWindows:
    """Half-second windows of recordings as `Pieces`, predicted by the simulator from smoothed states.

    What other starts would explain, by the linearised simulator, is not missed: a window's start is known no better than the sensors are good.
    """

    posed: Problem
    predictor: WindowPredictor

    def __len__(self) -> int:
        return len(self.predictor.measured)

    @property
    def entries(self) -> int:
        """Readings of a window."""
        return int(np.prod(self.predictor.measured.shape[1:]))

    def coarser(self) -> RecordedWindows:
        """Itself: it predicts whole batches."""
        return self

    def residuals(self, effects: Sequence[Effect], rows: Rows) -> Array:
        """What the simulator with `effects` misses in windows `rows`, in standard deviations of the noise, shape (rows, entries)."""
        found = self.posed.predictions(self.predictor.linear, effects, self.predictor.first)
        if found is None:
            return np.full((len(rows), self.entries), WORST)
        return np.clip(self.predictor.project(self.predictor.measured - found)[rows], -WORST, WORST)

    def heads(self, total: int) -> Rows:
        """All, whatever is asked for: they are few."""
        return np.arange(len(self))


def identified(rig: Rig, recordings: Sequence[Recording]) -> Learnt:
    """`rig` with all that is `USUAL`, fitted to `recordings` in the simulator itself by robust least squares, within the effects' bounds, until converged."""
    measured = measurements(rig, recordings)
    linear = reference(rig, measured.recordings)
    posed = problem(measured, linear, HORIZON)
    windows = RecordedWindows(posed, WindowPredictor(linear, posed.windows, posed.sigma))
    usual = [hypothesis(rig, one) for one in candidates(rig, scales(linear)) if one.name in USUAL]
    with Workers(1) as workers:
        found = at_once(windows, usual, STARTS, ROUNDS, 0, workers, DEFAULT.replay)
    said = {"parameters": found.model.size, "converged": found.converged, "descriptions": found.descriptions}
    return Learnt(with_effects(rig, found.model.effects).predict, said | {"effects": [one.to_dict() for one in found.model.effects]})


def hypothesis(rig: Rig, candidate: Candidate) -> Hypothesis:
    """`candidate` as fits of everything at once take it."""
    return Hypothesis((candidate.target,), candidate.starts, tuple(rig.absent(candidate.starts[:1]).tolist()))
