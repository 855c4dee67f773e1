"""The continuous hot loop: one Runge-Kutta step map, called once for all times, runs, candidates and perturbations.

Arrays are ``(n_states, n_columns, n_samples)``: column = unperturbed, one per state, one per parameter; ``n_samples`` =
all runs one behind the other. The map leads from every sample to the next; :func:`close` turns it into a free run by
Newton's method over the whole time axis, :func:`march` by a loop over time (many short runs, or where Newton fails).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sksurrogate.kernels.banded import recursion_band, solve_recursion
from sksurrogate.kernels.free_run_model import Stepper

#: Relative step of the forward differences through the step map (insensitive between 1e-9 and 1e-3).
DIFFERENCE = 1e-5

Derivative = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
Clip = Callable[..., np.ndarray]


def rk4(
    derivative: Derivative,
    t: np.ndarray,
    x: np.ndarray,
    mean: np.ndarray,
    half: np.ndarray | None,
    h: float | np.ndarray,
    clip: Clip | None = None,
) -> np.ndarray:
    """Fourth-order Runge-Kutta over one sample in ``n_sub`` steps.

    ``derivative`` (t, x, u) -> dx/dt.
    ``t``: time of every sample.
    ``x`` (n_states, *s).
    ``mean, half`` (n_sub, n_inputs, *s): inputs of every substep (:class:`~sksurrogate.kernels.signals.Signal`).
    ``h`` float or (*s): width of a substep.
    ``clip``: limits on the states at a time, in force at every stage so that other balances see the limited state; a
        third argument is True at the end of a substep, where what was cut off may go elsewhere.
    Returns (n_states, *s).
    """
    for s in range(len(mean)):
        u = mean[s]
        u0, u1 = (u, u) if half is None else (u - half[s], u + half[s])
        middle, end = t + h / 2, t + h
        k = derivative(t, x, u0)
        total = k
        z = _ahead(x, h / 2, k)
        k = derivative(middle, z if clip is None else clip(z, middle), u)
        total = _ahead(total, 2.0, k)
        z = _ahead(x, h / 2, k)
        k = derivative(middle, z if clip is None else clip(z, middle), u)
        total += 2 * k
        z = _ahead(x, h, k)
        k = derivative(end, z if clip is None else clip(z, end), u1)
        total += k
        total *= h / 6
        total += x
        x = total
        if clip is not None:
            x = clip(x, end, True)
        t = end
    return x


def _ahead(x: np.ndarray, h: float | np.ndarray, k: np.ndarray) -> np.ndarray:
    """``x + h k`` with one new array."""
    out = h * k
    out += x
    return out


def march(
    derivative: Derivative,
    x0: np.ndarray,
    t0: np.ndarray,
    mean: np.ndarray,
    half: np.ndarray | None,
    h: float | np.ndarray,
    clip: Clip | None = None,
) -> np.ndarray:
    """Free run by a loop over time, all runs at once.

    ``x0`` (n_states, n_runs).
    ``t0`` (n_runs,): time of the first row of every run.
    ``mean, half`` (n_sub, n_inputs, n_runs, n_samples).
    ``h`` float or (n_samples,): width of a substep; one for each sample where sampling is uneven.
    Returns (n_states, n_runs, n_samples): the first row is ``x0``.
    """
    n_sub, n_samples = len(mean), mean.shape[-1]
    out = np.empty((*x0.shape, n_samples))
    out[..., 0] = x = x0
    widths = np.broadcast_to(h, (n_samples,))
    now = np.asarray(t0, dtype=float)
    for k in range(n_samples - 1):
        x = rk4(derivative, now, x, mean[..., k], None if half is None else half[..., k], widths[k], clip)
        out[..., k + 1] = x
        now = now + n_sub * widths[k]
    return out


def moved_one_by_one(x: np.ndarray, steps: np.ndarray, n_columns: int = 0) -> np.ndarray:
    """x (n_states, n_samples) as columns (n_states, n_columns, n_samples): as it is, then one state after the other moved by its step.

    At least ``1 + n_states`` columns; further ones hold x as it is.
    """
    n = len(x)
    columns = np.repeat(x[:, None, :], max(n_columns, 1 + n), axis=1)
    for j in range(n):
        columns[j, 1 + j] += steps[j]
    return columns


def state_jacobian(step: Stepper, x: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The next states and their derivative with respect to the states, by forward differences of the whole step map.

    ``x`` (n_states, n_samples).
    ``scale`` (n_states,): size of each state.
    Returns ``following`` (n_states, n_samples), ``A`` (n_states, n_states, n_samples).
    """
    steps = DIFFERENCE * scale
    after = step(moved_one_by_one(x, steps))
    return after[:, 0], (after[:, 1:] - after[:, :1]) / steps[:, None]


def _defects(after: np.ndarray, x: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """``F(x[k-1]) - x[k]`` in row k, 0 in the first row of a run."""
    d = np.zeros_like(x)
    d[:, 1:] = after[:, :-1] - x[:, 1:]
    d[:, starts] = 0.0
    return d


def closing_weight(scale: np.ndarray, spread: np.ndarray, sd: np.ndarray, measured: Sequence[int] | None) -> np.ndarray:
    """Size (n_states,) to which every state of a free run is closed: the noise of the measured, that share of the others.

    ``scale`` (n_states,): size of every state.
    ``spread`` (n_outputs,): deviation of every output, > 0.
    ``sd`` (n_outputs,): noise of the sensors.
    ``measured``: position of the state that each output is; None where outputs are functions of states.
    """
    weight = scale * min(float(np.min(sd / spread)), 1.0)
    for j, i in enumerate(measured or ()):
        weight[i] = min(weight[i], sd[j])
    return weight


def close(
    step: Stepper,
    x: np.ndarray,
    starts: np.ndarray,
    scale: np.ndarray,
    tolerance: float,
    *,
    band: np.ndarray | None = None,
    max_steps: int = 14,
    max_fresh: int = 5,
) -> tuple[np.ndarray, bool, np.ndarray]:
    """Free run by Newton's method over the whole time axis, from a trajectory near it.

    Chord steps with the last Jacobian; a fresh one when a step shrinks the correction by less than 0.4.

    ``step``: the map with one column.
    ``x`` (n_states, n_samples): start; its first rows of the runs are the initial states.
    ``starts`` int (n_runs,).
    ``scale`` (n_states,): size of each state; corrections are measured in it.
    ``tolerance``: largest correction, in units of ``scale``, at which the run counts as closed.
    ``band``: band of the recursion from a linearisation near x.
    Returns ``x`` (n_states, n_samples), ``closed``, ``band``.
    """
    fresh, last = 0, np.inf
    weight = scale[:, None]
    for _ in range(max_steps):
        if band is None:
            after, A = state_jacobian(step, x, scale)
            band, fresh = recursion_band(A, starts), fresh + 1
        else:
            after = step(x[:, None, :])[:, 0]
        defect = _defects(after, x, starts)
        if not np.all(np.isfinite(defect)):
            return x, False, band
        correction = solve_recursion(band, defect[:, None, :])[:, 0]
        size = float(np.max(np.abs(correction) / weight))
        if not np.isfinite(size) or size > 1e6:
            return x, False, band
        x = x + correction
        if size < tolerance:
            return x, True, band
        if size > 0.4 * last:
            if fresh >= max_fresh:
                return x, False, band
            band = None
        last = size
    return x, False, band if band is not None else np.empty(0)
