"""The residual map."""

from __future__ import annotations

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from mpge_bench.envs import get_task
from mpge_bench.harness.residuals import draw_residuals

ROBOT = get_task("biased_pendulum").robot


def _table(rows: int, scale: float = 1.0) -> pd.DataFrame:
    rng = np.random.default_rng(0)
    states, left = rng.normal(size=(rows, 4)), scale * rng.normal(size=(rows, 4))
    columns = {f"o{index}": states[:, index] for index in range(4)} | {f"left{index}": left[:, index] for index in range(4)}
    return pd.DataFrame(columns | {"after": np.sqrt((left**2).mean(1))})


# Nothing is left where the mismatch is an action transformation.
@pytest.mark.parametrize(("rows", "scale"), [(60, 1.0), (60, 0.0), (2, 1.0)])
def test_a_picture_is_drawn(tmp_path, rows, scale):
    draw_residuals(_table(rows, scale), ROBOT, tmp_path / "map.png")
    picture = matplotlib.image.imread(tmp_path / "map.png")
    assert picture.shape[1] > 1000
    assert picture.std() > 0.01


def test_the_map_lies_over_the_coordinates_that_the_residual_depends_on(tmp_path, monkeypatch):
    table = _table(200)
    table["after"] = table["o1"].abs() + 0.2 * table["o3"]
    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: drawn.append(self))
    draw_residuals(table, ROBOT, tmp_path / "map.png")
    bars, over, _ = drawn[0].axes
    assert [label.get_text() for label in bars.get_yticklabels()] == ROBOT.observation_names
    assert (over.get_xlabel(), over.get_ylabel()) == ("hinge", "speed of hinge")
