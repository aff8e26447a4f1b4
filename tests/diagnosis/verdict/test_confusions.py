"""What would tell two models apart is what their effects say of each other."""

from __future__ import annotations

from mpge_bench.diagnosis.verdict.confusions import experiment


def test_the_experiment_is_found_whichever_effect_has_it() -> None:
    delay, lag = frozenset({"delay:elbow"}), frozenset({"lag:elbow"})
    assert "a lag lowers it" in experiment(delay, lag)
    assert experiment(delay, lag) == experiment(lag, delay)


def test_what_both_have_is_left_out() -> None:
    # These two would be told apart by another experiment, and come first.
    both = {"coulomb_friction:elbow", "load_friction:elbow"}
    assert "two different loads" in experiment(frozenset({"coulomb_friction:elbow"}), frozenset({"load_friction:elbow"}))
    assert "a lag lowers it" in experiment(frozenset({"delay:elbow"} | both), frozenset({"lag:elbow"} | both))


def test_without_one_more_motion_is_asked_for() -> None:
    assert experiment(frozenset({"air_drag:elbow"}), frozenset({"sensor_scale:elbow"})).startswith("record again")
