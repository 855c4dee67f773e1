"""External programs and functions called at points: they get finite numbers only, and nan stands for what they refuse."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

#: Values beyond this are not offered to an external program: their cubes would leave the finite numbers.
LARGEST_OFFERED = 1e100
#: What a function raises at a point that it refuses; other errors are mistakes in the function.
REFUSALS = (ArithmeticError, ValueError, RuntimeError)


def offered(*values: np.ndarray) -> np.ndarray:
    """Which points (n, n_points) an external program may see: finite ones below :data:`LARGEST_OFFERED`.

    >>> offered(np.array([[0.0, np.nan, 1.0]]), np.array([1e300, 0.0, 2.0])).tolist()
    [False, False, True]
    """
    found = np.ones(values[0].shape[-1], dtype=bool)
    for value in values:
        if value.size:
            found &= (
                np.abs(value).max(axis=0) if value.ndim > 1 else np.abs(value)
            ) <= LARGEST_OFFERED  # nan is not <=
    return found


def at_points(function: Callable[..., np.ndarray], t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> np.ndarray:
    """A function of flat points, (n, n_points) and p with floats or (n_points,), at points of any shape (n, *s)."""
    if len(x) and hasattr(x[0], "graph"):  # symbols of an export
        raise TypeError(
            "its equations are in an external program, which can be called but not written as a graph: fit a model of this package to "
            "its runs and export that."
        )
    states = np.asarray(x, dtype=float)
    shape = states.shape[1:]
    if len(shape) == 1 and isinstance(u, np.ndarray) and u.shape[1:] == shape:
        return function(t, states, u, p)
    flat = states.reshape(len(states), -1) if len(states) else states.reshape(0, int(np.prod(shape)))

    def spread(value: Any) -> np.ndarray:
        return np.broadcast_to(np.asarray(value, dtype=float), shape).reshape(-1)

    inputs = np.array([spread(row) for row in u], dtype=float).reshape(-1, flat.shape[1])
    params = {name: spread(value) if np.ndim(value) else value for name, value in p.items()}
    return function(spread(t), flat, inputs, params).reshape(-1, *shape)
