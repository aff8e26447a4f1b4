"""What the README and the documentation show works as it stands there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer

from mpge_bench import pages
from mpge_bench.cli import app
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.run import run
from mpge_bench.harness.settings import RunSettings
from mpge_bench.leaderboard.results import collect
from mpge_bench.markdown import with_table

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "leaderboard/README.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_between_pages_lead_somewhere(page):
    links = [link for link in re.findall(r"\]\(([^)]+)\)", page.read_text()) if "://" not in link]
    assert links
    assert [link for link in links if not (page.parent / link.partition("#")[0]).exists()] == []


@pytest.mark.parametrize("name", pages.TABLES)
def test_tables_of_the_documentation_are_as_their_command_writes_them(name):
    assert (ROOT / f"docs/{name}.md").read_text() == pages.fresh(name), f"write it anew: python -m mpge_bench {name} --update"


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_command_line_knows_every_command_that_a_page_shows(page):
    program = typer.main.get_command(app)
    for block in re.findall(r"```\n(.*?)```", page.read_text(), re.DOTALL):
        for line in re.findall(r"^python -m mpge_bench (.*)$", block.replace("\\\n", " "), re.MULTILINE):
            command, words = program, shlex.split(line, comments=True)
            while isinstance(command, typer.core.TyperGroup):
                command = command.commands[words.pop(0)]
            command.make_context(command.name, words)


def test_the_gallery_is_small():
    assert sum(path.stat().st_size for path in (ROOT / "docs/gallery").iterdir()) < 3e6


def test_a_page_without_a_place_for_its_table_is_refused(tmp_path):
    (tmp_path / "page.md").write_text("<!-- pairs -->\n")
    for name in ("page.md", "missing.md"):
        with pytest.raises(UserError, match="no place for a table between two comments <!-- pairs -->"):
            with_table(tmp_path / name, "pairs", "")


def test_the_readme_stays_a_page():
    assert len((ROOT / "README.md").read_bytes()) <= 9000


def test_the_example_of_a_users_method_runs_and_enters_the_tables(policy_folder, tmp_path, monkeypatch):
    (code,) = (block for block in re.findall(r"```python\n(.*?)```", (ROOT / "docs/methods.md").read_text(), re.DOTALL) if "class BestGain(Method)" in block)
    (tmp_path / "readme_example.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    settings = RunSettings("biased_pendulum", "readme_example:BestGain", 50, "smoke", 0, ("agent.steps=1024", "gains=[0.5, 1]"))
    result = run(settings, tmp_path / "out", policy_folder=policy_folder)
    assert result["report"]["gain"] in (0.5, 1.0)
    assert result["action_transformation_error"]["value"] > 0
    assert list(collect(tmp_path / "out")["method"]) == ["readme_example:BestGain"]
