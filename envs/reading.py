"""Files that anybody may have written, read so that whatever is wrong with one is a line that names it, and nothing of it is run."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET
from xml.parsers import expat

from yaml import YAMLError

from mpge_bench.envs import yaml12
from mpge_bench.envs.errors import UserError, one_line

#: Bytes beyond which a text is none of ours: the largest result has 50 thousand. A device may be without end.
LARGEST = 16 << 20


@contextmanager
def reading(path: Path, what: str, advice: str) -> Iterator[None]:
    """Whatever goes wrong within is the file's fault: parsers, and code that takes what they give to be as it should, raise what they like.

    Args:
        what: the file is to be, for people.
        advice: what to do where it is none.

    Raises:
        UserError: in the place of any other exception; one that says itself what is wrong has the path put before it, if it is not there.
    """
    try:
        yield
    except UserError as error:
        said = one_line(error)
        raise type(error)(said if str(path) in said else f"{path}: {said}") from error
    except Exception as error:
        speaks = isinstance(error, OSError | ValueError | YAMLError)
        said = "it is nested too deeply" if isinstance(error, RecursionError) else one_line(error, named=not speaks)
        raise UserError(f"{path}: not a readable {what} ({said}); {advice}") from error


def text_of(path: Path) -> str:
    """The text in the file `path`, in UTF-8.

    Raises:
        ValueError: if it is too large, or no text.
        OSError: if it cannot be read.
    """
    with path.open("rb") as file:
        data = file.read(LARGEST + 1)
    if len(data) > LARGEST:
        raise ValueError(f"it has more than {LARGEST >> 20} MB")
    return data.decode("utf-8")


def at(path: Path, *address: str | int) -> str:
    """The YAML file `path`, which has been read before, and the line on which what has this `address` stands (see `yaml12.line_of`), for messages."""
    return f"{path}, line {yaml12.line_of(text_of(path), *address)}"


def at_element(path: Path, root: ET.Element, element: ET.Element) -> str:
    """The XML file `path`, whose elements are those of `root`, and the line on which `element` stands, for messages."""
    lines: list[int] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda *_: lines.append(parser.CurrentLineNumber)
    parser.Parse(path.read_bytes(), True)
    return f"{path}, line {lines[list(root.iter()).index(element)]}"


def json_of(path: Path, what: str, advice: str) -> Any:
    """What the JSON file `path` holds.

    Raises:
        UserError: if it cannot be read; see `reading`.
    """
    with reading(path, what, advice):
        data = json.loads(text_of(path))
        json.dumps(data, ensure_ascii=False).encode()  # halves of characters, which an escape may say, cannot be printed
        return data


def yaml_of(path: Path, what: str, advice: str) -> Any:
    """What the YAML file `path` holds.

    Raises:
        UserError: if it cannot be read; see `reading`.
    """
    with reading(path, what, advice):
        return yaml12.load(text_of(path))
