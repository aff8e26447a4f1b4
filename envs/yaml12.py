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
