"""What every real joint has more or less of (dry and viscous friction, a rotor), at all joints at once, each its own, and then only where it is needed.

Single effects lead nowhere where a dozen joints all miss something: each of them explains next to nothing.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.choose.score import fallen
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of, values_of

Array = npt.NDArray[np.float64]


def everywhere(trials: Trials) -> tuple[Model, LinearFitter] | None:
    """The model of all that every joint has and that its own joint needs, fitted; None where there is not enough of it to be looked at together."""
    effects = [one.starts[0] for one in trials.candidates if one.kind.everywhere]
    if len(effects) < 2 or trials.cut_short("fitting all joints at once"):
        return None
    pair = _fitted(trials, effects)
    while len(pair[0].effects) > 2 and not trials.cut_short("fitting all joints at once"):
        kept = needed(trials.problem, pair[0])
        if len(kept) == len(pair[0].effects):
            break
        trials.add(pair[0])
        pair = _fitted(trials, kept)
    return pair


def _fitted(trials: Trials, effects: list[Effect]) -> tuple[Model, LinearFitter]:
    """Fitted about its own fit until that gains nothing, however far from the noise it ends: none of its parts would come nearer by itself."""
    settings = trials.settings
    model, fitter = polished(trials.problem, effects)
    for _ in range(settings.convergences):
        if trials.cut_short("fitting all joints at once"):
            break
        (model, fitter), gained = trials.again(model, fitter, evaluations=1)
        if gained < settings.converged * model.train:
            break
    return model, fitter


def needed(problem: Problem, model: Model) -> list[Effect]:
    """The effects of `model` without which their own joint would be predicted worse, whatever the others then did: left out one by one, the idlest first."""
    settings, joints = problem.settings.choose, problem.rig.joints
    missed = _left_out(problem, model)
    kept = list(range(len(model.effects)))
    while len(kept) > 1:
        dropped = [index for index in range(len(model.effects)) if index not in kept]
        rich, needs = missed(dropped), {}
        for index in kept:
            joint = joints.index(model.effects[index].target)
            share, error = fallen(missed([*dropped, index])[:, joint], rich[:, joint])
            # By how much more than is material it lowers what is missed there.
            needs[index] = min(share - settings.material, share - settings.coarse_errors * error)
        idlest = min(kept, key=needs.__getitem__)
        if needs[idlest] > 0:
            break
        kept.remove(idlest)
    return [model.effects[index] for index in kept]


def _left_out(problem: Problem, model: Model) -> Callable[[list[int]], Array]:
    """Root of what `model` misses of each joint in each window, shape (windows, joints), without some of its effects, by index, the others at their best.

    To first order, from the derivatives about the fit: thirty fits in the simulator would take minutes.
    """
    owner = np.repeat(np.arange(len(model.effects)), [len(parameters_of(effect)) for effect in model.effects])
    size = np.linalg.norm(model.fit.jacobian.reshape(len(owner), -1), axis=1)
    size = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    away = np.divide(model.absent - values_of(model.effects), size, out=np.zeros_like(size), where=size > 0)
    jacobian = model.fit.jacobian * size[:, None, None]
    weights = problem.fitter(model.effects).weights(model.fit.cost)
    columns = (jacobian * weights).reshape(len(owner), -1)
    gram, along = columns @ columns.T, columns @ (model.fit.residuals * weights).ravel()

    def missed(without: list[int]) -> Array:
        free = ~np.isin(owner, without)
        step = np.where(free, 0.0, away)
        step[free] = np.linalg.lstsq(gram[np.ix_(free, free)], (along - gram @ step)[free], rcond=1e-9)[0]
        left = model.fit.residuals - np.tensordot(step, jacobian, 1)
        return np.asarray(np.sqrt((left.reshape(len(left), -1, 2, len(problem.rig.joints)) ** 2).mean((1, 2)) + 1e-9))

    return missed
