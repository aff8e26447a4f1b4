"""A neural residual: a small ensemble of networks, with history, that adds to the simulator the torques that it lacks from row to row."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from mpge_bench.concealed.compare import HORIZON, Learnt
from mpge_bench.diagnosis.data.checks import measurements, trusted
from mpge_bench.diagnosis.data.parts import parted
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.predict.bullet import stretches
from mpge_bench.diagnosis.predict.fast.rollout import mass_matrices
from mpge_bench.diagnosis.predict.fast.trees import flat_tree
from mpge_bench.diagnosis.predict.simulated import SimulatedWindows
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.envs.errors import UserError

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

#: Rows of states and commands that it sees: at the usual 100 Hz .1 s, longer than delays and lags are in most machines.
HISTORY = 10
#: Networks whose outputs are averaged, and units of each of their two layers: more gain nothing on some thousand rows.
MEMBERS, WIDTH = 4, 64
#: Of Adam with decoupled decay (AdamW): with .0001 two cases of three were learnt worse.
RATE, DECAY, BATCH = 1e-3, 1.0, 256
#: Passes over the recordings, at most; after so many each rollouts are looked at; looks without a better one after which it ends.
EPOCHS, EVERY, PATIENCE = 600, 10, 12
#: Share of the error that a better one is better by: less is chance.
BETTER = 0.002


class Residual(nn.Module):
    """Torques that the simulator lacks, shape (rows, joints), from histories, shape (rows, inputs); none before it is trained, none larger than it has seen.

    Args:
        inputs: histories by which they are normalised.
        outputs: torques that are to be learnt, whose spread is the unit.
    """

    def __init__(self, inputs: torch.Tensor, outputs: torch.Tensor) -> None:
        super().__init__()
        self.mean, self.spread, self.unit = inputs.mean(0), inputs.std(0) + 1e-6, outputs.std(0) + 1e-9
        self.most = outputs.abs().amax(0)
        self.members = nn.ModuleList(_network(inputs.shape[1], outputs.shape[1]) for _ in range(MEMBERS))

    def each(self, inputs: torch.Tensor) -> torch.Tensor:
        """What every member says, in units of the spread, shape (members, rows, joints)."""
        seen = (inputs - self.mean) / self.spread
        return torch.stack([one(seen) for one in self.members])

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        return torch.clamp(self.unit * self.each(inputs).mean(0), -self.most, self.most)


def _network(inputs: int, outputs: int) -> nn.Sequential:
    last = nn.Linear(WIDTH, outputs)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(nn.Linear(inputs, WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh(), last)


class RowByRow:
    """`rig` along a recording, a row at a time, so that something can be added to each.

    Args:
        rows: first rows, shape (n,), in each of which a prediction starts anew.
        length: rows that each prediction has at most.
    """

    def __init__(self, rig: Rig, recording: Recording, rows: Rows, length: int) -> None:
        (one,), _ = trusted([recording], rig)
        self.recording, self.rows, self.length, self._layout = one, rows, length, rig.layout
        (self.smooth,) = reference(rig, [one]).motion.references
        self.starts = self._layout.state(one.q, np.where(np.isfinite(one.dq), one.dq, self._layout.dq(self.smooth)))
        self.u, self.period = np.nan_to_num(one.u), float(np.median(np.diff(one.time)))
        self._tree = flat_tree(rig.changed(), rig.joints, rig.rotors(), rig.gravity)
        # Beyond the recording's end its last row is predicted again, and nobody looks.
        at = [np.minimum(rows + offset, len(one.time) - 2) for offset in range(length - 1)]
        self._steps = [SimulatedWindows(rig, [one], np.zeros(len(rows), np.int64), np.stack((row, row + 1), 1)) for row in at]

    def step(self, offset: int, states: Array) -> Array:
        """Where the simulator alone comes from `states`, shape (n, 2 joints), at rows so far after the first ones, to the next row.

        Raises:
            UserError: if it becomes unstable.
        """
        found = self._steps[offset].predict((), states, [self.smooth])
        if found is None:
            raise UserError(f"{self.recording.path}: the simulation becomes unstable; choose a smaller timestep in the rig")
        return np.asarray(found[:, 1])

    def inertia(self, states: Array) -> Array:
        """Of the joints in `states`, shape (n, joints, joints)."""
        return mass_matrices(self._tree, self._layout.q(states))

    def history(self, states: Array, offset: int) -> torch.Tensor:
        """What the networks see: `states` of the last rows, shape (n, HISTORY, 2 joints), and their commands; before the first row it stood still there."""
        rows = np.clip(self.rows[:, None] + offset + np.arange(1 - HISTORY, 1), 0, len(self.u) - 1)
        return torch.as_tensor(np.concatenate((states, self.u[rows]), -1).reshape(len(states), -1), dtype=torch.float32)

    def before(self) -> Array:
        """Recorded states up to each first row, shape (n, HISTORY, 2 joints), the last as predictions start from it."""
        found = self.smooth[np.maximum(self.rows[:, None] + np.arange(1 - HISTORY, 1), 0)]
        found[:, -1] = self.starts[self.rows]
        return np.asarray(found)

    def rolled(self, residual: Residual) -> Array:
        """Predictions with `residual`, shape (n, length, 2 joints)."""
        past, path = self.before(), [self.starts[self.rows]]
        for offset in range(self.length - 1):
            with torch.no_grad():
                torques = residual(self.history(past, offset)).numpy().astype(float)
            # Constant from row to row.
            pushed = np.linalg.solve(self.inertia(path[-1]), torques[..., None])[..., 0]
            path.append(self.step(offset, path[-1]) + self._layout.state(pushed * self.period**2 / 2, pushed * self.period))
            past = np.concatenate((past[:, 1:], path[-1][:, None]), 1)
        return np.stack(path, 1)


def trained(rig: Rig, recordings: Sequence[Recording]) -> Learnt:
    """`rig` with a residual beside its simulator (Golemo et al. 2018), of torques, which sees the last states and commands (Hwangbo et al. 2019).

    Four networks (two layers of 64 tanh units), of which the mean counts, see ten rows of q, dq and commands. They learn the torques that, with the joints'
    inertia, make up for what the simulator misses of the velocities a row on from smoothed states (AdamW, batches of 256, 600 passes at most). Kept is what
    predicts best .5 s ahead in recordings that are held out from that, a quarter of them. It acts from row to row, constant in between.

    Raises:
        UserError: if the rig has effects on sensors, or its simulation is unstable.
    """
    if any(effect.on == "sensor" for effect in rig.nominal):
        raise UserError(f"{rig.path}: a residual is learnt of true states only; leave effects on sensors out of the rig")
    # Cases are worked on side by side.
    torch.set_num_threads(1)
    parts = parted(measurements(rig, recordings))
    inputs, outputs = (torch.cat(some) for some in zip(*(_lesson(rig, one) for one in parts.searched.recordings), strict=True))
    held_out = [_stretched(rig, one) for one in parts.unseen]
    with torch.random.fork_rng():
        torch.manual_seed(0)
        residual, errors = _kept(Residual(inputs, outputs), inputs, outputs, held_out)
    said = {"rows": len(inputs), "epochs": EVERY * (len(errors) - 1), "held_out": [errors[0], min(errors)]}
    return Learnt(lambda recording: _predicted(rig, recording, residual), said)


def _lesson(rig: Rig, recording: Recording) -> tuple[torch.Tensor, torch.Tensor]:
    """Histories along a recording, and the torques that the simulator lacks after them."""
    every = RowByRow(rig, recording, np.arange(len(recording.time) - 1), 2)
    every.starts = every.smooth
    missed = every.smooth[1:] - every.step(0, every.smooth[:-1])
    torques = every.inertia(every.smooth[:-1]) @ rig.layout.dq(missed)[..., None] / every.period
    return every.history(every.before(), 0), torch.as_tensor(torques[..., 0], dtype=torch.float32)


def _stretched(rig: Rig, recording: Recording) -> RowByRow:
    """Of the stretches by which errors are told."""
    parts = list(stretches(recording, HORIZON))
    return RowByRow(rig, recording, np.array([first for first, _ in parts]), max(end - first for first, end in parts))


def _predicted(rig: Rig, recording: Recording, residual: Residual) -> Array:
    """`Learnt.predict`."""
    return _joined(_stretched(rig, recording), residual)


def _joined(along: RowByRow, residual: Residual) -> Array:
    """Predicted positions at every row, shape (rows, joints)."""
    found, recording = along.rolled(residual), along.recording
    q = np.empty_like(recording.q)
    for path, (first, end) in zip(found, stretches(recording, HORIZON), strict=True):
        q[first:end] = path[: end - first, : q.shape[1]]
    return q


def _kept(residual: Residual, inputs: torch.Tensor, outputs: torch.Tensor, held_out: Sequence[RowByRow]) -> tuple[Residual, list[float]]:
    """`residual` trained, as it was when it predicted `held_out` best, and its errors there since the beginning, when it added nothing."""
    optimizer = torch.optim.AdamW(residual.parameters(), RATE, weight_decay=DECAY)
    wanted, best, since = outputs / residual.unit, copy.deepcopy(residual), 0
    errors = [_error(residual, held_out)]
    for epoch in range(1, EPOCHS + 1):
        for batch in torch.randperm(len(inputs)).split(BATCH):  # type: ignore[no-untyped-call]
            loss = ((residual.each(inputs[batch]) - wanted[batch]) ** 2).mean()
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
        if epoch % EVERY:
            continue
        error = _error(residual, held_out)
        since = 0 if error < (1 - BETTER) * min(errors) else since + 1
        if error < min(errors):
            best = copy.deepcopy(residual)
        errors.append(error)
        if since >= PATIENCE:
            break
    return best, errors


def _error(residual: Residual, held_out: Sequence[RowByRow]) -> float:
    """Root mean square of positions; infinite where the simulation becomes unstable."""
    try:
        found = [_joined(one, residual) - one.recording.q for one in held_out]
    except UserError:
        return math.inf
    return float(np.sqrt(np.mean([np.mean(one**2) for one in found])))
