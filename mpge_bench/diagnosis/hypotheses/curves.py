"""Nameless torques: curves over one signal of a joint, for what no effect of the catalogue is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from mpge_bench.diagnosis.predict.windows import WindowPredictor
from mpge_bench.envs.effects import UnknownTorque

Array = npt.NDArray[np.float64]


def curves(predictor: WindowPredictor) -> Iterator[tuple[UnknownTorque, Array]]:
    """A curve, all its torques 0, over each joint's q, dq and command, and its columns, shape (knots, windows, rows * channels)."""
    rig, settings = predictor.linear.rig, predictor.linear.motion.settings.hypotheses
    for index, joint in enumerate(rig.joints):
        for signal in ("q", "dq", "command") if joint in rig.driven else ("q", "dq"):
            values = predictor.range_of(index, signal)
            low, high = np.quantile(values, (settings.outermost, 1 - settings.outermost)) if len(values) else (0.0, 0.0)
            if high - low > 1e-6:
                knots = np.linspace(low, high, settings.knots)
                yield UnknownTorque(joint, signal, tuple(knots), (0.0,) * settings.knots), predictor.curve(index, signal, knots)


def columns_of(curve: UnknownTorque, predictor: WindowPredictor) -> Array:
    """The columns of an existing curve, as `curves` gives them."""
    return predictor.curve(predictor.linear.rig.joints.index(curve.target), curve.signal, np.array(curve.at))
