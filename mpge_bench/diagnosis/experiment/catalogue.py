"""What a motion would tell of the effects of the catalogue, each beside all the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.checks import measurements
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.experiment.motions import Limits, motion
from mpge_bench.diagnosis.fit.problem import problem
from mpge_bench.diagnosis.hypotheses.candidates import candidates, scales
from mpge_bench.diagnosis.predict.smooth import reference
from mpge_bench.diagnosis.settings import DEFAULT
from mpge_bench.envs.effects import Effect

Array = npt.NDArray[np.float64]
#: Of sensors whose noise the rig does not state, rad (m) and rad/s (m/s): usual encoders.
NOISE = {"q": 5e-4, "dq": 5e-3}
#: Added to the information of each effect, in units of the noise: what shows less than a thirtieth of it is not there.
_RIDGE = 1e-3
#: Share of that, below which what is known of an effect is known from the motion.
_TOLD = 0.1


@dataclass(frozen=True)
class Seen:
    """One motion.

    Attributes:
        commands: shape (rows, joints).
        gram: information about each effect, in units of `sizes`, nuisances taken off; shape (effects, effects).
        sizes: of their parameters, shape (effects,).
        effects: one start each.
    """

    commands: Array
    gram: Array
    sizes: Array
    effects: tuple[Effect, ...]


def information(gram: Array) -> float:
    """Logarithm of the determinant."""
    return float(np.linalg.slogdet(gram + _RIDGE * np.eye(len(gram)))[1])


def errors(gram: Array) -> Array:
    """Of each effect beside all the others; infinite where those could make up for it."""
    variance = np.diagonal(np.linalg.inv(gram + _RIDGE * np.eye(len(gram))))
    return np.where(variance * _RIDGE < _TOLD, np.sqrt(variance), np.inf)


def tried(rig: Rig, limits: Limits, rows: int, seed: int, index: int) -> Seen | None:
    """Motion number `index` of `seed`, as large as the limits allow; None if none stays within them."""
    found = motion(rig, limits, rows, seed, index)
    if found is None:
        return None
    rng, noise = np.random.default_rng([seed, index, rows]), {**NOISE, **rig.noise}
    q, dq = (one + noise[name] * rng.normal(size=one.shape) for name, one in zip(("q", "dq"), found[0].seen, strict=True))
    return _seen(rig, Recording(rig.path, np.asarray(rig.record_period * np.arange(rows)), found[0].commands, q, dq))


def _seen(rig: Rig, recording: Recording) -> Seen:
    """How much `recording`, of the rig as it believes itself to be, would tell of each effect that can be absent and has a single first parameter."""
    measured = measurements(rig, [recording], DEFAULT)
    linear = reference(rig, measured.recordings, DEFAULT)
    fitter = problem(measured, linear, DEFAULT.predict.horizon).fitter()
    columns, sizes, effects = [], [], []
    for one in candidates(rig, scales(linear)):
        # What acts on all alike is made up for by what acts on each.
        if not one.measure or one.is_of_all:
            continue
        changed = fitter.clear(fitter.columns(one))
        best = int(np.argmax((changed**2).sum((1, 2))))
        columns.append(changed[best].ravel())
        sizes.append(one.amount(rig, one.starts[best]))
        effects.append(one.starts[best])
    matrix = np.array(columns)
    return Seen(recording.u, matrix @ matrix.T, np.array(sizes), tuple(effects))


def in_one_unit(found: list[Seen]) -> tuple[list[Array], Array]:
    """Information of each of `found` in one unit, whatever sizes each motion's search would begin at, and that unit."""
    unit = np.asarray(np.median([one.sizes for one in found], axis=0))
    return [one.gram / np.outer(one.sizes, one.sizes) * np.outer(unit, unit) for one in found], unit
