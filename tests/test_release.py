"""What is released, a source archive and a wheel, holds all that the package needs and nothing else, and works where no checkout is about."""

from __future__ import annotations

import configparser
import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
#: Beside the package, what a source archive holds of the project.
_BESIDE = {"CHANGELOG.md", "CITATION.cff", "LICENSE", "MANIFEST.in", "README.md", "constraints.txt", "pyproject.toml", "setup.cfg"}
_BUILD = "import sys, setuptools.build_meta as build; getattr(build, sys.argv[1])(sys.argv[2])"
#: The README's commands, one after another as on a command line each; tables go to the end of the output.
_FIRST = """
import json, runpy, sys, mpge_bench
for arguments in json.loads(sys.argv[1]):
    sys.argv = ["mpge_bench", *arguments]
    try:
        runpy.run_module("mpge_bench", run_name="__main__", alter_sys=True)
    except SystemExit as end:
        assert not end.code, (arguments, end.code)
elsewhere = {name: module.__file__ for name, module in sys.modules.items() if name.startswith("mpge_bench") and not module.__file__.startswith(sys.path[1])}
assert not elsewhere, elsewhere
"""


def _tracked() -> list[str]:
    """Files of the project as they are in the working tree."""
    listed = subprocess.run(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True)
    return [name for name in listed.stdout.split("\0") if name and os.path.lexists(ROOT / name)]


def _package(tracked: list[str]) -> set[str]:
    """Those of the package, by the place where they are imported from."""
    moved = {name: f"mpge_bench/{name}" if name.startswith(("envs/", "baselines/")) else name for name in tracked}
    return {moved[name] for name in tracked if moved[name].startswith("mpge_bench/") and not (ROOT / name).is_symlink()}


def _built(what: str, tree: Path, out: Path) -> Path:
    """The one file that setuptools builds of the source `tree`."""
    done = subprocess.run([sys.executable, "-c", _BUILD, f"build_{what}", out], cwd=tree, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    (made,) = out.glob("*.whl" if what == "wheel" else "*.tar.gz")
    return made


@pytest.fixture(scope="module")
def released(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Source archive, the wheel made of it unpacked, as an index's users get it, and the wheel made of a checkout."""
    folder = tmp_path_factory.mktemp("released")
    for name in _tracked():
        (folder / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / "tree" / name, follow_symlinks=False)
    archive = _built("sdist", folder / "tree", folder / "sdist")
    with tarfile.open(archive) as file:
        file.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    return archive, _built("wheel", unpacked, folder / "wheel"), _built("wheel", folder / "tree", folder / "direct")


@pytest.mark.parametrize("of", [1, 2], ids=["of the source archive", "of a checkout"])
def test_the_wheel_holds_the_package_and_nothing_else(released, of):
    with zipfile.ZipFile(released[of]) as wheel:
        names = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert names == _package(_tracked())
    assert {Path(name).suffix for name in names} == {".py", ".typed", ".yaml", ".json", ".safetensors", ".urdf", ".j2", ".css", ".js"}


def test_the_source_archive_holds_the_package_and_what_builds_it(released):
    with tarfile.open(released[0]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames() if not archive.getmember(name).isdir()}
    made = {name for name in names if name.startswith("mpge_bench.egg-info/")} | {"PKG-INFO"}
    assert names - made == _package(_tracked()) | _BESIDE


@pytest.mark.slow
def test_an_installed_wheel_runs_the_readmes_first_commands_in_an_empty_folder(released, tmp_path):
    where, here = tmp_path / "installed", tmp_path / "empty"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--no-compile", "--target", where, released[1]]
    subprocess.run(pip, check=True, capture_output=True)
    here.mkdir()
    # Not README's mpge: grounding and learning would first have to be compiled, for half a minute.
    run = ["run", "--method", "direct", "--task", "biased_pendulum", "--preset", "smoke", "--jobs", "1"]
    record = ["record", "--task", "biased_pendulum", "--policy", "target", "--episodes", "1", "--seconds", "2"]
    simulate = ["simulate", "--rig", "recordings/rig.yaml", "--recording", "recordings/episode_00.csv"]
    commands = [run, ["leaderboard", "runs"], ["verify", "runs", "--form"], ["tasks"], ["methods"], record, simulate]
    environment = {**os.environ, "PYTHONPATH": str(where), "OMP_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", _FIRST, json.dumps(commands)], cwd=here, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "1 of 1 results are in order." in done.stdout
    (result,) = here.rglob("result.json")
    assert json.loads(result.read_text())["commit"] is None
    assert sorted(path.name for path in here.iterdir()) == ["predicted.csv", "recordings", "runs"]


def test_what_to_cite_is_said() -> None:
    """The file was empty once."""
    said = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    settings = configparser.ConfigParser()
    settings.read(ROOT / "setup.cfg")
    assert {"cff-version", "title", "message", "authors"} <= set(said)
    assert said["version"] == settings["metadata"]["version"]
    assert said["license"] == settings["metadata"]["license"]
