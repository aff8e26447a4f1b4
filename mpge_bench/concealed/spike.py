"""Known alterations of measured recordings, or of the rig that believes them: real noise, real everything, and one mismatch whose size is known.

What a recording says was commanded, or read, is altered so that the machine that was recorded looks as if it had one effect more. The alterations are exact:
a motor that is said to have been asked for u - b has a bias b, since it did deliver u; links that the rig believes lighter are heavier in truth.
"""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import yaml

from mpge_bench.diagnosis.data.recording import read_recording, read_table
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.errors import UserError
from mpge_bench.files import write_text

Array = npt.NDArray[np.float64]
#: What an effect makes of the columns of one joint: altered in place.
Change = Callable[["Columns", float], None]


@dataclass
class Columns:
    """Of one joint in one recording.

    Attributes:
        u: command, N m or N.
        q, dq: position, and velocity as recorded or, where it was not, by differences.
        rows: by how many rows the joint's command is to come sooner (more than 0) or its readings later (less).
    """

    u: Array
    q: Array
    dq: Array
    rows: int = 0


@dataclass(frozen=True)
class Kind:
    """One kind of alteration.

    Attributes:
        on: motor (with torque commands), joint or link.
        parameter: of the effect of that name, which the size is beyond `neutral`.
        change: of recordings; None of what stands in the rig's URDF file.
        in_rows: whether its size is a time and a whole number of rows.
    """

    on: str
    parameter: str
    neutral: float
    change: Change | None
    in_rows: bool = False


def _gain(of: Columns, size: float) -> None:
    of.u = of.u / (1 + size)


def _bias(of: Columns, size: float) -> None:
    of.u = of.u - size


def _dead_zone(of: Columns, size: float) -> None:
    of.u = of.u + size * np.sign(of.u)


def _spring(of: Columns, size: float) -> None:
    of.u = of.u + size * of.q


def _viscous(of: Columns, size: float) -> None:
    of.u = of.u + size * of.dq


def _offset(of: Columns, size: float) -> None:
    of.q = of.q + size


def _scale(of: Columns, size: float) -> None:
    of.q, of.dq = of.q * (1 + size), of.dq * (1 + size)


def _sooner(of: Columns, rows: float) -> None:
    of.rows = round(rows)


def _later(of: Columns, rows: float) -> None:
    of.rows = -round(rows)


#: By the name of the effect that they look like.
KINDS: dict[str, Kind] = {
    "torque_gain": Kind("motor", "gain", 1.0, _gain),
    "torque_bias": Kind("motor", "torque", 0.0, _bias),
    "dead_zone": Kind("motor", "torque", 0.0, _dead_zone),
    "delay": Kind("motor", "seconds", 0.0, _sooner, in_rows=True),
    "joint_spring": Kind("motor", "stiffness", 0.0, _spring),
    "viscous_friction": Kind("motor", "damping", 0.0, _viscous),
    "sensor_bias": Kind("joint", "offset", 0.0, _offset),
    "sensor_scale": Kind("joint", "gain", 1.0, _scale),
    "sensor_delay": Kind("joint", "seconds", 0.0, _later, in_rows=True),
    "mass_scale": Kind("link", "factor", 1.0, None),
    "inertia_scale": Kind("link", "factor", 1.0, None),
}
#: Noise added to the readings of a sham, in standard deviations of the sensors': it looks like a spike to whoever handles it, and alters nothing.
SHAM_NOISE = 0.1


@dataclass(frozen=True)
class Spike:
    """One alteration of one machine's recordings.

    Attributes:
        effect: one of `KINDS`, or "sham".
        times: its size, in detectable sizes.
        size: what is injected, beyond what changes nothing, in the parameter's unit.
    """

    effect: str
    target: str
    times: float
    size: float

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.effect}-{self.target}-{self.times:g}"


def possible(rig: Rig) -> dict[str, list[str]]:
    """By kind, what it could act on in `rig`.

    Raises:
        UserError: of a rig that is no mechanism on a fixed base with a URDF file of its own.
    """
    if rig.robot or not rig.is_tree:
        raise UserError(f"{rig.path}: only recordings of mechanisms on a fixed base, without ground, can be spiked")
    motors = [joint for joint in rig.joints if rig.modes[joint] == "torque"]
    links = [link for link in rig.model.moving_links() if rig.model.inertial(link)[0] > 0]
    places = {"motor": motors, "joint": list(rig.joints), "link": links}
    return {name: places[kind.on] for name, kind in KINDS.items() if places[kind.on]}


def spikes(rig: Rig, detectable: dict[tuple[str, str], float], times: Sequence[float], shams: int, seed: int) -> list[Spike]:
    """One target of each kind whose detectable size is known, drawn by `seed`, spiked by so many `times` that size; and shams.

    Args:
        detectable: size by (effect, target), beyond what changes nothing.
    """
    rng = np.random.default_rng(seed)
    found = []
    for name, targets in possible(rig).items():
        known = [target for target in targets if 0 < detectable.get((name, target), math.inf) < math.inf]
        if known:
            target = str(rng.choice(known))
            found += [_sized(rig, name, target, detectable[name, target], one) for one in times]
    # Two sizes of less than a row are one.
    return [*dict.fromkeys(found), *(Spike("sham", rig.joints[0], float(index), 0.0) for index in range(shams))]


def _sized(rig: Rig, name: str, target: str, least: float, times: float) -> Spike:
    size = times * least
    if KINDS[name].in_rows:
        size = max(1, round(size / rig.record_period)) * rig.record_period
    return Spike(name, target, size / least, size)


def write(rig: Rig, recordings: Sequence[Path], spike: Spike, out: Path, seed: int) -> list[Path]:
    """rig.yaml, its URDF file and the recordings (Parquet) with `spike`, in `out`; where the recordings are.

    Raises:
        UserError: if a recording cannot be read.
    """
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "robot.urdf", _urdf(rig, spike))
    write_text(out / "rig.yaml", yaml.safe_dump({**rig.data, "robot": "robot.urdf"}, sort_keys=False))
    rng, written = np.random.default_rng([seed, round(10 * spike.times)]), []
    for index, path in enumerate(recordings):
        read_recording(path, rig)  # it may have changed since it was diagnosed
        table = read_table(path)
        table = _sham(table, rig, rng) if spike.effect == "sham" else altered(table, rig, spike)
        written.append(out / f"recording_{index:02d}.parquet")
        table.to_parquet(written[-1])
    return written


def _sham(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    readings = {f"q_{joint}": table[f"q_{joint}"].to_numpy(float) for joint in rig.joints}
    return table.assign(**{name: q + SHAM_NOISE * _noise(q) * rng.normal(size=len(q)) for name, q in readings.items()})


def _noise(q: Array) -> float:
    """Standard deviation of the noise of readings, from their third differences, to which motion adds next to nothing."""
    return float(np.std(np.diff(q, 3)) / math.sqrt(20))


def altered(table: pd.DataFrame, rig: Rig, spike: Spike) -> pd.DataFrame:
    """A recording as if the machine had the spike's effect."""
    kind, joint = KINDS[spike.effect], spike.target
    if kind.change is None:
        return table
    time, q = table["time"].to_numpy(float), table[f"q_{joint}"].to_numpy(float)
    recorded = f"dq_{joint}" in table
    speed = table[f"dq_{joint}"].to_numpy(float) if recorded else np.gradient(q, time)
    command = table[f"u_{joint}"].to_numpy(float) if f"u_{joint}" in table else np.zeros(len(table))
    columns = Columns(command, q, speed)
    kind.change(columns, spike.size / rig.record_period if kind.in_rows else spike.size)
    new = {f"q_{joint}": columns.q} | ({f"u_{joint}": columns.u} if f"u_{joint}" in table else {}) | ({f"dq_{joint}": columns.dq} if recorded else {})
    found, rows = table.assign(**new), abs(columns.rows)
    if not rows:
        return found
    moved = [f"u_{joint}"] if columns.rows > 0 else [f"q_{joint}", *([f"dq_{joint}"] if recorded else [])]
    # What was commanded later is written down sooner; what was read sooner, later.
    ahead, behind = found.iloc[rows:].reset_index(drop=True), found.iloc[:-rows].reset_index(drop=True)
    kept, other = (behind, ahead) if columns.rows > 0 else (ahead, behind)
    return kept.assign(**{name: other[name] for name in moved})


def _urdf(rig: Rig, spike: Spike) -> str:
    """The rig's URDF file, its link lighter where the truth is to be heavier."""
    path = rig.model.path
    root = ET.parse(path).getroot()
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        if "://" not in name and not os.path.isabs(name):
            mesh.set("filename", str((path.parent / name).resolve()))
    if spike.effect in KINDS and KINDS[spike.effect].on == "link":
        inertial = root.find(f"link[@name='{spike.target}']/inertial")
        assert inertial is not None, "a link that moves has mass"
        for tag, keys in (("mass", ("value",)), ("inertia", ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))):
            element = inertial.find(tag)
            if element is not None and (tag == "inertia" or spike.effect == "mass_scale"):
                for key in keys:
                    element.set(key, repr(float(element.get(key, "0")) / (1 + spike.size)))
    return ET.tostring(root, encoding="unicode")
