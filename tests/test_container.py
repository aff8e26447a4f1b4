"""What the Containerfile says is there, pinned, and run without rights; it is not built here."""

from __future__ import annotations

import json
import re
import subprocess
from fnmatch import fnmatch
from pathlib import Path

ROOT = Path(__file__).parents[1]
LINES = [line for line in (ROOT / "Containerfile").read_text("utf-8").replace("\\\n", " ").splitlines() if line and not line.startswith("#")]


def said(instruction: str) -> list[str]:
    return [line.partition(" ")[2] for line in LINES if line.startswith(f"{instruction} ")]


def test_the_main_job_runs_as_a_user_without_rights() -> None:
    assert json.loads(said("ENTRYPOINT")[0]) == ["python", "-m", "mpge_bench"]
    assert json.loads(said("CMD")[0]) == ["run"]
    (user,) = said("USER")
    assert user != "root"
    assert f"useradd --create-home {user}" in " ".join(said("RUN"))
    assert max(index for index, line in enumerate(LINES) if line.startswith("RUN")) < LINES.index(f"USER {user}")


def test_versions_are_those_of_constraints() -> None:
    installs = [part for line in said("RUN") for part in line.split("&&") if "pip install" in part]
    assert installs
    assert all("-c /built/constraints.txt" in part for part in installs)
    # CPython 3.11 is what constraints.txt is for, and the last that PyBullet ships for.
    assert {re.match(r"python:3\.11\b", one) is not None for one in said("FROM")} == {True}


def test_all_that_the_wheel_is_made_of_gets_into_the_build_and_nothing_else() -> None:
    rules = [line for line in (ROOT / ".dockerignore").read_text("utf-8").splitlines() if line and not line.startswith("#")]
    assert rules[0] == "*"
    let_in = [rule[1:] for rule in rules if rule.startswith("!")]
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    found = {name for name in tracked if any(name == rule or name.startswith(f"{rule}/") for rule in let_in)}
    needed = ("mpge_bench/*", "envs/*", "baselines/*", "setup.cfg", "pyproject.toml", "README.md", "constraints.txt")
    assert found >= {name for name in tracked if any(fnmatch(name, pattern) for pattern in needed)}
    assert not [name for name in found if name.startswith(("tests/", "leaderboard/", "benchmarks/", "docs/"))]
    assert all((ROOT / rule).exists() for rule in let_in)
