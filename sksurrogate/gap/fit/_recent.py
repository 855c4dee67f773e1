"""Values of an instance that are large and cheap to make again: only the latest few are kept."""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Callable
from functools import cached_property
from typing import Any, TypeVar

Kept = TypeVar("Kept")


def recent_property(most: int) -> Callable[[Callable[[Any], Kept]], cached_property[Kept]]:
    """A cached property of which only the ``most`` instances that computed it last keep the value.

    Memory does not grow with the number of instances; what was dropped is computed again where it is asked for.

    >>> class Number:
    ...     def __init__(self, n):
    ...         self.n = n
    ...
    ...     @recent_property(1)
    ...     def row(self):
    ...         return [self.n] * 3
    >>> first, second = Number(1), Number(2)
    >>> first.row, second.row, "row" in vars(first), "row" in vars(second)
    ([1, 1, 1], [2, 2, 2], False, True)
    """

    class Recent(cached_property):  # type: ignore[type-arg]
        def __init__(self, function: Callable[[Any], Kept]):
            super().__init__(function)
            self.holders: deque[weakref.ref[Any]] = deque()

        def __get__(self, instance: Any, owner: type | None = None) -> Any:
            if instance is None:
                return self
            value = super().__get__(instance, owner)
            self.holders.append(weakref.ref(instance))
            while len(self.holders) > most:
                oldest = self.holders.popleft()()
                if oldest is not None:
                    vars(oldest).pop(self.attrname, None)
            return value

    return Recent
