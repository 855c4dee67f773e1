"""A unit for model exchange as a right-hand side: derivatives and outputs at any points."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np

from sksurrogate.physics._call_loop import Call, CallLoop, Real, Row
from sksurrogate.physics._fmu_signals import Signals
from sksurrogate.physics._fmu_unit import Messages, new_instance
from sksurrogate.physics._foreign import LARGEST_OFFERED, offered

#: Up to so many points an order of their visit costs more than it saves.
_FEW = 8
#: Rounds of an event until nothing changes any more.
_EVENT_ROUNDS = 100


class Refused(Exception):
    """The unit refuses what it is asked."""


class Calls:
    """The functions that are called at every point, as addresses go in; status 0 and 1 are success."""

    def __init__(self, dll: Any, version: int):
        pointer, real, size, status = ctypes.c_void_p, ctypes.c_double, ctypes.c_size_t, ctypes.c_int

        def call(name: str, *types: Any) -> Any:
            return ctypes.CFUNCTYPE(status, pointer, *types)((f"fmi{version}{name}", dll))

        array, several = (pointer, size), (pointer, size, pointer, *((size,) if version == 3 else ()))
        self.set_time = call("SetTime", real)
        self.set_states = call("SetContinuousStates", *array)
        self.get_states = call("GetContinuousStates", *array)
        self.get_rates = call("GetDerivatives" if version == 2 else "GetContinuousStateDerivatives", *array)
        self.get_indicators = call("GetEventIndicators", *array)
        self.set_real = call("SetReal" if version == 2 else "SetFloat64", *several)
        self.get_real = call("GetReal" if version == 2 else "GetFloat64", *several)


class ExchangeUnit:
    """One instance of a unit for model exchange, put to any point.

    ``folder``: of the unpacked unit.
    ``params``: names behind ``signals.params``.
    """

    def __init__(self, folder: str, description: Any, signals: Signals, params: tuple[str, ...]):
        self.folder, self.description, self.signals, self.names = folder, description, signals, params
        self.messages = Messages()
        self._tail = lambda n: (n,) if signals.version == 3 else ()
        self._values: tuple[float, ...] | None = None
        self._open()

    def _open(self) -> None:
        self.instance = new_instance(self.folder, self.description, "ModelExchange", self.messages)
        self.calls = Calls(self.instance.dll, self.signals.version)
        self._begun, self._values = False, None
        self._loops: dict[bool, CallLoop] = {}

    def close(self) -> None:
        """Free the instance."""
        self.instance.freeInstance()

    # ---- from the start ---------------------------------------------------------------------------------------------
    def _set(self, references: np.ndarray, values: Any) -> None:
        """Real values by reference."""
        numbers = np.ascontiguousarray(values, dtype=float)
        given = (references.ctypes.data, len(references), numbers.ctypes.data, *self._tail(len(references)))
        if len(references) and self.calls.set_real(self.instance.component, *given) > 1:
            raise Refused(f"refuses the values {numbers.tolist()}")

    def begin(self, values: tuple[float, ...], u: np.ndarray, t: float = 0.0) -> float:
        """From instantiation to continuous time with these parameters; the time of the next event, inf for none."""
        s, instance = self.signals, self.instance
        self._values = None
        if self._begun:
            instance.reset()
        self._begun = True
        if s.version == 2:
            instance.setupExperiment(startTime=t)
        self._set(s.params, values)
        instance.enterInitializationMode(**({"startTime": t} if s.version == 3 else {}))
        self._set(s.inputs, u)
        instance.exitInitializationMode()
        event = self.update()
        self._values = values
        return event

    def update(self) -> float:
        """Discrete states until they settle, then continuous time; the time of the next event, inf for none."""
        renew = self.instance.newDiscreteStates if self.signals.version == 2 else self.instance.updateDiscreteStates
        for _ in range(_EVENT_ROUNDS):
            again, ended, _, _, timed, event = renew()
            if ended:
                raise Refused("ends the simulation at an event")
            if not again:
                self.instance.enterContinuousTimeMode()
                return float(event) if timed else np.inf
        raise Refused(f"does not settle in {_EVENT_ROUNDS} rounds of an event")

    def states(self) -> np.ndarray:
        """Continuous states where the unit is, (n_states,)."""
        found = np.empty(len(self.signals.states))
        if self.calls.get_states(self.instance.component, found.ctypes.data, len(found)) > 1:
            raise Refused("gives no states")
        return found[self.signals.order]

    def renew(self, fatal: bool = False) -> None:
        """A point failed: the unit goes back to its start; after a fatal error nothing may be called, not even to free it."""
        self._values = None
        try:
            if fatal:
                raise Refused("is lost")
            self.instance.reset()
            self._begun = False
        except Exception:  # whatever the binary says, a new instance is the way out
            self._open()

    # ---- at points --------------------------------------------------------------------------------------------------
    def derivatives(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any]) -> np.ndarray:
        """dx/dt (n_states, n_points); nan where the unit refuses a point."""
        found = self._at_points(t, x, u, p, len(self.signals.states), None)
        return found[self.signals.order]

    def outputs(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any]) -> np.ndarray:
        """Outputs (n_outputs, n_points); nan where the unit refuses a point."""
        return self._at_points(t, x, u, p, len(self.signals.outputs), self.signals.outputs)

    def parameter_rows(self, p: Mapping[str, Any], n_points: int) -> np.ndarray:
        """Values of the parameters at every point, (n_points, n_params)."""
        rows = np.empty((n_points, len(self.names)))
        for i, name in enumerate(self.names):
            rows[:, i] = p[name]
        return rows

    def _at_points(
        self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], size: int, asked: np.ndarray | None
    ) -> np.ndarray:  # fmt: skip
        """Derivatives, or what is ``asked`` for by reference, (size, n_points)."""
        n_points = x.shape[1]
        if n_points == 1:
            return self._single(t, x[:, 0], u[:, 0], p, size, asked)
        T, P = np.broadcast_to(np.asarray(t, dtype=float), (n_points,)), self.parameter_rows(p, n_points)
        X = np.empty((n_points, len(self.signals.states)))
        X[:, self.signals.order] = x.T
        V = np.ascontiguousarray(u.T, dtype=float)
        good = offered(T, x, u, P.T)
        several = any(isinstance(value, np.ndarray) and value.ndim for value in p.values())
        if not several and good.all() and self._loop(asked).native:
            found = np.full((n_points, size), np.nan)
            self._begun_at(P, [0, n_points], np.ascontiguousarray(T), X, V, np.ones(n_points, bool), found, asked)
            return found.T
        visit = _few_calls if not self._loop(asked).native else _as_they_come
        order, fresh, moved, new = visit(np.flatnonzero(good), P, np.column_stack([T, V]), X)
        visited = order[new]
        found = np.full((len(visited), size), np.nan)
        edges = [*np.flatnonzero(fresh[new]).tolist(), len(visited)]
        self._begun_at(P[visited], edges, T[visited], X[visited], V[visited], moved[new], found, asked)
        out = np.full((size, n_points), np.nan)
        out[:, order] = found[np.cumsum(new) - 1].T
        return out

    def _begun_at(
        self, P: np.ndarray, edges: list[int], T: np.ndarray, X: np.ndarray, V: np.ndarray, moved: np.ndarray, out: np.ndarray, asked: np.ndarray | None
    ) -> None:  # fmt: skip
        """Stretches of points with the same parameters; what the unit refuses stays nan."""
        for a, b in zip(edges[:-1], edges[1:]):
            try:
                self._at(tuple(P[a].tolist()), V[a], float(T[a]))
            except Exception as error:  # these parameters are refused
                self._failed(error)
                continue
            self._walk(T[a:b], X[a:b], V[a:b], moved[a:b], out[a:b], asked)

    def _single(
        self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], size: int, asked: np.ndarray | None
    ) -> np.ndarray:  # fmt: skip
        """One point: a simulation asks for one after the other, where all that sorts points would cost most."""
        s, now = self.signals, t.item() if isinstance(t, np.ndarray) else float(t)
        given = [p[name] for name in self.names]
        values = tuple(v.item() if isinstance(v, np.ndarray) else float(v) for v in given)
        X, V, out = np.empty((1, len(x))), np.array(u, dtype=float)[None], np.full((1, size), np.nan)
        X[0, s.order] = x
        if all(abs(v) <= LARGEST_OFFERED for v in (now, *values, *x.tolist(), *V[0].tolist())):
            try:
                self._at(values, V[0], now)
            except Exception as error:  # these parameters are refused
                self._failed(error)
            else:
                self._walk(np.array([now]), X, V, np.ones(1, bool), out, asked)
        return out.T

    def _walk(
        self, times: np.ndarray, X: np.ndarray, V: np.ndarray, moved: np.ndarray, out: np.ndarray, asked: np.ndarray | None
    ) -> None:  # fmt: skip
        """Point after point with the same parameters; what the unit refuses stays nan."""
        at = {"t": times, "x": X, "u": V, "moved": moved, "out": out}
        k = 0
        while True:
            k, status = self._loop(asked)(k, at)
            if k == len(X):
                return
            out[k], values = np.nan, self._values
            try:
                self.renew(bool(status & 4))  # status 4 is fatal
                self.begin(values or (), V[k], min(float(times[k]), 0.0))
            except Exception as error:  # it does not begin any more: the rest stays nan
                out[k:] = np.nan
                return self._failed(error)
            k += 1
            moved[k : k + 1] = True

    def _loop(self, asked: np.ndarray | None) -> CallLoop:
        """The calls at a point: time and inputs where they differ from the point before, states, and what is asked for."""
        if (asked is None) not in self._loops:
            s, c, calls = self.signals, self.instance.component, self.calls
            n, m, size = len(s.states), len(s.inputs), 0 if asked is None else len(asked)

            def address(function: Any) -> int:
                return int(ctypes.cast(function, ctypes.c_void_p).value or 0)

            made = [Call(address(calls.set_time), (c, Real("t")), "moved")]
            if m:
                given = (c, s.inputs.ctypes.data, m, Row("u"), *self._tail(m))
                made.append(Call(address(calls.set_real), given, "moved"))
            made.append(Call(address(calls.set_states), (c, Row("x"), n)))
            if asked is None:
                made.append(Call(address(calls.get_rates), (c, Row("out"), n)))
            else:
                wanted = (c, asked.ctypes.data, size, Row("out"), *self._tail(size))
                made.append(Call(address(calls.get_real), wanted))
            self._loops[asked is None] = CallLoop(made)
        return self._loops[asked is None]

    def _failed(self, error: Exception) -> None:
        """A unit that stopped begins anew at the next point."""
        self.messages.keep(f"{type(error).__name__}: {error}")
        self.renew(getattr(error, "status", 3) == 4)

    def _at(self, values: tuple[float, ...], u: np.ndarray, t: float) -> None:
        """In continuous time with these parameters."""
        if self._values != values:
            self.begin(values, u, min(t, 0.0))


#: Points in the order of their visit; where parameters, where times and inputs, and where anything differs from the point before.
Visits = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _as_they_come(points: np.ndarray, P: np.ndarray, moving: np.ndarray, X: np.ndarray) -> Visits:
    """For calls that take less time than an order saves: only points of the same parameters stand together."""
    order = points[np.lexsort(P[points].T)] if P.shape[1] else points
    every = np.ones(len(order), bool)
    return order, _changes(P[order]), every, every


def _few_calls(points: np.ndarray, P: np.ndarray, moving: np.ndarray, X: np.ndarray) -> Visits:
    """In the order of parameters, times and inputs, so that the unit hears of a change only, and of equal points only once."""
    few = len(points) <= _FEW
    keys = () if few else (*X[points].T[::-1], *moving[points].T[::-1], *P[points].T[::-1])
    order = points if few else points[np.lexsort(keys)]
    fresh = _changes(P[order])
    moved = np.ones(len(order), bool) if few else fresh | _changes(moving[order])
    return order, fresh, moved, moved.copy() if few else moved | _changes(X[order])


def _changes(rows: np.ndarray) -> np.ndarray:
    """Which rows differ from the one before; the first does."""
    return np.r_[True, np.any(rows[1:] != rows[:-1], axis=1)][: len(rows)]
