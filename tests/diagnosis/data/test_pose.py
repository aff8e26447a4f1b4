"""Poses of a free base that can be none are refused in one line, naming the row."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mpge_bench.diagnosis.data.pose import check_carried, checked_pose
from mpge_bench.envs.errors import UserError

TIME = 0.01 * np.arange(60)
GRAVITY = (0.0, 0.0, -9.81)


def thrown(lands: bool = False) -> np.ndarray:
    """A body that flies along x, falls and turns about y; with `lands` it stops at z = 0.5."""
    z = 1.0 - 9.81 / 2 * TIME**2
    turn = 3.0 * TIME
    q = np.column_stack((2.0 * TIME, 0 * TIME, np.maximum(z, 0.5) if lands else z, 0 * TIME, np.sin(turn / 2), 0 * TIME, np.cos(turn / 2)))
    return q


def test_quaternions_of_few_digits_are_scaled_to_length_1() -> None:
    q = thrown()
    found = checked_pose(Path("a.csv"), TIME, np.round(q, 2))
    assert np.linalg.norm(found[:, 3:], axis=1) == pytest.approx(1, abs=1e-12)
    assert found[:, :3] == pytest.approx(q[:, :3], abs=0.006)


def test_another_sign_of_a_quaternion_is_no_jump() -> None:
    q = thrown()
    q[30:, 3:] *= -1
    checked_pose(Path("a.csv"), TIME, q)


def test_an_impact_is_no_jump() -> None:
    checked_pose(Path("a.csv"), TIME, thrown(lands=True))


def longer(q: np.ndarray) -> None:
    q[20, 3:] *= 1.1


def aside(q: np.ndarray) -> None:
    q[20:, 0] += 0.5


def outlier(q: np.ndarray) -> None:
    q[20, 2] += 0.3


def turned(q: np.ndarray) -> None:
    q[20:, 3:] = q[20:, [4, 3, 6, 5]] * [1, -1, 1, -1]


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (longer, "columns qx, qy, qz, qw, row 21: a quaternion of length 1.1, not 1"),
        (aside, r"row 21: the place jumps, at 5\d.* m/s"),
        (outlier, r"row 21: the place jumps"),
        (turned, r"row 21: the orientation jumps"),
    ],
)
def test_what_no_pose_can_be_is_one_line(spoil: Callable[[np.ndarray], None], says: str) -> None:
    q = thrown()
    spoil(q)
    with pytest.raises(UserError, match=f"a.csv: {says}") as error:
        checked_pose(Path("a.csv"), TIME, q)
    assert "\n" not in str(error.value)


def test_what_falls_freely_needs_no_ground_and_what_does_not_fall_does() -> None:
    check_carried(Path("a.csv"), TIME, thrown(), GRAVITY)
    check_carried(Path("a.csv"), TIME, np.zeros((60, 7)), (0.0, 0.0, 0.0))
    with pytest.raises(UserError, match=r"a.csv: columns x, y, z: the body does not fall freely from row 2\d on.*add ground"):
        check_carried(Path("a.csv"), TIME, thrown(lands=True), GRAVITY)
