"""What there is to say of each source/target pair: the overview and a page a pair, as data and as text."""

from __future__ import annotations

import inspect
import re
from dataclasses import asdict
from typing import Any

from rich.table import Column, Table

from mpge_bench.baselines.progress import Progress
from mpge_bench.envs import FAMILIES, FAMILY_IDS, SOURCE_IDS, TARGET_IDS, TASKS, Task
from mpge_bench.envs.classic import CLASSICS
from mpge_bench.envs.severity import AT, plain
from mpge_bench.harness.mismatch import Mismatch, measure_mismatch, stored_mismatches

#: What the tracks are, as a pair's page has it.
_ROLES = {
    "headline": "Headline track: pairs of the papers, their like, and targets of another simulator.",
    "control": "Control: source and target hardly differ, so that nothing is to be gained.",
    "physics": "Physics track: actions can make up for less than half of the mismatch.",
}
#: Transitions on which a pair that has no stored figures is measured.
_TRANSITIONS = 100


def _entry(task: Task, mismatch: Mismatch | None) -> dict[str, Any]:
    robot = task.robot
    return {
        **task.to_dict(),
        "severity": task.severity.to_dict() if task.severity else None,
        "lacks": task.simulator.lacks() if task.simulator else "",
        "observation_size": robot.observation_size,
        "action_size": len(robot.actuators),
        "control_step_s": robot.dt,
        "episode_steps": robot.episode_steps,
        "gymnasium": {"source": SOURCE_IDS.get(robot.name), "target": TARGET_IDS.get(task.name)},
        "mismatch": asdict(mismatch) if mismatch else None,
    }


def overview() -> list[dict[str, Any]]:
    """An entry for every shipped pair: what differs, dimensions, citation, Gymnasium ids and the measured mismatch."""
    stored = stored_mismatches()
    return [_entry(task, stored.get(name)) for name, task in TASKS.items()]


def table(entries: list[dict[str, Any]]) -> Table:
    """The overview as a table."""
    drawn = Table(
        Column("task", no_wrap=True),
        Column("o × a", no_wrap=True),
        Column("the target differs by (effects)", ratio=1),
        Column("from", no_wrap=True),
        Column("track", no_wrap=True),
        Column("mismatch", justify="right", no_wrap=True),
        Column("removable", justify="right", no_wrap=True),
        caption="o × a: sizes of observation and action. mismatch: distance of the next states, in spreads of the state's change in a control step; removable:"
        " share that the best action transformation takes away. *: settings are chosen on these pairs. `tasks NAME` shows more.",
        caption_justify="left",
        row_styles=["", "dim"],
    )
    for entry, (name, summary, *others) in zip(entries, rows(entries), strict=True):
        effects = ", ".join(dict.fromkeys(effect["effect"] for effect in entry["effects"])) or entry["simulator"]
        lacks = f". {entry['lacks']}" if entry["lacks"] else ""
        drawn.add_row(name, f"{entry['observation_size']} × {entry['action_size']}", f"{summary} ({effects}){lacks}", *others)
    return drawn


def rows(entries: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """What the overview says of each pair: name, how the target differs, where it is from, track, mismatch, and what actions can remove of it."""
    found: list[tuple[str, ...]] = []
    for entry in entries:
        measured = entry["mismatch"]
        size, share = (f"{measured['mismatch']:.2g}", f"{max(measured['removable'], 0):.0%}") if measured else ("-", "-")
        track = entry["track"] + ("*" if entry["development"] else "")
        found.append((entry["name"], entry["summary"], _short_citation(entry["citation"]), track, size, share))
    return found


def _short_citation(citation: str) -> str:
    """The methods' names, where they are given in brackets."""
    return ", ".join(re.findall(r"\((\w+)\)", citation)) or citation


def families_table() -> Table:
    """The families of environments drawn at random, as a table."""
    drawn = Table(Column("family", no_wrap=True), Column("gymnasium.make(id, instance=0 to 99)", no_wrap=True), "drawn", title="Families (MULTIPOLAR)")
    for name, family in FAMILIES.items():
        drawn.add_row(f"{name}_0 ... _99", FAMILY_IDS[name], ", ".join(family.ranges))
    for name in CLASSICS:
        drawn.add_row("", FAMILY_IDS[name], "Gymnasium's own, discrete actions")
    return drawn


def page(task: Task, progress: Progress) -> dict[str, Any]:
    """The entry of one pair, measured now if nothing is stored of it, and with its robot's description."""
    mismatch = stored_mismatches().get(task.name) if TASKS.get(task.name) is task else None
    if mismatch is None:
        progress.stage(f"measuring {task.name}", _TRANSITIONS)
        mismatch = measure_mismatch(task, _TRANSITIONS, progress=progress.advance)
    return {**_entry(task, mismatch), "robot_description": inspect.getdoc(type(task.robot)) or ""}


def text(page: dict[str, Any]) -> str:
    """The page of one pair as text."""
    found = page["mismatch"]
    ids = page["gymnasium"]
    lines = [f"{page['name']}: {page['robot']}; {page['summary'] or 'a pair of your own'}", ""]
    lines += [f"From {page['citation']}."] if page["citation"] else []
    lines += [page["note"]] if page["note"] else []
    lines += [_ROLES[page["track"]]] if page["track"] else []
    lines += ["Development pair: settings of the methods are chosen on it."] if page["development"] else []
    lines += [
        f"Observation {page['observation_size']}, action {page['action_size']}, control step {1000 * page['control_step_s']:.4g} ms,"
        f" {page['episode_steps']} steps an episode.",
    ]
    lines += [f"Gymnasium: source {ids['source']}, target {ids['target']}."] if ids["source"] and ids["target"] else []
    lines += [page["lacks"]] if page["lacks"] else []
    lines += ["", "Effects of the target:" if page["effects"] else f"The target has no effects: it moves in {page['simulator']}."]
    for effect in page["effects"]:
        values = ", ".join(f"{key} {_short(value)}" for key, value in effect.items() if key not in ("effect", "target"))
        lines.append(f"  {effect['effect']} on {effect['target']}: {values}")
    lines += _ladder(page["name"], page["severity"])
    share = max(found["removable"], 0.0)
    lines += [
        "",
        f"Mismatch, over {found['transitions']} random transitions of the target:",
        f"  next states of source and target are {found['mismatch']:.3g} spreads of the state's change apart; {found['left']:.3g} are left under the best"
        " action transformation",
        f"  so any action transformation can remove at most {share:.0%} of the mismatch",
        f"  transition error (observations): {found['transition_error']:.3g}, floor {found['transition_floor']:.3g}",
        f"  action-transformation error of the ungrounded source: {found['action_distance']:.3g}, floor {found['action_floor']:.2g}"
        + (" (known in closed form)" if found["closed_form"] else f" (found numerically, {found['steps']:.0f} simulator steps a transition)"),
        "",
        "Robot:",
    ]
    lines += [f"  {line}".rstrip() for line in page["robot_description"].splitlines()]
    return "\n".join(lines)


def _ladder(name: str, severity: dict[str, Any] | None) -> list[str]:
    """How the pair is had at other severities, if it is."""
    if severity is None:
        return []
    asked = ", ".join(f"{name}{AT}{plain(value)}" for value in severity["ladder"])
    unit = f", {severity['unit']}" if severity["unit"] else ""
    return ["", f"Severity ({severity['meaning']}{unit}), any value after the {AT}: {asked}"]


def _short(value: Any) -> str:
    if isinstance(value, list):
        return "(" + ", ".join(map(_short, value)) + ")"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
