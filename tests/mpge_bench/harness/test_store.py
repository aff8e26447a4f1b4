"""The folder of a run is one process's alone, and what killed ones have left does not disturb."""

from __future__ import annotations

import threading

import pytest
from filelock import FileLock

from mpge_bench.envs.errors import UserError
from mpge_bench.harness import run as harness_run
from mpge_bench.harness.run import run
from mpge_bench.harness.settings import RunSettings
from mpge_bench.harness.store import remove_remains

from .conftest import SMOKE


def test_groundings_of_another_run_are_not_taken_up(policy_folder, tmp_path, monkeypatch):
    folder = SMOKE.partial(tmp_path) / "tensorboard/grounding_0"
    folder.mkdir(parents=True)
    (folder / "finished.safetensors").write_text("not what it should be")
    (SMOKE.partial(tmp_path) / "asked.json").write_text("{}")
    assert run(SMOKE, tmp_path, policy_folder=policy_folder)["machine"]["resumed"] is False


def test_remains_of_a_killed_run_do_not_disturb(policy_folder, tmp_path):
    settings = RunSettings("biased_pendulum", "direct", 50, "smoke", 0)
    remains = settings.folder(tmp_path).with_name("seed0.partial")
    remains.mkdir(parents=True)
    (remains / "result.json").write_text("{}")
    run(settings, tmp_path, policy_folder=policy_folder)
    assert not remains.exists()


def test_a_run_that_another_process_is_at_is_left_alone(policy_folder, tmp_path, monkeypatch):
    settings = RunSettings("biased_pendulum", "direct", 50, "smoke", 0)
    half = settings.partial(tmp_path) / "tensorboard" / "half"
    half.parent.mkdir(parents=True)
    half.write_text("")
    monkeypatch.setattr(harness_run, "_DYING", 0.0)
    with FileLock(settings.partial(tmp_path) / "lock"):
        with pytest.raises(UserError, match=r"seed0: another process is making this result; wait for it, or choose another folder with --out$"):
            run(settings, tmp_path, policy_folder=policy_folder)
        remove_remains(settings, tmp_path)
        assert half.exists()
    remove_remains(settings, tmp_path)
    assert not settings.partial(tmp_path).exists()


def test_a_run_waits_for_another_process_at_it_and_takes_its_result(policy_folder, tmp_path):
    settings = RunSettings("biased_pendulum", "direct", preset="smoke")
    made = run(settings, tmp_path, policy_folder=policy_folder)
    folder, partial = settings.folder(tmp_path), settings.partial(tmp_path)
    written = (folder / "result.json").stat().st_mtime_ns
    # As if the other one had yet to move what it has made to its place.
    folder.replace(partial)
    lock = FileLock(partial / "lock", thread_local=False)
    lock.acquire()

    def finish():
        partial.replace(folder)
        (folder / "lock").unlink()
        lock.release()

    other = threading.Timer(0.5, finish)
    other.start()
    assert run(settings, tmp_path, policy_folder=policy_folder) == made
    other.join()
    assert (folder / "result.json").stat().st_mtime_ns == written
    assert {path.name for path in folder.iterdir()} == {"result.json", "policy.safetensors"}
    assert not partial.exists()
