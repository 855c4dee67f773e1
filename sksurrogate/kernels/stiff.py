"""One sample of a plant, stiff or not; for stiff ones a Rosenbrock method of fixed step, for all times and columns at once.

RODAS3 (order 3, four stages, stiffly accurate; Sandu et al., *Benchmarking stiff ODE solvers for atmospheric chemistry
problems II*, Atmospheric Environment 31 (1997) 3459-3472). The step is fixed, so that differences through the map are
smooth; those through an adaptive solver would not be.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sksurrogate.kernels.integrate import rk4

#: The first step of a sample is 0.5 to this power of it.
_DOUBLINGS = 13
#: Relative step of the differences for the Jacobian of the right-hand side.
_STEP = 1.5e-8
#: A state counts as at least this share of its largest value, or as its change in a step, when its difference is taken.
_FLOOR = 1e-3

#: Stage i starts from x plus these multiples of earlier stages (only stage 3 and 4 move), and adds these multiples / h.
_A = ((), (0.0,), (2.0, 0.0), (2.0, 0.0, 1.0))
_C = ((), (4.0,), (1.0, -1.0), (1.0, -1.0, -8.0 / 3.0))
_M = (2.0, 0.0, 1.0, 1.0)
_ALPHA = (0.0, 0.0, 1.0, 1.0)
_GAMMA = (0.5, 1.5, 0.0, 0.0)

Derivative = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def one_sample(
    derivative: Derivative,
    t: np.ndarray,
    x: np.ndarray,
    mean: np.ndarray,
    half: np.ndarray | None,
    dt: float | np.ndarray,
    stiff: bool,
) -> np.ndarray:
    """The states one sample later, by Runge-Kutta with a step for each substep of the inputs or by :func:`rosenbrock`.

    ``derivative`` (t, x, u) -> dx/dt.
    ``t``: time of every sample.
    ``x`` (n_states, *s).
    ``mean, half`` (n_sub, n_inputs, *s): inputs of every substep (:class:`~sksurrogate.kernels.signals.Signal`).
    ``dt`` float or (*s): width of a sample.
    Returns (n_states, *s).
    """
    if not stiff:
        return rk4(derivative, t, x, mean, half, dt / len(mean))
    first, last = (mean[0], mean[-1]) if half is None else (mean[0] - half[0], mean[-1] + half[-1])
    return rosenbrock(derivative, t, x, first, last, dt, len(mean))


def rosenbrock(
    derivative: Derivative,
    t: np.ndarray,
    x: np.ndarray,
    u0: np.ndarray,
    u1: np.ndarray,
    dt: float | np.ndarray,
    refine: int = 1,
) -> np.ndarray:
    """The states one sample later.

    Steps grow by factors of two: inputs jump at the samples, and fast states settle behind a jump.

    ``derivative`` (t, x, u) -> dx/dt.
    ``t``: time of every sample.
    ``x`` (n_states, *s).
    ``u0, u1`` (n_inputs, *s): inputs at the start and at the end of the sample, joined linearly.
    ``dt`` float or (*s): width of a sample.
    ``refine``: each of the 14 steps is cut into as many.
    Returns (n_states, *s).
    """
    edges = np.r_[0.0, 0.5 ** np.arange(_DOUBLINGS, -1, -1)]
    inner = np.arange(refine) / refine
    edges = np.r_[(edges[:-1, None] + np.diff(edges)[:, None] * inner).ravel(), 1.0]
    rise = u1 - u0
    for a, b in zip(edges[:-1], edges[1:]):
        x = _substep(derivative, t + a * dt, x, u0 + a * rise, u0 + b * rise, (b - a) * dt)
    return x


def _substep(
    derivative: Derivative, t: np.ndarray, x: np.ndarray, u0: np.ndarray, u1: np.ndarray, h: float | np.ndarray
) -> np.ndarray:
    """One step of width h."""
    n, shape = len(x), x.shape[1:]
    f0 = derivative(t, x, u0)
    small = 1e-6
    drift = (derivative(t + small * h, x, u0 + small * (u1 - u0)) - f0) / (small * h)
    largest = np.max(np.abs(x), axis=tuple(range(1, x.ndim)))
    J = np.empty((*shape, n, n))
    for j in range(n):
        step = _STEP * np.maximum(np.maximum(np.abs(x[j]), h * np.abs(f0[j])), _FLOOR * largest[j] + 1e-6)
        moved = x.copy()
        moved[j] = x[j] + step
        J[..., j] = np.moveaxis((derivative(t, moved, u0) - f0) / (moved[j] - x[j]), 0, -1)
    W = np.eye(n) * np.asarray(2.0 / h)[..., None, None] - J
    if not np.all(np.isfinite(W)):
        return np.full_like(x, np.nan)
    inverse = np.linalg.inv(W)
    stages: list[np.ndarray] = []
    value = f0
    for i in range(4):
        if i > 1:
            z = x + sum(a * k for a, k in zip(_A[i], stages))
            value = derivative(t + _ALPHA[i] * h, z, u1)
        right = value + (h * _GAMMA[i]) * drift + sum((c / h) * k for c, k in zip(_C[i], stages))
        stages.append(np.moveaxis(np.einsum("...ij,...j->...i", inverse, np.moveaxis(right, 0, -1)), -1, 0))
    return x + sum(m * k for m, k in zip(_M, stages))
