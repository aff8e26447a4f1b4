"""How strongly windows speak for one model against another, be they few: what a test by their signs cannot tell."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
#: Share of the noise below which a window counts as one that misses so much: the noise is but estimated, and where motion is violent much is forgiven.
_LEAST = 0.5


def log_odds(before: Array, after: Array, pieces: float) -> float:
    """Logarithm of the likelihood ratio for what misses `after` against what misses `before`, mean squares in units of the noise's, shape (windows,).

    As if each window's errors were of a size of their own, which nobody knows, and it were as good as so many independent readings, its `pieces`. So a model
    gains by what it explains whole, in however few windows, and next to nothing by taking a little of what is wrong in each.
    """
    floor = float(np.clip(np.median(after), _LEAST, 1.0))
    return float(np.sum(np.log(np.maximum(before, floor) / np.maximum(after, floor))) * pieces / 2)
