"""GARAT (Desai et al. 2020), which MPGE's paper calls SPG: grounding with a single rollout policy."""

from __future__ import annotations

from mpge_bench.baselines.mpg import MPG


class GARAT(MPG):
    """MPG with K = 1 and N = 1; rollout policy number seed mod 5 collects all target samples."""

    summary = "grounding as imitation from observation, one rollout policy (SPG)"
    citation = "Desai et al. 2020"
    preset = "garat"
