"""Recordings cut where a joint is at an end stop: what happens there is in no catalogue, and the linearised simulator knows no stops."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation

from mpge_bench.diagnosis.data.parts import Parts
from mpge_bench.diagnosis.data.recording import Recording
from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.diagnosis.settings import DataSettings
from mpge_bench.envs.errors import UserError


def between_stops(parts: Parts, horizon: float) -> Parts:
    """The recordings in stretches between end stops, each long enough for two windows of `horizon` s; those without any stop as they are.

    What is searched then has none: models that reach one where the machine did not are wrong either way, and PyBullet alone could tell what they make of it.

    Raises:
        UserError: if nothing is left of what is searched on, or of what is held out.
    """
    rig, settings = parts.searched.rig, parts.searched.settings.data
    found = [_stretches(some, rig, horizon, settings) for some in (parts.searched.recordings, parts.unseen)]
    said = _said((*parts.searched.recordings, *parts.unseen), rig, settings)
    for stretches, given in zip(found, (parts.searched.recordings, parts.unseen), strict=True):
        if not stretches:
            names = ", ".join(dict.fromkeys(str(one.path) for one in given))
            raise UserError(f"{names}: nothing of {2 * horizon:g} s is between end stops: {' '.join(said)}")
    searched, unseen = found
    without = replace(parts.searched, rig=rig.without_stops(), recordings=searched, left_out=(*parts.searched.left_out, *said))
    return replace(parts, searched=without, unseen=unseen)


def _stretches(recordings: Iterable[Recording], rig: Rig, horizon: float, settings: DataSettings) -> tuple[Recording, ...]:
    return tuple(stretch for one in recordings for stretch in _between(one, rig, horizon, settings))


def _between(recording: Recording, rig: Rig, horizon: float, settings: DataSettings) -> list[Recording]:
    at = at_stops(recording, rig, settings).any(1)
    if not at.any():
        return [recording]
    around = round(settings.bounce / float(np.median(np.diff(recording.time))))
    free = ~(binary_dilation(at, iterations=around) if around else at)
    # First rows of the stretches, and the rows after their last ones.
    edges = np.flatnonzero(np.diff(np.concatenate(([False], free, [False])))).reshape(-1, 2)
    found = [recording.rows(slice(first, end)) for first, end in edges.tolist()]
    return [one for one in found if len(one.time) >= settings.fewest_rows and one.duration >= 2 * horizon]


def at_stops(recording: Recording, rig: Rig, settings: DataSettings) -> npt.NDArray[np.bool_]:
    """In which rows joints are at an end stop, or beyond, where the rig's file has none of the machine's; shape (rows, joints)."""
    lowest, highest = rig.model.stops(rig.joints).T
    near = settings.near_stop * (highest - lowest)
    with np.errstate(invalid="ignore"):
        found = (recording.q < lowest + near) | (recording.q > highest - near)
    return np.asarray(found & np.isfinite(near))


def _said(recordings: Sequence[Recording], rig: Rig, settings: DataSettings) -> tuple[str, ...]:
    """A sentence on each joint that is at a stop in some rows."""
    share = np.concatenate([at_stops(one, rig, settings) for one in recordings]).mean(0)
    found = []
    for column, (joint, (low, high)) in enumerate(zip(rig.joints, rig.model.stops(rig.joints).tolist(), strict=True)):
        if share[column] > 0:
            q = np.concatenate([one.q[:, column] for one in recordings])
            unit = rig.units(joint).position
            found.append(
                f"{joint}: at an end stop ({low:.4g} or {high:.4g} {unit} in {rig.model.path.name}; recorded are {q.min():.4g} to {q.max():.4g}) in"
                f" {100 * share[column]:.2g}% of the rows, which are left out; if the machine has no stop there, correct the file's limits."
            )
    return tuple(found)
