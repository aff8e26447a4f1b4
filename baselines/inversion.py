"""Inversion, ours: ask the source itself which action does what the target did, and fit the action transformation to the answers."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from scipy.optimize import least_squares

from mpge_bench.baselines.agent import AgentSettings, train_grounded
from mpge_bench.baselines.grounding.inverse import REACHED, Solver
from mpge_bench.baselines.grounding.networks import Networks, stretches_of
from mpge_bench.baselines.grounding.store import beside, part
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.policy import Array, PolicySet
from mpge_bench.baselines.presets import RolloutSettings
from mpge_bench.baselines.problem import Problem, Transitions
from mpge_bench.baselines.progress import Progress
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.robots import Robot

#: What is left of the mismatch, as a share, below which an action transformation counts as all there is to it.
EXPLAINED = 0.1
#: Accuracy of an inverted action, in units of the action limit, beyond which it is no use to go.
_ACCURACY = 1e-3
#: Largest condition number of a calibration, which is near 1 unless the samples say nothing of some action.
_TRUSTED = 10.0


@dataclass(frozen=True)
class InversionSettings(RolloutSettings):
    """Hyperparameters of inversion.

    Attributes:
        agent: learning in the grounded source, as of MPGE.
        ensemble: N, members of the grounding, fitted to bootstrap samples.
        transitions: most target transitions that are inverted, evenly spread over the samples.
        own_transitions: transitions of the source itself that are inverted alike, to calibrate the answers and to compare with.
        passes: times that all are inverted; from the second on each coordinate counts by how well the fit so far predicts it, which finds the sensors' noise.
        folds: of the cross-validation that chooses between ã = a, linear, and networks.
        hidden, updates, learning_rate, weight_decay, input_spread: of the networks (`Networks`).
    """

    agent: AgentSettings
    ensemble: int = 5
    transitions: int = 5000
    own_transitions: int = 1000
    passes: int = 2
    folds: int = 5
    hidden: tuple[int, ...] = (32, 32)
    updates: int = 1000
    learning_rate: float = 3e-3
    weight_decay: float = 1e-3
    input_spread: float = 3.0

    def __post_init__(self) -> None:
        for name, least in (("ensemble", 1), ("transitions", 1), ("own_transitions", 1), ("passes", 1), ("folds", 2)):
            if getattr(self, name) < least:
                raise UserError(f"setting {name} of inversion is {getattr(self, name)}; give {least} or more")


@dataclass(frozen=True)
class Inverted:
    """n target transitions run backwards in the source.

    Attributes:
        actions: the source's nearest answers (n, k).
        root: (n, k, k); ‖root (ã − action)‖ is by how many times the noise the next state moves when ã is executed instead of the answer: an answer
            counts for as much as the state tells of it, for nothing where the action makes no difference, as at an end stop. And it counts the less, the
            farther from the target's state it leaves the source: that is divided by its distance, if that is beyond what the nearest twentieth have.
    """

    actions: Array
    root: Array

    def distance(self, found: Array) -> Array:
        """Distances (n, k) of the actions `found` (n, k) from the answers, in noise."""
        distance: Array = np.einsum("nij,nj->ni", self.root, found - self.actions)
        return distance

    def scale(self, found: Array, limit: float) -> float:
        """Where the Cauchy loss of `distance` begins to bend: at its middle, but no finer than an action can be known."""
        informed = np.median(np.sqrt(np.einsum("nij,nij->n", self.root, self.root)))
        return max(float(np.median(np.abs(self.distance(found)))), _ACCURACY * limit * float(informed), 1e-12)

    def calibrated(self, executed: Array, own: Inverted, limit: float) -> Inverted:
        """These answers freed of what is wrong with all answers alike.

        What a state does not tell (Bullet's cached contacts, the sensors' noise) also makes the source answer wrongly when asked what it did itself. If its
        own answers are W u + b for the actions u = `executed`, an answer y means the action W⁻¹(y − b).
        """
        linear, _ = fit_linear(executed, own, np.ones(len(executed)), limit)
        if np.linalg.cond(linear[:, :-1]) > _TRUSTED:
            return self  # an action that makes no difference anywhere
        inverse = np.linalg.inv(linear[:, :-1])
        return Inverted((self.actions - linear[:, -1]) @ inverse.T, self.root @ linear[:, :-1])


class FittedTransformation:
    """ã = clip(W a + b + network(s, a)), several members of it.

    Args:
        linear: W and b side by side, (members, k, k + 1).
        networks: one a member; None where ã is linear in the action.
        limit: the action limit.
    """

    def __init__(self, linear: Array, networks: Networks | None, limit: float) -> None:
        self.linear, self.networks, self.limit = linear, networks, limit
        self.members = len(linear)

    def __call__(self, observation: Array, action: Array, member: Array) -> Array:
        found = np.einsum("nij,nj->ni", self.linear[member, :, :-1], action) + self.linear[member, :, -1]
        if self.networks:
            change = self.networks.predict(np.concatenate((observation, action), axis=1))
            found = found + self.limit * change[member, np.arange(len(action))]
        executed: Array = np.clip(found, -self.limit, self.limit)
        return executed

    def state(self) -> dict[str, torch.Tensor]:
        """Plain tensors by name, from which `from_state` makes it again."""
        own = {"linear": torch.as_tensor(self.linear), "limit": torch.tensor(self.limit)}
        return beside(own=own, networks=self.networks.parts() if self.networks else {})

    @classmethod
    def from_state(cls, state: Mapping[str, torch.Tensor]) -> FittedTransformation:
        own, networks = part(state, "own"), part(state, "networks")
        return cls(own["linear"].numpy(), Networks.from_parts(networks) if networks else None, float(own["limit"]))


class Inversion(Method):
    """Grounds the source without an adversary, since the source can be put into any state of the target's.

    1. For each target transition (s, a, s') Gauss-Newton finds the source's action whose next state from s is nearest to s'.
       The source's own transitions are inverted, too: what their answers are off by is taken off the target's.
    2. ã(s, a) is fitted to these by robust regression (Cauchy loss), each weighed by how much the next state says of it. Capacity grows as
       cross-validation over stretches of the samples asks for it: ã = a, linear in a, an ensemble of networks on (s, a) upon that.
    3. The ensemble goes to the same policy learning as MPGE's.

    It also says what no action of the source can do: ``report`` and ``residuals``, one row a transition with the observation (o0, ...), the action
    (a0, ...), the source's nearest answer (inverted0, ...), the distance of the next states without and with it (before, after: root mean square over
    coordinates, each in spreads of its change in a control step), and what is left of each coordinate (left0, ..., in the same spreads).
    """

    summary = "inverts the source on each target transition, robust regression of ã (ours)"
    citation = "mpge_bench"
    access = frozenset({"transitions", "resets", "noise"})
    settings = InversionSettings
    preset = "inversion"

    def train(self, problem: Problem, settings: InversionSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        begun = time.monotonic()
        rollouts = problem.rollouts.widened(settings.rollout_std)
        found = invert(problem, rollouts, problem.demonstrations(rollouts), settings, seed, progress)
        result = train_grounded(problem, {found.steps: found.grounding}, found.steps, settings.agent, seed, progress, log_dir, begun, jobs)
        return replace(result, report=found.report, residuals=found.residuals)


@dataclass(frozen=True)
class Grounded:
    """What inversion makes of target transitions.

    Attributes:
        grounding: the ensemble.
        capacity: that cross-validation chose: ``none`` (ã = a), ``linear``, ``networks``.
        report, residuals: as `Inversion` has them.
        steps: control steps of the source that it took.
    """

    grounding: FittedTransformation
    capacity: str
    report: dict[str, Any]
    residuals: pd.DataFrame
    steps: int


def invert(problem: Problem, policies: PolicySet, target: Transitions, settings: InversionSettings, seed: int, progress: Progress) -> Grounded:
    """The action transformation under which the source of `problem` does what the `target` transitions show, which `policies` drew, as far as it can."""
    taken = np.unique(np.linspace(0, len(target) - 1, settings.transitions).astype(int)) if len(target) > settings.transitions else np.arange(len(target))
    target = Transitions(target.observations[taken], target.actions[taken], target.next_observations[taken])
    own = problem.measured(problem.source_transitions(policies, settings.own_transitions, seed))
    progress.stage("inversion", settings.passes * (len(target) + len(own)))
    itself, source = _Source(problem, own), _Source(problem, target)
    own_answers, answers = itself.invert(settings.passes, progress), source.invert(settings.passes, progress)
    fitter = _Fitter(target, answers.calibrated(own.actions, own_answers, source.limit), settings, source.limit, seed)
    chosen, losses = fitter.choose()
    grounding = fitter.fit(chosen)
    residuals = source.residuals(answers.actions, source.scale)
    report = _report(problem.robot, residuals, itself.residuals(own_answers.actions, source.scale))
    report |= {"capacity": chosen, "held_out_loss": losses}
    return Grounded(grounding, chosen, report, residuals, itself.solver.steps + source.solver.steps)


class _Source:
    """The source beside the target's transitions."""

    def __init__(self, problem: Problem, target: Transitions) -> None:
        self.target, env = target, problem.source()
        self.scale = np.maximum(np.std(target.next_observations - target.observations, axis=0), 1e-6)
        self.states = [env.robot.state(observation) for observation in target.observations]
        self.solver = Solver(env, env.robot.observation, self.scale, restarts=0)
        self.limit = env.robot.action_limit

    def predict(self, actions: Array) -> Array:
        """The source's next observations (n, o) under `actions`."""
        return np.array([self.solver.reach(*state, action) for state, action in zip(self.states, actions, strict=True)])

    def invert(self, passes: int, progress: Progress) -> Inverted:
        """The nearest answers, sought from the target's own actions at first, then from those that a fit to the answers so far predicts.

        Coordinates count in units of their spread at first, then of how well that fit predicts them, which finds the sensors' noise.
        """
        guess, noise = self.target.actions, self.scale
        for turn in range(passes):
            inverted = self._invert(guess, noise, progress)
            if turn < passes - 1:
                linear, _ = fit_linear(self.target.actions, inverted, np.ones(len(guess)), self.limit)
                guess = _linear(linear, self.target.actions, self.limit)
                missed = np.median(np.abs(self.predict(guess) - self.target.next_observations), axis=0)
                noise = np.maximum(1.4826 * missed, 1e-4 * self.scale)
        return inverted

    def _invert(self, guess: Array, noise: Array, progress: Progress) -> Inverted:
        self.solver.weigh(noise)
        rng = np.random.default_rng(0)  # there are no random restarts
        actions, misses, roots = [], [], []
        for state, wanted, start in zip(self.states, self.target.next_observations, guess, strict=True):
            solution = self.solver.solve(*state, wanted, start, rng)
            action = solution.action
            slope = self.solver.slope(*state, action, self.solver.reach(*state, action)) / noise[:, None]
            actions.append(action)
            misses.append(solution.miss)
            # The information matrix is the root's square; its eigenvalues may be 0, where Cholesky's root would fail.
            values, vectors = np.linalg.eigh(slope.T @ slope)
            roots.append((vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T)
            progress.advance(1)
        nearest = max(float(np.quantile(misses, 0.05)), REACHED)
        weights = nearest / np.maximum(misses, nearest)
        return Inverted(np.array(actions), np.array(roots) * weights[:, None, None])

    def residuals(self, answers: Array, scale: Array) -> pd.DataFrame:
        """What the answers leave, each coordinate in units of `scale`; columns as `Inversion` says."""
        target = self.target
        missed = {name: (self.predict(actions) - target.next_observations) / scale for name, actions in (("before", target.actions), ("after", answers))}
        columns = {"o": target.observations, "a": target.actions, "inverted": answers, "left": missed["after"]}
        table = {f"{name}{index}": column for name, values in columns.items() for index, column in enumerate(values.T)}
        return pd.DataFrame(table | {name: np.sqrt(np.mean(values**2, axis=1)) for name, values in missed.items()})


def _linear(linear: Array, actions: Array, limit: float) -> Array:
    found: Array = np.clip(actions @ linear[:, :-1].T + linear[:, -1], -limit, limit)
    return found


def fit_linear(actions: Array, inverted: Inverted, shares: Array, limit: float) -> tuple[Array, float]:
    """W and b (k, k + 1) of clip(W a + b) by robust least squares, and the scale of its loss, both found in turn."""
    size, scale = actions.shape[1], inverted.scale(actions, limit)
    weight = np.sqrt(shares)[:, None]
    linear = np.concatenate((np.eye(size), np.zeros((size, 1))), axis=1)

    def distance(values: Array) -> Array:
        found: Array = (inverted.distance(_linear(values.reshape(size, -1), actions, limit)) * weight).ravel()
        return found

    for _ in range(3):
        linear = least_squares(distance, linear.ravel(), loss="cauchy", f_scale=scale, x_scale="jac", max_nfev=30).x.reshape(size, -1)
        scale = min(scale, 2 * inverted.scale(_linear(linear, actions, limit), limit))
    return linear, scale


class _Fitter:
    """Fits ã to inverted transitions, with as much capacity as cross-validation asks for."""

    def __init__(self, target: Transitions, inverted: Inverted, settings: InversionSettings, limit: float, seed: int) -> None:
        self.target, self.inverted, self.settings, self.limit, self.seed = target, inverted, settings, limit, seed
        self.inputs = np.concatenate((target.observations, target.actions), axis=1)
        self.scale = self._robust(np.ones(len(target)))[1]

    def _robust(self, shares: Array) -> tuple[Array, float]:
        return fit_linear(self.target.actions, self.inverted, shares, self.limit)

    def _loss(self, found: Array) -> Array:
        """Loss of each transition, (n,), on one scale for all capacities."""
        loss: Array = np.log1p((self.inverted.distance(found) / self.scale) ** 2).sum(1)
        return loss

    def choose(self) -> tuple[str, dict[str, float]]:
        """The least capacity whose held-out loss none with more undercuts by more than two standard errors, and all their losses."""
        count, folds = len(self.target), self.settings.folds
        # Neighbouring samples are alike; stretches of them are held out together.
        stretches = stretches_of(count, folds)
        fold = stretches % folds
        held_out = {name: np.empty(count) for name in ("none", "linear", "networks")}
        held_out["none"] = self._loss(self.target.actions)
        linears = np.array([self._robust((fold != one).astype(float))[0] for one in range(folds)])
        networks = self._networks(linears, np.array([fold != one for one in range(folds)], float))
        for name, fitted in (("linear", FittedTransformation(linears, None, self.limit)), ("networks", FittedTransformation(linears, networks, self.limit))):
            held_out[name] = self._loss(fitted(self.target.observations, self.target.actions, fold))
        chosen = "none"
        for name in ("linear", "networks"):
            gain = np.bincount(stretches, held_out[chosen] - held_out[name]) / np.bincount(stretches)
            if gain.mean() > 2 * gain.std(ddof=1) / np.sqrt(len(gain)):
                chosen = name
        return chosen, {name: float(loss.mean()) for name, loss in held_out.items()}

    def fit(self, capacity: str) -> FittedTransformation:
        """The ensemble of this capacity, each member fitted to a bootstrap sample."""
        rng, members, count = np.random.default_rng(self.seed), self.settings.ensemble, len(self.target)
        size = self.target.actions.shape[1]
        if capacity == "none":
            return FittedTransformation(np.tile(np.concatenate((np.eye(size), np.zeros((size, 1))), axis=1), (members, 1, 1)), None, self.limit)
        shares = np.array([np.bincount(rng.integers(count, size=count), minlength=count) for _ in range(members)], float)
        linears = np.array([self._robust(share)[0] for share in shares])
        return FittedTransformation(linears, self._networks(linears, shares) if capacity == "networks" else None, self.limit)

    def _networks(self, linears: Array, shares: Array) -> Networks:
        """One network for each of `linears`, fitted to what it leaves; `shares` (members, n) weigh the transitions."""
        settings, actions = self.settings, self.target.actions

        def tensor(values: Array) -> torch.Tensor:
            return torch.as_tensor(values, dtype=torch.float32)

        networks = Networks(self.inputs, actions.shape[1], settings.hidden, len(linears), self.seed, settings.input_spread)
        torch.nn.init.zeros_(networks.weights[-1])
        base = tensor(np.einsum("mij,nj->mni", linears[:, :, :-1], actions) + linears[:, None, :, -1])
        answers, root, limit = tensor(self.inverted.actions), tensor(self.inverted.root / self.scale), self.limit

        def loss(found: torch.Tensor, index: torch.Tensor) -> torch.Tensor:
            executed = torch.clamp(base[:, index] + limit * found, -limit, limit)
            distance = torch.einsum("nij,mnj->mni", root[index], executed - answers[index])
            return torch.log1p(distance**2).sum(-1)

        networks.fit(
            self.inputs,
            loss,
            shares,
            updates=settings.updates,
            batch_size=512,
            learning_rate=settings.learning_rate,
            weight_decay=settings.weight_decay,
            seed=self.seed,
        )
        return networks


def _report(robot: Robot, residuals: pd.DataFrame, own: pd.DataFrame) -> dict[str, Any]:
    """How much of the mismatch an action transformation can remove, where it cannot, and a sentence that says so."""
    before, after, own_before, own_after = (float(table[name].mean()) for table in (residuals, own) for name in ("before", "after"))
    found = {"transitions": len(residuals), "distance_before": before, "distance_after": after}
    found |= {"source_distance_before": own_before, "source_distance_after": own_after}
    if before <= 1.25 * own_before + 1e-6:
        return found | {"left": None, "verdict": "No mismatch to be seen: the source does what the target did about as well as it repeats itself."}
    left = max(after - own_after, 0.0) / (before - own_before)
    found |= {"left": left}
    if left <= EXPLAINED:
        return found | {"verdict": f"The mismatch is an action transformation: with the right actions the source does what the target did but for {left:.0%}."}
    coordinate, where, times = _where(robot, residuals)
    return found | {
        "worst_coordinate": coordinate,
        "worst_where": where,
        "verdict": f"The mismatch is not (only) an action transformation: {left:.0%} of it no action of the source can do. Most is left in {coordinate}, and"
        f" where {where} ({times:.1f} times the rest). The physics itself is to be corrected (`diagnose`).",
    }


def _where(robot: Robot, residuals: pd.DataFrame) -> tuple[str, str, float]:
    """The coordinate with the largest residual, and the half-space of one coordinate or action that splits what is left best."""
    names = [*robot.observation_names, *(f"action of {joint}" for joint in robot.actuators)]
    size = robot.observation_size
    left = residuals[[f"left{index}" for index in range(size)]].to_numpy()
    after = residuals["after"].to_numpy()
    inputs = residuals[[*(f"o{index}" for index in range(size)), *(f"a{index}" for index in range(len(robot.actuators)))]].to_numpy()
    best: tuple[float, str, float] = (-1.0, "", 1.0)
    for name, column in zip(names, inputs.T, strict=True):
        for threshold in np.quantile(column, np.arange(0.1, 0.95, 0.1)):
            above = column > threshold
            if 0.08 < above.mean() < 0.92:
                gain = above.mean() * (1 - above.mean()) * (after[above].mean() - after[~above].mean()) ** 2
                if gain > best[0]:
                    more = after[above].mean() > after[~above].mean()
                    times = after[above].mean() / max(after[~above].mean(), 1e-12)
                    best = (gain, f"{name} {'>' if more else '<'} {threshold:.2g}", float(times if more else 1 / times))
    return names[int(np.argmax((left**2).mean(0)))], best[1], best[2]
