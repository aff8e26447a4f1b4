"""What nothing looks at before the answer is judged: whole recordings, or where there are few the end of each."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mpge_bench.diagnosis.data.checks import Measurements
from mpge_bench.diagnosis.data.recording import Recording


@dataclass(frozen=True)
class Parts:
    """The recordings in two.

    Attributes:
        searched: for fitting and choosing.
        unseen: held out from both.
        whole: whether the latter are whole recordings, and not the end of each.
    """

    searched: Measurements
    unseen: tuple[Recording, ...]
    whole: bool


def parted(measurements: Measurements) -> Parts:
    """The last recordings, or of a few recordings the end of each, held out."""
    settings, recordings = measurements.settings.data, measurements.recordings
    if len(recordings) >= settings.few:
        count = max(1, round(settings.unseen * len(recordings)))
        return Parts(replace(measurements, recordings=recordings[:-count]), recordings[-count:], whole=True)
    cuts = [round((1 - settings.unseen) * len(one.time)) for one in recordings]
    first = tuple(one.rows(slice(cut)) for one, cut in zip(recordings, cuts, strict=True))
    rest = tuple(one.rows(slice(cut, None)) for one, cut in zip(recordings, cuts, strict=True))
    return Parts(replace(measurements, recordings=first), rest, whole=False)
