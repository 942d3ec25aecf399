"""What was worked out for an object, kept as long as the object lives."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

T = TypeVar("T")


class WeakCache(Generic[T]):
    """Values by owner, by identity: for owners that hold arrays and so cannot be hashed."""

    def __init__(self) -> None:
        self._values: dict[int, dict[Hashable, T]] = {}

    def get(self, owner: object, key: Hashable, make: Callable[[], T]) -> T:
        """The value under ``key`` of ``owner``; made when there is none yet."""
        if id(owner) not in self._values:
            self._values[id(owner)] = {}
            weakref.finalize(owner, self._values.pop, id(owner), None)
        values = self._values[id(owner)]
        if key not in values:
            values[key] = make()
        return values[key]

    def __len__(self) -> int:
        """How many owners have values."""
        return len(self._values)
