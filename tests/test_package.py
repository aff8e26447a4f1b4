"""What holds for the package as a whole."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def _imports(folder: str) -> set[str]:
    found = set()
    for path in (ROOT / folder).rglob("*.py"):
        if "mpge_bench/envs" not in str(path.relative_to(ROOT)) and "mpge_bench/baselines" not in str(path.relative_to(ROOT)):
            found |= set(re.findall(r"^\s*(?:from|import) ([\w.]+)", path.read_text(), re.M))
    return found


def test_arrows_point_one_way():
    assert not [name for name in _imports("envs") if name.startswith("mpge_bench") and not name.startswith("mpge_bench.envs")]
    assert not [name for name in _imports("envs") if name.split(".")[0] in ("torch", "stable_baselines3", "sb3_contrib")]
    assert not [name for name in _imports("baselines") if re.match(r"mpge_bench(?!\.(envs|baselines))", name)]


def test_symlinks_are_relative_and_lead_to_the_real_folders():
    for name in ("envs", "baselines"):
        link = ROOT / "mpge_bench" / name
        assert link.is_symlink()
        assert str(link.readlink()) == f"../{name}"
