"""Least squares under linear constraints, exactly: equalities eliminated, inequalities by non-negative least squares."""

from __future__ import annotations

import numpy as np
from scipy import linalg, optimize

from sksurrogate.kernels.gram import solve_rows

_CONSTRAINT_TOLERANCE = 1e-9


class Infeasible(Exception):
    """No parameter fulfils all constraints."""


def constrained_least_squares(
    A: np.ndarray, b: np.ndarray, C: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Minimise ``|A theta - b|^2`` subject to ``lower <= C theta <= upper``.

    Lawson and Hanson's way: rows with ``lower == upper`` are eliminated by a null-space basis, what is left becomes a
    least-distance problem whose dual is a non-negative least squares, a finite active-set method. The active rows are
    then solved once more as equalities, so that the solution is as exact as an unconstrained one; of several solutions
    the shortest.

    ``A`` (n_rows, n_params), ``b`` (n_rows,), ``C`` (n_constraints, n_params).
    ``lower, upper`` (n_constraints,): may be infinite.
    Returns ``theta`` (n_params,).
    Returns ``active`` int (n_constraints,): -1 at its lower bound, 1 at its upper bound, 2 an equality, 0 free.
    Raises Infeasible if the constraints contradict each other.

    See Lawson and Hanson, *Solving Least Squares Problems*, chapter 23.
    """
    norms = np.linalg.norm(C, axis=1)
    norms = np.where(norms > 0, norms, 1.0)
    C, lower, upper = C / norms[:, None], lower / norms, upper / norms
    reach = np.abs(C) @ _sizes(A, b)
    equal = lower == upper
    active = np.where(equal, 2, 0)
    theta = _with_equalities(A, b, C[equal], lower[equal])
    if theta is None:
        raise Infeasible
    if not _violated(C @ theta, lower, upper, reach):
        return theta, active
    theta, active = _least_distance(A, b, C, lower, upper, active)
    at_lower, at_upper = active == -1, active == 1
    rows = np.vstack([C[equal], C[at_lower], C[at_upper]])
    polished = _with_equalities(A, b, rows, np.concatenate([lower[equal], lower[at_lower], upper[at_upper]]))
    if polished is not None and not _violated(C @ polished, lower, upper, reach):
        theta = polished
    return theta, active


def _sizes(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """What each parameter is if it explains b alone, (n_params,); 0 for one that explains nothing."""
    columns = np.linalg.norm(A, axis=0)
    return np.where(columns > 0, np.linalg.norm(b) / np.where(columns > 0, columns, 1.0), 0.0)


def _violated(value: np.ndarray, lower: np.ndarray, upper: np.ndarray, reach: np.ndarray) -> bool:
    """Whether a constraint is broken by more than rounding; ``reach`` (n_constraints,): size that its value may have."""
    slack = _CONSTRAINT_TOLERANCE * (reach + np.abs(value))
    return bool(np.any(value < lower - slack) or np.any(value > upper + slack))


def _eliminate(E: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """A solution of ``E theta = e`` and a basis of the null space of E; None if there is no solution."""
    p = E.shape[1]
    if not len(E):
        return np.zeros(p), np.eye(p)
    U, s, Vt = linalg.svd(E)
    rank = int(np.sum(s > 10 * max(E.shape) * np.finfo(float).eps * s[0]))
    particular = Vt[:rank].T @ ((U[:, :rank].T @ e) / s[:rank])
    if np.any(np.abs(E @ particular - e) > _CONSTRAINT_TOLERANCE * np.abs(e).max()):
        return None
    return particular, Vt[rank:].T


def _with_equalities(A: np.ndarray, b: np.ndarray, E: np.ndarray, e: np.ndarray) -> np.ndarray | None:
    """Least squares with ``E theta = e``; None if there is no solution."""
    reduced = _eliminate(E, e)
    if reduced is None:
        return None
    particular, Z = reduced
    if not Z.shape[1]:
        return particular
    return particular + Z @ solve_rows(A @ Z, (b - A @ particular)[:, None])[0][:, 0]


def _least_distance(
    A: np.ndarray, b: np.ndarray, C: np.ndarray, lower: np.ndarray, upper: np.ndarray, active: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solution with inequalities and which of them hold it."""
    equal = active == 2
    reduced = _eliminate(C[equal], lower[equal])
    assert reduced is not None
    particular, Z = reduced
    below, above = np.flatnonzero(~equal & np.isfinite(lower)), np.flatnonzero(~equal & np.isfinite(upper))
    G = np.vstack([C[below], -C[above]])
    h = np.concatenate([lower[below], -upper[above]]) - G @ particular
    if not Z.shape[1]:
        raise Infeasible
    G, AZ = G @ Z, A @ Z
    # a breath of ridge where the features leave a null space; the polish that follows takes it out again
    size = np.linalg.norm(AZ, axis=0)
    size = np.where(size > 0, size, max(size.max(), 1.0))
    singular = linalg.svdvals(AZ / size)
    full = len(singular) == AZ.shape[1] and singular[-1] > 1e-6 * singular[0]
    Q, R = linalg.qr(np.vstack([AZ, np.diag((0.0 if full else 1e-5) * size)]), mode="economic")
    q = Q[: len(AZ)].T @ (b - A @ particular)
    # z = R v - q, so that |z| is to be least under  G R^-1 z >= h - G R^-1 q
    M = linalg.solve_triangular(R, G.T, trans="T").T
    k = h - M @ q
    sizes = np.linalg.norm(M, axis=1)
    if np.any((sizes == 0) & (k > 0)):
        raise Infeasible
    sizes = np.where(sizes > 0, sizes, 1.0)
    M, k = M / sizes[:, None], k / sizes
    scale = np.abs(k).max()
    stacked = np.vstack([M.T, k / scale])
    target = np.zeros(len(stacked))
    target[-1] = 1.0
    dual, _ = optimize.nnls(stacked, target, maxiter=max(1000, 20 * len(k)))
    residual = stacked @ dual - target
    if -residual[-1] < 1e-13:
        raise Infeasible
    z = -scale * residual[:-1] / residual[-1]
    held = np.flatnonzero(dual > 0)
    active = active.copy()
    active[below[held[held < len(below)]]] = -1
    active[above[held[held >= len(below)] - len(below)]] = 1
    return particular + Z @ linalg.solve_triangular(R, z + q), active
