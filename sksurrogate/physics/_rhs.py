"""A user's right-hand side, probed once and made safe to call on any number of points at a time."""

from __future__ import annotations

import warnings
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate._failures import line_in
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._branches import Branches
from sksurrogate.physics._foreign import REFUSALS, offered

#: Whole powers up to this are taken by multiplication.
_LARGEST_POWER = 8
#: Functions that were said to be slow: once in a process and in those that are forked from it.
_SAID: weakref.WeakSet[Any] = weakref.WeakSet()
#: Fewer points than this are passed as plain arrays: the detour would cost more than it saves.
_FEW_POINTS = 200
#: States beyond this are of a run that leaves the numbers: what is nan there is no answer of the function.
_RUNAWAY = 1e20


class _Points(np.ndarray):
    """Points whose small whole powers are products: numpy's own ``**`` is tens of times slower from 3 on."""

    def __pow__(self, other: Any, modulo: Any = None) -> Any:
        if isinstance(other, (int, float)) and 2 < other <= _LARGEST_POWER and other == int(other):
            half, out = self * self, None
            rest = int(other) // 2
            while rest:
                if rest % 2:
                    out = half if out is None else out * half
                rest //= 2
                half = half * half if rest else half
            return out * self if int(other) % 2 else out
        return super().__pow__(other)


class PointwiseFunction:
    """``function(t, x, u, p)`` on points ``(n, *s)``, whatever the user wrote.

    The function is probed on a few points: one that handles ``(n_states, n_points)`` arrays is called once for all
    points, one that branches on values once for all points of a branch. What neither can call is called point by point, with
    one warning that shows how to vectorise it. The function
    sees arrays that cannot be written; one that wants to write is handed copies, with one warning.

    ``size``: components it must return.
    ``what``: how the message calls it: "rhs", "output" or "step".
    ``names``: names of the components.
    ``input_range`` (2, n_inputs): least and largest recorded inputs, of a function that has answered at such: its probe
        stays within them, and every exception refuses a point; else those that arithmetic raises do, and others are
        mistakes in it.
    ``raised``: takes up all that it raises at points that it refuses.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        size: int,
        what: str,
        names: Sequence[str],
        input_range: np.ndarray | None = None,
        raised: dict[str, None] | None = None,
    ):
        self.function = function
        self.size = size
        self.what = what
        self.names = tuple(names)
        self.input_range = input_range
        self.raised = {} if raised is None else raised
        self.vectorised: bool | None = None
        #: The function where a parameter differs from point to point, if another way is needed then
        self.on_rows: Callable[..., Any] | None = None
        #: What the function raised when it last refused a point.
        self.refusal = ""
        self._copies, self._wrote = False, ""
        #: Whether ``raised`` takes up answers that are nan too: looked at where a candidate has failed, for it takes time.
        self.watched = False

    def probe(self, t: float, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], *extra: Any) -> None:
        """Decide how to call the function, at points around ``x`` (n_states,), ``u`` (n_inputs,).

        Raises SimulatorError where it raises, or returns the wrong number of components.
        """
        if self.vectorised is not None or self.size == 0:
            self.vectorised = True if self.vectorised is None else self.vectorised
            return
        spread = np.array([0.0, 1e-3, -1e-3, 0.5, -0.5])
        xs = x[:, None] + spread * np.maximum(np.abs(x), 0.1)[:, None]
        us = u[:, None] - spread * np.maximum(np.abs(u), 0.1)[:, None]
        if self.input_range is not None:  # forces at further ports have none
            low, high = self.input_range[:, :, None]
            us[: len(low)] = np.clip(us[: len(low)], low, high)
        xs, us, times = locked(xs), locked(us), locked(np.full(len(spread), t))
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            answers = {0: self._one(t, xs[:, 0], us[:, 0], p, *extra)}
            for k in range(1, len(spread)):
                try:
                    answers[k] = self._one(t, xs[:, k], us[:, k], p, *extra)
                except Exception as error:
                    self._check_refused(error)
            single, known = np.stack(list(answers.values()), axis=1), list(answers)
            xs, us, times = locked(xs[:, known]), locked(us[:, known]), times[: len(known)]
            self._choose(single, times, xs, us, p, *extra)
        self._tell()
        if not self.vectorised and _first_time(self.function):
            warnings.warn(
                f"{self.what} does not take arrays of points and is called point by point, which is slow. Write it so that every "
                "entry of x and u may be an array: np.where(x > 0, a, b) for 'a if x > 0 else b', np.maximum for max, "
                "np.exp for math.exp, x[0], x[1] for the components.",
                UserWarning,
                stacklevel=4,
            )

    def _choose(
        self, single: np.ndarray, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], *extra: Any
    ) -> None:
        """The first ways to ask for all points at once: with numbers for parameters, and with a parameter of every point."""
        alone, of_points = self.function, {k: locked(np.full(len(t), v)) for k, v in p.items()}
        ways: list[Any] = [alone]

        def first(p: Mapping[str, Any]) -> Callable[..., Any] | None:
            for k in range(3):
                if k == len(ways):  # rewritten only where the function as it is will not do
                    ways.append(Branches(alone, self.size, vectors=k == 2))
                self.function = ways[k]
                if self._agrees(single, t, x, u, p, *extra):
                    return self.function
            return None

        found, rows = first(p), first(of_points)
        self.function, self.vectorised = found or alone, found is not None
        self.on_rows = None if rows is found else rows
        for way in ways[2:]:
            way.patient = True

    def _agrees(self, single: np.ndarray, *given: Any) -> bool:
        """Whether the function gives for all points at once what it gives for single ones."""
        try:
            return bool(np.allclose(single, self._many(*given), rtol=1e-9, atol=1e-12, equal_nan=True))
        except Exception:
            return False

    def _ask(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], *extra: Any) -> Any:
        """The user's function at locked points; on copies where it wants to write into them."""
        function = self.function
        if self.on_rows is not None and any(isinstance(v, np.ndarray) and v.ndim for v in p.values()):
            function = self.on_rows
        if not self._copies:
            try:
                return function(t, x, u, dict(p), *extra)
            except (BufferError, TypeError, ValueError) as error:  # of numpy, Cython and numba
                if "read-only" not in str(error) and "readonly" not in str(error):
                    raise
        given = (_copied(t), x.copy(), u.copy(), {k: _copied(v) for k, v in p.items()})  # writable ones
        value = function(*given, *extra)
        if not self._copies or self.vectorised is None:  # at the first call, and all through a probe
            pairs = zip("txu", given, (t, x, u))
            changed = (name for name, own, kept in pairs if not np.array_equal(own, kept, equal_nan=True))
            self._wrote, self._copies = self._wrote or next(changed, ""), True
            if self.vectorised is not None:  # a probe says it when it is done
                self._tell()
        return value

    def _tell(self) -> None:
        """Say once that the function writes into its arguments."""
        name, self._wrote = self._wrote, ""
        if name:
            warnings.warn(
                f"{self.what} writes into its argument {name} and is handed copies, which is slow. Let it make its own: "
                f"{name} = {name}.copy(), or write np.maximum(x[0], 0) in place of x[0] = max(x[0], 0).",
                UserWarning,
                stacklevel=5,
            )

    @property
    def called(self) -> str:
        """The user's function with what it is given."""
        return f"{self.what}(t, x, u, p, dt)" if self.what == "step" else f"{self.what}(t, x, u, p)"

    def _one(self, t: float, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], *extra: Any) -> np.ndarray:
        """One point."""
        try:
            value = self._ask(t, x, u, p, *extra)
        except SimulatorError:  # says what is wrong already
            raise
        except (KeyError, NameError, AttributeError, TypeError, IndexError, ValueError) as error:
            detail = (
                f"parameter {error} is not in params"
                if isinstance(error, KeyError)
                else f"{type(error).__name__}: {error}"
            )
            raise SimulatorError(
                f"{self.called} failed at t={t:g}, x={x.tolist()}, u={u.tolist()}: {detail}. "
                f"x has {len(x)} states and u {len(u)} inputs; params are {sorted(p)}."
            ) from error
        try:
            # None, a forgotten return, would pass for nan
            out = np.array(
                [
                    np.asarray(component, dtype=float).reshape(())
                    for component in (() if value is None else _components(value))
                ]
            )
        except (TypeError, ValueError):
            out = np.empty(0)
        if len(out) != self.size:
            raise SimulatorError(
                f"{self.called} must return {self.size} components, one for each of {list(self.names)}, "
                f"but returned {value!r} for one point."
            )
        return out

    def _many(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], *extra: Any) -> np.ndarray:
        """All points in one call."""
        if x.size > _FEW_POINTS * len(x):
            x, u = x.view(_Points), u.view(_Points)
        value = self._ask(t, x, u, p, *extra)
        out = np.empty((self.size, *x.shape[1:])) if x.ndim > 1 else np.empty(self.size)
        if len(value) != self.size:
            raise SimulatorError(
                f"{self.what} returned {len(value)} components, expected {self.size}: {list(self.names)}."
            )
        for i, component in enumerate(value):
            out[i] = component
        if self.watched:
            self._watch(x, u, out)
        return out

    def _watch(self, x: np.ndarray, u: np.ndarray, out: np.ndarray) -> None:
        """Take up the first nan at a point that is none of a run that leaves the numbers by itself."""
        points, inputs, values = (a.reshape(len(a), -1) for a in (x, u, out))
        bad = np.flatnonzero((np.abs(points) < _RUNAWAY).all(axis=0) & offered(inputs) & np.isnan(values).any(axis=0))
        if len(bad):
            k = int(bad[0])
            self.raised[
                f"{self.what} gives {[float(f'{v:.4g}') for v in values[:, k]]} for {list(self.names)} at x="
                f"{[float(f'{v:.4g}') for v in points[:, k]]}, u={[float(f'{v:.4g}') for v in inputs[:, k]]}"
            ] = None
            self.watched = False

    def __call__(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], *extra: Any) -> np.ndarray:
        """Points ``x`` (n_states, n_points) -> (size, n_points); t and entries of p are floats or (n_points,)."""
        return self.points(locked(t), locked(x), locked(u), {k: locked(v) for k, v in p.items()}, *extra)

    def points(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], *extra: Any) -> np.ndarray:
        """The same for arrays that cannot be written."""
        if self.vectorised is None:
            points = x.reshape(len(x), -1)
            at = (float(np.ravel(t)[0]), points[:, 0], u.reshape(len(u), points.shape[1])[:, 0])
            self.probe(
                *at, {k: (float(np.ravel(v)[0]) if isinstance(v, np.ndarray) else v) for k, v in p.items()}, *extra
            )
        if self.vectorised:
            try:
                return self._many(t, x, u, p, *extra)
            except Exception as error:  # one point of many, as a rule
                self._check_refused(error)
        return self._each(t, x, u, p, *extra)

    def _check_refused(self, error: Exception) -> BaseException:
        """What the function raised where it refused a point; a mistake in it is raised."""
        cause = error.__cause__ if isinstance(error, SimulatorError) else error
        if not (self.input_range is not None or isinstance(cause, REFUSALS)):
            raise error
        return cause or error

    def _each(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], *extra: Any) -> np.ndarray:
        """Point by point; nan where the function refuses a point, and where a point is not finite: then it is not asked."""
        n_points = x.shape[1]
        times = np.broadcast_to(t, (n_points,))
        varied = {k: v for k, v in p.items() if isinstance(v, np.ndarray) and v.ndim > 0}
        out, cause, last = np.full((self.size, n_points), np.nan), None, 0
        for m in np.flatnonzero(offered(times, x, u, *varied.values())):
            q = {**p, **{k: float(v[m]) for k, v in varied.items()}} if varied else p
            try:
                out[:, m] = self._one(float(times[m]), x[:, m], u[:, m], q, *extra)
            except Exception as error:
                last, cause = int(m), self._check_refused(error)
                self.raised[f"{type(cause).__name__}: {cause}"] = None
        if cause is not None:
            place = f" ({where})" if (where := line_in(None, cause)) else ""
            self.refusal = (
                f" {self.what} last raised {type(cause).__name__}: {cause}{place}, at t={times[last]:g}, x={x[:, last].tolist()}, "
                f"u={u[:, last].tolist()}."
            )
        return out


def locked(value: Any) -> Any:
    """A view of an array that cannot be written."""
    if not isinstance(value, np.ndarray) or not value.flags.writeable:
        return value
    view = value.view()
    view.setflags(write=False)
    return view


def _copied(value: Any) -> Any:
    return value.copy() if isinstance(value, np.ndarray) else value


def _first_time(function: Any) -> bool:
    """Whether a function, or the one behind a method, has not been said to be slow; always, for what cannot be remembered."""
    inner = getattr(function, "__func__", function)
    try:
        known = inner in _SAID
        _SAID.add(inner)
    except TypeError:
        return True
    return not known


def _components(value: Any) -> Any:
    """A scalar counts as one component, and so does an array without axes, as of ``np.where``."""
    scalar = not hasattr(value, "__len__") or (isinstance(value, np.ndarray) and value.ndim == 0)
    return [value] if scalar else value
