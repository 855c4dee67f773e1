"""Free runs of a right-hand side: substeps chosen by their error, for all samples or for each; scipy's integrators for stiff plants."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from sksurrogate.exceptions import SimulationDiverged, SimulatorError
from sksurrogate.kernels.integrate import march, rk4
from sksurrogate.kernels.signals import hold
from sksurrogate.kernels.windows import run_in_windows
from sksurrogate.physics._own_substeps import run_with_own_substeps

#: Largest local error of a sample, relative to the size of the state, that the choice of substeps accepts.
TOLERANCE = 1e-8
#: Evaluations of the right-hand side in a stretch, beside 2000 a sample, after which the integrator counts as stuck.
MOST_EVALUATIONS = 20_000
#: Share of a sample after which states that begin at 0 show their size.
FIRST_INSTANT = 1e-6
#: More substeps than this and the plant counts as stiff.
MOST_PLANT_SUBSTEPS = 48
#: Runs of more samples are closed window by window where many points cost little more than one.
LONG_RUN = 1_000

#: Why an export cannot equal such a run.
OF_SCIPY = (
    "An integrator simulates this run with variable steps, so no export with fixed steps equals it. Choose n_sub and "
    'compare, or simulate with method="RK4", hold="zoh" and without events.'
)

#: The way out of a run that diverged.
REMEDY = (
    'Check x0, the units of the inputs and the signs in rhs. A stiff plant may want method="LSODA" or a smaller dt; an rhs that jumps '
    "(np.sign, an if) stops the integrator where the plant rests on the jump: write np.tanh(v / width)."
)

Derivative = Callable[[Any, np.ndarray, np.ndarray], np.ndarray]


def hold_inputs(U: np.ndarray, n_sub: int, order: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Inputs (n_runs, n_samples, n_inputs) as substep means and half rises (n_sub, n_inputs, n_runs, n_samples)."""
    n_runs, n_samples, n_inputs = U.shape
    signals = [hold(U[r, :, i], n_sub, order, np.array([0])) for i in range(n_inputs) for r in range(n_runs)]
    if not signals:
        return np.zeros((n_sub, 0, n_runs, n_samples)), None
    mean = np.stack([s.mean[:, 0] for s in signals], 1).reshape(n_sub, n_inputs, n_runs, n_samples)
    if order == 0:
        return mean, None
    half = np.stack([s.half[:, 0] for s in signals if s.half is not None], 1).reshape(mean.shape)
    return mean, half


def free_run(
    derivative: Derivative,
    U: np.ndarray,
    X0: np.ndarray,
    t: np.ndarray,
    *,
    order: int,
    method: str,
    many: bool = False,
    n_sub: int | None = None,
) -> np.ndarray:
    """States of runs of equal length.

    ``derivative`` (t, x, u) -> dx/dt on arrays (n, n_runs), ``U`` (n_runs, n_samples, n_inputs), ``X0`` (n_runs,
        n_states), ``t`` (n_samples,).
    ``order`` {0, 1}: hold.
    ``method``: "auto", "RK4", or a method of :func:`scipy.integrate.solve_ivp`.
    ``many``: whether many points cost little more than one: then long runs are closed by Newton's method, window by
        window, and the samples of a plant that is stiff now and then have substeps of their own.
    ``n_sub``: with "auto" and "RK4": this many substeps per sample ("auto": unless the run becomes infinite or nan with
        them); None: as many as the local error asks for.
    Returns (n_runs, n_samples, n_states): not finite from where a run diverges.
    """
    if X0.shape[1] == 0:
        return np.zeros((len(U), len(t), 0))
    with np.errstate(all="ignore"):
        if method in ("auto", "RK4"):
            windows = many and len(t) > LONG_RUN
            if n_sub is not None:
                X = _explicit(derivative, U, X0, t, order, windows, n_sub)[0]
                if method == "RK4" or np.all(np.isfinite(X)):
                    return X
            X, n_sub = _explicit(derivative, U, X0, t, order, windows, most=_most(method))
            if method == "RK4" or (n_sub <= MOST_PLANT_SUBSTEPS and np.all(np.isfinite(X))):
                return X
            own = run_with_own_substeps(derivative, U, X0, t, _widths(t), order=order, near=X) if windows else None
            if own is not None:
                return own
            method = "LSODA"
        return np.stack([_adaptive(derivative, U[r], X0[r], t, order, method) for r in range(len(U))])


def substeps(
    derivative: Derivative,
    U: np.ndarray,
    X0: np.ndarray,
    t: np.ndarray,
    order: int,
    *,
    method: str = "auto",
    many: bool = False,
) -> int | None:
    """Substeps per sample that :func:`free_run` takes along these runs; None where scipy's integrators take them."""
    if method not in ("auto", "RK4"):
        return None
    with np.errstate(all="ignore"):
        X, n_sub = _explicit(derivative, U, X0, t, order, many and len(t) > LONG_RUN, most=_most(method))
    return n_sub if method == "RK4" or (n_sub <= MOST_PLANT_SUBSTEPS and np.all(np.isfinite(X))) else None


def _explicit(
    derivative: Derivative, U: np.ndarray, X0: np.ndarray, t: np.ndarray, order: int, windows: bool,
    fixed: int = 0, most: float = np.inf,
) -> tuple[np.ndarray, int]:  # fmt: skip
    """Runge-Kutta with as many substeps as are ``fixed``, or (0) as the local error asks for; that number.

    Where the error asks for more than ``most``, that number and a run with fewer.
    A jump that is crossed now and then asks for as many as a stiff plant does. Its error falls with the number of substeps, that of a
    smooth plant with the fourth power of it: where it falls more slowly than with the square, the most substeps are taken.
    """
    n_sub, X = fixed or 2, None
    fewer, before = n_sub, np.inf
    dt = _widths(t)
    step: float | np.ndarray = float(dt[0]) if np.allclose(dt, dt[0], rtol=1e-9, atol=0.0) else dt
    while True:
        mean, half = hold_inputs(U, n_sub, order)
        if windows:
            X = _in_windows(derivative, X0.T, t, mean, half, np.broadcast_to(step, len(t)) / n_sub, X)
        else:
            X = march(derivative, X0.T, np.full(len(U), t[0]), mean, half, np.asarray(step) / n_sub)
        often, rare = (0.0, 0.0) if fixed else _local_errors(derivative, X, U, t, order, n_sub, step)
        worst = max(often, rare)
        if worst <= TOLERANCE or n_sub > MOST_PLANT_SUBSTEPS:
            return X.transpose(1, 2, 0), n_sub
        finite = np.isfinite(worst)
        wanted = int(np.ceil(n_sub * min((worst / TOLERANCE) ** 0.25 * 1.1, 8.0))) if finite else 2 * n_sub
        jumps = often <= TOLERANCE and rare > before * (fewer / n_sub) ** 2
        if wanted > MOST_PLANT_SUBSTEPS and jumps:
            return _explicit(derivative, U, X0, t, order, windows, MOST_PLANT_SUBSTEPS)
        if wanted > most:
            return X.transpose(1, 2, 0), wanted
        fewer, before, n_sub = n_sub, rare, wanted


def _most(method: str) -> float:
    """Largest number of substeps that is worth a run: "RK4" has no other way."""
    return MOST_PLANT_SUBSTEPS if method == "auto" else np.inf


def _widths(t: np.ndarray) -> np.ndarray:
    """Time from every sample to the next; the last one as the one before."""
    return np.diff(t, append=t[-1] + (t[-1] - t[-2] if len(t) > 1 else 1.0))


def _in_windows(
    derivative: Derivative, x0: np.ndarray, t: np.ndarray, mean: np.ndarray, half: np.ndarray | None, h: np.ndarray,
    near: np.ndarray | None,
) -> np.ndarray:  # fmt: skip
    """Free runs (n_states, n_runs, n_samples), as :func:`march` gives them, from runs in longer steps where these are known."""
    n_runs, n_samples = mean.shape[-2:]
    times, widths = np.tile(t, n_runs), np.tile(h, n_runs)
    mean = mean.reshape(*mean.shape[:2], 1, -1)
    half = None if half is None else half.reshape(mean.shape)

    def step(x: np.ndarray, rows: np.ndarray) -> np.ndarray:
        shape = (*mean.shape[:2], *x.shape[1:])
        inputs = np.broadcast_to(mean[..., rows], shape)
        rises = None if half is None else np.broadcast_to(half[..., rows], shape)
        return rk4(derivative, np.broadcast_to(times[rows], x.shape[1:]), x, inputs, rises, widths[rows])  # type: ignore[arg-type]

    size = np.where(np.abs(x0) > 0, np.abs(x0), 1.0).max(axis=1)
    if near is not None:
        near = near.reshape(len(x0), -1) if np.all(np.isfinite(near)) else None
    x = run_in_windows(step, x0, n_samples * np.arange(n_runs), np.full(n_runs, n_samples), size, near)
    return x.reshape(len(x0), n_runs, n_samples)


def _local_errors(
    derivative: Derivative,
    X: np.ndarray,
    U: np.ndarray,
    t: np.ndarray,
    order: int,
    n_sub: int,
    step: float | np.ndarray,
) -> tuple[float, float]:
    """Errors of one sample in ``n_sub`` substeps against twice as many, for all samples at once; inf where they are not finite.

    The error that 98 % of the samples keep, and a thousandth of the largest: a kink is crossed now and then, and asks for fewer substeps
    than its own error would.
    """
    if not np.all(np.isfinite(X)):
        return np.inf, np.inf
    scale = np.maximum(np.max(np.abs(X), axis=(1, 2)), 1e-12)[:, None, None]
    times = np.broadcast_to(t, X.shape[1:])
    widths = np.broadcast_to(step, X.shape[1:])
    once = rk4(derivative, times, X, *hold_inputs(U, n_sub, order), widths / n_sub)  # type: ignore[arg-type]
    twice = rk4(derivative, times, X, *hold_inputs(U, 2 * n_sub, order), widths / (2 * n_sub))  # type: ignore[arg-type]
    error = np.max(np.abs(once - twice) / scale, axis=0)
    if not np.all(np.isfinite(error)):
        return np.inf, np.inf
    return float(np.quantile(error, 0.98)), 1e-3 * float(np.max(error))


def _adaptive(
    derivative: Derivative, U: np.ndarray, x0: np.ndarray, t: np.ndarray, order: int, method: str
) -> np.ndarray:
    """scipy's integrator over stretches of constant input (held), each at most as long as the run before it.

    The absolute tolerance is a share of what every state has reached before.
    """
    X = np.full((len(t), len(x0)), np.nan)
    X[0], size = x0, np.abs(x0)
    spent, budget = 0, 0

    def rhs(now: float, x: np.ndarray, a: int) -> np.ndarray:
        nonlocal spent
        spent += 1
        if spent > budget:  # steps that shrink to nothing before a pole would never end
            raise _Stuck(now)
        u = U[a] if order == 0 else np.array([np.interp(now, t, column) for column in U.T])
        return derivative(now, x[:, None], u[:, None])[:, 0]

    def solve(a: int, b: int, least: float = 0.0) -> Any:
        nonlocal spent, budget
        spent, budget = 0, MOST_EVALUATIONS + 2_000 * (b - a)
        longest = np.inf if order == 0 else float(np.max(np.diff(t)))
        span, rows = (t[a], t[b]), t[a : b + 1]
        fine = np.maximum(1e-10 * (size if np.all(size > 0) else np.where(size > 0, size, reached_soon(a))), least)
        return solve_ivp(rhs, span, X[a], method=method, t_eval=rows, args=(a,), rtol=1e-8, atol=fine, max_step=longest)

    def reached_soon(a: int) -> np.ndarray:
        """What states at 0 reach in some short steps, in which each moves the next; 1 where they stay."""
        x = X[a]
        for _ in x:
            x = x + FIRST_INSTANT * (t[a + 1] - t[a]) * derivative(t[a], x[:, None], U[a][:, None])[:, 0]
        return np.where(np.isfinite(x) & (x != 0), np.abs(x), 1.0)

    for a, b in itertools.pairwise(_edges(U, order)):
        try:
            try:
                try:
                    solution = solve(a, b)
                except _Stuck:  # a state that rounding alone moves
                    solution = solve(a, b, 1e-10)
            except _Stuck as stuck:
                reached = int(np.searchsorted(t, stuck.args[0])) - 1
                if reached > a:
                    solution = solve(a, reached)
                    X[a : reached + 1] = solution.y.T
                return X
        except ValueError as error:
            if "method" in str(error):
                raise SimulatorError(
                    f'method={method!r} is unknown: use "auto", "RK4", "RK45", "DOP853", "LSODA", "Radau", "BDF" or "exact".'
                ) from error
            return X  # scipy refuses non-finite states: the caller reports the divergence
        X[a : a + solution.y.shape[1]] = solution.y.T
        size = np.maximum(size, np.max(np.abs(solution.y), axis=1, initial=0.0))
        if not solution.success:
            X[a + solution.y.shape[1] :] = np.nan
            return X
    return X


def _edges(U: np.ndarray, order: int) -> list[int]:
    """Rows between which inputs are held, and 0, 1, 2, 4, ... rows: what comes is of the size of what was."""
    last = len(U) - 1
    doubled = 2 ** np.arange(max(last, 1).bit_length())
    held = order == 0 and last > 1
    changes = np.flatnonzero(np.any(np.diff(U[:-1], axis=0) != 0, axis=1)) + 1 if held else np.empty(0, int)
    return [int(row) for row in np.unique(np.r_[0, doubled[doubled < last], changes, last])]


class _Stuck(ArithmeticError):
    """The integrator no longer moves; its argument is the time."""


def raise_if_diverged(
    X: np.ndarray,
    t: np.ndarray,
    states: tuple[str, ...],
    said: str = "",
    remedy: str = REMEDY,
) -> None:
    """Raise :class:`SimulationDiverged` with run, time, state and remedy if states (n_runs, n_samples, n_states) are not finite.

    ``said`` is what a function said of a point that it refused.
    """
    bad = ~np.isfinite(X)
    if not bad.any():
        return
    run = int(np.flatnonzero(bad.any(axis=(1, 2)))[0])
    row = int(np.flatnonzero(bad[run].any(axis=1))[0])
    state = states[int(np.flatnonzero(bad[run, row])[0])]
    label = run if len(X) > 1 else None
    where = "" if label is None else f"run {label!r}, "
    raise SimulationDiverged(
        f"the simulation became infinite or nan: {where}row {row}, t = {t[row]:g}, state {state!r}. {remedy}{said}",
        run=label,
        row=row,
        time=float(t[row]),
        state=state,
    )
