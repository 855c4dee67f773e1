"""Free runs of an augmented model: substeps chosen by their error, Newton over time, scipy where it is stiff."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from sksurrogate.effects._families import BalanceEffect, LimitEffect
from sksurrogate.effects._model import BoundModel
from sksurrogate.effects._onset import Starting
from sksurrogate.kernels.integrate import close
from sksurrogate.kernels.windows import run_in_windows
from sksurrogate.physics._free_run import LONG_RUN, TOLERANCE

#: Sharp kinks want many substeps; all samples take them at once, so that their cost stays small.
MOST_SHARP_SUBSTEPS = 192
#: Substeps of the inputs where scipy integrates between them.
SUBSTEPS_OF_SHARP = 4
#: Its steps may be as short as this share of theirs: fast memories act as fast as they are.
FOLLOWED_BY_SCIPY = 1e-3
#: Right-hand sides that scipy may ask for between two substeps of the inputs: what needs more diverges.
MOST_CALLS = 20_000

#: Sizes of the run before from which on a run has been led away by its own steps: its size would hide every error.
LED_AWAY = 1e3
#: Effects have kinks, crossed now and then: these ask for fewer substeps than their own error would.
AT_KINKS = 1e-3
#: Likewise a jump in time; what it leaves stays to the end of the run, so it weighs more.
AT_JUMPS = 1e-2

Build = Callable[..., BoundModel]


def augmented_states(
    build: Build, X0: np.ndarray, scale: np.ndarray | None, method: str
) -> tuple[np.ndarray, BoundModel, bool]:
    """States of all runs.

    ``build`` ``build(n_sub, scale, bare=False) -> BoundModel``: ``bare`` leaves the effects out.
    ``X0`` (n_nominal_states, n_runs).
    ``scale`` (n_nominal_states,): sizes of the states; None: those of the free run without effects.
    ``method``: "auto", "RK4", or a method of :func:`scipy.integrate.solve_ivp`.
    Returns ``X`` (n_states, n_samples): not finite from where a run diverges.
    Returns ``bound``: the model that made them.
    Returns ``fixed``: whether a recursion of fixed operations made them, and not an integrator of scipy.
    """
    unit = np.ones(len(X0))
    first = build(1, unit)
    explicit = first.a.plant.access == "rhs" and method in ("auto", "RK4")
    guess = None
    if explicit or (scale is None and _smooths(first)):
        guess = _march(build(1, unit, bare=True), X0)
    if scale is None:
        scale = unit if guess is None else _sizes(guess)
    if first.a.plant.access == "step":
        bound = build(SUBSTEPS_OF_SHARP, scale)
        return _march(bound, X0), bound, True
    if not explicit:
        bound = build(SUBSTEPS_OF_SHARP, scale)
        return _adaptive(bound, X0, method), bound, False
    assert guess is not None
    X, bound = _explicit(build, X0, scale, guess)
    if method == "auto" and (bound.a.n_sub > MOST_SHARP_SUBSTEPS or not np.all(np.isfinite(X))):
        stiff = build(SUBSTEPS_OF_SHARP, scale)
        return _adaptive(stiff, X0, "LSODA"), stiff, False
    return X, bound, True


def _smooths(bound: BoundModel) -> bool:
    """Whether an effect smooths a kink over the size of a signal."""
    return any(isinstance(effect, BalanceEffect) and effect.variable for effect in bound.a.effects)


def _sizes(X: np.ndarray) -> np.ndarray:
    """Deviation of every state; its largest value where it does not move, 1 where it is nil or diverges."""
    spread, largest = np.std(X, axis=1), np.max(np.abs(X), axis=1)
    size = np.where(spread > 1e-9 * largest, spread, largest)
    return np.where(np.isfinite(size) & (size > 0), size, 1.0)


def _march(bound: BoundModel, X0: np.ndarray) -> np.ndarray:
    """Free runs by a loop over time, all runs of equal length at once."""
    starts, n_samples = bound.record.starts, bound.record.n_samples
    length = n_samples // len(starts)
    x = bound.start(X0[:, None])
    out = np.full((len(x), n_samples), np.nan)
    out[:, starts] = x[:, 0]
    for k in range(length - 1):
        x = bound(x, starts + k)
        out[:, starts + k + 1] = x[:, 0]
        if not np.any(np.isfinite(x)):
            break
    return out


def _explicit(build: Build, X0: np.ndarray, scale: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, BoundModel]:
    """Runge-Kutta with the substeps that the local error asks for, by Newton's method from the run without effects."""
    bound = build(2, scale)
    start = bound.start(X0[:, None])[:, 0]
    near = np.repeat(start, bound.record.n_samples // start.shape[1], axis=1)
    near[: len(guess)] = guess
    near[:, bound.record.starts] = start
    while True:
        X = _closed(bound, near)
        if X is None:
            X = _march(bound, X0) if bound.record.lengths[0] <= LONG_RUN else _in_windows(bound, start, near)
        wanted = _substeps_needed(build, bound, X, scale)
        if wanted <= bound.a.n_sub or bound.a.n_sub > MOST_SHARP_SUBSTEPS:
            return X, bound
        bound, near = build(wanted, scale), near if _has_run_away(X, near) else X


def _in_windows(bound: BoundModel, start: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Long free runs window by window, from initial states (n_states, n_runs); ``near``: runs that they may be near."""
    record, known = bound.record, bool(np.all(np.isfinite(near)))
    return run_in_windows(bound, start, record.starts, record.lengths, _sizes(near), near if known else None)


def _has_run_away(X: np.ndarray, near: np.ndarray) -> bool:
    """Whether a run (n_states, n_samples) is too far from another one to start from: steps that are too long grow without end."""
    return not np.max(np.abs(X) / _sizes(near)[:, None]) < LED_AWAY


def _closed(bound: BoundModel, near: np.ndarray) -> np.ndarray | None:
    """The free run by Newton's method over the time axis; None where it does not settle."""
    if not np.all(np.isfinite(near)):
        return None
    X, closed, _ = close(bound, near, bound.record.starts, _sizes(near), 1e-11)
    return X if closed and np.all(np.isfinite(X)) else None


def _substeps_needed(build: Build, bound: BoundModel, X: np.ndarray, scale: np.ndarray) -> int:
    """Compare one sample in ``n_sub`` and in ``2 n_sub`` substeps, for all samples at once."""
    n_sub = bound.a.n_sub
    if not np.all(np.isfinite(X)):
        return 4 * n_sub
    finer, rows = build(2 * n_sub, scale), _before_jumps(bound)
    once, twice = bound(X[:, None])[:, 0], finer(X[:, None])[:, 0]
    if len(rows):  # a jump at the end of a sample is spread to both sides of it: two samples together show its error
        once[:, rows], twice[:, rows] = (
            model(model(X[:, None, rows], rows), rows + 1)[:, 0] for model in (bound, finer)
        )
        once[:, rows + 1] = twice[:, rows + 1]
    error = np.max(np.abs(once - twice) / np.maximum(np.max(np.abs(X), axis=1), 1e-12)[:, None], axis=0)
    if not np.all(np.isfinite(error)):
        return 2 * n_sub
    jumps = [0.0, *error[rows]]
    worst = max(float(np.quantile(error, 0.85)), float(np.max(error)) * AT_KINKS, float(np.max(jumps)) * AT_JUMPS)
    return n_sub if worst <= TOLERANCE else int(np.ceil(n_sub * min((worst / TOLERANCE) ** 0.25 * 1.1, 8.0)))


def _before_jumps(bound: BoundModel) -> np.ndarray:
    """Rows of the samples, not the last of a run, at whose end an effect jumps: to within a substep."""
    t, later = bound.record.t, np.r_[~np.isin(np.arange(1, bound.record.n_samples), bound.record.starts), False]
    near = np.zeros(len(t), dtype=bool)
    for effect, values in zip(bound.a.effects, bound._parameters):
        for time in [value for parameter, value in zip(effect.parameters, values) if parameter.jumps]:
            near |= np.abs(t + bound.record.dt - np.ravel(time)[0]) < bound.h
    return np.flatnonzero(near & later)


def _adaptive(bound: BoundModel, X0: np.ndarray, method: str) -> np.ndarray:
    """scipy's integrator from substep to substep of the inputs, limits at the end of each."""
    starts, t = bound.record.starts, bound.record.t
    bound.followed = FOLLOWED_BY_SCIPY * bound.h
    length = bound.record.n_samples // len(starts)
    first = bound.start(X0[:, None])
    out = np.full((len(first), bound.record.n_samples), np.nan)
    out[:, starts] = first[:, 0]
    for start in starts:
        for row in range(start, start + length - 1):
            out[:, row + 1] = _one_sample(bound, out[:, row], float(t[row]), row, method)
            if not np.all(np.isfinite(out[:, row + 1])):
                break
    return out


def _one_sample(bound: BoundModel, x: np.ndarray, t: float, row: int, method: str) -> np.ndarray:
    """One sample by scipy's integrator; nan where it gives up."""
    mean, half, h = bound._mean[..., row], bound._half, bound.h
    column: Any = (slice(None), slice(0, 1), None)
    windows = any(isinstance(effect, LimitEffect) and isinstance(effect, Starting) for effect in bound.a.effects)
    steady = half is None and not windows and bool(np.all(mean == mean[:1]))
    for s in range(1 if steady else len(mean)):
        width = bound.record.dt if steady else h
        u, rise = mean[s][column], None if half is None else half[..., row][s][column]

        def rhs(now: float, z: np.ndarray, u=u, rise=rise, begin=t, width=width) -> np.ndarray:
            acting = u if rise is None else u + (2 * (now - begin) / width - 1) * rise
            return bound.derivative(np.array([now]), bound.clip(z[:, None, None], now), acting)[:, 0, 0]

        size = np.maximum(bound.a.scale, np.abs(x))
        end = _end_of(rhs, t, width, x, method, 1e-8, 1e-10 * size)
        if end is None:  # where a limit sets in, the finest steps may not end
            end = _end_of(rhs, t, width, x, method, 1e-6, 1e-8 * size)
        if end is None:
            return np.full(len(x), np.nan)  # the caller reports the divergence
        t = t + width
        x = bound.clip(end[:, None, None], t, True)[:, 0, 0]
    return x


def _end_of(
    rhs: Callable[[float, np.ndarray], np.ndarray],
    t: float,
    width: float,
    x: np.ndarray,
    method: str,
    rtol: float,
    atol: np.ndarray,
) -> np.ndarray | None:
    """States (n_states,) a time later; None where they are not finite, or the integrator gives up or needs :data:`MOST_CALLS`."""
    calls = itertools.count()

    def counted(now: float, z: np.ndarray) -> np.ndarray:
        if next(calls) > MOST_CALLS:
            raise ValueError("diverges")
        return rhs(now, z)

    try:
        solution = solve_ivp(counted, (t, t + width), x, method=method, rtol=rtol, atol=atol)
    except ValueError:
        return None
    return solution.y[:, -1] if solution.success else None
