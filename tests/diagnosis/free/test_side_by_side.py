"""Windows linearised in several processes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.workers import Workers
from mpge_bench.diagnosis.free.side_by_side import linearised, relinearised
from mpge_bench.diagnosis.free.windows import windows_of
from mpge_bench.diagnosis.settings import DEFAULT

from .conftest import Tossed
from .test_windows import HIDDEN, measured


@pytest.mark.slow
def test_it_does_not_matter_in_how_many(tossed: Tossed) -> None:
    windows = windows_of(*measured(tossed(HIDDEN, tosses=3)), DEFAULT.free, 7)
    alone = windows.linearised().relinearised(HIDDEN, anew=True)
    with Workers(2) as workers:
        together = relinearised(workers, linearised(workers, windows), HIDDEN, anew=True)
    for field in dataclasses.fields(windows):
        one, other = (getattr(found, field.name) for found in (alone, together))
        if isinstance(one, np.ndarray):
            assert np.array_equal(one, other), field.name
    assert [[past.tolist() for past in pair] for pair in alone.past] == [[past.tolist() for past in pair] for pair in together.past]
