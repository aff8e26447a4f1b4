"""Grounding by repair: put physics that the transitions tell of into the source, and learn there. Ours diagnoses it; the usual practice fits everything."""

from __future__ import annotations

import copy
import functools
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mpge_bench.baselines.agent import AgentSettings, train_transfer
from mpge_bench.baselines.inversion import Grounded, InversionSettings, invert
from mpge_bench.baselines.method import Method, Result
from mpge_bench.baselines.problem import Problem
from mpge_bench.baselines.progress import Progress
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.diagnosis.transitions.at_once import at_once
from mpge_bench.diagnosis.transitions.hypotheses import hypotheses
from mpge_bench.diagnosis.transitions.pipeline import parted, unmask
from mpge_bench.envs import RobotEnv
from mpge_bench.envs.effects import CATALOGUE, Effect
from mpge_bench.envs.errors import UserError
from mpge_bench.unmask import episodes_of, own_of

#: What changing the source's physics by target transitions takes.
_ACCESS = frozenset({"transitions", "resets", "physics", "noise"})
#: Verdicts that leave something for an action transformation.
_LEFT_OVER = ("partly_explained", "unexplained")


def _repaired(problem: Problem, effects: Sequence[Effect]) -> Problem:
    """`problem` whose source has `effects`."""
    found = copy.copy(problem)
    found.source = functools.partial(RobotEnv, problem.robot, tuple(effects))
    return found


def _learnt_in(
    repaired: Problem,
    physics: Sequence[Effect],
    upon: Grounded | None,
    agent: AgentSettings,
    seed: int,
    progress: Progress,
    log_dir: Path,
    jobs: int,
    begun: float,
    report: dict[str, Any],
) -> Result:
    """The result of learning in a source `repaired` by `physics`, found since `begun` (time.monotonic()), and an action transformation `upon` it."""
    grounded, transformation = time.monotonic(), upon.grounding if upon else None
    policy, steps = train_transfer(repaired, transformation, agent, seed, progress, log_dir / "agent", jobs, "agent in the repaired source")
    seconds = {"grounding": grounded - begun, "agent": time.monotonic() - grounded}
    steps_of = {"grounding": upon.steps if upon else 0, "agent": steps}
    return Result(policy, transformation, physics=physics, steps=steps_of, seconds=seconds, report=report)


class Repair(Method):
    """Says by `diagnose --task` what the source lacks, puts it in, and learns there what all methods learn in their grounded sources.

    It changes the simulator's physics, which black-box methods may not. Where no physics of the catalogue explains all, the repaired source is inverted as
    `Inversion` does, and cross-validation chooses whether an action transformation upon it does better than none. ``report`` holds the verdict, the effects
    with their intervals, the held-out errors, and what was put upon the repair.
    """

    summary = "diagnoses what physics the source lacks, puts it in, and learns there; what it cannot name becomes an action transformation (ours)"
    citation = "mpge_bench"
    access = _ACCESS
    settings = InversionSettings
    preset = "diagnose"

    def train(self, problem: Problem, settings: InversionSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        begun, policies = time.monotonic(), problem.rollouts.widened(settings.rollout_std)
        target = problem.demonstrations(policies)
        # No time budget: what is found must not depend on how fast the machine is.
        found = unmask(problem.robot, episodes_of(target), own_of(problem, policies, seed), jobs=jobs, progress=progress)
        repaired, said = _repaired(problem, found.effects), found.result.to_json()
        report = {key: said[key] for key in ("effects", "p_value", "fit", "indistinguishable")} | {"found": said["verdict"], "upon": None}
        report["verdict"] = " ".join(found.result.summary)
        upon = invert(repaired, policies, target, settings, seed, progress) if said["verdict"] in _LEFT_OVER else None
        if upon and upon.capacity == "none":
            upon = None
        if upon:
            report |= {"upon": upon.report, "verdict": f"{report['verdict']} Upon that: {upon.report['verdict']}"}
        return _learnt_in(repaired, found.effects, upon, settings.agent, seed, progress, log_dir, jobs, begun, report)


@dataclass(frozen=True)
class IdentificationSettings:
    """Hyperparameters of system identification.

    Attributes:
        agent: as of every method that learns one.
        effects: names of the catalogue's effects, each of which every joint and link has in its own measure.
        starts: fits from different parameters, of which the best counts.
        rounds: of fitting on, 15 Levenberg-Marquardt iterations each, at most.
    """

    agent: AgentSettings
    effects: tuple[str, ...]
    starts: int = 3
    rounds: int = 4

    def __post_init__(self) -> None:
        unknown = sorted(set(self.effects) - CATALOGUE.keys())
        if unknown:
            raise UserError(f"setting effects names {', '.join(unknown)}; the catalogue has {', '.join(CATALOGUE)}")
        if min(self.starts, self.rounds) < 1:
            raise UserError("settings starts and rounds take 1 or more")


class Identification(Method):
    """System identification as it is mostly done: the usual parameters of all joints and links fitted together, the simulator then taken for the target.

    The fit predicts the target's transitions in the simulator itself, as `diagnose` does (robust least squares, several starts, to convergence). ``report``
    holds all parameters, the errors on transitions that it was not fitted to, and whether it converged.
    """

    summary = "fits the usual parameters of all joints and links at once, puts them in, and learns there"
    citation = "common practice"
    access = _ACCESS
    settings = IdentificationSettings
    preset = "sysid"

    def train(self, problem: Problem, settings: IdentificationSettings, seed: int, *, progress: Progress, log_dir: Path, jobs: int) -> Result:
        begun, replay, target = time.monotonic(), DEFAULT.replay, problem.demonstrations(problem.rollouts)
        parts = parted(problem.robot, episodes_of(target), own_of(problem, problem.rollouts, seed), replay)
        options = [one for one in hypotheses(problem.robot, parts.fitted.episodes, replay) if one.kind.name in settings.effects]
        progress.stage("fitting all parameters", settings.starts)
        with Workers(min(jobs, settings.starts)) as workers:
            found = at_once(parts.fitted, options, settings.starts, settings.rounds, seed, workers, replay)
        progress.advance(settings.starts)

        def missed(effects: Sequence[Effect]) -> float:
            return float(np.median(np.abs(parts.whole.residuals(effects, np.arange(len(parts.whole)))[parts.unseen])))

        before, after = missed(()), missed(found.model.effects)
        report = {
            "parameters": found.model.size,
            "effects": [one.to_dict() for one in found.model.effects],
            "descriptions": list(found.descriptions),
            "converged": found.converged,
            "held_out": {"before": before, "after": after, "unit": "step spreads"},
            "verdict": f"{found.model.size} parameters fitted, {'converged' if found.converged else 'NOT converged'}: on unseen transitions {after:.3g} step "
            f"spreads are missed instead of {before:.3g} (median).",
        }
        return _learnt_in(_repaired(problem, found.model.effects), found.model.effects, None, settings.agent, seed, progress, log_dir, jobs, begun, report)
