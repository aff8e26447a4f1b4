"""Two sets of results are held against each other, row by row."""

from __future__ import annotations

import numpy as np
import pytest

from mpge_bench.envs.errors import UserError
from mpge_bench.leaderboard.compare import Compared, Row, compared
from mpge_bench.leaderboard.results import collect


def test_what_is_clearly_better_differs_beyond_chance():
    found = Compared((Row("a", np.array([0.8, 0.9, 0.85, 0.95, 0.9]), np.array([0.1, 0.2, 0.0, 0.1, 0.2])),))
    # Of 252 deals of five and five, two part them as far.
    assert found.p_value() == pytest.approx(2 / 252, abs=0.003)
    assert found.verdict().startswith("They differ beyond chance: the first is normalised return 0.76 higher on average")


def test_too_few_runs_are_said_to_be_too_few():
    found = Compared((Row("a", np.array([0.8, 0.9]), np.array([0.1, 0.2])),))
    assert found.least() == pytest.approx(2 / 6, abs=0.02)
    assert found.verdict().startswith("Too few runs to tell: however far apart they are, p is at least 0.3")


def test_several_pairs_tell_together_what_each_is_too_few_for():
    row = Row("a", np.array([0.8, 0.9, 0.7]), np.array([0.1, 0.2, 0.3]))
    assert row.p_value() == pytest.approx(0.1, abs=0.02)
    assert Compared((row, row, row)).p_value() < 0.01


def test_opposite_differences_of_two_pairs_are_said_though_they_cancel():
    low, high = np.linspace(0.1, 0.2, 6), np.linspace(0.8, 0.9, 6)
    found = Compared((Row("a", high, low), Row("b", low, high)))
    assert found.p_value() > 0.9
    assert found.verdict().startswith("No difference beyond chance on average")
    assert "By itself a differs: the first is higher (p = 0.00" in found.verdict()
    assert "By itself b differs: the first is lower (p = 0.00" in found.verdict()
    assert not Compared((Row("a", high, high), Row("b", low, low))).apart()


def test_p_is_uniform_where_nothing_differs():
    rng = np.random.default_rng(0)
    p = [Row("a", *rng.normal(size=(2, 5))).p_value() for _ in range(200)]
    assert np.mean(np.array(p) < 0.2) == pytest.approx(0.2, abs=0.08)
    assert np.mean(p) == pytest.approx(0.5, abs=0.06)


def test_rows_are_of_one_pair_and_of_what_both_have_several_of(tmp_path, write_result):
    for seed in range(3):
        for task in ("a", "b"):
            write_result(tmp_path / f"one/{task}/{seed}/result.json", 0.5, task=task, method="mine", samples=500, seed=seed)
            write_result(tmp_path / f"other/{task}/{seed}/result.json", 0.6, task=task, method="theirs", samples=1000, seed=seed)
    found = compared(collect(tmp_path / "one"), collect(tmp_path / "other"))
    assert [row.name for row in found.rows] == ["a: mine n500 smoke against theirs n1000 smoke", "b: mine n500 smoke against theirs n1000 smoke"]
    write_result(tmp_path / "one/more/result.json", 0.5, task="a", method="more", samples=500)
    with pytest.raises(UserError, match="nothing to compare: pairs of the first folder: a, b; of the second: a, b; where they meet, method differ"):
        compared(collect(tmp_path / "one"), collect(tmp_path / "other"))


def test_an_empty_folder_is_refused_in_a_line(tmp_path, write_result):
    write_result(tmp_path / "one/result.json", 0.5)
    (tmp_path / "other").mkdir()
    with pytest.raises(UserError, match=r"no result\.json below it"):
        compared(collect(tmp_path / "one"), collect(tmp_path / "other"))
