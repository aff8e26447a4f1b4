"""Which effects of a model of all joints these need: joints that are alike have what they have together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import yaml

from mpge_bench.diagnosis.choose.points import Effects, Point
from mpge_bench.diagnosis.choose.score import fallen
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.fit.problem import Model, Problem
from mpge_bench.diagnosis.settings import ChooseSettings
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.effects.vector import limits_of, parameters_of, values_of

Array = npt.NDArray[np.float64]


def needed(problem: Problem, model: Model) -> list[Effect]:
    """The effects of `model` without which the joints that they act on would be predicted worse, whatever the others then did: left out the idlest first.

    Joints that are alike have what they have together: one of four legs that moved less does not say that its motors are made otherwise.
    """
    settings, groups = problem.settings.choose, _groups(problem, model.effects)
    missed = _left_out(problem, model)
    # Far from the noise windows differ too much for two standard errors.
    errors = settings.errors if model.overall < settings.coarse else settings.coarse_errors

    def without(*indices: int) -> Array:
        return missed([effect for index in indices for effect in groups[index].effects])

    def need(index: int, dropped: list[int], rich: Array) -> float:
        share, error = fallen(*(np.sqrt((one[:, groups[index].joints] ** 2).mean(1)) for one in (without(*dropped, index), rich)))
        # By how much more than is material it lowers what is missed there.
        return min(share - settings.material, share - errors * error)

    kept = _kept(len(groups), lambda dropped: without(*dropped), need)
    return [model.effects[index] for index in sorted(effect for group in kept for effect in groups[group].effects)]


def needed_as_used(rig: Rig, point: Point, settings: ChooseSettings, least: float) -> Effects:
    """The effects of `point` without which more would be missed, from recorded states, of the joint that they act on, whatever the others did.

    To first order, left out the idlest first. What acts on no joint has to matter to all of them together, as much as it had to when it was taken in.

    Args:
        least: share of the sum of squares of its joint's errors that an effect has to explain.
    """
    joints = len(rig.joints)
    owner = np.repeat(np.arange(len(point.effects)), [len(parameters_of(effect)) for effect in point.effects])
    size = np.linalg.norm(point.jacobian, axis=0)
    size = np.where(size > 0, size, 1.0)
    values = values_of(point.effects)
    columns, away = point.jacobian / size, (rig.absent(point.effects) - values) * size
    away = np.where(np.isfinite(away), away, 0.0)
    # Nothing goes beyond its bounds to make up for others: friction that is none would be less than none.
    at_bound = np.min([np.abs(bound - values) * size for bound in limits_of(point.effects)], axis=0) < settings.material * np.linalg.norm(point.missed)
    gram, along = columns.T @ columns, -columns.T @ point.missed

    def missed(without: list[int]) -> Array:
        """Sum of squares of each joint, shape (joints,)."""
        absent = np.isin(owner, without)
        step = _step(gram, along, np.where(absent, away, 0.0), ~absent & ~at_bound)
        return np.asarray(((point.missed + columns @ step).reshape(-1, joints) ** 2).sum(0))

    def need(index: int, dropped: list[int], rich: Array) -> float:
        poor, target = missed([*dropped, index]), point.effects[index].target
        own, share = ([rig.joints.index(target)], least) if target in rig.joints else (list(range(joints)), settings.coarse_material)
        return float(1 - rich[own].sum() / poor[own].sum()) - share

    return tuple(point.effects[index] for index in _kept(len(point.effects), missed, need))


def _kept(count: int, without: Callable[[list[int]], Array], need: Callable[[int, list[int], Array], float]) -> list[int]:
    """Which of `count` things are needed: the idlest is dropped as long as it is not, the last one never.

    Args:
        without: what is missed without those that are dropped.
        need: by how much more than it has to the thing of an index lowers what is missed without it beside those dropped, to what is missed without these.
    """
    kept = list(range(count))
    while len(kept) > 1:
        dropped = [index for index in range(count) if index not in kept]
        rich = without(dropped)
        needs = {index: need(index, dropped, rich) for index in kept}
        idlest = min(kept, key=needs.__getitem__)
        if needs[idlest] > 0:
            break
        kept.remove(idlest)
    return kept


def _step(gram: Array, along: Array, given: Array, free: npt.NDArray[np.bool_]) -> Array:
    """Changes of parameters, shape (parameters,): `given` and, of those that are `free`, what explains most beside it by least squares.

    Args:
        gram, along: products of the parameters' columns with each other and with what is to be explained.
    """
    step = given.copy()
    step[free] = np.linalg.lstsq(gram[np.ix_(free, free)], (along - gram @ step)[free], rcond=1e-9)[0]
    return step


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
        step = _step(gram, along, np.where(free, 0.0, away), free)
        left = model.fit.residuals - np.tensordot(step, jacobian, 1)
        return np.asarray(np.sqrt((left.reshape(len(left), -1, 2, len(problem.rig.joints)) ** 2).mean((1, 2)) + 1e-9))

    return missed
