"""Events of a right-hand side: a state that jumps when a condition falls through zero."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._rhs import PointwiseFunction

#: Largest difference between one sample in n and in 2 n substeps, relative to each state.
_EVENT_TOLERANCE = 1e-8
_MOST_SUBSTEPS_TRIED = 64
#: So many substeps are tried first where there are events, which a longer one may pass over.
_FEWEST_WITH_EVENTS = 4
#: Events that one point may have within a substep; with more (a ball at rest) it stays on the event.
_EVENTS_IN_SUBSTEP = 4
#: Share of a step after which a point that starts on an event must have risen.
_SHORT = 1e-3
#: Steps of the search for the moment of an event.
_LOCATE = 30


class EventMap:
    """The map from sample to sample of a right-hand side with events, for many points at once.

    ``rhs`` callable ``rhs(t, x, u, p)``.
    ``events`` sequence of (when, then): ``when(t, x, u, p)`` falls through zero, and the states become ``then(t, x, u,
        p)``.
    """

    def __init__(self, rhs: Callable[..., Any], events: Sequence[tuple[Any, Any]], states: Sequence[str]):
        self.rhs = PointwiseFunction(rhs, len(states), "rhs", states)
        self.pairs = []
        for k, pair in enumerate(events):
            if not (isinstance(pair, (tuple, list)) and len(pair) == 2 and all(callable(part) for part in pair)):
                raise SimulatorError(
                    f"events[{k}]={pair!r}: expected (when, then), two functions of (t, x, u, p): the states become then(...) "
                    "at the moment when(...) falls through zero."
                )
            when = PointwiseFunction(pair[0], 1, f"events[{k}] when", ["condition"])
            self.pairs.append((when, PointwiseFunction(pair[1], len(states), f"events[{k}] then", states)))

    def sample(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], dt: float) -> np.ndarray:
        """States (n_states, n_points) a time ``dt`` later under held inputs, each point in as many substeps as its error asks for."""
        times, out = np.broadcast_to(np.asarray(t, dtype=float), x.shape[1:]), np.empty_like(x, dtype=float)
        rows, n_sub = np.arange(x.shape[1]), _FEWEST_WITH_EVENTS if self.pairs else 1
        coarse, _ = self._march(times, x, u, p, dt, n_sub)
        while True:
            n_sub *= 2
            at = x[:, rows]
            fine, rested = self._march(times[rows], at, u[:, rows], _of(p, rows), dt, n_sub)
            out[:, rows] = fine
            error = np.max(np.abs(fine - coarse) / (np.maximum(np.abs(at), np.abs(fine)) + 1e-12), axis=0)
            open_ = np.isfinite(error) & ~rested & (error > _EVENT_TOLERANCE)
            if n_sub >= _MOST_SUBSTEPS_TRIED or not open_.any():
                return out
            rows, coarse = rows[open_], fine[:, open_]

    def _march(
        self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], dt: float, n_sub: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """States after ``n_sub`` steps; which points came to rest on an event."""
        h = np.full(x.shape[1], float(dt) / n_sub)
        rested = np.zeros(x.shape[1], bool)
        for s in range(n_sub):
            x = self._substep(t + s * h, x, u, p, h, rested)
        return x, rested

    def _substep(
        self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], h: np.ndarray, rested: np.ndarray
    ) -> np.ndarray:
        """A Runge-Kutta step, cut at events."""
        out = np.where(rested, x, self._rk4(t, x, u, p, h))
        h = np.where(rested, 0.0, h)
        active = np.arange(x.shape[1])
        start, end, left, now = x, out, h, t
        for count in range(_EVENTS_IN_SUBSTEP + 1):
            q, v = _of(p, active), u[:, active]
            which, share = self._first(now, start, end, v, q, left)
            hit = np.flatnonzero(which >= 0)
            if not len(hit):
                return out
            active, which, share = active[hit], which[hit], share[hit]
            q, v = _of(p, active), u[:, active]
            start, left, now = start[:, hit], left[hit], now[hit]
            at, passed = self._rk4(now, start, v, q, share * left), now + share * left
            for k, (_, then) in enumerate(self.pairs):
                rows = np.flatnonzero(which == k)
                if len(rows):
                    at[:, rows] = then(passed[rows], at[:, rows], v[:, rows], _of(q, rows))
            out = out.copy()
            left, now, start = left * (1.0 - share), passed, at
            if count == _EVENTS_IN_SUBSTEP:  # events pile up: the point stays where the last one left it
                out[:, active] = at
                rested[active] = True
                return out
            end = self._rk4(now, start, v, q, left)
            out[:, active] = end
        return out

    def _first(
        self, t: np.ndarray, x: np.ndarray, end: np.ndarray, u: np.ndarray, p: Mapping[str, Any], h: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Number of the first event of every point (-1: none) and the share of the step at which it happens."""
        which, share = np.full(x.shape[1], -1), np.ones(x.shape[1])
        for k, (when, _) in enumerate(self.pairs):
            before, after = when(t, x, u, p)[0], when(t + h, end, u, p)[0]
            begin, tiny = np.zeros(len(h)), 1e-12 * (1.0 + np.maximum(np.abs(before), np.abs(after)))
            on = np.flatnonzero((before <= tiny) & (after < -tiny) & (h > 0))
            if len(on):  # it starts on the event: does it rise and fall again within the step, or fall at once?
                short, v, q = _SHORT * h[on], u[:, on], _of(p, on)
                begin[on] = _SHORT
                before[on] = when(t[on] + short, self._rk4(t[on], x[:, on], v, q, short), v, q)[0]
                falls = on[before[on] <= 0]
                which[falls], share[falls] = k, 0.0
            rows = np.flatnonzero((before > np.where(begin > 0, 0.0, tiny)) & (after <= 0) & (h > 0))
            if len(rows):
                v, q = u[:, rows], _of(p, rows)
                ends = (begin[rows], before[rows], after[rows])
                found = self._locate(when, t[rows], x[:, rows], v, q, h[rows], *ends)
                earlier = (found < share[rows]) | (which[rows] < 0)
                which[rows], share[rows] = np.where(earlier, k, which[rows]), np.minimum(found, share[rows])
        return which, share

    def _locate(
        self, when: PointwiseFunction, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], h: np.ndarray,
        begin: np.ndarray, high: np.ndarray, low: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """Share of the step at which ``when`` is zero: false position after Illinois, all points at once."""
        a, b, fa, fb = begin, np.ones_like(h), high, low
        side = np.full(len(h), -1)
        for _ in range(_LOCATE):
            c = np.where(fa - fb > 0, (a * -fb + b * fa) / np.where(fa - fb > 0, fa - fb, 1.0), (a + b) / 2)
            fc = when(t + c * h, self._rk4(t, x, u, p, c * h), u, p)[0]
            above = fc > 0
            again = above == side
            fa, fb = np.where(above, fc, np.where(again, fa / 2, fa)), np.where(above, np.where(again, fb / 2, fb), fc)
            a, b, side = np.where(above, c, a), np.where(above, b, c), above.astype(int)
            if np.all((b - a < 1e-12) | (np.abs(fc) < 1e-11 * (np.abs(high) + np.abs(low)))):
                return c
        return b

    def _rk4(self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], h: np.ndarray) -> np.ndarray:
        k1 = self.rhs(t, x, u, p)
        k2 = self.rhs(t + h / 2, x + (h / 2) * k1, u, p)
        k3 = self.rhs(t + h / 2, x + (h / 2) * k2, u, p)
        return x + (h / 6) * (k1 + 2 * (k2 + k3) + self.rhs(t + h, x + h * k3, u, p))


def _of(p: Mapping[str, Any], rows: np.ndarray) -> dict[str, Any]:
    """Parameters of these points."""
    return {k: (v[rows] if isinstance(v, np.ndarray) and v.ndim else v) for k, v in p.items()}
