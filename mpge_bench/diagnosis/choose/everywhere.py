"""What every real machine has more or less of (friction, rotors, sensors not quite at zero, a base not quite level), all at once, and then only where needed.

Single effects lead nowhere where a dozen joints all miss something: each of them explains next to nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import yaml

from mpge_bench.diagnosis.choose.score import fallen, idle
from mpge_bench.diagnosis.choose.trials import Trials
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.linear import LinearFitter
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.diagnosis.fit.told import unit_length
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import parameters_of, values_of

Array = npt.NDArray[np.float64]
#: What is said to be cut short where time is up.
_STAGE = "fitting all joints at once"


def everywhere(trials: Trials) -> tuple[Model, LinearFitter] | None:
    """The model of all that every machine has and that this one needs, fitted; None where there is not enough of it to be looked at together.

    One kind after another, on all that it acts on, what explains most of what is left first, where that is much and what models are chosen by is predicted no
    worse as well: a fit of fifty parameters from nothing ends where some joint that hardly moved sticks, and never moves again.
    """
    kinds: dict[str, list[Effect]] = {}
    for one in trials.candidates:
        if one.kind.is_everywhere(trials.problem.scale(one.target)):
            kinds.setdefault(one.name, []).append(one.starts[0])
    if sum(map(len, kinds.values())) < 2 or trials.cut_short(_STAGE):
        return None
    pair = trials.nominal, trials.fitter
    while not trials.cut_short(_STAGE):
        richer = _richer(trials, pair, kinds)
        if richer is None:
            break
        pair = richer
    while len(pair[0].effects) > 2 and not trials.cut_short(_STAGE):
        useless = list(idle(trials.problem, pair[1], pair[0].effects))
        kept = [effect for effect in needed(trials.problem, pair[0]) if effect not in useless]
        if len(kept) == len(pair[0].effects):
            break
        trials.add(pair[0])
        pair = _fitted(trials, kept)
    return pair


def _richer(trials: Trials, pair: tuple[Model, LinearFitter], kinds: Mapping[str, Sequence[Effect]]) -> tuple[Model, LinearFitter] | None:
    """`pair` with the first of `kinds` that it has not and that helps, what promises most first; None where none does."""
    present = {effect.name for effect in pair[0].effects}
    for name in _ranked(pair, {name: starts for name, starts in kinds.items() if name not in present}):
        if trials.cut_short(_STAGE):
            break
        # What is off by a sensor's zero or a tilted base readily stands in for other physics; friction and rotors every joint has.
        least = trials.settings.material if kinds[name][0].on == "joint" else trials.settings.coarse_material
        grown = _fitted(trials, [*pair[0].effects, *kinds[name]])
        if grown[0].train < (1 - least) * pair[0].train and trials.no_worse(grown[0], pair[0]):
            return grown
    return None


def _ranked(pair: tuple[Model, LinearFitter], kinds: Mapping[str, Sequence[Effect]]) -> list[str]:
    """`kinds` by how much they explain of what the model leaves, to first order, beside what the model's own effects can; the most first."""
    model, fitter = pair
    cost = model.fit.cost
    left, own = fitter.weighted(model.fit.residuals, cost), fitter.weighted(model.fit.jacobian, cost)
    at = fitter.predictor.change(model.effects)
    missed = {}
    for name, starts in kinds.items():
        columns = np.stack([fitter.predictor.change([*model.effects, start]) - at for start in starts])
        unknown = unit_length(np.concatenate((own, fitter.weighted(columns, cost)))).T
        missed[name] = float(((left - unknown @ np.linalg.lstsq(unknown, left, rcond=1e-6)[0]) ** 2).sum())
    return sorted(missed, key=missed.__getitem__)


def _fitted(trials: Trials, effects: list[Effect]) -> tuple[Model, LinearFitter]:
    """Fitted about its own fit until that gains nothing, however far from the noise it ends: none of its parts would come nearer by itself."""
    settings = trials.settings
    model, fitter = polished(trials.problem, effects)
    for _ in range(settings.convergences):
        if trials.cut_short(_STAGE):
            break
        (model, fitter), gained = trials.again(model, fitter, evaluations=1)
        if gained < settings.converged * model.train:
            break
    return model, fitter


def needed(problem: Problem, model: Model) -> list[Effect]:
    """The effects of `model` without which the joints that they act on would be predicted worse, whatever the others then did: left out the idlest first.

    Joints that are alike have what they have together: one of four legs that moved less does not say that its motors are made otherwise.
    """
    settings, groups = problem.settings.choose, _groups(problem, model.effects)
    missed = _left_out(problem, model)
    kept = list(range(len(groups)))
    # Far from the noise windows differ too much for two standard errors.
    errors = settings.errors if model.overall < settings.coarse else settings.coarse_errors

    def without(*indices: int) -> Array:
        return missed([effect for index in indices for effect in groups[index].effects])

    while len(kept) > 1:
        dropped = [index for index in range(len(groups)) if index not in kept]
        rich, needs = without(*dropped), {}
        for index in kept:
            share, error = fallen(*(np.sqrt((one[:, groups[index].joints] ** 2).mean(1)) for one in (without(*dropped, index), rich)))
            # By how much more than is material it lowers what is missed there.
            needs[index] = min(share - settings.material, share - errors * error)
        idlest = min(kept, key=needs.__getitem__)
        if needs[idlest] > 0:
            break
        kept.remove(idlest)
    return [model.effects[index] for index in sorted(effect for group in kept for effect in groups[group].effects)]


@dataclass(frozen=True)
class _Group:
    """Effects of one kind, by their indices in a model, and the joints, by theirs, that they act on: joints that are alike, or all."""

    effects: tuple[int, ...]
    joints: tuple[int, ...]


def _groups(problem: Problem, effects: Sequence[Effect]) -> list[_Group]:
    rig = problem.rig
    makes = {joint: _make(rig, joint) for joint in rig.joints}
    found: dict[object, list[int]] = {}
    for index, effect in enumerate(effects):
        found.setdefault((effect.name, makes.get(effect.target)), []).append(index)
    joints = [[rig.joints.index(effects[index].target) for index in indices if effects[index].target in makes] for indices in found.values()]
    return [_Group(tuple(indices), tuple(own or range(len(rig.joints)))) for indices, own in zip(found.values(), joints, strict=True)]


def _make(rig: Rig, joint: str) -> object:
    """What is equal of joints that are alike: how they are driven, their place in the chain and the body that they turn, mirrored or not."""
    model = rig.model
    own = [link for link in model.moving_links() if model.carriers(link)[:1] == (joint,)]
    bodies = []
    for link in own:
        mass, centre, inertia = model.inertial(link)
        length = float(np.linalg.norm(centre))
        bodies.append(tuple(f"{value:.2g}" for value in (mass, length, *np.linalg.eigvalsh(inertia))))
    depth = len(model.carriers(own[0])) if own else 0
    return rig.modes[joint], yaml.safe_dump(rig.data["joints"].get(joint)), model.is_prismatic(joint), depth, tuple(bodies)


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
