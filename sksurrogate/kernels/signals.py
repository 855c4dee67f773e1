"""Input signals between the samples: linear pieces on a grid of substeps, and what actuators do to them.

A :class:`Signal` holds, for every substep, the mean and half the rise of the input. Zero-order hold and first-order hold
are exact in this form; delays and lags are kept to the zeroth and first moment of every substep, so that a simulation
with them converges as one with a smooth input and depends smoothly on the delay. What an output shows of them at a sample
stands beside these moments.

Arrays are ``(n_sub, n_columns, n_samples)`` for one input: column = candidate or perturbation, ``n_samples`` = stacked runs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.kernels.banded import first_order_scan

#: Paths that follow an input number by number: of more a call of NumPy for every sample is sooner done.
FOLLOWED_ONE_BY_ONE = 16


@dataclass(frozen=True, eq=False)
class Signal:
    """One input as linear pieces."""

    mean: np.ndarray  #: (n_sub, n_columns, n_samples)
    half: np.ndarray | None = None  #: Half the rise over the substep; None where the signal is constant within a sample
    #: (n_columns, n_samples): value at every sample; None where it is that at the start of the first substep
    shown: np.ndarray | None = None

    def at_samples(self) -> np.ndarray:
        """Value at every sample (n_columns, n_samples)."""
        return self.start()[0] if self.shown is None else self.shown

    def start(self) -> np.ndarray:
        """Value at the start of every substep."""
        return self.mean if self.half is None else self.mean - self.half

    def end(self) -> np.ndarray:
        """Value at the end of every substep."""
        return self.mean if self.half is None else self.mean + self.half


def hold(u: np.ndarray, n_sub: int, order: int, starts: np.ndarray) -> Signal:
    """Samples ``u`` (n_samples,) held (``order=0``) or joined linearly (``order=1``)."""
    if order == 0:
        return Signal(np.broadcast_to(u, (n_sub, 1, len(u))))
    following = np.r_[u[1:], u[-1]]
    ends = np.r_[starts[1:], len(u)] - 1
    following[ends] = u[ends]
    rise = (following - u) / n_sub
    place = np.arange(n_sub)[:, None, None] + 0.5
    return Signal(u + place * rise, np.broadcast_to(rise / 2, (n_sub, 1, len(u))))


def pointwise(g: Callable[[np.ndarray], np.ndarray], signal: Signal) -> Signal:
    """A static characteristic g(u); exact for held inputs, Simpson's rule within a substep otherwise."""
    if signal.half is None:
        return Signal(g(signal.mean))
    first, middle, last = g(signal.start()), g(signal.mean), g(signal.end())
    return Signal((first + 4 * middle + last) / 6, (last - first) / 2, g(signal.at_samples()))


def _by_time(values: np.ndarray) -> np.ndarray:
    """(n_sub, n_columns, n_samples) -> (n_columns, n_samples * n_sub) in order of time."""
    n_sub, n_columns, n_samples = values.shape
    return values.transpose(1, 2, 0).reshape(n_columns, n_samples * n_sub)


def _by_substep(values: np.ndarray, n_sub: int) -> np.ndarray:
    """Inverse of :func:`_by_time`."""
    n_columns, n = values.shape
    return np.ascontiguousarray(values.reshape(n_columns, n // n_sub, n_sub).transpose(2, 0, 1))


def _over_columns(
    one: Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]], signal: Signal, size: np.ndarray
) -> Signal:
    """Apply ``one(mean, half, size)`` to every column; equal sizes on equal signals are computed once.

    It gives means, half rises and the values at the starts of the substeps.
    """
    given, rise = np.broadcast_arrays(signal.mean, np.zeros_like(signal.mean) if signal.half is None else signal.half)
    n_sub, n_given, _ = given.shape
    size = np.ravel(size)
    mean, half = _by_time(given), _by_time(rise)
    n_columns = max(n_given, len(size))
    out = np.empty((3, n_columns, mean.shape[1]))
    known: dict[tuple[float, int], int] = {}
    for c in range(n_columns):
        source = c if n_given > 1 else 0
        value = float(size[c if len(size) > 1 else 0])
        twin = known.setdefault((value, source), c)
        out[:, c] = one(mean[source], half[source], value) if twin == c else out[:, twin]
    return Signal(_by_substep(out[0], n_sub), _by_substep(out[1], n_sub), out[2, :, ::n_sub])


#: What a signal was before every run: one value, one for each run with nan for its first value, or None for that in all.
Before = float | np.ndarray | None


def _before_run(first: np.ndarray, before: Before) -> np.ndarray:
    """What the signal was before every run, whose first value is ``first`` (..., n_runs)."""
    return first if before is None else np.where(np.isnan(before), first, before)


def delay(signal: Signal, time: np.ndarray, h: float, starts: np.ndarray, before: Before = None) -> Signal:
    """``u(t - time)``. Exact in the first two moments of every substep.

    ``time`` (n_columns,): delay of every column, >= 0.
    ``h``: width of a substep.
    ``starts`` int (n_runs,): first sample of every run.
    ``before`` float or (n_runs,): the input before the first row of a run; None or nan: the value of that row.
    """
    n_sub = len(signal.mean)
    n = signal.mean.shape[2] * n_sub
    firsts = starts * n_sub
    run = np.repeat(np.arange(len(starts)), np.diff(np.r_[firsts, n]))
    first = firsts[run]

    def one(mean: np.ndarray, half: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        m, phi = delay_in_substeps(size, h, n)
        held = _before_run((mean - half)[firsts], before)[run]
        late, later = np.arange(n) - m, np.arange(n) - m - 1
        in2, in1 = late >= first, later >= first
        late, later = np.maximum(late, first), np.maximum(later, first)
        a2, b2 = np.where(in2, mean[late], held), np.where(in2, half[late], 0.0)
        a1, b1 = np.where(in1, mean[later], held), np.where(in1, half[later], 0.0)
        return delayed_piece((a1, b1), (a2, b2), phi)

    return _over_columns(one, signal, time)


def lag(
    signal: Signal, time_constant: np.ndarray, h: float, starts: np.ndarray, before: Before = None, falling: float = 1.0
) -> Signal:
    """``c dw/dt + w = u``, ``w(0) = before``, solved exactly and kept to two moments a substep.

    Parameters as :func:`delay`, with the time constant of every column.
    ``falling``: how many times as fast it falls as it rises.
    """
    n_sub = len(signal.mean)
    firsts = starts * n_sub

    def one(mean: np.ndarray, half: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        k = max(size / h, 1e-15)  # time constant in substeps
        decay, first = float(np.exp(-1.0 / k)), _before_run((mean - half)[firsts], before)
        if falling != 1.0:
            return _lag_either_way(mean, half, first, firsts, k, max(k / falling, 1e-15))
        b, _, _ = lag_piece(mean, half, 0.0, k)
        b[firsts] += decay * first
        ends = first_order_scan(decay, b, firsts)
        w0 = np.r_[first[0], ends[:-1]]
        w0[firsts] = first
        return *lag_piece(mean, half, w0, k)[1:], w0

    return _over_columns(one, signal, time_constant)


def _lag_either_way(
    mean: np.ndarray, half: np.ndarray, first: np.ndarray, firsts: np.ndarray, rising: float, falling: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, half rise and first value in every substep of a lag with two time constants, in substeps: where it rises and where it falls.

    Exact where the input is held in every substep: there w turns at edges only.
    """
    (a_up, b_up), (a_down, b_down) = (
        (float(np.exp(-1.0 / k)), lag_piece(mean, half, 0.0, k)[0].tolist()) for k in (rising, falling)
    )
    w0, aims = np.empty(len(mean)), (mean + half).tolist()
    for a, b, w in zip(firsts, [*firsts[1:], len(mean)], first.tolist()):
        for row in range(a, b):
            w0[row] = w
            w = a_up * w + b_up[row] if aims[row] > w else a_down * w + b_down[row]
    rises, up, down = mean + half > w0, *(lag_piece(mean, half, w0, k)[1:] for k in (rising, falling))
    return np.where(rises, up[0], down[0]), np.where(rises, up[1], down[1]), w0


def lag_piece(mean: Any, half: Any, w0: Any, k: float) -> tuple[Any, Any, Any]:
    """A first-order lag over a substep, from ``w0``: its end, and mean and half rise that keep two moments; ``k`` in substeps."""
    p, q = mean - half, 2 * half
    decay, rise = np.exp(-1.0 / k), -np.expm1(-1.0 / k)  # rise = 1 - decay
    d = w0 - p + q * k
    moment = 2 * k * k * rise - k * (1 + decay) if k < 100 else -1 / (6 * k) + 1 / (12 * k**2) - 1 / (40 * k**3)
    end = decay * w0 + p * rise + q * (1 - k * rise)
    return end, p + q / 2 - q * k + d * k * rise, half + 3 * d * moment


def _first_of_run(starts: np.ndarray, n: int) -> np.ndarray:
    """For each row, the first row of its run."""
    return np.repeat(starts, np.diff(np.r_[starts, n]))


def play(signal: Signal, half_width: np.ndarray, starts: np.ndarray, before: Before = None) -> Signal:
    """Backlash: ``w[k] = clip(w[k-1], u[k] - c, u[k] + c)``, starts at the first value, or from ``before``.

    Clips compose to clips, so that the recursion is a prefix scan of log2(n) vectorised passes.
    """
    n_sub = len(signal.mean)
    held = signal.half is None
    nodes = (
        _by_time(signal.mean[:1])
        if held
        else _by_time(np.stack([signal.start(), signal.end()], 1).reshape(2 * n_sub, *signal.mean.shape[1:]))
    )
    per_sample = 1 if held else 2 * n_sub
    width = np.reshape(half_width, (-1, 1))
    n = nodes.shape[1]
    low, high = np.broadcast_arrays(nodes - width, nodes + width)
    low, high = low.copy(), high.copy()
    firsts = starts * per_sample
    low[:, firsts] = high[:, firsts] = np.clip(_before_run(nodes[:, firsts], before), low[:, firsts], high[:, firsts])
    age = np.arange(n) - _first_of_run(firsts, n)
    step = 1
    while step < n:
        rows = np.flatnonzero(age >= step)
        if not len(rows):
            break
        a, b = low[:, rows - step], high[:, rows - step]
        low[:, rows], high[:, rows] = np.clip(a, low[:, rows], high[:, rows]), np.clip(b, low[:, rows], high[:, rows])
        step *= 2
    if held:
        return Signal(np.broadcast_to(low, (n_sub, *low.shape)))
    pairs = _by_substep(low, per_sample).reshape(n_sub, 2, len(low), -1)
    return Signal((pairs[:, 0] + pairs[:, 1]) / 2, (pairs[:, 1] - pairs[:, 0]) / 2)


def rate_limit(
    signal: Signal, limit: np.ndarray, h: float, starts: np.ndarray, before: Before = None, falling: float = 1.0
) -> Signal:
    """``abs(dw/dt) <= c`` towards the input, starts at its first value or at ``before``; the ramp ends exactly where it meets a held input.

    ``falling``: how many times as fast it falls as it rises.
    """
    n_sub = len(signal.mean)
    target = _by_time(signal.end())
    reach = np.reshape(limit, (-1, 1)) * h
    target, reach = np.broadcast_arrays(target, np.broadcast_to(reach, (max(len(target), len(reach)), 1)))
    n = target.shape[1]
    first = _before_run(_by_time(signal.start())[:, starts * n_sub], before)
    up = reach[:, :1]
    down = falling * up
    ahead = _followed(target, np.broadcast_to(first, (len(target), first.shape[1])), down, up, np.r_[starts * n_sub, n])
    r = np.where(target > ahead, up, down)
    mean, half = ramp_piece(ahead, target, r)
    if signal.half is not None:  # where it follows from end to end, it is the input
        u, rise = np.broadcast_to(_by_time(signal.mean), mean.shape), np.broadcast_to(_by_time(signal.half), mean.shape)
        met = np.abs(ahead - target) <= r
        follows = met & (np.abs(ahead - (u - rise)) <= 1e-12 * (np.abs(u) + np.abs(rise)))
        mean, half = np.where(follows, u, mean), np.where(follows, rise, half)
    return Signal(_by_substep(mean, n_sub), _by_substep(half, n_sub), ahead[:, ::n_sub])


def _followed(
    target: np.ndarray, first: np.ndarray, down: np.ndarray, up: np.ndarray, bounds: np.ndarray
) -> np.ndarray:
    """``w[k + 1] = w[k] + clip(target[k] - w[k], -down, up)`` in every run, (n_columns, n_rows).

    Each sample depends on the last: a loop over time, all runs and columns at once, the longest runs first so that those that are
    left stand together.

    ``first`` (n_columns, n_runs); ``down``, ``up`` (n_columns, 1).
    ``bounds``: first rows of the runs, and the number of rows.
    """
    if first.size <= FOLLOWED_ONE_BY_ONE and np.isfinite(up).all():
        return _followed_one_by_one(target, first, down, up, bounds)
    lengths = np.diff(bounds)
    longest_first = np.argsort(-lengths, kind="stable")
    age = np.arange(bounds[-1]) - np.repeat(bounds[:-1], lengths)
    rank = np.repeat(np.argsort(longest_first, kind="stable"), lengths)
    order = np.lexsort((rank, age))
    ends = np.cumsum(np.bincount(age)).tolist()
    targets, w, least, most = target.T[order], first.T[longest_first], -down.T, up.T
    out, begin = np.empty_like(targets), 0
    for end in ends:
        w = w[: end - begin]
        out[begin:end] = w
        step = targets[begin:end] - w
        np.minimum(np.maximum(step, least, out=step), most, out=step)
        w = w + step
        begin = end
    ahead = np.empty(target.shape)
    ahead[:, order] = out.T
    return ahead


def _followed_one_by_one(
    target: np.ndarray, first: np.ndarray, down: np.ndarray, up: np.ndarray, bounds: np.ndarray
) -> np.ndarray:
    """The same, number by number: sooner done for few columns than a call of NumPy for every sample."""
    ahead = np.empty(target.shape)
    for row, begins, least, most, out in zip(target, first.tolist(), (-down[:, 0]).tolist(), up[:, 0].tolist(), ahead):
        for a, b, w in zip(bounds[:-1], bounds[1:], begins):
            path = []
            for aim in row[a:b].tolist():
                path.append(w)
                step = aim - w
                step = least if step < least else step
                w += most if step > most else step
            out[a:b] = path
    return ahead


def ramp_piece(before: Any, target: Any, reach: Any) -> tuple[Any, Any]:
    """Mean and half rise over a substep of a ramp from ``before`` to a held ``target`` that goes at most ``reach`` far."""
    d = before - target
    met = np.abs(d) <= reach
    steep = np.where(met, 0.0, reach)  # an infinite limit is always met
    f = np.minimum(np.abs(d) / np.maximum(reach, 1e-300), 1.0)
    mean = np.where(met, target + d * f / 2, before - np.sign(d) * steep / 2)
    return mean, np.where(met, d * (f * f - 1.5 * f), -np.sign(d) * steep / 2)


def delayed_piece(later: tuple[Any, Any], late: tuple[Any, Any], phi: float) -> tuple[Any, Any, Any]:
    """A substep of a signal that is late by a share ``phi`` of a substep: mean, half rise and first value.

    ``later`` and ``late`` are (mean, half rise) of the substeps that end and begin within it.
    """
    (a1, b1), (a2, b2) = later, late
    cube = (2 * phi - 1) ** 3
    mean = phi * (a1 + b1 * (1 - phi)) + (1 - phi) * (a2 - b2 * phi)
    half = 3 * (
        (a1 + 2 * (1 - phi) * b1 - a2 + 2 * phi * b2) * (phi * phi - phi) + b1 * (cube + 1) / 6 + b2 * (1 - cube) / 6
    )
    return mean, half, a1 + b1 * (1 - 2 * phi) if phi > 0 else a2 - b2


def delay_in_substeps(time: float, h: float, most: int) -> tuple[int, float]:
    """A delay as whole substeps, at most so many, and the share of one."""
    whole = max(time, 0.0) / h
    m = int(min(np.floor(whole), most))
    return m, min(whole - m, 1.0) if m < most else 0.0


def stacked(signals: list[Signal]) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
    """Means and half rises (n_sub, n_inputs, n_columns | 1, n_samples) of signals, values at the samples."""
    mean, shown = _stack([s.mean for s in signals]), _stack([s.at_samples()[None] for s in signals])[0]
    if all(s.half is None for s in signals):
        return mean, None, shown
    half = _stack([np.zeros_like(s.mean) if s.half is None else s.half for s in signals])
    return mean, np.broadcast_to(half, mean.shape), shown


def _stack(parts: list[np.ndarray]) -> np.ndarray:
    """(n_sub, n_columns | 1, n_samples) of every input -> (n_sub, n_inputs, n_columns | 1, n_samples)."""
    if all(part.shape[1] == 1 for part in parts):
        return np.stack(parts, axis=1)
    return np.stack(np.broadcast_arrays(*parts), axis=1)
