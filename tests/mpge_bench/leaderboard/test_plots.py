"""What the pictures of the leaderboard show."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from mpge_bench.leaderboard import estimates
from mpge_bench.leaderboard.estimates import interquartile_means
from mpge_bench.leaderboard.plots import draw
from mpge_bench.leaderboard.results import collect


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch):
    monkeypatch.setattr(estimates, "_RESAMPLES", 50)


@pytest.fixture
def store(write_result):
    def write(folder, task, method, samples, seed, normalized, curve=None, **more):
        path = folder / task / method / f"n{samples}" / f"seed{seed}"
        names = {"task": task, "method": method, "samples": samples, "preset": "standard", "variant": "standard", "seed": seed}
        write_result(path / "result.json", normalized, **names, **more)
        if curve:
            pd.DataFrame(curve.items(), columns=["steps", "action_transformation_error"]).to_parquet(path / "curve.parquet")

    return write


@pytest.fixture
def figures(monkeypatch):
    """Figures by the name they are saved under."""
    saved, save = {}, Figure.savefig

    def remember(figure, path, **options):
        saved[path.name.strip(".").removesuffix(".partial")] = figure
        save(figure, path, **options)

    monkeypatch.setattr(Figure, "savefig", remember)
    return saved


def lines(axes, style):
    """(x, y) of each line whose marker or line style is `style`."""
    return [line.get_xydata() for line in axes.lines if style in (line.get_marker(), line.get_linestyle()) and len(line.get_xydata())]


def panels(figure):
    """Panels that something is drawn in, by their titles."""
    return {axes.get_title(loc="left"): axes for axes in figure.axes if axes.axison}


def legend(figure):
    return [text.get_text() for text in figure.legends[0].texts]


def test_returns_are_the_tables_interquartile_means_and_intervals(tmp_path, figures, store):
    values = {"good": [0.7, 1.5, 0.9, 0.8, 0.6], "bad": [0.1, -0.2, 0.3, 0.0, 0.2]}
    for method, found in values.items():
        for seed, value in enumerate(found):
            store(tmp_path / "r", "t", method, 500, seed, value)
    assert [path.name for path in draw(collect(tmp_path / "r"), tmp_path / "new" / "plots")] == ["returns-headline.png"]
    (axes,) = panels(figures["returns-headline.png"]).values()
    assert [label.get_text() for label in axes.get_yticklabels()] == ["bad", "good"]
    bad, good = interquartile_means([values["bad"], values["good"]])
    assert {round(point[0][1]): point[0][0] for point in lines(axes, "o")} == pytest.approx({0: bad.value, 1: good.value})
    bars = sorted(tuple(line[:, 0]) for line in lines(axes, "-") if len(line) == 2 and line[0, 1] == line[1, 1])
    assert bars == [pytest.approx(bad.bounds), pytest.approx(good.bounds)]


def test_few_runs_are_dots_without_an_interval(tmp_path, figures, store):
    for seed in range(3):
        store(tmp_path / "r", "t", "m", 500, seed, 0.1 * seed)
    draw(collect(tmp_path / "r"), tmp_path / "plots")
    (axes,) = panels(figures["returns-headline.png"]).values()
    assert not [line for line in lines(axes, "-") if line[0, 1] == line[1, 1]]
    assert axes.collections[0].get_offsets()[:, 0].tolist() == pytest.approx([0.0, 0.1, 0.2])


def test_returns_over_budgets_are_lines_and_methods_without_samples_go_across(tmp_path, figures, store):
    for samples, value in ((500, 0.2), (1000, 0.6)):
        store(tmp_path / "r", "t", "m", samples, 0, value)
    store(tmp_path / "r", "t", "direct", 0, 0, 0.1)
    draw(collect(tmp_path / "r"), tmp_path / "plots")
    (axes,) = panels(figures["samples-headline.png"]).values()
    np.testing.assert_allclose(lines(axes, "o"), [[[0, 0.2], [1, 0.6]]])
    np.testing.assert_allclose(lines(axes, "--"), [[[0, 0.1], [1, 0.1]]])
    assert [label.get_text() for label in axes.get_xticklabels()] == ["500", "1k"]
    assert legend(figures["samples-headline.png"]) == ["m", "direct"]


def test_curves_are_means_over_seeds_and_a_grounding_made_at_once_is_a_mark(tmp_path, figures, store):
    for seed in range(2):
        store(tmp_path / "r", "t", "slow", 500, seed, 0.5, curve={100: 1.0 + seed, 200: 0.2 + 0.2 * seed}, floor=0.02)
        store(tmp_path / "r", "t", "fast", 500, seed, 0.9, curve={50: 1e-12}, floor=0.02)
        store(tmp_path / "r", "t", "none", 500, seed, 0.0, floor=0.02)
    draw(collect(tmp_path / "r"), tmp_path / "plots")
    (axes,) = panels(figures["curves-headline.png"]).values()
    (slow,) = (line for line in lines(axes, "-") if len(line) == 2 and line[0, 0] == 100)
    np.testing.assert_allclose(slow, [[100, 1.5], [200, 0.3]])
    ((mark,),) = lines(axes, "v")  # below what is drawn: marked at the edge, its figure written beside it
    assert mark == pytest.approx([50, 1e-3])
    assert {"1e-12", "ungrounded source", "floor more than 20% of the error"} <= {text.get_text() for text in axes.texts}
    assert any(patch.get_y() + patch.get_height() == pytest.approx(0.1) for patch in axes.patches)
    assert legend(figures["curves-headline.png"]) == ["fast", "slow"]


def test_grounded_and_target_returns_are_points_beside_the_references(tmp_path, figures, store):
    for seed in range(2):
        store(tmp_path / "r", "t", "m", 500, seed, 0.5, grounded=7.0 + seed)
    store(tmp_path / "r", "t", "perfect", 0, 0, 0.9)
    draw(collect(tmp_path / "r"), tmp_path / "plots")
    (axes,) = panels(figures["grounded-headline.png"]).values()
    np.testing.assert_allclose(lines(axes, "o"), [[[7, 5], [8, 5]]])
    assert {text.get_text(): text.xy[1] for text in axes.texts} == {"J*": 10.0, "perfect": 9.0, "direct": 0.0}


def test_profiles_and_improvements_are_over_the_pairs_that_all_have(tmp_path, figures, store):
    for task in ("one", "two"):
        for seed in range(5):
            store(tmp_path / "r", task, "good", 500, seed, 0.5 + 0.1 * seed)
            store(tmp_path / "r", task, "direct", 0, seed, 0.0)
    draw(collect(tmp_path / "r"), tmp_path / "plots")
    (profile,) = panels(figures["profile-headline.png"]).values()
    (good,) = lines(profile, "-")
    assert np.interp([0.45, 0.75], good[:, 0], good[:, 1]) == pytest.approx([1.0, 0.4])
    (improvement,) = panels(figures["improvement-headline.png"]).values()
    assert [tuple(line[0]) for line in lines(improvement, "s")] == [(1.0, pytest.approx(0.88))]
    assert [label.get_text() for label in improvement.get_yticklabels()] == ["direct", "good"]


def test_methods_without_a_normalised_return_or_with_an_oracle_are_drawn(tmp_path, figures, store):
    store(tmp_path / "r", "one", "direct", 0, 0, None)
    oracle = {"chosen": "x", "returns": {"mean": 8.0}, "normalized_return": 0.8}
    store(tmp_path / "r", "two", "swept", 0, 0, 0.5, curve={100: 0.5, 200: 0.1}, oracle=oracle)
    draw(collect(tmp_path / "r"), tmp_path / "plots")
    found = panels(figures["returns-headline.png"])
    assert list(found) == ["one", "two"]
    assert {label.get_text() for label in found["one"].get_yticklabels()} == {"swept", "swept (oracle)", "direct"}
    assert [[text.get_text() for text in found[task].texts] for task in ("one", "two")] == [["not normalised"], []]
    assert legend(figures["curves-headline.png"]) == ["swept"]


def test_panels_that_are_not_needed_are_left_empty(tmp_path, figures, store):
    for task in "abcde":
        store(tmp_path / "r", task, "m", 500, 0, 0.5)
    draw(collect(tmp_path / "r"), tmp_path / "plots")
    figure = figures["returns-headline.png"]
    assert (len(figure.axes), list(panels(figure))) == (6, list("abcde"))


def test_a_method_looks_the_same_in_every_section(tmp_path, figures, store):
    for task, methods in {"a": "xyz", "b": "z"}.items():
        for method in methods:
            for samples in (500, 1000):
                store(tmp_path / "r", task, method, samples, 0, 0.5, development=task == "a")
    draw(collect(tmp_path / "r"), tmp_path / "plots")
    colours = [
        {line.get_label(): line.get_color() for axes in figures[f"samples-{name}.png"].axes for line in axes.lines} for name in ("development", "headline")
    ]
    assert colours[1]["z"] == colours[0]["z"] != colours[0]["x"]
