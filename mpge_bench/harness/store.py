"""The folder of a run: what is there already, and one process's alone until all is there."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from mpge_bench.baselines.grounding.finished import NAME as FINISHED
from mpge_bench.envs import get_task
from mpge_bench.envs.errors import UserError
from mpge_bench.harness.result import read_result
from mpge_bench.harness.settings import RunSettings

#: In a run's partial folder, held while the run is made.
_LOCK = "lock"
#: How often a run looks whether another process has let go of it, s.
_LOOK = 0.1
#: Beside the lock: what the run was asked for and by which libraries and physics, so that only the very same run goes on from its groundings.
_ASKED = "asked.json"


def present_result(settings: RunSettings, out: Path, chosen: Any = None) -> dict[str, Any] | None:
    """The result that is there already, if there is one.

    Raises:
        UserError: if it cannot be read, or is that of another pair of the same name or of other settings.
    """
    path, task = settings.folder(out) / "result.json", get_task(settings.task)
    if not path.exists():
        return None
    found = read_result(path)
    if found["pair"] != task.to_dict():
        raise UserError(f"{path} holds the result of another pair called {task.name}; rename the pair, or choose another folder with --out")
    if found["settings"] != json.loads(json.dumps(asdict(chosen or settings.effective()))):
        raise UserError(f"{path} holds a result with other settings (the preset has changed since); remove it, or choose another folder with --out")
    return found


@contextmanager
def own_folder(settings: RunSettings, out: Path, wait: float = 0.0) -> Iterator[Path]:
    """The run's folder ``….partial``, this process's alone; removed at the end, unless it was moved to its final place or holds finished groundings.

    Raises:
        UserError: if it cannot be written to, or another process is at work in it and still is after `wait` seconds.
    """
    partial = settings.partial(out)
    try:
        lock = _locked(partial, time.monotonic() + wait)
    except Timeout as error:
        raise UserError(f"{settings.folder(out)}: another process is making this result; wait for it, or choose another folder with --out") from error
    except OSError as error:
        raise UserError(f"{settings.folder(out)}: cannot be written to ({error.strerror}); choose another folder with --out") from error
    try:
        yield partial
    finally:
        if not any(partial.rglob(FINISHED)):
            shutil.rmtree(partial, ignore_errors=True)
        lock.release()


def _locked(folder: Path, until: float) -> FileLock:
    """A lock on `folder`, which is made at need; whoever has it may let go `until` then, or move the folder to its final place."""
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / _LOCK)
        try:
            lock.acquire(timeout=0)
        except (Timeout, FileNotFoundError):
            if time.monotonic() >= until:
                raise
            time.sleep(_LOOK)
        else:
            return lock


def taken_up(partial: Path, asked: dict[str, Any]) -> bool:
    """Whether finished groundings are there of a run that was asked for the same, and was cut short; all else that it left is removed."""
    written, path = json.dumps(asked, default=str), partial / _ASKED
    same = path.exists() and path.read_bytes() == written.encode()
    kept = {one.parent for one in partial.rglob(FINISHED)} if same else set()
    for remains in sorted(partial.rglob("*"), reverse=True):
        if remains.parent in kept or remains == partial / _LOCK:
            continue
        if not remains.is_dir():
            remains.unlink()
        elif not any(remains.iterdir()):
            remains.rmdir()
    path.write_text(written)
    return bool(kept)


def remove_remains(settings: RunSettings, out: Path) -> None:
    """Remove what a run that was killed has left, but not the files of one that another process is still at."""
    if settings.partial(out).exists():
        with suppress(UserError), own_folder(settings, out):
            pass


def finish(partial: Path, folder: Path) -> None:
    """Move what `own_folder` has given, and the run has filled, to its final place, without what only served its making."""
    shutil.rmtree(folder, ignore_errors=True)
    for path in (partial / _ASKED, *partial.rglob(FINISHED)):
        path.unlink()
    # The lock last: without it the folder would be another's who waits for it.
    partial.replace(folder)
    (folder / _LOCK).unlink()
