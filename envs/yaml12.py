"""YAML in which 3e5 and 1e-3 are numbers, as YAML 1.2 has it; PyYAML's 1.1 reads them as text unless they are written 3.0e+5."""

from __future__ import annotations

import re
from typing import Any

import yaml


class _Loader(yaml.SafeLoader):
    """PyYAML's, which runs no code, with one more way to write a number."""


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(r"^[-+]?(\.\d+|\d+(\.\d*)?)[eE][-+]?\d+$"), list("-+.0123456789"))


def load(text: str) -> Any:
    """What the YAML document `text` holds.

    Raises:
        yaml.YAMLError: if it is none.
    """
    return yaml.load(text, _Loader)


def lines(text: str) -> dict[str, int]:
    """On which line, from 1, each key of the mapping that the document `text` is stands; none if it is no mapping.

    Raises:
        yaml.YAMLError: if it is no document.
    """
    node = yaml.compose(text, _Loader)
    return {key.value: key.start_mark.line + 1 for key, _ in node.value} if isinstance(node, yaml.MappingNode) else {}
