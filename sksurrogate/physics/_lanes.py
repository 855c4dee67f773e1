"""Points side by side, as one number of a function that is written for one point."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np


class Mixed(BaseException):
    """Points do not decide alike. No ``except Exception`` of the user's function stops it."""

    def __init__(self, true: np.ndarray):
        self.true = true


def _unchanged(operation: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda self, other: operation(self, other)


class Lanes(np.ndarray):
    """Points side by side; asked whether they are true, they answer only if all of them agree."""

    def __bool__(self) -> bool:
        true = np.asarray(self) != 0
        if true.ndim > 1:
            raise TypeError("a comparison of several components has no single answer at a point.")
        if true.all():
            return True
        if not true.any():
            return False
        raise Mixed(true)

    # A number is never changed by ``a += b``; nor are points, whose array may have another name too.
    __iadd__ = _unchanged(operator.add)  # type: ignore[assignment]
    __isub__ = _unchanged(operator.sub)  # type: ignore[assignment]
    __imul__ = _unchanged(operator.mul)  # type: ignore[assignment]
    __itruediv__ = _unchanged(operator.truediv)  # type: ignore[assignment]
    __ifloordiv__ = _unchanged(operator.floordiv)  # type: ignore[assignment]
    __imod__ = _unchanged(operator.mod)  # type: ignore[assignment]
    __ipow__ = _unchanged(operator.pow)  # type: ignore[assignment]


class Entry(Lanes):
    """Points that are one number beside vectors: an operation with a vector or matrix gives one whose entries are points."""

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *given: Any, **named: Any) -> Any:
        vectors = [one for one in given if isinstance(one, np.ndarray) and one.ndim and not isinstance(one, Entry)]
        if method == "__call__" and vectors and not named and ufunc.signature is None:
            shape = np.broadcast_shapes(*(one.shape for one in vectors))
            spread = [np.broadcast_to(one, shape) if any(one is v for v in vectors) else one for one in given]
            out = np.empty(shape, dtype=object)
            for place in np.ndindex(shape):
                out[place] = ufunc(
                    *(one if isinstance(one, Entry) or not np.ndim(one) else one[place] for one in spread)
                )
            return out
        if "out" in named:
            raise TypeError("points are one number: nothing is written into them.")
        plain = [one.view(np.ndarray) if isinstance(one, Entry) else one for one in given]
        found = getattr(ufunc, method)(*plain, **named)
        return found.view(Entry) if isinstance(found, np.ndarray) and found.ndim else found


def _method(name: str) -> Callable[..., Any]:
    """What numpy asks every entry of a vector for: ``np.sin(vector)`` is ``entry.sin()``."""
    function = getattr(np, name)
    return lambda self, *others: function(self, *others)


for _name in (
    "sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh", "arcsinh", "arccosh", "arctanh", "sqrt",
    "cbrt", "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "floor", "ceil", "trunc", "rint", "fabs", "hypot", "degrees",
    "radians", "deg2rad", "rad2deg",
):  # fmt: skip
    setattr(Entry, _name, _method(_name))
