"""The last results of something that is asked for again and again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


class Memory(Generic[Key, Value]):
    """The results of the last `most` keys that were asked for. It forgets all on its way to another process: results weigh more than they cost."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._known: dict[Key, Value] = {}

    def get(self, key: Key, make: Callable[[], Value]) -> Value:
        """What `make` gives, which is asked only if the result for `key` is not known."""
        if key in self._known:
            found = self._known.pop(key)
        else:
            found = make()
            if len(self._known) >= self._most:
                self._known.pop(next(iter(self._known)))
        self._known[key] = found
        return found

    def __reduce__(self) -> tuple[Any, ...]:
        return Memory, (self._most,)
