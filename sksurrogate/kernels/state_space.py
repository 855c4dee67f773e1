"""State-space models ``x[t+1] = f(x[t], u[t])``, ``y[t] = g(x[t], u[t])``: subspace start, free run, output-error fit.

Runs lie one behind the other, rows first: x (n_samples, n_states); ``starts`` holds the first row of every run. The free
run and its exact sensitivities are banded solves over the whole time axis; the initial state of every run is unknown
and eliminated run by run from the normal equations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sksurrogate.kernels.banded import recursion_band, solve_recursion
from sksurrogate.kernels.linear_fit import linear_least_squares
from sksurrogate.kernels.state_model import StateModel

#: Rows whose sensitivities are held at once.
SENSITIVITY_ROWS = 20_000


def simulate(
    model: StateModel,
    theta: np.ndarray,
    x0: np.ndarray,
    U: np.ndarray,
    starts: np.ndarray,
    guess: np.ndarray | None = None,
) -> np.ndarray:
    """States of a free run, (n_samples, n_states): Newton over time from a guess, else all runs at once step by step.

    ``x0`` (n_runs, n_states), ``U`` (n_samples, n_inputs), ``starts`` int (n_runs,).
    ``guess`` (n_samples, n_states): a trajectory near it; an affine model needs none.
    """
    if guess is None and not model.hidden:
        guess = np.zeros((len(U), model.n_states))
    if guess is not None:
        x = guess.copy()
        x[starts] = x0
        last = np.inf
        with np.errstate(all="ignore"):
            for _ in range(10):
                z = np.concatenate([x, U], axis=1)
                after, by_z = model.f.slopes(theta[: model.f.size], z)
                defect = np.zeros_like(x)
                defect[1:] = after[:-1] - x[1:]
                defect[starts] = 0.0
                size = float(np.abs(defect).max())
                if not np.isfinite(size) or (size > 1e6 and model.hidden):
                    break
                band = recursion_band(by_z[:, :, : model.n_states].transpose(1, 2, 0), starts)
                step = solve_recursion(band, defect.T[:, None, :])[:, 0].T
                moved = float(np.abs(step).max())
                if not np.isfinite(moved) or moved > 2 * last + 1e3:
                    break
                x = x + step
                if moved < 1e-9 * (1.0 + float(np.abs(x).max())) or not model.hidden:
                    return x
                last = moved
    return _abreast(model, theta, x0, U, starts)


def _abreast(model: StateModel, theta: np.ndarray, x0: np.ndarray, U: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Step by step, runs in order of length so that finished ones drop out."""
    lengths = np.diff(np.r_[starts, len(U)])
    order = np.argsort(-lengths, kind="stable")
    alive = np.searchsorted(-lengths[order], -np.arange(1, lengths.max() + 1), side="right")
    out, x, first = np.empty((len(U), model.n_states)), x0[order], starts[order]
    step, parts = model.f.value_of, model.f.parts(theta[: model.f.size])
    with np.errstate(over="ignore", invalid="ignore"):
        for t in range(int(lengths.max())):
            rows = first[: alive[t]] + t
            x = x[: alive[t]]
            out[rows] = x
            x = step(parts, np.concatenate([x, U[rows]], axis=1))
    return out


def state_slopes(
    model: StateModel, theta: np.ndarray, x: np.ndarray, U: np.ndarray, starts: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outputs of free runs, and their slopes by theta (n_samples, n_outputs, n_theta) and by a run's initial state (..., n_states)."""
    n, nf = model.n_states, model.f.size
    _, by_z, by_f = model.f.jacobians(theta[:nf], np.concatenate([x, U], axis=1))
    rhs = np.zeros((n, nf + n, len(x)))
    rhs[:, :nf, 1:] = by_f[:-1].transpose(1, 2, 0)
    rhs[:, :, starts] = 0.0
    rhs[:, nf:, starts] = np.eye(n)[:, :, None]
    S = solve_recursion(recursion_band(by_z[:, :, :n].transpose(1, 2, 0), starts), rhs).transpose(2, 0, 1)
    value, by_x, by_g = model.g.jacobians(theta[nf:], model.seen(x, U))
    moved = by_x[:, :, :n] @ S
    return value, np.concatenate([moved[:, :, :nf], by_g], axis=2), moved[:, :, nf:]


def start_states(
    model: StateModel,
    theta: np.ndarray,
    U: np.ndarray,
    Y: np.ndarray,
    mean: np.ndarray,
    precision: np.ndarray,
    n_steps: int = 6,
) -> np.ndarray:
    """Initial states from the first outputs: Gauss-Newton with a normal prior on the state.

    ``U`` (n_windows, n_rows, n_inputs).
    ``Y`` (n_windows, n_rows, n_outputs): nan counts as not measured.
    ``mean`` (n_states,).
    ``precision`` (n_states, n_states): of the prior, in units of the squared output error.
    Returns (n_windows, n_states).
    """
    R, L, n = len(U), U.shape[1], model.n_states
    x0, known = np.broadcast_to(mean, (R, n)).copy(), np.isfinite(Y)
    target, best, damping = np.where(known, Y, 0.0), np.full(R, np.inf), np.full(R, 1e-6)
    kept = x0.copy()
    for _ in range(n_steps if model.hidden else 2):
        x, S = x0, np.broadcast_to(np.eye(n), (R, n, n))
        normal = np.broadcast_to(precision, (R, n, n)).copy()
        gradient = (x0 - mean) @ precision
        cost = np.einsum("ri,ij,rj->r", x0 - mean, precision, x0 - mean)
        with np.errstate(all="ignore"):
            for t in range(L):
                y, by_seen = model.g.slopes(theta[model.f.size :], model.seen(x, U[:, t]))
                J = np.where(known[:, t, :, None], by_seen[:, :, :n] @ S, 0.0)
                e = np.where(known[:, t], y - target[:, t], 0.0)
                cost = cost + (e**2).sum(axis=1)
                normal = normal + J.transpose(0, 2, 1) @ J
                gradient = gradient + (J.transpose(0, 2, 1) @ e[:, :, None])[:, :, 0]
                x, by_z = model.f.slopes(theta[: model.f.size], np.concatenate([x, U[:, t]], axis=1))
                S = by_z[:, :, :n] @ S
        better = np.isfinite(cost) & (cost <= best) & np.isfinite(normal).all(axis=(1, 2))
        kept[better], best[better] = x0[better], cost[better]
        damping = np.where(better, damping / 10, damping * 100)
        if not better.any():
            break
        normal[~better], gradient[~better] = np.eye(n), 0.0
        step = np.linalg.solve(normal + damping[:, None, None] * np.eye(n), gradient[:, :, None])[:, :, 0]
        x0 = np.where(better[:, None], x0 - step, 0.5 * (x0 + kept))
    return kept if model.hidden else x0


def subspace(
    U: Sequence[np.ndarray], Y: Sequence[np.ndarray], n_states: int, n_past: int, feedthrough: bool
) -> tuple[np.ndarray, ...] | None:
    """A, B, C, D, b, c of a linear model by projection of the future on the past (N4SID), runs of any lengths.

    ``U, Y`` sequence of (n_samples, n_inputs) and (n_samples, n_outputs).
    ``n_states, n_past``: order; rows of the past and of the future.

    See Van Overschee, De Moor, *N4SID*, Automatica 30 (1994).
    """
    p = n_past
    pieces = [(u, y) for u, y in zip(U, Y) if len(u) >= 2 * p + 1]
    o, m = Y[0].shape[1], U[0].shape[1]
    count = sum(len(u) - 2 * p + 1 for u, _ in pieces)
    if p * o < n_states or count < 3 * p * (o + m):
        return None

    def hankel(values: np.ndarray, first: int, n: int) -> np.ndarray:
        return np.concatenate([values[first + k : first + k + n] for k in range(p)], axis=1)

    past, future, inputs = [], [], []
    for u, y in pieces:
        n = len(u) - 2 * p + 1
        past.append(np.concatenate([hankel(y, 0, n), hankel(u, 0, n)], axis=1))
        future.append(hankel(y, p, n))
        inputs.append(hankel(u, p, n))
    Z, F, V = (np.concatenate(part) for part in (past, future, inputs))
    regressors = np.concatenate([Z, V, np.ones((len(Z), 1))], axis=1)
    normal = regressors.T @ regressors
    normal[np.diag_indices_from(normal)] += 1e-8 * np.trace(normal) / len(normal)
    L = np.linalg.solve(normal, regressors.T @ F)[: Z.shape[1]]
    covariance = np.cov(Z.T).reshape(len(L), len(L)) + 1e-10 * np.eye(len(L))
    root = np.linalg.cholesky(covariance + 1e-9 * np.trace(covariance) / len(L) * np.eye(len(L)))
    left, values, _ = np.linalg.svd(root.T @ L, full_matrices=False)
    if len(values) < n_states or values[n_states - 1] <= 0:
        return None
    project = np.linalg.solve(root.T, left[:, :n_states])  # unit variance of every state over the data
    now, nxt, u_now, y_now = [], [], [], []
    for (u, y), z in zip(pieces, past):
        x = z @ project
        now.append(x[:-1])
        nxt.append(x[1:])
        u_now.append(u[p : p + len(x) - 1])
        y_now.append(y[p : p + len(x) - 1])
    x, x_next, u, y = (np.concatenate(part) for part in (now, nxt, u_now, y_now))
    ones = np.ones((len(x), 1))
    by_f = linear_least_squares(np.concatenate([x, u, ones], axis=1), x_next).T
    seen = np.concatenate([x, u, ones] if feedthrough else [x, ones], axis=1)
    by_g = linear_least_squares(seen, y).T
    A, radius = by_f[:, :n_states], float(np.abs(np.linalg.eigvals(by_f[:, :n_states])).max())
    if radius > 0.998:
        A = A * (0.998 / radius)
    D = by_g[:, n_states:-1] if feedthrough else np.zeros((o, m))
    return A, by_f[:, n_states:-1], by_g[:, :n_states], D, by_f[:, -1], by_g[:, -1]


@dataclass(frozen=True, eq=False)
class StateFit:
    """Result of :func:`fit_output_error`."""

    theta: np.ndarray
    x0: np.ndarray  #: (n_runs, n_states)
    x: np.ndarray  #: (n_samples, n_states)
    cost: float  #: Mean squared error and penalty
    n_iter: int


class OutputErrorLoss:
    """Mean squared output error of the free run, and its normal equations with the initial states eliminated."""

    def __init__(self, model: StateModel, U: np.ndarray, Y: np.ndarray, starts: np.ndarray, alpha: float):
        self.model, self.U, self.Y, self.starts = model, U, Y, starts
        self.known = np.isfinite(Y)
        self.scale = 1.0 / max(int(self.known.sum()), 1)
        self.penalty = alpha * model.penalised
        # only holds the states in place where the outputs do not see them
        self.tie = 1e-12

    def cost(self, theta: np.ndarray, x0: np.ndarray, guess: np.ndarray | None) -> tuple[float, np.ndarray]:
        x = simulate(self.model, theta, x0, self.U, self.starts, guess)
        with np.errstate(all="ignore"):
            e = np.where(self.known, self.model.output(theta, x, self.U) - self.Y, 0.0)
            total = self.scale * float((e**2).sum()) + float(self.penalty @ theta**2) + self.tie * float((x0**2).sum())
        return (total if np.isfinite(total) else np.inf), x

    def blocks(self) -> list[tuple[int, int]]:
        """Runs in blocks of at most ROWS rows."""
        edges = np.r_[self.starts, len(self.U)]
        out, a = [], 0
        for r in range(1, len(self.starts) + 1):
            if r == len(self.starts) or edges[r + 1] - edges[a] > SENSITIVITY_ROWS:
                out.append((a, r))
                a = r
        return out

    def normal(self, theta: np.ndarray, x0: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """H (n, n), its gradient, and per run the coupling to x0, the block of x0 and its gradient."""
        model, n = self.model, self.model.n_states
        size, R = len(theta), len(self.starts)
        H, gradient = np.diag(self.penalty), self.penalty * theta
        couple, own, own_gradient = np.zeros((R, size, n)), np.zeros((R, n, n)), self.tie * x0
        own += self.tie * np.eye(n)
        edges = np.r_[self.starts, len(self.U)]
        for a, b in self.blocks():
            rows, first = slice(edges[a], edges[b]), self.starts[a:b] - edges[a]
            value, J, Jx = state_slopes(model, theta, x[rows], self.U[rows], first)
            known = self.known[rows]
            J, Jx = np.where(known[:, :, None], J, 0.0), np.where(known[:, :, None], Jx, 0.0)
            e = np.where(known, value - np.where(known, self.Y[rows], 0.0), 0.0)
            flat = J.reshape(-1, size)
            H += self.scale * flat.T @ flat
            gradient = gradient + self.scale * flat.T @ e.ravel()
            lengths = np.diff(edges[a : b + 1])
            e = e[:, :, None]
            if b - a > 1 and np.all(lengths == lengths[0]):  # runs of one length in one product
                each = (b - a, lengths[0] * e.shape[1], -1)
                Jr, Xr, er = J.reshape(each), Jx.reshape(each), e.reshape(each)
                couple[a:b] = self.scale * Jr.transpose(0, 2, 1) @ Xr
                own[a:b] += self.scale * Xr.transpose(0, 2, 1) @ Xr
                own_gradient[a:b] += self.scale * (Xr.transpose(0, 2, 1) @ er)[:, :, 0]
                continue
            for r in range(a, b):
                part = slice(edges[r] - edges[a], edges[r + 1] - edges[a])
                Jr, Xr, er = J[part].reshape(-1, size), Jx[part].reshape(-1, n), e[part].ravel()
                couple[r] = self.scale * Jr.T @ Xr
                own[r] += self.scale * Xr.T @ Xr
                own_gradient[r] += self.scale * Xr.T @ er
        return H, gradient, couple, own, own_gradient


def fit_output_error(
    model: StateModel,
    theta: np.ndarray,
    x0: np.ndarray,
    U: np.ndarray,
    Y: np.ndarray,
    starts: np.ndarray,
    *,
    alpha: float = 0.0,
    max_iter: int = 100,
    tol: float = 1e-6,
    accepts: Callable[[np.ndarray, np.ndarray], bool] | None = None,
) -> StateFit:
    """Levenberg-Marquardt on the free run, parameters and the initial state of every run together.

    ``theta``: start.
    ``x0`` (n_runs, n_states): start.
    ``U`` (n_samples, n_inputs).
    ``Y`` (n_samples, n_outputs): nan counts as not measured.
    ``starts`` int (n_runs,).
    ``alpha``: penalty on the networks' weights beside the mean squared error.
    ``max_iter, tol``: steps at most; relative decrease at which it stops.
    ``accepts`` (theta, x) -> bool: steps to parameters that it refuses are not taken.
    """
    objective = OutputErrorLoss(model, U, Y, starts, alpha)
    cost, x = objective.cost(theta, x0, None)
    damping, done, slow = 1e-3, 0, 0
    while done < max_iter and np.isfinite(cost):
        done += 1
        H, gradient, couple, own, own_gradient = objective.normal(theta, x0, x)
        if not (np.all(np.isfinite(H)) and np.all(np.isfinite(couple))):
            break
        size, own_size = np.diag(H) + 1e-9 * np.diag(H).max(), np.einsum("rii->ri", own)
        before = cost
        for _ in range(12):
            inverse = np.linalg.inv(own + damping * own_size[:, :, None] * np.eye(model.n_states))
            taken = couple @ inverse
            reduced = H + damping * np.diag(size) - np.tensordot(taken, couple, axes=([0, 2], [0, 2]))
            rhs = gradient - np.tensordot(taken, own_gradient, axes=([0, 2], [0, 1]))
            try:
                step = np.linalg.solve(reduced, rhs)
            except np.linalg.LinAlgError:
                damping *= 4
                continue
            own_step = np.einsum("rnm,rm->rn", inverse, own_gradient - np.tensordot(couple, step, axes=([1], [0])))
            trial, trial_x0 = theta - step, x0 - own_step
            new, x_new = objective.cost(trial, trial_x0, x)
            if new < cost and (accepts is None or accepts(trial, x_new)):
                theta, x0, cost, x, damping = trial, trial_x0, new, x_new, max(damping / 5, 1e-10)
                break
            damping *= 4
        slow = slow + 1 if before - cost <= tol * before else 0
        if slow >= 3 or before == cost:
            break
    return StateFit(theta, x0, x, cost, done)
