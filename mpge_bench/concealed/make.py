"""One case: a folder that a diagnosis may read, and one that holds the answer."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import yaml

from mpge_bench.concealed.laws import UNCATALOGUED
from mpge_bench.concealed.mechanism import GRAVITY, PERIOD, ROWS, SERVO_STEPS, Case, H, Rig, Values, absolute, urdf
from mpge_bench.concealed.recorded import Commands, Sensors, Truth

KINDS = {"train_00": "sines", "train_01": "steps", "train_02": "closed", "train_03": "noise", "test_00": "sines", "test_01": "closed"}


def make(case: Case, out: Path, seed: int) -> list[float]:
    """Write one case; returns how far its effect can be seen, and the largest q and dq."""
    key = [seed, zlib.crc32(case.name.encode())]
    rng = np.random.default_rng(key)
    rig = Rig(case, rng)
    effects = absolute(case, rig, rng)
    sensors = Sensors(case, effects, rig.joints)
    folders = {"train": out / "given" / case.name, "test": out / "kept" / case.name}
    for folder in folders.values():
        folder.mkdir(parents=True, exist_ok=True)
    modes: dict[str, Values] = {link.joint: {"mode": link.mode} for link in rig.links}
    for i in np.flatnonzero(rig.servo):
        modes[rig.joints[i]] |= {"kp": float(rig.kp[i]), "kd": float(rig.kd[i]), "servo_period": SERVO_STEPS * H}
    belief = {"robot": "robot.urdf", "base": "fixed", "gravity": list(GRAVITY), "timestep": 0.001, "record_period": PERIOD, "joints": modes}
    noise = dict(zip(("q", "dq") if sensors.has_dq else ("q",), sensors.noise, strict=False))
    answers = [{"effect": e.kind, "target": e.target, "catalogued": e.kind not in UNCATALOGUED, "value": e.values} for e in effects]
    label = {"effects": answers, "noise_q": noise["q"], "noise_dq": noise.get("dq")}
    (folders["train"] / "robot.urdf").write_text(urdf(rig.links, rig.efforts))
    (folders["train"] / "rig.yaml").write_text(yaml.safe_dump(belief | ({"noise": noise} if "told" in case.options else {}), sort_keys=False))
    (folders["test"] / "label.yaml").write_text(yaml.safe_dump(label, sort_keys=False))

    errors, peaks = [], []
    for k, (name, kind) in enumerate(KINDS.items()):
        rng = np.random.default_rng([*key, k])
        start = rng.uniform(-1, 1, (2, len(rig.links))) * (0.6 if rig.driven.any() else 1.5)
        start[1] *= not any(sensors.late)
        commands = Commands(rig, "closed" if "closed" in case.options else kind, rng, start)
        for _ in range(6):  # no joint goes round
            rows, clean = Truth(rig, effects).record(commands, start, sensors, rng)
            if np.abs(clean[:, 1]).max() < 2.8:
                break
            start, commands.signals = start * 0.8, commands.signals * 0.8
        channels = ["u", *noise]
        header = ",".join(["time", *(f"{channel}_{joint}" for channel in channels for joint in rig.joints)])
        table = np.column_stack([np.arange(ROWS) * PERIOD, rows[:, : len(channels)].reshape(ROWS, -1)])
        np.savetxt(folders[name.split("_")[0]] / f"{name}.csv", table, fmt="%.6g", delimiter=",", header=header, comments="")
        expected = rig.nominal(lambda row, q, w, clean=clean: clean[row, 0], clean[:, 1:], restart=50)
        errors.append((expected - clean[:, 1:])[50::50])
        peaks.append(np.abs(clean[:, 1:]).max((0, 2)))
    worst = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)).max(1)[: len(noise)]
    return [float(max(worst / list(noise.values()))), *np.max(peaks, axis=0).tolist()]
