"""The page of results, as `leaderboard --update` writes it."""

from __future__ import annotations

import json
import re

import pytest
from typer.testing import CliRunner

from mpge_bench.cli import app
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.perfect import stored_perfect
from mpge_bench.leaderboard import estimates, page
from mpge_bench.leaderboard.page import OWN, Places, texts, update
from mpge_bench.leaderboard.results import collect

STANDARD = {"preset": "standard", "variant": "standard"}


@pytest.fixture
def places(tmp_path):
    board = tmp_path / "leaderboard"
    board.mkdir()
    return Places(board / "results", board / "README.md", board / "plots", tmp_path / "perfect.json")


@pytest.fixture
def few_resamples(monkeypatch):
    monkeypatch.setattr(estimates, "_RESAMPLES", 20)


@pytest.fixture
def made(places, write_result):
    for task, more in {"one": {"development": True}, "two": {"track": "physics"}}.items():
        for seed in range(2):
            names = {"task": task, "seed": seed} | STANDARD | more
            write_result(places.results / f"{task}/m{seed}/result.json", 0.5, method="m", error=0.3, **names)
            write_result(places.results / f"{task}/p{seed}/result.json", 0.9, method="perfect", samples=0, **names)
    return places


def test_page_plots_and_store_are_what_the_results_say(made, few_resamples):
    update(made)
    text = made.page.read_text()
    row = "| one | 10 | standard | m | T | 2 | 0.50 (0.50, 0.50) | 5 | 0 | 9 | 10 | 2.0 |"
    assert text.index("## Development pairs") < text.index(row) < text.index("## Test pairs, physics track")
    assert "8 runs on 2 pairs." in text
    assert {path.name for path in made.plots.iterdir()} == {"returns-development.png", "returns-physics.png"}
    assert set(re.findall(r"\]\(plots/(.+?)\)", text)) == {path.name for path in made.plots.iterdir()}
    assert json.loads(made.store.read_text())["one"] == {"mean": 9.0, "normalized": 0.9, "seeds": 2, "fingerprints": {"robot": "aa", "pair": "bb"}}
    assert texts(collect(made.results), made) == {made.page: text, made.store: made.store.read_text()}


def test_what_is_kept_of_perfect_holds_for_its_physics_only(made, few_resamples):
    update(made)
    kept = stored_perfect("two", {"robot": "aa", "pair": "bb"}, made.store)
    assert (kept.mean, kept.seeds) == (9.0, 2)
    assert stored_perfect("two", {"robot": "aa", "pair": "cc"}, made.store) is None
    assert stored_perfect("three", {"robot": "aa", "pair": "bb"}, made.store) is None
    assert stored_perfect("two", {"robot": "aa", "pair": "bb"}, made.store.with_name("none.json")) is None


def test_perfect_runs_of_other_presets_are_not_kept(places, write_result, few_resamples):
    write_result(places.results / "result.json", 0.9, method="perfect")
    update(places)
    assert json.loads(places.store.read_text()) == {}


def test_plots_that_are_no_longer_made_are_removed(made, few_resamples):
    made.plots.mkdir()
    (made.plots / "returns-control.png").write_bytes(b"")
    (made.plots / "notes.txt").write_text("")
    update(made)
    assert {path.name for path in made.plots.iterdir()} == {"returns-development.png", "returns-physics.png", "notes.txt"}


def test_without_results_the_page_says_so(places):
    places.results.mkdir()
    assert update(places) == [places.page, places.store]
    assert "There are no results yet." in places.page.read_text()
    assert places.store.read_text() == "{}\n"


def test_results_that_do_not_compare_leave_the_page_as_it_was(made, write_result):
    made.page.write_text("as it was")
    write_result(made.results / "old/result.json", 0.5, schema="mpge_bench/run/1")
    with pytest.raises(UserError, match="earlier protocol"):
        update(made)
    assert made.page.read_text() == "as it was"
    assert not made.plots.exists()


def test_the_command_updates_or_says_why_not(made, monkeypatch, few_resamples):
    run = CliRunner().invoke
    monkeypatch.setattr(page, "OWN", made)
    done = run(app, ["leaderboard", "--update"])
    assert done.exit_code == 0
    assert f"{made.page}: written" in done.output
    refused = run(app, ["leaderboard", str(made.results), "--update"])
    assert isinstance(refused.exception, UserError)
    assert "--update writes the page of leaderboard/results; give it alone" in str(refused.exception)
    monkeypatch.setattr(page, "OWN", Places(*(path.parent / "nowhere" / path.name for path in (made.results, made.page, made.plots, made.store))))
    refused = run(app, ["leaderboard", "--update"])
    assert "--update works in a checkout of the project" in str(refused.exception)


@pytest.mark.slow
def test_the_projects_page_is_what_its_results_say():
    """Else: python -m mpge_bench leaderboard --update."""
    for path, text in texts(collect(OWN.results), OWN).items():
        assert path.read_text() == text, f"{path.name} is not that of the results: python -m mpge_bench leaderboard --update"
    assert {path.name for path in OWN.plots.glob("*.png")} == set(re.findall(r"\]\(plots/(.+?)\)", OWN.page.read_text()))
