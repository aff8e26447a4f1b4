"""The papers' figures that are shown beside ours."""

from __future__ import annotations

import pytest

from mpge_bench.baselines.registry import ADDRESSES
from mpge_bench.envs import get_task
from mpge_bench.leaderboard import papers

PAIRS = ("biased_pendulum", "broken_hopper", "broken_cheetah", "heavy_cheetah")


@pytest.mark.parametrize("pair", PAIRS)
def test_each_of_mpges_pairs_has_five_methods_at_six_budgets(pair):
    found = list(papers.returns(pair))
    assert [samples for samples, _ in found] == [budget for budget in (500, 1000, 5000, 10_000, 50_000, 100_000) for _ in range(5)]
    assert {said.method for _, said in found} <= set(ADDRESSES)
    assert get_task(pair).citation.startswith("Lee et al. 2022")


def test_normalised_figures_lie_between_the_papers_own_references():
    found = {(samples, said.name): said for samples, said in papers.returns("heavy_cheetah")}
    said = found[1000, "MPGE-ER"]
    assert (said.mean, said.std) == (6636.4, 711.7)
    assert said.normalized == pytest.approx((6636.4 - 3396.2) / (5226.9 - 3396.2))  # above 1: the paper says so, too
    assert said.spread == pytest.approx(711.7 / (5226.9 - 3396.2))


def test_other_pairs_have_nothing():
    assert not list(papers.returns("heavy_hopper"))
    assert papers.learning("heavy_hopper") == ("heavy", [])


@pytest.mark.parametrize("family", ["multipolar_ant", "multipolar_hopper"])
def test_a_family_has_three_methods_at_four_shares_that_lie_in_their_intervals(family):
    found, learnt = papers.learning(get_task(f"{family}_3").name)
    assert found == family
    assert [said.name for said in learnt] == ["MLP", "RPL", "MULTIPOLAR (K=4)"]
    assert all(low <= mean <= high for said in learnt for mean, low, high in said.episodes)
    assert {len(said.episodes) for said in learnt} == {4}
