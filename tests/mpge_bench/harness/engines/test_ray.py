"""Calls in Ray's processes, where Ray is installed."""

from __future__ import annotations

import os
import signal

import pytest

from mpge_bench import numerics
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.engines import Killed, engine

pytest.importorskip("ray", reason="the extra ray is not installed")


def _place(call):
    if call == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid(), os.getcwd(), numerics.is_fixed()


@pytest.mark.slow
def test_calls_are_made_as_here_and_a_killed_one_is_an_answer(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with engine("ray", 2) as ray:
        assert ray.processes == 2
        found = dict(ray.side_by_side(_place, ["a", "killed", "b"]))
    assert found.pop("killed") == Killed("WorkerCrashedError")
    assert found.keys() == {"a", "b"}
    # A process for each call.
    assert len({process for process, _, _ in found.values()}) == 2
    assert {(folder, fixed) for _, folder, fixed in found.values()} == {(str(tmp_path), numerics.is_fixed())}


@pytest.mark.slow
def test_a_machine_without_the_sweeps_folder_ends_it_in_a_line(monkeypatch):
    monkeypatch.setattr("mpge_bench.harness.engines.ray.os.getcwd", lambda: "/nowhere")
    with engine("ray", 1) as ray, pytest.raises(UserError, match=r"/nowhere: the machine .* cannot work in this folder \(No such file or directory\)"):
        list(ray.side_by_side(_place, ["a"]))


def test_no_cluster_there():
    with pytest.raises(UserError, match=r"no Ray cluster at 127\.0\.0\.1:1 .*; `ray start --head` starts one"), engine("ray", 1, "127.0.0.1:1"):
        pass
