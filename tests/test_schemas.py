"""Every version of a file that the code writes stands in docs/schemas.md, and every shipped file is of one that does."""

from __future__ import annotations

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "schemas.md").read_text("utf-8")
_NAME = re.compile(r"mpge_bench/[a-z_]+/\d+")


def test_the_page_lists_what_the_code_writes_and_tells_of_what_it_refuses() -> None:
    sources = [path for folder in ("envs", "baselines", "mpge_bench") for path in (ROOT / folder).glob("**/*.py")]
    found = {name for path in sources for name in re.findall(rf'"({_NAME.pattern})"', path.read_text("utf-8"))}
    written = {line.split("`")[1] for line in PAGE.splitlines() if line.startswith("| `mpge_bench/")}
    assert {"mpge_bench/run/2", "mpge_bench/policy/2", "mpge_bench/diagnosis/1"} <= written
    # What is named in the code and not written is an older one, which the page has to tell of, too.
    assert written <= found
    assert found <= set(_NAME.findall(PAGE))
    newest = {name.rpartition("/")[0]: max((one for one in found if one.startswith(name.rpartition("/")[0] + "/")), key=_number) for name in found}
    assert written == set(newest.values())


def _number(name: str) -> int:
    return int(name.rpartition("/")[2])


def test_shipped_files_are_of_versions_that_the_page_tells_of() -> None:
    shipped = [path for folder in ("baselines/policies", "leaderboard/results") for path in (ROOT / folder).rglob("*.json")]
    found = {json.loads(path.read_text("utf-8")).get("schema") for path in shipped} - {None}
    assert found
    assert found <= set(_NAME.findall(PAGE))
