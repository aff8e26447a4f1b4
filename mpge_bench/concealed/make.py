"""Cases as files: of each a folder that a diagnosis may read, and one that holds the answer."""

from __future__ import annotations

import itertools
import json
import zlib
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import yaml

from mpge_bench.concealed import thrown
from mpge_bench.concealed.draw import POOLS, drawn, key_of, missed, rig_of, visibility
from mpge_bench.concealed.floating import FloatingRig
from mpge_bench.concealed.laws import UNCATALOGUED
from mpge_bench.concealed.mechanism import GRAVITY, PERIOD, ROWS, SERVO_STEPS, TRIES, Array, Case, Effect, H, Rig, Values, absolute
from mpge_bench.concealed.pool import each_done
from mpge_bench.concealed.recorded import Commands, Sensors, Truth
from mpge_bench.console import ConsoleProgress
from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import json_of, reading
from mpge_bench.files import write_text
from mpge_bench.form import check

#: Says what a folder of cases is made of.
MANIFEST = "cases.json"
#: Draws of a case until one can be recorded: few cannot (a pair of servos trembled, however little was asked of it).
DRAWS = 5
#: Share of the velocities' spread by which their means over rows and the way gone miss each other at most (eight rows a turn): rows must follow the motion.
ROUGHEST = 0.05
#: Recordings of a case: those that may be read, and those that its answer is tried on; what their commands are.
KINDS = {"train_00": "sines", "train_01": "steps", "train_02": "closed", "train_03": "noise", "test_00": "sines", "test_01": "closed"}


def make(case: Case, out: Path, seed: int, *, size: float = 1.0, rows: int = ROWS, given: str = "") -> list[float]:
    """Write one case; returns how far its effect can be seen, and the largest q and dq.

    Args:
        size: share of the usual motion's.
        rows: of each recording, at most.
        given: kind of the commands of what may be read; those of `kinds_of` if none is.

    Raises:
        RuntimeError: if the simulation is unstable, or a joint goes round or trembles however little is asked of it.
    """
    key = key_of(seed, case.name)
    rig, effects, sensors = _system(case, key)
    folders = {"train": out / "given" / case.name, "test": out / "kept" / case.name}
    for folder in folders.values():
        folder.mkdir(parents=True, exist_ok=True)
    noise = dict(zip(("q", "dq") if sensors.has_dq else ("q",), sensors.noise, strict=False))
    belief = _belief(rig) | ({"noise": noise} if "told" in case.options else {})
    (folders["train"] / "robot.urdf").write_text(rig.text(rig.links))
    (folders["train"] / "rig.yaml").write_text(yaml.safe_dump(belief, sort_keys=False))

    errors, peaks = [], []
    for k, (name, kind) in enumerate(kinds_of(rig).items()):
        part = name.split("_")[0]
        eyes = sensors.best() if part == "test" else sensors
        played = given if given and part == "train" else "closed" if "closed" in case.options else kind
        read, off, most = _motion(rig, effects, eyes, played, np.random.default_rng([*key, k]), size)
        _write(folders[part] / f"{name}.csv", rig, eyes, read[:rows])
        errors.append(off)
        peaks.append(most)
    answers = [{"effect": e.kind, "target": e.target, "catalogued": e.kind not in UNCATALOGUED, "value": e.values} for e in effects]
    # Last: a case without its answer is none.
    label = {"effects": answers, "noise_q": noise["q"], "noise_dq": noise.get("dq")}
    write_text(folders["test"] / "label.yaml", yaml.safe_dump(label, sort_keys=False))
    return [visibility(np.concatenate(errors), sensors), *np.max(peaks, axis=0).tolist()]


def play(case: Case, seed: int, commands: Array, path: Path) -> float:
    """Have the concealed system play `commands`, shape (rows, joints), from rest at 0, and write to `path` what its sensors say; the largest position.

    Raises:
        RuntimeError: if the simulation is unstable.
    """
    key = key_of(seed, case.name)
    rig, effects, sensors = _system(case, key)
    held = np.concatenate((commands, np.repeat(commands[-1:], ROWS - len(commands), 0)))
    # Other noise than that of any other recording.
    noise = np.random.default_rng([*key, zlib.crc32(commands.tobytes())])
    read, clean = Truth(rig, effects).record(lambda row, q, w: held[row], np.zeros((2, len(rig.links))), sensors, noise)
    _write(path, rig, sensors, read[: len(commands)])
    return float(np.abs(clean[: len(commands), 1]).max())


def kinds_of(rig: Rig) -> dict[str, str]:
    """The names of a case's recordings, and of what kind their commands are."""
    if not isinstance(rig, FloatingRig):
        return KINDS
    names = [f"{part}_{index:02d}" for part, count in (("train", rig.shape.given), ("test", rig.shape.kept)) for index in range(count)]
    return dict(zip(names, itertools.cycle(("sines", "steps", "noise"))))


def _system(case: Case, key: list[int]) -> tuple[Rig, list[Effect], Sensors]:
    """The mechanism of the case drawn by `key`, what is hidden in it, and what reads it."""
    rng = np.random.default_rng(key)
    rig = rig_of(case, rng)
    effects = absolute(case, rig, rng)
    return rig, effects, (thrown.Cameras if isinstance(rig, FloatingRig) else Sensors)(case, effects, rig.joints)


def _write(path: Path, rig: Rig, sensors: Sensors, read: Array) -> None:
    """A recording of what was `read` of u, q and dq, shape (rows, ...), as far as there are sensors for it."""
    names = ["time", *itertools.chain(*rig.columns[: 3 if sensors.has_dq else 2])]
    table = np.column_stack([np.arange(len(read)) * PERIOD, read.reshape(len(read), -1)[:, : len(names) - 1]])
    np.savetxt(path, table, fmt="%.6g", delimiter=",", header=",".join(names), comments="")


def _belief(rig: Rig) -> Values:
    """rig.yaml of `rig`, without the noise."""
    modes: dict[str, Values] = {link.joint: {"mode": link.mode} for link in rig.links if link.joint}
    for i in np.flatnonzero(rig.servo):
        modes[rig.joints[i]] |= {"kp": float(rig.kp[i]), "kd": float(rig.kd[i]), "servo_period": SERVO_STEPS * H}
    return {"robot": "robot.urdf", "base": "fixed", "gravity": list(GRAVITY), "timestep": 0.001, "record_period": PERIOD, "joints": modes} | rig.told()


def _motion(rig: Rig, effects: list[Effect], sensors: Sensors, kind: str, rng: np.random.Generator, size: float) -> tuple[Array, Array, Array]:
    """Rows of a recording, what the rig as believed misses of them (`missed`), and the joints' largest q and dq, shape (2,); arguments as of `_recorded`."""
    if isinstance(rig, FloatingRig) and isinstance(sensors, thrown.Cameras):
        motion = thrown.played(rig, effects, sensors, kind, rng, size)
        return motion.read, thrown.missed(rig, motion), np.array([np.abs(motion.qpos[:, 7:]).max(initial=0.0), np.abs(motion.qvel[:, 6:]).max(initial=0.0)])
    read, clean = _recorded(rig, effects, sensors, kind, rng, size)
    return read, missed(rig, clean), np.abs(clean[:, 1:]).max((0, 2))


def _recorded(rig: Rig, effects: list[Effect], sensors: Sensors, kind: str, rng: np.random.Generator, size: float) -> tuple[Array, Array]:
    """Rows of u, q and dq under commands of one kind, as recorded and as they would be without noise; no joint goes round, or trembles faster than rows follow.

    Args:
        size: share of the usual motion's.
    """
    start = rng.uniform(-1, 1, (2, len(rig.links))) * (0.6 if rig.driven.any() else 1.5)
    start[1] *= not any(sensors.late)
    commands = Commands(rig, kind, rng, start)
    start, commands.signals = start * size, commands.signals * size
    for _ in range(TRIES):
        rows, clean = Truth(rig, effects).record(commands, start, sensors, rng)
        if np.abs(clean[:, 1]).max() < 2.8 and not _trembles(clean[:, 1], clean[:, 2], sensors.noise[1]):
            return rows, clean
        start, commands.signals = start * 0.8, commands.signals * 0.8
        # What is hidden may make the controller's loop unstable, however little is asked of it.
        commands.kp, commands.kd = commands.kp * 0.64, commands.kd * 0.8
    raise RuntimeError(f"a joint goes round or trembles, however little is asked of it, after {TRIES} tries")


def _trembles(q: Array, dq: Array, noise: float) -> bool:
    """Whether a joint's motion, shape (rows, joints) each, is too fast for its rows, and that shows beside the `noise` of dq, rad/s."""
    missed = np.std((dq[1:] + dq[:-1]) / 2 - np.diff(q, axis=0) / PERIOD, axis=0)
    return bool(((missed > ROUGHEST * np.std(dq, axis=0)) & (missed > noise)).any())


def make_cases(out: Path, counts: Mapping[str, int], seed: int, jobs: int, progress: ConsoleProgress) -> int:
    """Draw so many cases of `seed` of each pool (its letter, as of `POOLS`) and write to `out` those that are not there yet; how many were missing.

    Raises:
        UserError: if `out` holds cases of another seed.
    """
    manifest, asked = out / MANIFEST, {"seed": seed}
    if manifest.exists() and (found := _seed_in(manifest)) != seed:
        raise UserError(f"{out}: holds cases of seed {found}, says {MANIFEST}; give another --out, or --seed {found}")
    out.mkdir(parents=True, exist_ok=True)
    write_text(manifest, json.dumps(asked))
    wanted = [(index, pool) for pool, count in counts.items() for index in range(count)]
    missing = [(index, pool) for index, pool in wanted if not (out / "kept" / f"{pool}{index:04d}" / "label.yaml").exists()]
    progress.stage("making cases", len(missing))
    for _ in each_done(jobs, _made, [(out, seed, *one) for one in missing]):
        progress.advance(1)
    return len(missing)


def _seed_in(manifest: Path) -> int:
    what, advice = "manifest of cases", "choose another folder with --out"
    data = json_of(manifest, what, advice)
    with reading(manifest, what, advice):
        check(data, {"seed": "count"})
    return int(data["seed"])


def _made(out: Path, seed: int, index: int, pool: str) -> None:
    # Of commands that turned out too large; `record` looks for itself.
    mujoco.set_mju_user_warning(lambda text: None)
    for turn in range(DRAWS):
        case = drawn(seed, index, POOLS[pool], turn)
        try:
            make(case, out, seed)
            return
        except RuntimeError as error:
            why = error
    raise UserError(f"{case.name} of seed {seed}: none of {DRAWS} draws can be recorded ({why}); take another --seed")
