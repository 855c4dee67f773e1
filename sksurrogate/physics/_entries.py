"""Vectors and matrices of one point whose entries are many points: what numpy makes of numbers, made of rows of points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

import numpy as np

from sksurrogate.physics._lanes import Entry


def holds_points(value: Any) -> bool:
    """Whether a value is a row of points, or a vector or list with some."""
    if isinstance(value, (list, tuple)):
        return any(map(holds_points, value))
    return isinstance(value, np.ndarray) and (value.dtype == object or isinstance(value, Entry))


def entries(rows: Sequence[Any]) -> np.ndarray:
    """A vector (n,) whose entries are rows of points.

    >>> entries([np.ones(3), 2.0])[0].tolist()
    [1.0, 1.0, 1.0]
    """
    out = np.empty(len(rows), dtype=object)
    for i, row in enumerate(rows):
        out[i] = row
    return out


def _nested(values: Any) -> Any:
    """An array of objects in the shape of nested lists and vectors, rows of points as they are."""
    if isinstance(values, (list, tuple)) or (isinstance(values, np.ndarray) and values.dtype == object and values.ndim):
        parts = [_nested(one) for one in values]
        vectors = [one for one in parts if isinstance(one, np.ndarray) and one.dtype == object]
        if not vectors:
            return entries(parts)
        if len(vectors) < len(parts) or len({one.shape for one in vectors}) > 1:
            raise ValueError("rows of a matrix differ in length.")
        return np.stack(vectors)
    return values


def _made(make: Callable[..., Any]) -> Callable[..., Any]:
    """An array of numbers that rows of points can be written into; one of another kind as it is."""

    def called(shape: Any, *given: Any, **named: Any) -> Any:
        out = make(shape, *given, **named)
        return out.astype(object) if out.dtype == np.float64 and type(out) is np.ndarray else out

    return called


def _array(values: Any, *given: Any, **named: Any) -> Any:
    """``np.array`` of numbers, or of rows of points."""
    return (
        _nested(values)
        if holds_points(values) and isinstance(values, (list, tuple))
        else np.array(values, *given, **named)
    )


def _asarray(values: Any, *given: Any, **named: Any) -> Any:
    """``np.asarray``: vectors of points stay as they are."""
    return values if isinstance(values, np.ndarray) and holds_points(values) else _array(values, *given, **named)


def _joined(join: Callable[..., Any]) -> Callable[..., Any]:
    """``np.concatenate`` or ``np.hstack`` of vectors, of lists of points, and of points that are one number each."""

    def called(parts: Any, *given: Any, **named: Any) -> Any:
        vectors = [entries([one]) if isinstance(one, Entry) else _asarray(one) for one in parts]
        return join(vectors if holds_points(vectors) else parts, *given, **named)

    return called


def _reduced(reduce: Callable[..., Any]) -> Callable[..., Any]:
    """``np.sum`` and its like of points in a list: a list is a vector, not a table with a row for each of them."""

    def called(values: Any, *given: Any, **named: Any) -> Any:
        return reduce(_asarray(values) if holds_points(values) else values, *given, **named)

    return called


def _mean(values: Any, *given: Any, **named: Any) -> Any:
    """``np.mean`` of a vector of points."""
    vector = _asarray(values)
    plain = given or named or vector.dtype != object or isinstance(vector, Entry)
    return np.mean(values, *given, **named) if plain else np.sum(vector) / vector.size


def _diag(values: Any, *given: Any) -> Any:
    """``np.diag`` of a vector of points."""
    vector = _asarray(values)
    if vector.dtype != object or vector.ndim != 1 or given:
        return np.diag(values, *given)
    out = np.zeros((len(vector), len(vector))).astype(object)
    out[np.diag_indices(len(vector))] = vector
    return out


def _stacked(matrix: Any) -> np.ndarray:
    """Vector or matrix of rows of points as numbers, (n_points, ...)."""
    flat = np.broadcast_arrays(*(np.asarray(one, dtype=float) for one in np.asarray(matrix, dtype=object).ravel()))
    return np.stack(flat, axis=-1).reshape(-1, *np.shape(matrix)) if len(flat) else np.empty((0, 0))


def _unstacked(values: np.ndarray) -> np.ndarray:
    """The way back, (n_points, ...) to a vector or matrix of rows."""
    rows = np.moveaxis(values, 0, -1).reshape(-1, len(values))
    return entries([row.view(Entry) for row in rows]).reshape(values.shape[1:])


def _solve(matrix: Any, right: Any) -> Any:
    """``np.linalg.solve`` at every point."""
    if not (holds_points(matrix) or holds_points(right)):
        return np.linalg.solve(matrix, right)
    A, b = _stacked(matrix), _stacked(right)
    return _unstacked(np.linalg.solve(A, b[..., None])[..., 0] if np.ndim(right) == 1 else np.linalg.solve(A, b))


def _inv(matrix: Any) -> Any:
    """``np.linalg.inv`` at every point."""
    return _unstacked(np.linalg.inv(_stacked(matrix))) if holds_points(matrix) else np.linalg.inv(matrix)


def _keeping_kind(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that forgets of which kind the points were that it took."""

    def called(*given: Any, **named: Any) -> Any:
        out = function(*given, **named)
        return out.view(Entry) if any(isinstance(one, Entry) for one in given) and np.ndim(out) == 1 else out

    return called


#: Functions of numpy that make vectors and matrices, or take them, for points.
REPLACED: dict[int, Callable[..., Any]] = {
    id(np.array): _array, id(np.asarray): _asarray, id(np.diag): _diag, id(np.linalg.solve): _solve, id(np.linalg.inv): _inv,
    **{id(make): _made(make) for make in (np.zeros, np.ones, np.empty)},
    **{id(join): _joined(join) for join in (np.concatenate, np.hstack)},
    id(np.mean): _mean,
    **{id(reduce): _reduced(reduce) for reduce in (np.sum, np.prod, np.max, np.min, np.linalg.norm)},
    **{id(function): _keeping_kind(function) for function in (np.where, np.interp)},
}  # fmt: skip


def _module(original: ModuleType, **others: Any) -> ModuleType:
    """A module whose functions take points."""
    out = ModuleType(original.__name__)
    out.__dict__.update({name: REPLACED.get(id(value), value) for name, value in vars(original).items()} | others)
    return out


LINALG = _module(np.linalg)
#: ``numpy`` and ``numpy.linalg`` for functions of one point.
MODULES = {id(np): _module(np, linalg=LINALG), id(np.linalg): LINALG}
