"""Joints that dry friction may hold fast.

The linearised simulator, in which they would move, cannot tell: friction that goes by the sign of a velocity of noise explains nothing of a joint that stands
still. Each is tried in the simulator itself.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model
from mpge_bench.diagnosis.hypotheses.candidates import Candidate
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import within_bounds

Array = npt.NDArray[np.float64]


def held(trials: Trials, least: float) -> list[tuple[Model, LinearFitter]]:
    """Models of dry friction alone, fitted to the end, on each joint that stands still, if that much of it explains most of what the simulator misses.

    Args:
        least: share of the rows in which a joint stands still.
    """
    if trials.cut_short("joints that are held fast"):
        return []
    lacking = trials.fitter.predictor.linear.residual_torques()
    starts = [start for candidate in trials.candidates for start in _starts(trials, candidate, lacking, least)]
    drafts = trials.refined(trials.fitter, [trials.fitter.at([start]) for start in starts])
    most = trials.settings.holding_leaves * trials.nominal.overall
    best: dict[frozenset[str], Model] = {}
    for one in sorted(drafts, key=lambda one: one.overall):
        if one.overall < most:
            best.setdefault(one.key, one)
    return trials.polished([one.effects for one in best.values()])


def _starts(trials: Trials, candidate: Candidate, lacking: Array, least: float) -> list[Effect]:
    """As much of `candidate` as the simulator lacks where its joint stands still, mostly and at most, and where that slides; none if it seldom stands still.

    Args:
        lacking: torques that the simulator lacks, shape (r, k, j).
        least: as of `held`.
    """
    if not candidate.kind.holding(1.0) or trials.problem.rig.own(candidate.starts[0]):
        return []
    settings, motion, joint = trials.settings, trials.fitter.predictor.linear.motion, trials.problem.rig.joints.index(candidate.target)
    moves = motion.valid(ahead=1)
    torque, speed = lacking[moves][:, joint], motion.layout.dq(motion.state)[moves][:, joint]
    rests = np.abs(speed) < settings.resting * motion.spread[joint]
    if rests.mean() < least:
        return []
    torques = np.quantile(np.abs(torque[rests]), settings.holding).tolist()
    if not rests.all():
        torques.append(float(np.mean(-torque[~rests] * np.sign(speed[~rests]))))
    found = [one for size in torques if size > 0 for one in candidate.kind.holding(size)]
    return [within_bounds(candidate.kind, candidate.target, one) for one in found]
