"""The residual map: where in the state space, and in which coordinates, the target did what no action of the source can do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from mpge_bench.envs.robots import Robot


def draw_residuals(residuals: pd.DataFrame, robot: Robot, path: Path) -> None:
    """Draw the table that `Inversion` makes: what is left in each coordinate, and over the two coordinates that it depends on most.

    Args:
        residuals: one row a target transition.
        robot: names the coordinates.
        path: of the PNG file.
    """
    names = robot.observation_names
    states = residuals[[f"o{index}" for index in range(len(names))]].to_numpy()
    left = residuals[[f"left{index}" for index in range(len(names))]].to_numpy()
    figure = Figure(figsize=(11, max(3.6, 0.26 * len(names) + 1.4)), layout="constrained")
    bars, map_ = figure.subplots(1, 2, width_ratios=[1, 1.25])
    bars.barh(names, np.sqrt((left**2).mean(0)), color="#0072b2")
    bars.invert_yaxis()
    bars.set_xlabel("left with the best action, spreads of the change in a step")
    bars.set_title("In which coordinates", loc="left")
    # Rank correlation with the residual's size, of the coordinate itself or of its distance from its middle.
    ranks = [max(_rank_correlation(one, residuals["after"]) for one in (column, np.abs(column - np.median(column)))) for column in states.T]
    across, up = np.argsort(ranks)[::-1][:2]
    most = max(float(residuals["after"].quantile(0.98)), 1e-12)
    order = np.argsort(residuals["after"].to_numpy())
    drawn = map_.scatter(states[order, across], states[order, up], c=residuals["after"].to_numpy()[order], s=12, cmap="viridis", vmin=0, vmax=most)
    map_.set_xlabel(names[across])
    map_.set_ylabel(names[up])
    map_.set_title("Where: each point is a target transition", loc="left")
    figure.colorbar(drawn, ax=map_, label="distance left, spreads")
    figure.savefig(path, dpi=110)


def _rank_correlation(one: npt.ArrayLike, other: npt.ArrayLike) -> float:
    """Its size; 0 where one of them does not vary."""
    ranks = pd.DataFrame({"one": np.asarray(one), "other": np.asarray(other)}).rank()
    return 0.0 if (ranks.nunique() < 2).any() else abs(float(ranks["one"].corr(ranks["other"])))
