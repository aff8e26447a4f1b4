"""What the pictures of the leaderboard show."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from mpge_bench.figures import draw
from mpge_bench.leaderboard import collect, interquartile_mean, interval


@pytest.fixture
def store(write_result):
    def write(folder, task, method, samples, seed, normalized, curve=None, **more):
        path = folder / task / method / f"n{samples}" / f"seed{seed}"
        write_result(path / "result.json", normalized, task=task, method=method, samples=samples, variant="standard", seed=seed, **more)
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


def test_returns_are_the_tables_interquartile_means_and_intervals(tmp_path, figures, store):
    values = {"good": [0.7, 1.5, 0.9], "bad": [0.1, -0.2, 0.3]}
    for method, found in values.items():
        for seed, value in enumerate(found):
            store(tmp_path / "r", "t", method, 500, seed, value)
    assert [path.name for path in draw(collect(tmp_path / "r"), tmp_path / "new" / "plots")] == ["returns.png"]
    (axes,) = figures["returns.png"].axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["bad", "good"]
    drawn = {round(point[0][1]): point[0][0] for point in lines(axes, "o")}
    assert drawn == pytest.approx({0: interquartile_mean(values["bad"]), 1: interquartile_mean(values["good"])})
    bars = sorted(tuple(line[:, 0]) for line in lines(axes, "-") if len(line) == 2 and line[0, 1] == line[1, 1])
    assert bars == [pytest.approx(interval(values["bad"])), pytest.approx(interval(values["good"]))]


def test_curves_are_means_over_seeds_and_a_grounding_made_at_once_is_a_mark(tmp_path, figures, store):
    for seed in range(2):
        store(tmp_path / "r", "t", "slow", 500, seed, 0.5, curve={100: 1.0 + seed, 200: 0.2 + 0.2 * seed})
        store(tmp_path / "r", "t", "fast", 500, seed, 0.9, curve={50: 1e-12})
        store(tmp_path / "r", "t", "none", 500, seed, 0.0)
    draw(collect(tmp_path / "r"), tmp_path / "plots")
    (axes,) = figures["curves.png"].axes
    np.testing.assert_allclose(next(line for line in lines(axes, "-") if len(line) == 2 and line[0, 0] == 100), [[100, 1.5], [200, 0.3]])
    ((mark,),) = lines(axes, "v")  # below what is drawn: marked at the edge, its figure written beside it
    assert mark == pytest.approx([50, 1e-3])
    assert {"1e-12", "ungrounded source"} <= {text.get_text() for text in axes.texts}
    assert sorted(text.get_text() for text in figures["curves.png"].legends[0].texts) == ["fast", "slow"]


def test_methods_without_a_normalised_return_or_with_an_oracle_are_drawn(tmp_path, figures, store):
    store(tmp_path / "r", "one", "direct", 0, 0, None)
    oracle = {"chosen": "x", "returns": {"mean": 8.0}, "normalized_return": 0.8}
    store(tmp_path / "r", "two", "swept", 0, 0, 0.5, curve={100: 0.5, 200: 0.1}, oracle=oracle)
    draw(collect(tmp_path / "r"), tmp_path / "plots")
    assert [axes.get_title(loc="left") for axes in figures["returns.png"].axes] == ["one", "two"]
    assert {label.get_text() for label in figures["returns.png"].axes[0].get_yticklabels()} == {"swept", "swept (oracle)", "direct"}
    assert [text.get_text() for text in figures["curves.png"].legends[0].texts] == ["swept"]
