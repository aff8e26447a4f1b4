"""PyBullet, imported and loading models without the noise it prints from C, and its clients."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """PyBullet prints from C while it is imported and while it loads a model; that noise is kept from the user's terminal."""
    libc = ctypes.CDLL(None)
    sys.stdout.flush()
    sys.stderr.flush()
    saved = [os.dup(stream) for stream in (1, 2)]
    with open(os.devnull, "w") as sink:
        for stream in (1, 2):
            os.dup2(sink.fileno(), stream)
    try:
        yield
    finally:
        libc.fflush(None)
        for stream, copied in zip((1, 2), saved, strict=True):
            os.dup2(copied, stream)
            os.close(copied)


with _quiet():
    import pybullet as bullet
    import pybullet_data

#: Folder of the models that come with PyBullet.
BULLET_DATA = Path(pybullet_data.getDataPath())


def load_urdf(text: bytes, client: int, *, fixed: bool, flags: int = 0) -> int:
    """Load the URDF file `text` into the world of `client`; its body's number.

    Raises:
        bullet.error: if PyBullet cannot load it.
    """
    with tempfile.NamedTemporaryFile("wb", suffix=".urdf") as file, _quiet():
        file.write(text)
        file.flush()
        return int(bullet.loadURDF(file.name, useFixedBase=fixed, flags=flags, physicsClientId=client))


#: A program that loads one link with the shape of a file.
_LOADS = """
import sys, tempfile, pybullet
pybullet.connect(pybullet.DIRECT)
with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
    file.write('<robot name="r"><link name="a"><collision><geometry><mesh filename="%s"/></geometry></collision></link></robot>' % sys.argv[1])
    file.flush()
    pybullet.loadURDF(file.name)
"""


@functools.cache
def kills(mesh: Path, changed: int) -> bool:
    """Whether PyBullet dies of the COLLADA file `mesh`, last changed at `changed`, ns, as it does of many that are not whole; tried in a process of its own."""
    return subprocess.run([sys.executable, "-c", _LOADS, str(mesh)], capture_output=True, check=False).returncode < 0


def link_names(body: int, client: int) -> dict[int, str]:
    """Every link's name by its index; the base's is -1."""
    names = {-1: bullet.getBodyInfo(body, physicsClientId=client)[0].decode()}
    for index in range(bullet.getNumJoints(body, physicsClientId=client)):
        names[index] = bullet.getJointInfo(body, index, physicsClientId=client)[12].decode()
    return names


#: Clients of worlds that are gone. A finalizer swallows what is raised in it, a Ctrl-C too: so it takes no time, and what does is done later.
_dropped: list[int] = []


def take_client(owner: Any) -> int:
    """A PyBullet client without anything in it, for as long as `owner` lives: that of an owner that is gone, which takes a third of the time, or a new one."""
    client = _empty_client()
    weakref.finalize(owner, _dropped.append, client)
    return client


def _empty_client() -> int:
    if not _dropped:
        return int(bullet.connect(bullet.DIRECT))
    client = _dropped.pop()
    disconnect_dropped()
    bullet.resetSimulation(physicsClientId=client)
    return client


def disconnect_dropped() -> None:
    """Give back the memory of worlds that are gone; making a world does it, too."""
    while _dropped:
        with contextlib.suppress(bullet.error):
            bullet.disconnect(_dropped.pop())


__all__ = ["BULLET_DATA", "bullet", "disconnect_dropped", "kills", "link_names", "load_urdf", "take_client"]
