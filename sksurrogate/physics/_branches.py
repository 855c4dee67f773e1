"""A function written for one point, called for many: points that take the same branches run together as arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from types import CellType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np
from scipy import special

from sksurrogate.physics._entries import MODULES, REPLACED, entries
from sksurrogate.physics._foreign import offered
from sksurrogate.physics._lanes import Entry, Lanes, Mixed

#: Time, states, inputs, parameters.
_Part = tuple[Any, np.ndarray, np.ndarray, dict[str, Any]]

#: So few points that disagree are asked one by one; so few whose vectors would have to be made of entries too.
_POINTS_ONE_BY_ONE, _FEW_VECTORS = 32, 8
#: Functions of :mod:`math` that numpy has under another name, or scipy has.
_OTHER_NAMES = {
    "fabs": np.fabs, "pow": np.power, "erf": special.erf, "erfc": special.erfc, "gamma": special.gamma, "lgamma": special.gammaln,
    "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "atan2": np.arctan2, "asinh": np.arcsinh, "acosh": np.arccosh,
    "atanh": np.arctanh,
}  # fmt: skip
_SAME_NAMES = (
    "ceil", "copysign", "cos", "cosh", "degrees", "exp", "exp2", "expm1", "floor", "fmod", "hypot", "isfinite", "isinf", "isnan",
    "ldexp", "log10", "log1p", "log2", "cbrt", "radians", "sin", "sinh", "sqrt", "tan", "tanh", "trunc",
)  # fmt: skip


class Branches:
    """``function(t, x, u, p, *extra)`` for points ``(n, n_points)``, though it has an ``if``, ``max`` or ``math.exp`` for one point.

    The function runs on arrays. Where points disagree about a condition, it starts again for those where the condition is
    true and for the others, until all points of a run take the same branches. ``float`` and functions of :mod:`math` in it, and in
    the functions that it calls by name, work on arrays. The answers are those of single points up to rounding. A point that is
    not finite is not asked: its answer is nan.

    ``size``: components that it returns.
    ``vectors``: states and inputs are vectors whose entries are points, and the vectors and matrices that numpy makes
        inside the function hold points too.

    >>> def rhs(t, x, u, p):
    ...     return (-math.sqrt(x[0]) if x[0] > 1 else max(u[0], 0.5),)
    >>> Branches(rhs, 1)(0.0, np.array([[4.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 2.0]]), {})[0].tolist()
    [-2.0, 0.5, 2.0]
    """

    def __init__(self, function: Callable[..., Any], size: int, vectors: bool = False):
        self.function = function
        self.size = size
        self.vectors = vectors
        #: Whether few points, and those that cannot be taken together after all, are asked one by one
        self.patient = False
        called: Any = function.__call__  # type: ignore[operator]  # a method, where function is an object of the user's
        self._on_arrays = _Rewritten(vectors).of(called if isinstance(called, MethodType) else function)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.function, self.size, self.vectors), {"patient": self.patient}

    def __call__(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], *extra: Any) -> Any:
        if x.ndim < 2:
            return self.function(t, x, u, p, *extra)
        n_points = int(np.prod(x.shape[1:]))
        t, p, x_flat, u_flat = (
            _flat(t),
            {k: _flat(v) for k, v in p.items()},
            x.reshape(len(x), n_points),
            u.reshape(len(u), n_points),
        )
        arrays = [v for v in (t, *p.values()) if isinstance(v, np.ndarray) and v.ndim]
        which = offered(x_flat, u_flat, *arrays)
        if which.all():
            out = self._run(t, x_flat, u_flat, p, extra)
        else:
            out = np.full((self.size, n_points), np.nan)
            if which.any():
                out[:, which] = self._run(*_part(which, t, x_flat, u_flat, p), extra)
        return [row.reshape(x.shape[1:]) for row in out]

    def _run(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], extra: tuple[Any, ...]) -> np.ndarray:
        """All components (size, n_points) at points that may disagree."""
        n_points = x.shape[1]
        if self.patient and n_points <= _FEW_VECTORS:
            return self._each(n_points, t, x, u, p, extra)
        try:
            return self._together(n_points, t, x, u, p, extra)
        except Mixed as decision:
            if n_points <= _POINTS_ONE_BY_ONE:
                return self._each(n_points, t, x, u, p, extra)
            out = np.empty((self.size, n_points))
            for which in (decision.true, ~decision.true):
                out[:, which] = self._run(*_part(which, t, x, u, p), extra)
            return out
        except (TypeError, ValueError, AttributeError):
            if not self.patient:
                raise
            return self._each(n_points, t, x, u, p, extra)

    def _each(
        self, n_points: int, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], extra: tuple[Any, ...]
    ) -> np.ndarray:
        """All components (size, n_points), point by point."""
        return np.stack([self._single(k, t, x, u, p, extra) for k in range(n_points)], axis=1)

    def _together(
        self, n_points: int, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], extra: tuple[Any, ...]
    ) -> np.ndarray:
        """All components (size, n_points) at points that take the same branches."""
        if self.vectors:
            given = _lanes(t, Entry), *(entries([_lanes(row, Entry) for row in rows]) for rows in (x, u))
            value = self._on_arrays(*given, {k: _lanes(v, Entry) for k, v in p.items()}, *extra)
        else:
            value = self._on_arrays(_lanes(t), _lanes(x), _lanes(u), {k: _lanes(v) for k, v in p.items()}, *extra)
        components = value if hasattr(value, "__len__") and not _is_row(value, n_points) else [value]
        if len(components) != self.size:
            raise ValueError(f"{len(components)} components, expected {self.size}.")
        out = np.empty((self.size, n_points))
        for i, component in enumerate(components):
            out[i] = component
        return out

    def _single(
        self, k: int, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], extra: tuple[Any, ...]
    ) -> np.ndarray:
        """All components at one of the points."""
        value = self.function(*_part(k, t, x, u, p), *extra)
        return np.array(value, dtype=float).reshape(-1)


# ---- points ---------------------------------------------------------------------------------------------------------
def _flat(value: Any) -> Any:
    return value.reshape(-1) if isinstance(value, np.ndarray) and value.ndim else value


def _lanes(value: Any, kind: type[Lanes] = Lanes) -> Any:
    """Points that decide together and that nobody may write into: a run that starts again needs them as they were."""
    if not isinstance(value, np.ndarray) or not value.ndim:
        return value
    lanes = value.view(kind)
    lanes.setflags(write=False)
    return lanes


def _part(which: Any, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any]) -> _Part:
    """Time, states, inputs and parameters of some points, or of one."""

    def some(value: Any) -> Any:
        return value[which] if isinstance(value, np.ndarray) and value.ndim else value

    return some(t), x[:, which], u[:, which], {name: some(value) for name, value in p.items()}


def _is_row(value: Any, n_points: int) -> bool:
    """Whether an answer is one component for all points, and no vector of as many entries."""
    return isinstance(value, np.ndarray) and value.shape == (n_points,) and value.dtype != object


# ---- functions ------------------------------------------------------------------------------------------------------
def _as_in_math(scalar: Callable[..., Any], on_arrays: Callable[..., Any]) -> Callable[..., Any]:
    """A function of math that takes points, and raises where its own does: where finite arguments have no finite value."""

    def called(*given: Any) -> Any:
        if not any(isinstance(one, np.ndarray) and one.ndim for one in given):
            return scalar(*given)
        with np.errstate(all="ignore"):
            out = on_arrays(*given)
        bad = ~np.isfinite(np.asarray(out))
        if bad.any():
            for one in given:
                bad = bad & np.isfinite(one)
            if bad.all():
                return scalar(*(float(np.ravel(one)[0]) for one in given))  # it raises, in its own words
            if bad.any():
                raise Mixed(np.asarray(bad))
        return out

    return called


def _log(x: Any, *base: Any) -> Any:
    return np.log(x) / np.log(base[0]) if base else np.log(x)


def _float(value: Any = 0.0) -> Any:
    return value if isinstance(value, np.ndarray) and value.ndim else float(value)


_ARRAY_MATH = {name: _as_in_math(getattr(math, name), getattr(np, name)) for name in _SAME_NAMES if hasattr(math, name)}
_ARRAY_MATH |= {name: _as_in_math(getattr(math, name), function) for name, function in _OTHER_NAMES.items()}
_ARRAY_MATH["log"] = _as_in_math(math.log, _log)
_MATH = ModuleType("math")
_MATH.__dict__.update({**vars(math), **_ARRAY_MATH})
_FOR_ARRAYS = {id(getattr(math, name)): function for name, function in _ARRAY_MATH.items()}


class _Names(dict[str, Any]):
    """Globals of a function: those that are replaced, all others as they are at that moment."""

    def __init__(self, replaced: dict[str, Any], others: dict[str, Any]):
        super().__init__(replaced)
        self.others = others

    def __missing__(self, name: str) -> Any:
        return self.others[name]


class _Rewritten:
    """Functions with the names they use replaced by what takes arrays; each once. ``vectors``: what numpy makes too."""

    def __init__(self, vectors: bool = False) -> None:
        self.known: dict[int, Any] = {}
        self.others = {**_FOR_ARRAYS, **REPLACED} if vectors else _FOR_ARRAYS
        self.modules = MODULES if vectors else {}

    def of(self, value: Any) -> Any:
        """What stands for a value that a function uses; the value itself, as a rule."""
        if value is math:
            return _MATH
        if id(value) in self.modules:
            return self.modules[id(value)]
        if value is float:
            return _float
        if isinstance(value, MethodType):
            return MethodType(self.of(value.__func__), value.__self__)
        if isinstance(value, partial):
            return partial(self.of(value.func), *value.args, **value.keywords)
        if isinstance(value, FunctionType) and not _of_a_library(value):
            return self._function(value)
        return self.others.get(id(value), value)

    def _function(self, function: FunctionType) -> Any:
        if id(function) in self.known:
            return self.known[id(function)]
        names = _Names({}, function.__globals__)
        cells = [CellType() for _ in function.__closure__ or ()]
        out = FunctionType(function.__code__, names, function.__name__, function.__defaults__, tuple(cells) or None)
        out.__kwdefaults__ = function.__kwdefaults__
        self.known[id(function)] = out
        for name in _global_names(function.__code__):
            found = function.__globals__.get(name, float if name == "float" else None)
            other = self.of(found)
            if other is not found:
                names[name] = other
        for mine, theirs in zip(cells, function.__closure__ or ()):
            mine.cell_contents = self.of(theirs.cell_contents)
        return out


def _of_a_library(function: FunctionType) -> bool:
    return (function.__module__ or "").partition(".")[0] in ("numpy", "scipy", "sksurrogate")


def _global_names(code: CodeType) -> set[str]:
    """Names that code, and the functions defined inside it, look up."""
    inner = (one for one in code.co_consts if isinstance(one, CodeType))
    return set(code.co_names).union(*(_global_names(one) for one in inner))
