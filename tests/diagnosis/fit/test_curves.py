"""Nameless curves that are solved for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mpge_bench.diagnosis.fit.curves import solved
from mpge_bench.diagnosis.settings import DEFAULT

KNOTS, ROWS = 9, 40
#: Windows of three recordings, of which the last chooses.
RECORDING = np.repeat([0, 1, 2], 8)


@pytest.mark.parametrize("recordings", [(0, 1, 2), (0, 0, 2)], ids=["two fitted to", "one fitted to"])
@pytest.mark.parametrize(("signs", "is_law"), [((1.0, 1.0, 1.0), True), ((1.0, -1.0, 1.0), False)], ids=["in all", "turned round in the second"])
def test_a_curve_has_to_help_in_recordings_that_it_was_not_solved_from(recordings: tuple[int, ...], signs: tuple[float, ...], is_law: bool) -> None:
    """What one recording needs and another refuses is no law, though the one that chooses should like it."""
    generator = np.random.default_rng(0)
    columns = generator.normal(size=(KNOTS, len(RECORDING), ROWS))
    torques = np.sin(np.linspace(0, np.pi, KNOTS))
    residuals = np.array(signs)[RECORDING, None] * np.tensordot(torques, columns, 1) + 0.1 * generator.normal(size=(len(RECORDING), ROWS))
    windows = SimpleNamespace(recording=np.array(recordings)[RECORDING])
    problem: Any = SimpleNamespace(settings=DEFAULT, windows=windows, validation=RECORDING == 2)
    share, found = solved(problem, SimpleNamespace(fit=SimpleNamespace(residuals=residuals)), columns)  # type: ignore[arg-type]
    assert (share > DEFAULT.choose.coarse_material) is is_law
    if is_law:
        assert np.allclose(found, torques, atol=0.05)
