"""A right-hand side that is linear in states and inputs, found by probes and stepped exactly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.exceptions import SimulatorError
from sksurrogate.kernels.linear_step import linear_run

#: Largest departure from the linear law at a probe, relative to the size of its terms: rounding of a sum of some hundred.
NOT_LINEAR = 1e-10
#: Sizes of the probes beside those of the start and of the inputs.
_SIZES = (1e-3, 1.0, 1e3)

Derivative = Callable[[Any, np.ndarray, np.ndarray], np.ndarray]


class LinearParts(NamedTuple):
    """``dx/dt = A x + B u + b``."""

    A: np.ndarray
    B: np.ndarray
    b: np.ndarray


def linear_parts(
    derivative: Derivative, x0: np.ndarray, u: np.ndarray, t: np.ndarray, states: Sequence[str]
) -> LinearParts:
    """Matrices of a linear right-hand side, read off at unit vectors and checked at probes.

    ``derivative`` (t, x, u) -> dx/dt on arrays (n, n_points), ``x0`` (n_states,).
    ``u`` (n_inputs,): largest inputs.
    ``t`` (n_samples,).
    Raises SimulatorError where a probe leaves the linear law: the message says where.

    >>> import numpy as np
    >>> from sksurrogate.physics._linear import linear_parts
    >>> linear_parts(lambda t, x, u: -2 * x + u + 1, np.zeros(1), np.ones(1), np.zeros(2), ["x"]).A
    array([[-2.]])
    """
    n, m = len(x0), len(u)
    unit = np.concatenate([np.eye(n + m), np.zeros((n + m, 1))], axis=1)
    with np.errstate(all="ignore"):
        values = derivative(np.full(n + m + 1, t[0]), unit[:n], unit[n:])
        b = values[:, -1]
        slopes = values[:, :-1] - b[:, None]
        size = np.maximum(np.abs(np.r_[x0, u]), 1.0)[:, None]
        probes = np.random.default_rng(0).uniform(-1.0, 1.0, (n + m, 4 * len(_SIZES))) * size * np.repeat(_SIZES, 4)
        times = np.linspace(t[0], t[-1], probes.shape[1]) + np.arange(probes.shape[1]) % 2 * (t[-1] - t[0] + 1.0)
        found = derivative(times, probes[:n], probes[n:])
    expected = slopes @ probes + b[:, None]
    terms = np.abs(slopes) @ np.abs(probes) + np.abs(b)[:, None] + np.finfo(float).tiny
    wrong = ~(np.abs(found - expected) <= NOT_LINEAR * terms)
    if wrong.any():
        i, k = np.argwhere(wrong)[0]
        raise SimulatorError(
            f'method="exact" needs a right-hand side that is linear in states and inputs and does not depend on time: the derivative of '
            f"{states[i]!r} at t={times[k]:g}, x={probes[:n, k].round(4).tolist()}, u={probes[n:, k].round(4).tolist()} is {found[i, k]:.6g}, "
            f'a linear one would be {expected[i, k]:.6g}. Write method="auto".'
        )
    return LinearParts(slopes[:, :n].copy(), slopes[:, n:].copy(), b.copy())


def exact_run(
    derivative: Derivative, U: np.ndarray, X0: np.ndarray, t: np.ndarray, *, order: int, states: Sequence[str]
) -> np.ndarray:
    """States (n_runs, n_samples, n_states) of runs of equal length, by the matrix exponential.

    ``derivative``: of arrays (n, n_points).
    ``U`` (n_runs, n_samples, n_inputs), ``X0`` (n_runs, n_states), ``t`` (n_samples,).
    ``order``: hold.
    """
    if X0.shape[1] == 0:
        return np.zeros((len(U), len(t), 0))
    largest = np.max(np.abs(U), axis=(0, 1)) if U.size else np.zeros(U.shape[2])
    parts = linear_parts(derivative, np.max(np.abs(X0), axis=0), largest, t, states)
    B = parts.B
    if np.any(parts.b):  # a constant is an input of 1
        B, U = np.column_stack([B, parts.b]), np.concatenate([U, np.ones((*U.shape[:2], 1))], axis=2)
    return linear_run(parts.A, B, U, X0, t, order)
