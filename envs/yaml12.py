"""YAML in which 3e5 and 1e-3 are numbers, as YAML 1.2 has it; PyYAML's 1.1 reads them as text unless they are written 3.0e+5."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import yaml

from mpge_bench.envs.errors import one_line

#: Values that a document may have, those behind aliases counted wherever they stand: ten lines of aliases of aliases are a thousand million.
_MOST = 100_000


class _Loader(yaml.SafeLoader):
    """PyYAML's, which runs no code, with one more way to write a number, and an end to what aliases may stand for."""

    def get_single_node(self) -> yaml.Node | None:
        node: yaml.Node | None = super().get_single_node()
        if node is not None and _size(node, {}) > _MOST:
            raise yaml.YAMLError(f"it has more than {_MOST} values, aliases counted wherever they stand")
        return node


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(r"^[-+]?(\.\d+|\d+(\.\d*)?)[eE][-+]?\d+$"), list("-+.0123456789"))


def _size(node: yaml.Node, known: dict[int, int]) -> int:
    """How many values `node` is; too many if it holds itself.

    Raises:
        UnicodeEncodeError: if a text cannot be printed.
    """
    if id(node) not in known:
        if isinstance(node, yaml.ScalarNode):
            node.value.encode()  # halves of characters, which an escape may say, cannot be printed
            return 1
        known[id(node)] = _MOST + 1  # for what is met again within
        parts = [part for pair in node.value for part in pair] if isinstance(node, yaml.MappingNode) else node.value
        known[id(node)] = 1 + sum(_size(part, known) for part in parts)
    return known[id(node)]


@contextmanager
def _one_kind_of_error() -> Iterator[None]:
    """PyYAML has others, too: of dates that are none, say, or of numbers with too many digits."""
    try:
        yield
    except RecursionError as error:
        raise yaml.YAMLError("it is nested too deeply") from error
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise yaml.YAMLError(one_line(error, named=True)) from error


def load(text: str) -> Any:
    """What the YAML document `text` holds.

    Raises:
        yaml.YAMLError: if it is none.
    """
    with _one_kind_of_error():
        return yaml.load(text, _Loader)


def line_of(text: str, *address: str | int) -> int:
    """On which line, from 1, what has this `address` in the document `text` stands: the key in a mapping, the item in a list; its parent's, if it is not there.

    Args:
        address: keys and indices, from the outermost on.

    Raises:
        yaml.YAMLError: if it is no document.
    """
    with _one_kind_of_error():
        node, found = yaml.compose(text, _Loader), 1
    for part in address:
        if isinstance(node, yaml.MappingNode):
            places = {key.value: (key, value) for key, value in node.value}
        elif isinstance(node, yaml.SequenceNode):
            places = {str(index): (item, item) for index, item in enumerate(node.value)}
        else:
            break
        if str(part) not in places:
            break
        place, node = places[str(part)]
        found = place.start_mark.line + 1
    return found
