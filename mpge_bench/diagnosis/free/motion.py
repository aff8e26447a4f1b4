"""States along a recording, on their manifold: smoothed where no velocities were recorded, across no impact, and how far they may be off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.settings import FreeSettings
from mpge_bench.envs.layout import Layout

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Of the sensors, one standard deviation: of coordinates along the tangent, m and rad, and of velocities, m/s and rad/s, shapes (nv,).

    Velocities that were not recorded, or are not what the poses say, have an infinite one.
    """

    q: Array
    dq: Array


@dataclass(frozen=True)
class Motion:
    """States along a recording.

    Attributes:
        state: q and dq, shape (rows, nq + nv).
        spread: how far they may be off along the tangent, one standard deviation, shape (rows, 2 nv).
        misfit: of the motion around each row from parabolas, in standard deviations of the noise, shape (rows,): large near impacts.
    """

    state: Array
    spread: Array
    misfit: Array


def unrolled(q: Array, layout: Layout) -> Array:
    """Coordinates, shape (rows, nq), as a path in the tangent, shape (rows, nv): its derivative is dq. Of a free base turns are summed up."""
    state = layout.state(q, np.zeros((len(q), layout.nv)))
    steps = layout.dx(layout.minus(state[1:], state[:-1]))
    return np.concatenate((np.zeros((1, layout.nv)), np.cumsum(steps, 0)))


def noise_of(recordings: Sequence[Recording], layout: Layout, stated: dict[str, float], settings: FreeSettings) -> Noise:
    """What is stated, else what the fifth differences of rows say: noise makes them large, motion between impacts does not."""
    paths = [unrolled(one.q, layout) for one in recordings]
    q = np.full(layout.nv, stated["q"]) if "q" in stated else _rough(paths, settings.least_noise)
    recorded = [one.dq for one in recordings]
    known = np.all([np.isfinite(one).all(0) for one in recorded], 0)
    dq = np.full(layout.nv, stated["dq"]) if "dq" in stated else _rough(recorded, settings.least_noise)
    base = layout.nv - layout.joints
    trusted = np.zeros(layout.nv, bool)
    # A base's velocities are one measurement, and so are the joints'.
    for part in (slice(0, base), slice(base, None)):
        trusted[part] = known[part].all() and ("dq" in stated or not _are_late(recordings, paths, q, part, settings))
    return Noise(q, np.where(trusted, dq, np.inf))


def _rough(paths: Sequence[Array], least: float) -> Array:
    """Noise of columns, shape (columns,), from the median of their fifth differences."""
    fifth = np.abs(np.concatenate([np.diff(one, 5, axis=0) for one in paths]))
    return np.asarray(np.maximum(1.4826 * np.median(np.nan_to_num(fifth), 0) / math.sqrt(math.comb(10, 5)), least))


def _are_late(recordings: Sequence[Recording], paths: Sequence[Array], noise: Array, part: slice, settings: FreeSettings) -> bool:
    """Whether recorded velocities lag behind the poses, as difference quotients do by half a row, as far as the noise lets one say so."""
    late, weight = [], []
    for one, path in zip(recordings, paths, strict=True):
        value, misfit, shares = _parabolas(one.time, path, noise, settings)
        calm = misfit < settings.calm
        row = np.median(np.diff(one.time)) * 2 * value[calm, 2][:, part]
        late.append(((value[calm, 1] - one.dq[calm])[:, part] / np.where(row, row, 1.0)).ravel())
        weight.append((row / (shares[calm, 1:] * noise[part])).ravel() ** 2)
    every, weights = np.concatenate(late), np.concatenate(weight)
    order, total = np.argsort(every), float(weights.sum())
    if not total:
        return False
    # The median, since a quotient across an impact is off by any amount.
    middle = abs(float(every[order][np.searchsorted(np.cumsum(weights[order]), total / 2)]))
    return middle > settings.late and middle > 3 / math.sqrt(total)


def motion_of(one: Recording, layout: Layout, noise: Noise, settings: FreeSettings) -> Motion:
    """The states along a recording, and what is known of them."""
    value, misfit, shares = _parabolas(one.time, unrolled(one.q, layout), noise.q, settings)
    measured = np.isfinite(noise.dq)
    # Where the motion is not parabolic, parabolas are off by more than the noise makes them.
    doubt = settings.doubt * np.maximum(misfit, 1.0)[:, None] * shares[:, 1:] * noise.q
    spread = np.concatenate((np.broadcast_to(noise.q, doubt.shape), np.where(measured, noise.dq, doubt)), 1)
    return Motion(layout.state(one.q, np.where(measured, one.dq, value[:, 1])), spread, misfit)


def _parabolas(time: Array, path: Array, noise: Array, settings: FreeSettings) -> tuple[Array, Array, Array]:
    """Parabolas through the rows before, around or after each row, whichever fit best: an impact is on one side only.

    Returns:
        Value, slope and half the curvature at the row, shape (rows, 3, nv); their misfit, in standard deviations of the noise, shape (rows,); what share of
        the noise value and slope have, shape (rows, 2).
    """
    rows = len(time)
    half = max(2, round(settings.smoothing / float(np.median(np.diff(time)))))
    length = min(2 * half + 1, rows)
    best: tuple[Array, Array, Array] | None = None
    for before in (2 * half, half, 0):
        first = np.clip(np.arange(rows) - before, 0, rows - length)
        index = first[:, None] + np.arange(length)
        t = time[index] - time[:, None]
        design = np.stack((np.ones_like(t), t, t**2), -1)
        solver = np.linalg.pinv(design)
        value = solver @ path[index]
        left = (path[index] - design @ value) / noise
        misfit = np.sqrt((left**2).sum((1, 2)) / (max(length - 3, 1) * path.shape[1]))
        found = (value, misfit, np.sqrt((solver**2).sum(-1))[:, :2])
        if best is None:
            best = found
        else:
            better = misfit < best[1]
            best = tuple(np.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old) for new, old in zip(found, best, strict=True))  # type: ignore[assignment]
    assert best is not None
    return best
