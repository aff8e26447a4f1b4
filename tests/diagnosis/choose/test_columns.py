"""What columns of the linearised simulator make up of a change."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.diagnosis.choose.columns import remainder
from mpge_bench.envs.effects import ComOffset, Payload, TorqueGain


def test_what_columns_make_up_of_a_change() -> None:
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((3, 50))
    assert remainder(columns[0] - 2 * columns[2], 1e-6 * columns) == pytest.approx(0, abs=1e-9)
    beyond = rng.standard_normal(50)
    beyond -= columns.T @ np.linalg.lstsq(columns.T, beyond, rcond=None)[0]
    assert remainder(columns[1] + beyond, columns) == pytest.approx(np.linalg.norm(beyond))


def test_what_is_one_sided_makes_up_for_nothing_with_less_than_none() -> None:
    column, other = np.eye(4)[:2]
    assert remainder(-column, column[None], one_sided=True) == pytest.approx(1)
    assert remainder(-column, column[None]) == pytest.approx(0, abs=1e-9)
    # A heavy load less a light one farther out is no load.
    assert remainder(3 * column - other, np.stack((column, other)), one_sided=True) == pytest.approx(1)
    assert Payload.is_one_sided()
    assert not TorqueGain.is_one_sided()
    assert not ComOffset.is_one_sided()
