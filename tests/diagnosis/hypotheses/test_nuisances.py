"""What simulators do differently is forgiven, within limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..conftest import Made


def test_what_half_the_physics_step_changes_is_forgiven(made: Callable[..., Made]) -> None:
    _, fitter, _ = made()
    halved = fitter.predictor.project(fitter.predictor.halved_error)
    assert np.sqrt(np.mean(halved**2)) > 0.05
    forgiven = fitter.nuisances.forgive(halved, ())
    # Nearly all of it: it is small beside the noise, and so might be chance.
    assert np.abs(forgiven.residuals).max() < 0.05 * np.abs(halved).max()
    assert len(forgiven.free) >= 1
    # But no more than it can be.
    assert np.sqrt(np.mean(fitter.nuisances.forgive(10 * halved, ()).residuals ** 2)) > 5 * np.sqrt(np.mean(halved**2))
