"""A unit for model exchange with events of its own, as a map from sample to sample."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import brentq

from sksurrogate.physics._fmu_exchange import ExchangeUnit, Refused
from sksurrogate.physics._foreign import offered

#: Largest difference between one sample in n and in 2 n substeps, relative to the size of the states.
_FMU_TOLERANCE = 1e-8
_MOST_FMU_SUBSTEPS = 64
#: Points at which the substeps are chosen.
_FMU_PROBES = 16
#: Events within a sample: with more (a ball at rest) the states stay where the last one left them.
_EVENTS_IN_SAMPLE = 32
#: Share of a substep to which the moment of an event is found.
_MOMENT_FOUND = 1e-13


class EventSteps:
    """Samples of a unit: between events by Runge-Kutta of order 4, cut at the moment of each event.

    Every point begins anew: the unit is put back to its start and to the point's time, states, inputs and parameters, and
    settles its discrete states there. What it remembers beyond its continuous states is lost; whether that matters is
    found out before a unit is stepped.
    """

    def __init__(self, unit: ExchangeUnit):
        self.unit = unit
        self._copies = bool(unit.description.modelExchange.canGetAndSetFMUstate)
        self._kept: tuple[Any, tuple[float, ...], Any] | None = None
        self._x = np.empty(len(unit.signals.states))
        self._dx, self._z = np.empty_like(self._x), np.empty(unit.signals.n_indicators)

    def close(self) -> None:
        """Free the copy of the start and the instance."""
        self._forget()
        self.unit.close()

    def sample(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], dt: float) -> np.ndarray:
        """States (n_states, n_points) a time ``dt`` later under held inputs; nan where the unit refuses a point."""
        times = np.broadcast_to(np.asarray(t, dtype=float), (x.shape[1],))
        P = self.unit.parameter_rows(p, x.shape[1])
        good = np.flatnonzero(offered(times, x, u, P.T))

        def moved(rows: np.ndarray, n_sub: int) -> np.ndarray:
            found = [self._one(float(times[k]), x[:, k], u[:, k], tuple(P[k]), dt, n_sub) for k in rows]
            return np.stack(found, axis=1) if found else np.empty((len(x), 0))

        out, n_sub = np.full(x.shape, np.nan), 1
        probes = good[:: max(1, len(good) // _FMU_PROBES)]
        coarse = moved(probes, n_sub)
        while n_sub < _MOST_FMU_SUBSTEPS:
            fine = moved(probes, 2 * n_sub)
            n_sub *= 2
            size = np.maximum(np.max(np.abs(np.c_[x[:, probes], fine]), axis=1, initial=0.0), 1e-12)[:, None]
            if not np.nanmax(np.abs(fine - coarse) / size, initial=0.0) > _FMU_TOLERANCE:
                break
            coarse = fine
        rest = np.setdiff1d(good, probes)
        out[:, probes], out[:, rest] = fine if n_sub > 1 else coarse, moved(rest, n_sub)
        return out

    def outputs(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any]) -> np.ndarray:
        """Outputs (n_outputs, n_points) after the events at each point; nan where the unit refuses it."""
        times = np.broadcast_to(np.asarray(t, dtype=float), (x.shape[1],))
        P = self.unit.parameter_rows(p, x.shape[1])
        out = np.full((len(self.unit.signals.outputs), x.shape[1]), np.nan)
        for k in np.flatnonzero(offered(times, x, u, P.T)):
            out[:, k] = self._one(float(times[k]), x[:, k], u[:, k], tuple(P[k]), 0.0, 0)
        return out

    def run(
        self, t: np.ndarray, U: np.ndarray, x0: np.ndarray | None, values: tuple[float, ...]
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """States and outputs of one run that goes through, (n_samples, n_states) and (n_samples, n_outputs).

        ``x0=None``: the unit's own start. The substeps are doubled until the run moves no more.
        """
        X, Y = self._run(t, U, x0, values, 1)
        n_sub = 2
        while n_sub <= _MOST_FMU_SUBSTEPS:
            before = X
            X, Y = self._run(t, U, x0, values, n_sub)
            size = np.maximum(np.nanmax(np.abs(X), axis=0, initial=0.0), 1e-12)
            if not np.nanmax(np.abs(X - before) / size, initial=0.0) > _FMU_TOLERANCE:
                break
            n_sub *= 2
        return X, Y

    def _run(
        self, t: np.ndarray, U: np.ndarray, x0: np.ndarray | None, values: tuple[float, ...], n_sub: int
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """:meth:`run` in so many substeps per sample; nan from where the states are too large or not finite."""
        unit, s = self.unit, self.unit.signals
        X, Y = np.full((len(t), len(s.states)), np.nan), np.full((len(t), len(s.outputs)), np.nan)
        self._forget()
        unit.begin(values, U[0], float(t[0]))
        x = unit.states() if x0 is None else np.asarray(x0, dtype=float)
        for k, (now, u) in enumerate(zip(t, U)):
            x, event = self._settled(float(now), x, u)
            X[k], Y[k] = x, self._read()
            if k + 1 < len(t):
                x = self._through(float(now), x, u, float(t[k + 1] - now), n_sub, event)
                if not offered(x[:, None])[0]:
                    break
        return X, Y

    # ---- one point --------------------------------------------------------------------------------------------------
    def _one(self, t: float, x: np.ndarray, u: np.ndarray, values: tuple[float, ...], dt: float, n_sub: int) -> np.ndarray:  # fmt: skip
        """States a time ``dt`` later from a fresh start, outputs there without a substep."""
        try:
            self._begin(values, u, t)
            x, event = self._settled(t, x, u)
            if n_sub == 0:
                return self._read()
            return self._through(t, x, u, dt, n_sub, event)
        except Exception as error:  # FMPy's own, of a call that failed, and Refused
            self.unit.messages.keep(f"{type(error).__name__}: {error}")
            self._kept = None
            self.unit.renew(getattr(error, "status", 3) == 4)
            return np.full(len(x) if n_sub else len(self.unit.signals.outputs), np.nan)

    def _begin(self, values: tuple[float, ...], u: np.ndarray, t: float) -> None:
        """Back to the start: by a copy of the unit's state there, else anew."""
        instance = self.unit.instance
        if self._kept is not None and self._kept[0] is instance and self._kept[1] == values:
            (instance.setFMUstate if self.unit.signals.version == 2 else instance.setFMUState)(self._kept[2])
            return
        self._forget()
        self.unit.begin(values, u, min(t, 0.0))
        if self._copies:
            copy = instance.getFMUstate if self.unit.signals.version == 2 else instance.getFMUState
            self._kept = (instance, values, copy())

    def _forget(self) -> None:
        """Free the copy."""
        if self._kept is not None:
            instance, _, state = self._kept
            (instance.freeFMUstate if self.unit.signals.version == 2 else instance.freeFMUState)(state)
            self._kept = None

    def _settled(self, t: float, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, float]:
        """States after the events at a point, and the time of the next; inputs may jump there."""
        unit = self.unit
        self._put(t, x)
        unit.instance.enterEventMode()
        unit._set(unit.signals.inputs, u)
        event = unit.update()
        return unit.states(), event

    def _put(self, t: float, x: np.ndarray) -> None:
        """Time and states."""
        calls, c = self.unit.calls, self.unit.instance.component
        self._x[self.unit.signals.order] = x
        if calls.set_time(c, t) > 1 or calls.set_states(c, self._x.ctypes.data, len(x)) > 1:
            raise Refused(f"refuses t={t:g}, states {np.asarray(x).tolist()}")

    def _rates(self, t: float, x: np.ndarray) -> np.ndarray:
        self._put(t, x)
        if self.unit.calls.get_rates(self.unit.instance.component, self._dx.ctypes.data, len(x)) > 1:
            raise Refused(f"gives no derivatives at t={t:g}, states {np.asarray(x).tolist()}")
        return self._dx[self.unit.signals.order]

    def _read(self) -> np.ndarray:
        """Outputs where the unit is."""
        s = self.unit.signals
        found = np.empty(len(s.outputs))
        given = (s.outputs.ctypes.data, len(found), found.ctypes.data, *self.unit._tail(len(found)))
        if len(found) and self.unit.calls.get_real(self.unit.instance.component, *given) > 1:
            raise Refused("gives no outputs")
        return found

    def _signs(self, t: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Event indicators at a point, and whether each is positive."""
        self._put(t, x)
        if len(self._z) and self.unit.calls.get_indicators(self.unit.instance.component, self._z.ctypes.data, len(self._z)) > 1:  # fmt: skip
            raise Refused(f"gives no event indicators at t={t:g}")
        return self._z.copy(), self._z > 0

    def _through(self, t: float, x: np.ndarray, u: np.ndarray, dt: float, n_sub: int, event: float) -> np.ndarray:
        """States a time ``dt`` later, through all events between."""
        now, count = t, 0
        z, positive = self._signs(now, x)
        for k in range(n_sub):
            edge = t + dt if k == n_sub - 1 else t + (k + 1) * dt / n_sub
            while now < edge:
                until = max(min(edge, event), now)
                after = self._rk4(now, x, until - now)
                z1, positive1 = self._signs(until, after)
                crossed = np.flatnonzero(positive1 != positive)
                if len(crossed):
                    until, after = self._located(now, x, until - now, crossed, z, positive)
                now, x = until, after
                if not len(crossed) and now < event and not self._step_ends(now, x):
                    z, positive = z1, positive1
                    continue
                if count == _EVENTS_IN_SAMPLE:  # events pile up
                    return x
                count += 1
                x, event = self._settled(now, x, u)
                event = event if event > now else np.inf
                z, positive = self._signs(now, x)
        return x

    def _step_ends(self, t: float, x: np.ndarray) -> bool:
        """Whether the unit asks for an event after an accepted step."""
        if not self.unit.signals.completes_steps:
            return False
        self._put(t, x)
        event, ended = self.unit.instance.completedIntegratorStep()
        if ended:
            raise Refused(f"ends the simulation at t={t:g}")
        return bool(event)

    def _located(
        self, t: float, x: np.ndarray, h: float, crossed: np.ndarray, z: np.ndarray, positive: np.ndarray
    ) -> tuple[float, np.ndarray]:  # fmt: skip
        """Time and states behind the first crossing of zero within a substep."""

        def indicator(share: float, i: int) -> float:
            return float(self._signs(t + share, self._rk4(t, x, share))[0][i])

        near = _MOMENT_FOUND * h
        share = min(brentq(indicator, 0.0, h, args=(i,), xtol=near) if z[i] != 0 else 0.0 for i in crossed)
        while share < h and not np.any(self._signs(t + share, self._rk4(t, x, share))[1] != positive):
            share, near = min(share + near, h), 2 * near  # an event is met behind it
        return t + share, self._rk4(t, x, share)

    def _rk4(self, t: float, x: np.ndarray, h: float) -> np.ndarray:
        if h == 0.0:
            return x
        k1 = self._rates(t, x)
        k2 = self._rates(t + h / 2, x + (h / 2) * k1)
        k3 = self._rates(t + h / 2, x + (h / 2) * k2)
        return x + (h / 6) * (k1 + 2 * (k2 + k3) + self._rates(t + h, x + h * k3))
