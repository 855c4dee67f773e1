"""Linear systems stepped exactly: the matrix exponential under held inputs, or inputs joined linearly."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

#: Steps whose widths differ by less than so many roundings of the largest time are one step.
_ROUNDINGS = 8.0


class HoldMaps(NamedTuple):
    """One sample of ``dx/dt = A x + B u``: ``x[k+1] = F x[k] + G u[k] + H (u[k+1] - u[k])``."""

    F: np.ndarray  #: (n_states, n_states)
    #: G, H: (n_states, n_inputs): H is zero under held inputs
    G: np.ndarray
    H: np.ndarray


def hold_maps(A: np.ndarray, B: np.ndarray, dt: float, order: int) -> HoldMaps:
    """Maps of one sample, kept for the next call with the same system.

    The state is put beside the input (order 0), and beside the input and its rise over the sample (order 1); one matrix
    exponential of the block matrix holds all three integrals (Van Loan, IEEE Trans. Automatic Control 23 (1978) 395-404).

    ``A`` (n_states, n_states), ``B`` (n_states, n_inputs).
    ``order`` {0, 1}: inputs held, or joined linearly.

    >>> import numpy as np
    >>> maps = hold_maps(np.array([[-1.0]]), np.array([[1.0]]), 0.5, 0)
    >>> bool(abs(maps.F[0, 0] - np.exp(-0.5)) < 1e-15), bool(abs(maps.G[0, 0] - (1 - np.exp(-0.5))) < 1e-15)
    (True, True)
    """
    A, B = np.ascontiguousarray(A, dtype=float), np.ascontiguousarray(B, dtype=float)
    return _hold_maps(A.tobytes(), B.tobytes(), len(A), B.shape[1], float(dt), order)


@lru_cache(maxsize=256)
def _hold_maps(a: bytes, b: bytes, n: int, m: int, dt: float, order: int) -> HoldMaps:
    """:func:`hold_maps` of what can be a key."""
    block = np.zeros((n + (1 + order) * m, n + (1 + order) * m))
    block[:n, :n] = dt * np.frombuffer(a).reshape(n, n)
    block[:n, n : n + m] = dt * np.frombuffer(b).reshape(n, m)
    if order == 1:
        block[n : n + m, n + m :] = np.eye(m)
    whole = expm(block)[:n]
    H = whole[:, n + m :] if order == 1 else np.zeros((n, m))
    maps = HoldMaps(whole[:, :n].copy(), whole[:, n : n + m].copy(), H.copy())
    for part in maps:
        part.flags.writeable = False
    return maps


def linear_run(A: np.ndarray, B: np.ndarray, U: np.ndarray, X0: np.ndarray, t: np.ndarray, order: int) -> np.ndarray:
    """States of runs of equal length.

    ``A`` (n_states, n_states), ``B`` (n_states, n_inputs), ``U`` (n_runs, n_samples, n_inputs), ``X0`` (n_runs,
        n_states).
    ``t`` (n_samples,): even or not.
    ``order`` {0, 1}.
    Returns (n_runs, n_samples, n_states).
    """
    X = np.empty((U.shape[1], len(X0), X0.shape[1]))
    X[0] = X0
    widths, which = _widths(t)
    added = np.empty((len(t) - 1, len(X0), X0.shape[1]))
    steps = U.transpose(1, 0, 2)
    maps = [hold_maps(A, B, width, order) for width in widths]
    for k, one in enumerate(maps):
        rows = np.flatnonzero(which == k)
        added[rows] = steps[rows] @ one.G.T + (steps[rows + 1] - steps[rows]) @ one.H.T
    with np.errstate(all="ignore"):
        for k, one_step in enumerate(which):
            np.matmul(X[k], maps[one_step].F.T, out=X[k + 1])
            X[k + 1] += added[k]
    return X.transpose(1, 0, 2)


def _widths(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct widths of the steps, those apart from rounding, and which of them each step has."""
    steps = np.diff(t)
    if not len(steps):
        return np.empty(0), np.empty(0, int)
    order = np.argsort(steps, kind="stable")
    apart = np.diff(steps[order]) > _ROUNDINGS * np.finfo(float).eps * max(np.max(np.abs(t)), steps[order[-1]])
    which = np.empty(len(steps), int)
    which[order] = np.r_[0, np.cumsum(apart)]
    return np.bincount(which, steps) / np.bincount(which), which
