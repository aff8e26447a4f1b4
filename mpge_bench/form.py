"""What plain data read from a file has to look like, and where some does not."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from reprlib import repr as shortly
from typing import Any

#: Sums and squares of what is smaller are still numbers.
_LARGEST = 1e150


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and -_LARGEST < value < _LARGEST


def _is_count(value: Any) -> bool:
    return _is_number(value) and isinstance(value, int) and 0 <= value < 2**53


#: Kinds of values, in the words of the message that says that one is not of it.
_KINDS: Mapping[str, Callable[[Any], bool]] = {
    "text": lambda value: isinstance(value, str),
    "file name": lambda value: isinstance(value, str) and value not in ("", ".", "..") and not set("/\\\0") & set(value),
    "number": _is_number,
    "count": _is_count,
    "count above 0": lambda value: _is_count(value) and value > 0,
    "yes or no": lambda value: isinstance(value, bool),
    "list": lambda value: isinstance(value, list),
    "list of texts": lambda value: isinstance(value, list) and all(isinstance(one, str) for one in value),
    "list of lists of texts": lambda value: isinstance(value, list) and all(map(_KINDS["list of texts"], value)),
    "mapping": lambda value: isinstance(value, dict),
    "mapping to texts": lambda value: isinstance(value, dict) and all(isinstance(one, str) for one in value.values()),
    "mapping to numbers": lambda value: isinstance(value, dict) and all(one is None or _is_number(one) for one in value.values()),
}


def misfits(data: Any, form: Mapping[str, Any], path: str = "") -> Iterator[str]:
    """What of `data` is missing or of another kind than `form` says, a line each.

    Args:
        form: by the names of the mapping's entries their kinds, or their own form where they are mappings; a question mark behind kind or name stands for
            what may be null.
        path: of `data`, in the lines.
    """
    if not isinstance(data, dict):
        yield f"{path.removesuffix('.') or 'it'}: is {shortly(data)}, where there is to be a mapping"
        return
    for entry, kind in form.items():
        name = entry.removesuffix("?")
        nullable = entry.endswith("?") or (isinstance(kind, str) and kind.endswith("?"))
        words = ("mapping" if isinstance(kind, Mapping) else kind.removesuffix("?")) + " or null" * nullable
        if name not in data:
            yield f"{path}{name}: is missing; there is to be a {words}"
        elif data[name] is None and nullable:
            continue
        elif isinstance(kind, Mapping) and isinstance(data[name], dict):
            yield from misfits(data[name], kind, f"{path}{name}.")
        elif isinstance(kind, Mapping) or not _KINDS[kind.removesuffix("?")](data[name]):
            yield f"{path}{name}: is {shortly(data[name])}, where there is to be a {words}"


def check(data: Any, form: Mapping[str, Any]) -> None:
    """Raise a ValueError that says the first of `misfits`."""
    for line in misfits(data, form):
        raise ValueError(line)
