"""The recorded motion between its rows."""

from __future__ import annotations

import numpy as np

from mpge_bench.diagnosis.data.motion import motion_at


def test_between_rows_the_motion_is_smooth() -> None:
    time, hertz = np.arange(0, 1, 0.01), 13.0

    def motion(at: np.ndarray) -> np.ndarray:
        phase = 2 * np.pi * hertz * at
        return np.column_stack((np.sin(phase), 2 * np.pi * hertz * np.cos(phase)))

    at = np.arange(0, 0.98, 0.001)
    off = motion_at(time, motion(time), at) - motion(at)
    assert np.abs(off[:, 0]).max() < 0.002
    straight = np.interp(at, time, motion(time)[:, 0]) - motion(at)[:, 0]
    assert np.abs(straight).max() > 0.05


def test_beyond_the_ends_nothing_changes() -> None:
    found = motion_at(np.array([0.0, 1.0]), np.array([[1.0, 2.0], [3.0, 2.0]]), np.array([-1.0, 5.0]))
    np.testing.assert_allclose(found, [[1.0, 2.0], [3.0, 2.0]])
