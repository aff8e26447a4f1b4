"""Five ways to correct a simulator from recordings, on the same unseen recordings.

    python benchmarks/compare_corrections.py FOLDER [--out runs/compare] [--only 'd0*']

FOLDER is as for `mpge_bench concealed score`. For each case all methods see the training recordings of given/; the figure is the root mean square error of q,
0.5 s ahead from recorded states, on the test recordings of kept/, as a multiple of the error that the true effect gives in the same simulator:

- none: the rig as it is;
- all at once: the parameters that system identification tools fit, all together, on every joint and link (gain, bias, viscous and dry friction, rotor
  inertia, mass, centre of mass), by the same multi-step prediction as ours;
- neural: a network (2 x 64 tanh) from all joints' q, dq and command to the torque the simulator lacks, trained on the residual forces, the last training
  recording kept for early stopping, added to the motors' torques;
- oracle: the true effects' names told, only their parameters fitted;
- ours: `diagnose`.

Where the true effect is not in the catalogue there is no oracle and errors are in rad. A case that is there already is not run again.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
import yaml
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy import stats

from mpge_bench.diagnosis.data.checks import measurements, read_recordings
from mpge_bench.diagnosis.data.recording import Recording, find_recordings, read_recording
from mpge_bench.diagnosis.data.rig import Rig, read_rig
from mpge_bench.diagnosis.fit.problem import Problem, problem
from mpge_bench.diagnosis.fit.simulator import polished
from mpge_bench.diagnosis.hypotheses.candidates import candidates
from mpge_bench.diagnosis.pipeline import diagnose
from mpge_bench.diagnosis.predict.bullet import simulate
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.envs.effects import Effect, Hidden, effect_from_dict
from mpge_bench.envs.errors import UserError

HORIZON = 0.5
ALL = ("torque_gain", "torque_bias", "viscous_friction", "coulomb_friction", "armature", "mass_scale", "com_offset")
METHODS = ("none", "all at once", "neural", "oracle", "ours")
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class NeuralTorque(Effect):
    """A network's idea of the torques that the simulator lacks, at all joints (the target is only a place to hang it); it has no name in the catalogue."""

    layers: tuple[tuple[Array, Array], ...] = ()
    columns: tuple[int, ...] = ()

    on = "joint"
    parameters = {}
    place = 1

    def actuate(self, command: Any, joint: int, q: Any, dq: Any, hidden: Hidden) -> None:
        values = np.array([*q, *dq, *(command[column] for column in self.columns)])
        for weight, bias in self.layers[:-1]:
            values = np.tanh(weight @ values + bias)
        weight, bias = self.layers[-1]
        for index, torque in enumerate((weight @ values + bias).tolist()):
            command[index] += torque


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/compare"))
    parser.add_argument("--only", default="*")
    parser.add_argument("--diagnoses", type=Path, help="folder of answers of `concealed score`: its corrected rigs are taken as ours, not made again")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    arguments.out.mkdir(parents=True, exist_ok=True)
    cases = [path for path in sorted((arguments.folder / "given").iterdir()) if fnmatch(path.name, arguments.only)]
    console = Console(width=200)
    rows = []
    for case in track(cases, "comparing", console=console):
        path = arguments.out / f"{case.name}.json"
        if not path.exists():
            ready = arguments.diagnoses / case.name / "corrected.yaml" if arguments.diagnoses else Path()
            row = compare(case, arguments.folder / "kept" / case.name, ready, arguments.jobs)
            path.write_text(json.dumps(row))
        rows.append(json.loads(path.read_text()))
    table = Table("case", "truth", *METHODS)
    for row in rows:
        unit = row["true effect"] or 1.0
        cells = ["-" if row[method] is None else f"{row[method] / unit:.3g}" for method in METHODS]
        table.add_row(row["case"], row["truth"], *cells)
    ratios = {method: [row[method] / row["true effect"] for row in rows if row["true effect"] and row[method] is not None] for method in METHODS}
    table.add_row("geometric mean", "", *(f"{stats.gmean(values):.3g}" if values else "-" for values in ratios.values()))
    console.print(table)
    return 0


def compare(given: Path, kept: Path, ready: Path, jobs: int) -> dict[str, Any]:
    """Errors of all methods on one case, rad or m; `ready` is ours if that file exists."""
    rig = read_rig(given / "rig.yaml")
    recordings = read_recordings(find_recordings([str(given / "train_*.csv")]), rig)
    listed = yaml.safe_load(ready.read_text()).get("effects", []) if ready.is_file() else None
    found = diagnose(rig, recordings, jobs=jobs).effects if listed is None else [effect_from_dict(one) for one in listed]
    measured = measurements(rig, recordings)
    posed = problem(measured, reference(rig, measured.recordings), HORIZON)
    options = candidates(rig, posed.scales)
    together = polished(posed, [one.starts[0] for one in options if one.name in ALL])[0].effects
    network = neural(posed)
    # The label is opened only now.
    truth = yaml.safe_load((kept / "label.yaml").read_text())["effects"]
    catalogued = all(one["catalogued"] for one in truth)
    true = [effect_from_dict({"effect": one["effect"], "target": one["target"], **one["value"]}) for one in truth] if catalogued else []
    told: tuple[Effect, ...] = ()
    if true:
        starts = {(one.name, one.target): one.starts for one in options}
        # Every start is tried, as the search does; the best on the training recordings counts.
        tries = [
            polished(posed, [starts[effect.name, effect.target][min(index, len(starts[effect.name, effect.target]) - 1)] for effect in true])[0]
            for index in range(3)
        ]
        told = min(tries, key=lambda one: one.train).effects
    tests = [read_recording(path, rig) for path in sorted(kept.glob("test_*.csv"))]
    effects: dict[str, Sequence[Effect]] = {"none": (), "all at once": together, "neural": network, "oracle": told, "ours": found}
    row: dict[str, Any] = {"case": given.name, "truth": " + ".join(f"{one['effect']}:{one['target']}" for one in truth) or "nothing"}
    row |= {method: _error(rig, tests, effects[method]) for method in METHODS}
    row["true effect"] = _error(rig, tests, rig.joined((), *true)) if catalogued else None
    if not catalogued:
        row["oracle"] = None
    return row


def neural(posed: Problem) -> list[Effect]:
    """A network trained on the residual forces, as an effect."""
    rig, linear = posed.rig, posed.linear
    motion = linear.motion
    n = len(rig.joints)
    columns = tuple(index for index, joint in enumerate(rig.joints) if rig.modes[joint] != "passive")
    last = len(motion.rows) - 1
    valid = np.arange(motion.time.shape[1]) < motion.rows[:, None] - 1
    inputs = np.concatenate((motion.state, linear.delivered[..., list(columns)]), -1)
    outputs = linear.residual_torques()
    train, check = valid.copy(), valid.copy()
    train[last], check[:last] = False, False
    x, y = (torch.tensor(values[train], dtype=torch.float32) for values in (inputs, outputs))
    vx, vy = (torch.tensor(values[check], dtype=torch.float32) for values in (inputs, outputs))
    mean, std = x.mean(0), x.std(0) + 1e-6
    scale = y.std(0) + 1e-9
    torch.manual_seed(0)
    network = torch.nn.Sequential(torch.nn.Linear(x.shape[1], 64), torch.nn.Tanh(), torch.nn.Linear(64, 64), torch.nn.Tanh(), torch.nn.Linear(64, n))
    optimizer = torch.optim.Adam(network.parameters(), 3e-3, weight_decay=1e-5)
    best, kept = np.inf, None
    for epoch in range(300):
        for batch in torch.randperm(len(x)).split(256):
            loss = ((network((x[batch] - mean) / std) - y[batch] / scale) ** 2).mean()
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
        if epoch % 5 == 0:
            with torch.no_grad():
                error = float(((network((vx - mean) / std) - vy / scale) ** 2).mean())
            if error < best:
                best, kept = error, [parameter.detach().double().numpy().copy() for parameter in network.parameters()]
    assert kept is not None
    kept[1] = kept[1] - kept[0] @ (mean / std).double().numpy()
    kept[0] = kept[0] / std.double().numpy()
    kept[4], kept[5] = kept[4] * scale.double().numpy()[:, None], kept[5] * scale.double().numpy()
    layers = tuple((kept[index], kept[index + 1]) for index in (0, 2, 4))
    return [NeuralTorque(rig.joints[0], layers, columns)]


def _error(rig: Rig, recordings: Sequence[Recording], effects: Sequence[Effect]) -> float | None:
    try:
        return float(np.sqrt(np.mean([np.mean((simulate(rig, one, HORIZON, effects).q - one.q) ** 2) for one in recordings])))
    except UserError:
        return None


if __name__ == "__main__":
    sys.exit(main())
