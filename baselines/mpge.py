"""Multi-policy grounding and ensemble policy learning, MPGE (Lee et al. 2022)."""

from __future__ import annotations

from mpge_bench.baselines.mpg import MPG


class MPGE(MPG):
    """MPG with N groundings learnt from the same samples; the agent meets one of them in each episode, drawn uniformly."""

    summary = "multi-policy grounding and ensemble policy learning"
    preset = "mpge"
