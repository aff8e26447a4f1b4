"""A row's command is what was held until the next row."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpge_bench.diagnosis.data.rig import Rig
from mpge_bench.envs.errors import UserError
from mpge_bench.exchange.series import Series, held, joined, ordered

times = st.lists(st.integers(1, 1000), min_size=2, max_size=20, unique=True).map(lambda found: np.array(sorted(found), float))


def test_a_command_between_rows_counts_by_the_time_that_it_was_in_force() -> None:
    at, issued, values = np.array([0.0, 1.0, 2.0, 3.0]), np.array([-0.5, 0.25, 2.0, 2.5, 3.5]), np.array([8.0, 4.0, 1.0, 2.0, 9.0])
    assert held(at, issued, values).tolist() == [0.25 * 8 + 0.75 * 4, 4.0, 1.5, 2.0]


def test_of_commands_at_one_time_the_last_counts() -> None:
    assert held(np.array([0.0, 1.0]), np.array([0.0, 0.0, 0.5, 0.5]), np.array([1.0, 2.0, 3.0, 4.0])).tolist() == [3.0, 4.0]


@settings(deadline=None, max_examples=50)
@given(times, times, st.randoms(use_true_random=False))
def test_the_mean_is_that_of_the_signal_looked_at_finely(at: np.ndarray, issued: np.ndarray, random: object) -> None:
    issued[0] = min(issued[0], at[0])
    values = np.random.default_rng(len(at)).normal(size=len(issued))
    fine = np.arange(at[0], at[-1]) + 0.5  # all changes are at whole numbers
    signal = values[np.searchsorted(issued, fine, side="right") - 1]
    means = [signal[(fine > begin) & (fine < end)].mean() for begin, end in itertools.pairwise(at)]
    assert held(at, issued, values)[:-1] == pytest.approx(means, abs=1e-9)


@settings(deadline=None, max_examples=25)
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=2, max_size=30))
def test_commands_at_the_rows_stand_to_the_last_bit(values: list[float]) -> None:
    at = np.arange(len(values)) * 0.01 + 0.1
    table, notes = joined(Series("", at, {"q_a": np.array(values)}), Series("", at, {"u_a": np.array(values)}))
    assert table["u_a"].tolist() == table["q_a"].tolist() == values
    assert table["time"][0] == 0
    assert notes == ()


def test_rows_before_the_first_command_are_left_out_and_said_so() -> None:
    states, commands = Series("s", np.arange(5.0), {"q_a": np.arange(5.0)}), Series("c", np.array([1.5, 2.5]), {"u_a": np.array([1.0, 2.0])})
    table, notes = joined(states, commands)
    assert table.to_dict("list") == {"time": [0.0, 1.0, 2.0], "u_a": [1.5, 2.0, 2.0], "q_a": [2.0, 3.0, 4.0]}
    assert notes == ("left out: 2 of 5 rows, before the first command", "the last command is held for the last 1.50 s")


@pytest.mark.parametrize(
    ("time", "value", "said"),
    [
        ([0.0, 2.0, 1.0], 0.0, "s: sample 3: time goes from 2 to 1 s; it must rise"),
        ([0.0, 1.0, 1.0], 0.0, "s: sample 3: time goes from 1 to 1 s; it must rise"),
        ([0.0, 1.0, 2.0], np.nan, "s: sample 1: q_a is nan"),
        ([0.0, np.nan, 2.0], 0.0, "s: sample 2: time is nan"),
        ([], 0.0, "s: holds none of the rig's joints"),
    ],
)
def test_what_is_no_series_is_refused(time: list[float], value: float, said: str) -> None:
    with pytest.raises(UserError, match=said):
        joined(Series("s", np.array(time), {"q_a": np.full(len(time), value)}), Series("c", np.zeros(1), {"u_a": np.zeros(1)}))


def test_commands_after_the_last_state_are_of_another_time() -> None:
    with pytest.raises(UserError, match="c: begins 7 s after the first state, and the last state comes 1 s after it"):
        joined(Series("s", np.array([0.0, 1.0]), {"q_a": np.zeros(2)}), Series("c", np.array([7.0]), {"u_a": np.zeros(1)}))


def test_values_without_names_need_an_order(rig: Rig) -> None:
    assert ordered(("elbow", "shoulder"), rig, "x", 2) == ("elbow", "shoulder")
    for asked, said in (((), "x: has 2 values without names; give --joints"), (("elbow", "wrist"), "--joints names wrist"), (("elbow",), "names 1 joints")):
        with pytest.raises(UserError, match=said):
            ordered(asked, rig, "x", 2)
