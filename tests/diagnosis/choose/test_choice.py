"""Whether there is a mismatch at all."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.choice import chance_of
from mpge_bench.diagnosis.settings import ChooseSettings


@pytest.mark.parametrize("windows", [10, 30, 100])
def test_noise_up_to_what_is_allowed_for_is_no_mismatch_and_what_is_well_beyond_is(windows: int) -> None:
    settings = ChooseSettings()
    assert chance_of(1.0, windows, settings) > 0.999
    assert chance_of((0.9 * settings.beyond_noise) ** 2, windows, settings) > settings.significance
    assert chance_of((2 * settings.beyond_noise) ** 2, windows, settings) < settings.significance


def test_the_chance_is_that_of_noise_of_the_largest_size() -> None:
    settings = ChooseSettings()
    rng = np.random.default_rng(0)
    drawn = np.mean((settings.beyond_noise * rng.standard_normal((20000, 12))) ** 2, axis=1)
    assert chance_of(13.0, 12, settings) == pytest.approx(np.mean(drawn >= 13.0), abs=0.01)
