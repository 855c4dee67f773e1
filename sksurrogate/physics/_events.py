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
#: A condition of this share of what it is at the ends of the sample is zero.
_ZERO = 1e-9
#: What falls with a speed does at half a time half as much as at the whole; below this share it falls from rest.
_FROM_REST = 0.4
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
        zero = self._zero(times, x, u, p, dt)
        coarse, _ = self._march(times, x, u, p, dt, n_sub, zero)
        while True:
            n_sub *= 2
            at = x[:, rows]
            fine, rested = self._march(times[rows], at, u[:, rows], _of(p, rows), dt, n_sub, zero[:, rows])
            out[:, rows] = fine
            error = np.max(np.abs(fine - coarse) / (np.maximum(np.abs(at), np.abs(fine)) + 1e-12), axis=0)
            open_ = np.isfinite(error) & ~rested & (error > _EVENT_TOLERANCE)
            if n_sub >= _MOST_SUBSTEPS_TRIED or not open_.any():
                return out
            rows, coarse = rows[open_], fine[:, open_]

    def _zero(self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], dt: float) -> np.ndarray:
        """Values up to which every condition counts as zero, (n_events, n_points)."""
        if not self.pairs:
            return np.zeros((0, x.shape[1]))
        end = self._rk4(t, x, u, p, np.full(x.shape[1], float(dt)))
        ends = [(when(t, x, u, p)[0], when(t + dt, end, u, p)[0]) for when, _ in self.pairs]
        return np.array([_ZERO * np.maximum(np.abs(a), np.abs(b)) for a, b in ends])

    def _march(
        self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], dt: float, n_sub: int, zero: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """States after ``n_sub`` steps; which points came to rest on an event."""
        h = np.full(x.shape[1], float(dt) / n_sub)
        rested = np.zeros(x.shape[1], bool)
        for s in range(n_sub):
            x = self._substep(t + s * h, x, u, p, h, rested, zero)
        return x, rested

    def _substep(
        self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], h: np.ndarray, rested: np.ndarray,
        zero: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """A Runge-Kutta step, cut at events."""
        out = np.where(rested, x, self._rk4(t, x, u, p, h))
        h = np.where(rested, 0.0, h)
        active = np.arange(x.shape[1])
        start, end, left, now = x, out, h, t
        for count in range(_EVENTS_IN_SUBSTEP + 1):
            q, v = _of(p, active), u[:, active]
            which, share = self._first(now, start, end, v, q, left, zero[:, active])
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
        self,
        t: np.ndarray,
        x: np.ndarray,
        end: np.ndarray,
        u: np.ndarray,
        p: Mapping[str, Any],
        h: np.ndarray,
        zero: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Number of the first event of every point (-1: none) and the share of the step at which it happens.

        A condition that is below zero has fallen through it: its event does not happen again until it has risen.
        """
        which, share = np.full(x.shape[1], -1), np.ones(x.shape[1])
        for k, (when, _) in enumerate(self.pairs):
            before, after = when(t, x, u, p)[0], when(t + h, end, u, p)[0]
            begin, tiny = np.zeros(len(h)), zero[k]
            on = np.flatnonzero((np.abs(before) <= tiny) & (after < 0.0) & (h > 0))
            if len(on):  # it starts on the event: does it rise and fall again within the step, or fall at once?
                v, q, here = u[:, on], _of(p, on), before[on]
                begin[on] = _SHORT
                before[on], falls = self._held(k, t[on], x[:, on], v, q, _SHORT * h[on], here)
                which[on[falls]], share[on[falls]] = k, 0.0
            rows = np.flatnonzero((before > np.where(begin > 0, 0.0, tiny)) & (after <= 0) & (h > 0))
            if len(rows):
                v, q = u[:, rows], _of(p, rows)
                ends = (begin[rows], before[rows], after[rows])
                found = self._locate(when, t[rows], x[:, rows], v, q, h[rows], *ends)
                earlier = (found < share[rows]) | (which[rows] < 0)
                which[rows], share[rows] = np.where(earlier, k, which[rows]), np.minimum(found, share[rows])
        return which, share

    def _held(
        self,
        k: int,
        t: np.ndarray,
        x: np.ndarray,
        u: np.ndarray,
        p: Mapping[str, Any],
        short: np.ndarray,
        here: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Condition k a short time after points on its zero, and whether its event happens there again.

        It does where the states after it rise from there (a ball that falls onto the floor), and where the condition falls from rest (a
        ball that lies on it). Where it falls with a speed that the event does not turn, this event has happened.
        """
        when, then = self.pairs[k]

        def ahead(start: np.ndarray, step: np.ndarray) -> np.ndarray:
            return np.asarray(when(t + step, self._rk4(t, start, u, p, step), u, p)[0])

        later, half = ahead(x, short), ahead(x, 0.5 * short)
        turned = ahead(then(t, x, u, p), short) > here
        from_rest = np.abs(half - here) < _FROM_REST * np.abs(later - here)
        return later, (later <= 0.0) & (turned | from_rest)

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
