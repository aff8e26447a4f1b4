"""From a benchmark pair, or a file of transitions, to a verdict: the stages in their order.

episodes -> replay -> hypotheses -> evidence -> choose -> verdict -> report
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from mpge_bench.diagnosis.choose.clock import Clock
from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.pipeline import Progress
from mpge_bench.diagnosis.report.page import report_html
from mpge_bench.diagnosis.settings import DEFAULT, DiagnosisSettings, ReplaySettings
from mpge_bench.diagnosis.transitions.choose import Search
from mpge_bench.diagnosis.transitions.episodes import Episodes, checked
from mpge_bench.diagnosis.transitions.evidence import compared, trust_in
from mpge_bench.diagnosis.transitions.hypotheses import hypotheses
from mpge_bench.diagnosis.transitions.replay import Replay
from mpge_bench.diagnosis.transitions.verdict import concluded
from mpge_bench.diagnosis.verdict.result import DiagnosisResult
from mpge_bench.envs import Task, yaml12
from mpge_bench.envs.effects import Effect
from mpge_bench.envs.robots import Robot
from mpge_bench.files import write_text


@dataclass(frozen=True)
class Unmasked:
    """What was found in transitions.

    Attributes:
        result: what is said.
        effects: that turn the source into the target, as far as the transitions tell.
    """

    result: DiagnosisResult
    effects: tuple[Effect, ...]


@dataclass(frozen=True)
class Parts:
    """The same episodes as they are fitted to and judged by.

    Attributes:
        whole: all of the target's.
        fitted: the first part of each of the target's.
        own: all of the source's.
        unseen: which of `whole` no fit and no choice looks at, shape (transitions,).
    """

    whole: Replay
    fitted: Replay
    own: Replay
    unseen: npt.NDArray[np.bool_]


def parted(robot: Robot, target: Episodes, own: Episodes, settings: ReplaySettings) -> Parts:
    """The target's and the source's `own` transitions, ready to be predicted.

    Raises:
        UserError: if they are not the robot's.
    """
    found = checked(target, robot, "transitions")
    unseen = found.places >= np.ceil((1 - settings.unseen) * found.lengths)
    nothing = Replay(robot, checked(own, robot, "the source's transitions"), settings.settle, settings.worst)
    trust = trust_in(nothing, settings)
    # In one unit, lest the quieter of the two seem the noisier.
    fitted = found.part(~unseen)

    def ready(episodes: Episodes) -> Replay:
        return Replay(robot, episodes, settings.settle, settings.worst, trust, fitted.scale)

    return Parts(ready(found), ready(fitted), ready(nothing.episodes), unseen)


def unmask(
    robot: Robot,
    target: Episodes,
    own: Episodes,
    *,
    seconds: float | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
    settings: DiagnosisSettings = DEFAULT,
) -> Unmasked:
    """What the target that made the transitions `target` has and the source of `robot` lacks.

    Args:
        own: transitions of the source, drawn by the same policies and read by the same sensors: what nothing looks like.
        seconds: time budget; the best answer so far is given when it is up.
        jobs: processes.

    Raises:
        UserError: if the transitions are not the robot's.
    """
    clock = Clock.started(seconds, settings.choose)
    replay, parts = settings.replay, parted(robot, target, own, settings.replay)
    options = hypotheses(robot, parts.fitted.episodes, replay)
    if progress:
        progress.stage("fitting models", 0)
    with Workers(jobs) as workers:
        search = Search(parts.fitted, options, workers, clock, replay, progress.advance if progress else lambda steps: None, parts.own)
        test = compared(parts.fitted, parts.own, options, len(search.few), workers, settings)
        answer = search.answer() if test.is_mismatch else search.nothing()
    result = concluded(parts.whole, parts.fitted, parts.unseen, answer, test, settings, clock)
    return Unmasked(result, answer.chosen.effects if result.effects else ())


def corrected_pair(task: Task, effects: tuple[Effect, ...]) -> dict[str, Any]:
    """The content of a pair's YAML file whose target is the source of `task` with `effects`; `run --task` and `diagnose --task` take it."""
    robot: Any = task.robot.name
    address = Path(task.address)
    if address.suffix in (".yaml", ".yml"):
        robot = yaml12.load(address.read_text())["robot"]
        if isinstance(robot, dict) and "model" in robot:
            robot = {**robot, "model": str((address.parent / robot["model"]).resolve())}
    name = f"{task.name}_corrected".replace("@", "_at_").replace(".", "_")
    return {"name": name, "robot": robot, "summary": f"{task.name} as its diagnosis has it", "effects": [one.to_dict() for one in effects]}


def write(task: Task, found: Unmasked, out: Path) -> None:
    """diagnosis.json, report.html and, where an effect was found, corrected.yaml in `out`, each at once."""
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "report.html", report_html(found.result))
    if found.effects:
        write_text(out / "corrected.yaml", yaml.safe_dump(corrected_pair(task, found.effects), sort_keys=False))
    else:
        (out / "corrected.yaml").unlink(missing_ok=True)
    write_text(out / "diagnosis.json", json.dumps(found.result.to_json(), indent=1))
