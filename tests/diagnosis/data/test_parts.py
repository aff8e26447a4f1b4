"""What chooses a model is never its proof."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.data.checks import Measurements, measurements
from mpge_bench.diagnosis.data.parts import parted
from mpge_bench.diagnosis.data.rig import Rig

from ..conftest import record


def measured(rig: Rig, count: int) -> Measurements:
    return measurements(rig, [record(rig, seconds=2.0, seed=seed) for seed in range(count)])


@pytest.mark.parametrize(("count", "held"), [(3, 1), (4, 1), (8, 2)])
def test_the_last_recordings_are_kept_from_the_search(rig: Rig, count: int, held: int) -> None:
    given = measured(rig, count)
    parts = parted(given)
    assert parts.whole
    assert parts.unseen == given.recordings[-held:]
    assert parts.searched.recordings == given.recordings[:-held]


@pytest.mark.parametrize("count", [1, 2])
def test_few_recordings_are_cut_in_time(rig: Rig, count: int) -> None:
    given = measured(rig, count)
    parts = parted(given)
    assert not parts.whole
    for whole, first, rest in zip(given.recordings, parts.searched.recordings, parts.unseen, strict=True):
        assert np.concatenate((first.time, rest.time)).tolist() == whole.time.tolist()
        assert len(rest.time) == 50
