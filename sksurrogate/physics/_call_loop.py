"""Calls to C functions at one point after the other: a loop in machine code where llvmlite is installed, else through ctypes.

A call through ctypes takes about 0.3 microseconds, which is ten times what a small unit takes for its derivatives.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.physics._call_code import machine_code

#: Points between two looks at the keyboard: the machine code itself cannot be interrupted.
_STRETCH = 4096


class Row(NamedTuple):
    """An argument that is the address of a row of an array, one row for each point."""

    array: str


class Real(NamedTuple):
    """An argument that is a number, one for each point."""

    array: str


class Call(NamedTuple):
    """A call at every point."""

    function: int  #: Address of a C function that returns an int: 0 and 1 are success
    arguments: Sequence[int | Row | Real]  #: Integers (a handle, a size, a flag) are the same at every point
    when: str = ""  #: Array of bytes, one for each point: no call where it is 0; "" for a call at every point


class CallLoop:
    """The same calls at one point after the other.

    ``native``: whether machine code is used where it can be had.
    """

    def __init__(self, calls: Sequence[Call], native: bool = True):
        self.calls = list(calls)
        shape = tuple(("".join(_KIND[type(a)] for a in call.arguments), bool(call.when)) for call in calls)
        self._native = machine_code(shape) if native else None
        #: Place in the table, array, whether the width of its rows follows.
        self._filled: list[tuple[int, str, bool]] = []
        table = [0]
        for call in self.calls:
            table.append(int(call.function))
            if call.when:
                self._filled.append((len(table), call.when, False))
                table.append(0)
            for argument in call.arguments:
                if isinstance(argument, (Row, Real)):
                    self._filled.append((len(table), argument.array, True))
                    table.extend((0, 0))
                else:
                    table.append(int(argument))
        self._table = np.array(table, dtype=np.uint64).view(np.int64)

    @property
    def native(self) -> bool:
        """Whether machine code is used."""
        return self._native is not None

    def __call__(self, first: int, arrays: dict[str, np.ndarray]) -> tuple[int, int]:
        """Call at the points from the first on, until one fails.

        ``arrays``: all that the arguments name, contiguous, (n_points,) or (n_points, width).
        Returns ``point``: that which failed; the number of points where none did.
        Returns ``status``: what the function that failed returned.
        """
        n_points = len(next(iter(arrays.values())))
        if self._native is None:
            return self._interpreted(first, n_points, arrays)
        at = {name: (one.__array_interface__["data"][0], one.strides[0]) for name, one in arrays.items()}
        for place, name, spaced in self._filled:
            self._table[place] = at[name][0]
            if spaced:
                self._table[place + 1] = at[name][1]
        table = self._table.ctypes.data
        for k in range(first, n_points, _STRETCH):
            end = min(k + _STRETCH, n_points)
            reached = self._native(table, k, end)
            if reached < end:
                return reached, int(self._table[0])
        return n_points, 0

    def _interpreted(self, first: int, n_points: int, arrays: dict[str, np.ndarray]) -> tuple[int, int]:
        streams = [self._statuses(call, first, n_points, arrays) for call in self.calls]
        for k in range(first, n_points):
            for stream in streams:
                status = next(stream)
                if status > 1:
                    return k, status
        return n_points, 0

    def _statuses(self, call: Call, first: int, n_points: int, arrays: dict[str, np.ndarray]) -> Iterator[int]:
        """What a function returns at one point after the other."""
        kinds = [ctypes.c_double if isinstance(a, Real) else ctypes.c_size_t for a in call.arguments]
        function = ctypes.CFUNCTYPE(ctypes.c_int, *kinds)(call.function)

        def values(argument: int | Row | Real) -> Any:
            if isinstance(argument, Real):
                return iter(arrays[argument.array][first:].tolist())
            if isinstance(argument, Row):
                rows = arrays[argument.array]
                start, width = rows.__array_interface__["data"][0], rows.strides[0]
                return iter(range(start + first * width, start + n_points * width, width)) if width else repeat(start)
            return repeat(argument)

        given = map(values, call.arguments)
        if not call.when:
            return map(function, *given)
        return (function(*one) if go else 0 for go, one in zip(arrays[call.when][first:].tolist(), zip(*given)))


_KIND: dict[type, str] = {int: "i", Row: "r", Real: "d"}
