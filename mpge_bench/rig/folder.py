"""What lies in a user's folder: a rig, recordings, a robot."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from mpge_bench.envs.errors import UserError
from mpge_bench.envs.reading import reading

#: Kinds of robot files, by the name of their outermost element.
_KINDS = {"robot": "urdf", "mujoco": "mjcf"}


def kind_of(path: Path) -> str | None:
    """What robot file `path` is, by its beginning: ``urdf``, ``mjcf``, or None."""
    try:
        with reading(path, "XML file", "give a URDF or MJCF file"), path.open("rb") as file:
            _, outermost = next(iter(ET.iterparse(file, ("start",))))
            return _KINDS.get(outermost.tag)
    except UserError:
        return None
