"""Processes that are killed are noticed, and none outlives what it worked for."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mpge_bench.envs.errors import UserError
from mpge_bench.harness.engines import Killed, engine
from mpge_bench.harness.engines.local import LocalEngine

#: After this a process counts as hung, s. (Not conftest's: the processes import this file, and would wait for PyTorch.)
PATIENCE = 600


def _process(call):
    """Who is at work; some die of it."""
    if call == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if call == "gone":
        os._exit(3)
    if isinstance(call, Path):
        call.write_text(str(os.getpid()))
        time.sleep(PATIENCE)
    return os.getpid()


def _await(what):
    deadline = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def _number(path):
    return int(path.read_text() or 0) if path.exists() else 0


def _runs(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"


def test_processes_are_kept_from_call_to_call_and_their_death_is_an_answer():
    found = list(LocalEngine(1).side_by_side(_process, ["a", "b", "killed", "gone"]))
    process = found[0][1]
    assert found == [("a", process), ("b", process), ("killed", Killed("SIGKILL")), ("gone", Killed("exit status 3"))]
    assert process != os.getpid()


def test_who_stops_asking_ends_what_is_under_way(tmp_path):
    at_work = LocalEngine(2).side_by_side(_process, [tmp_path / "pid", "a"])
    assert next(at_work)[0] == "a"
    _await(lambda: _number(tmp_path / "pid"))
    at_work.close()
    assert not _runs(_number(tmp_path / "pid"))


def test_a_worker_ends_with_a_parent_that_is_killed(tmp_path):
    # The parent imports this file as a module of its own, as its worker does.
    lines = (
        "from pathlib import Path",
        "from mpge_bench.harness.engines.local import LocalEngine",
        f"from {__name__} import _process",
        f"if __name__ == '__main__': list(LocalEngine(1).side_by_side(_process, [Path({str(tmp_path / 'pid')!r})]))",
    )
    (tmp_path / "parent.py").write_text("\n".join(lines))
    folder = str(Path(__file__).parents[4])
    parent = subprocess.Popen([sys.executable, tmp_path / "parent.py"], env=os.environ | {"PYTHONPATH": os.pathsep.join([folder, *sys.path])})
    _await(lambda: _number(tmp_path / "pid") or parent.poll() is not None)
    worker = _number(tmp_path / "pid")
    assert _runs(worker)
    parent.kill()
    parent.wait()
    _await(lambda: not _runs(worker))


def test_engines_by_name(monkeypatch):
    with engine("local", 3) as found:
        assert found.processes == 3
    with pytest.raises(UserError, match="unknown engine 'slurm'; choose one of: local, ray"):
        engine("slurm", 1)
    with pytest.raises(UserError, match=r"--address 10\.0\.0\.1:6379 is of a Ray cluster; add --engine ray"):
        engine("local", 1, "10.0.0.1:6379")
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(UserError, match=r"--engine ray needs Ray: pip install 'mpge_bench\[ray\]'"), engine("ray", 1):
        pass
