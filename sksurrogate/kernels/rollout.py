"""The discrete hot loop: free runs of lag models, abreast or by Newton over time, and their exact sensitivities."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dtbtrs

__all__ = ["Net", "fit_free_run", "free_run", "free_run_jacobian", "march", "newton_in_time"]

#: Steps that one Newton solve covers; longer runs go chunk by chunk, so that a bad guess stays local.
CHUNK = 4096


@dataclass(frozen=True)
class Net:
    """A feedforward network on ``(phi - mean) / scale``; without hidden layers a linear model.

    Attributes
    ----------
    weights : tuple of ndarray (n_in, n_out)
    biases : tuple of ndarray (n_out,)
    activation : {"identity", "tanh", "logistic", "relu"}
        Of the hidden layers; the last layer is linear.
    mean, scale : ndarray (n_features,)
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    activation: str
    mean: np.ndarray
    scale: np.ndarray

    @property
    def theta(self) -> np.ndarray:
        """All weights, then all biases, flat."""
        return np.concatenate([w.ravel() for w in (*self.weights, *self.biases)])

    def at(self, theta: np.ndarray) -> Net:
        """The same network with other weights."""
        parts, place = [], 0
        for w in (*self.weights, *self.biases):
            parts.append(theta[place : place + w.size].reshape(w.shape))
            place += w.size
        n = len(self.weights)
        return replace(self, weights=tuple(parts[:n]), biases=tuple(parts[n:]))

    def folded(self) -> tuple[np.ndarray, np.ndarray]:
        """Weights and biases of the first layer with the scaling of the features inside."""
        first = self.weights[0] / self.scale[:, None]
        return first, self.biases[0] - self.mean @ first

    def __call__(self, phi: np.ndarray) -> np.ndarray:
        """(n_rows, n_features) -> (n_rows, n_outputs)."""
        first, bias = self.folded()
        return self.tail(phi @ first + bias)[-1]

    def tail(self, z: np.ndarray) -> list[np.ndarray]:
        """Values of every layer from the first layer's sums (n_rows, n_units); the last is the output."""
        values = []
        for w, b in zip(self.weights[1:], self.biases[1:]):
            values.append(activate(self.activation, z))
            z = values[-1] @ w + b
        return [*values, z]

    def jacobians(self, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Output, its slopes (n_rows, n_outputs, n_features) and (n_rows, n_outputs, n_theta)."""
        x = (phi - self.mean) / self.scale
        values = self.tail(x @ self.weights[0] + self.biases[0])
        n, o = values[-1].shape
        back = np.broadcast_to(np.eye(o), (n, o, o))
        into_w: list[np.ndarray] = []
        into_b: list[np.ndarray] = []
        for k in range(len(self.weights) - 1, -1, -1):
            below = values[k - 1] if k else x
            into_b.insert(0, back)
            into_w.insert(0, (below[:, None, :, None] * back[:, :, None, :]).reshape(n, o, -1))
            back = back @ self.weights[k].T
            if k:
                back = back * slope(self.activation, below)[:, None, :]
        return values[-1], back / self.scale, np.concatenate([*into_w, *into_b], axis=2)


def activate(kind: str, z: np.ndarray) -> np.ndarray:
    """Value of an activation."""
    if kind == "tanh":
        return np.tanh(z)
    if kind == "logistic":
        return 0.5 + 0.5 * np.tanh(0.5 * z)
    return np.maximum(z, 0.0) if kind == "relu" else z


def slope(kind: str, value: np.ndarray) -> np.ndarray:
    """Slope of an activation from its value."""
    if kind == "tanh":
        return 1.0 - value**2
    if kind == "logistic":
        return value * (1.0 - value)
    return (value > 0).astype(float) if kind == "relu" else np.ones_like(value)


def march(
    step: Callable[[np.ndarray], np.ndarray], known: np.ndarray, first: np.ndarray, lags: Sequence[int]
) -> np.ndarray:
    """Free run of any one-step model, all runs abreast, one call a step.

    Parameters
    ----------
    step : callable
        (n_runs, n_features) -> (n_runs, n_outputs); features are past outputs in the order of ``lags``, then ``known``.
    known : ndarray (n_steps, n_runs, n_known)
        Features that do not depend on the outputs.
    first : ndarray (n_first, n_runs, n_outputs)
        Outputs at the first steps.
    lags : sequence of int

    Returns
    -------
    ndarray (n_steps, n_runs, n_outputs)
    """
    n_steps, n_runs, _ = known.shape
    y = np.empty((n_steps, n_runs, first.shape[2]))
    y[: len(first)] = first[:n_steps]
    for t in range(len(first), n_steps):
        if not np.all(np.isfinite(y[t - 1])):
            y[t:] = np.nan
            break
        y[t] = step(np.concatenate([*(y[t - k] for k in lags), known[t]], axis=1))
    return y


def free_run(net: Net, known: np.ndarray, first: np.ndarray, lags: Sequence[int]) -> np.ndarray:
    """Free run of a network; arguments and result as for :func:`march`.

    A few long runs with one output go by Newton over time, others abreast with the known features' share of the first
    layer made beforehand and each step's past outputs one contiguous window.
    """
    n_steps, n_runs, o = known.shape[0], known.shape[1], first.shape[2]
    if n_steps <= len(first):
        return first[:n_steps].copy()
    weight, bias = net.folded()
    n_past = len(lags) * o
    sums = known @ weight[n_past:] + bias
    if o == 1 and n_runs <= 4 and n_steps > 64:
        runs = [newton_in_time(net, sums[:, r], first[:, r, 0], lags) for r in range(n_runs)]
        return np.stack(runs, axis=1)[:, :, None]
    return _abreast(net, weight[:n_past], sums, first, lags)


def _abreast(net: Net, past: np.ndarray, sums: np.ndarray, first: np.ndarray, lags: Sequence[int]) -> np.ndarray:
    """Time-major loop; y is (n_steps, n_outputs, n_runs), so that a window is one contiguous block."""
    n_steps, n_runs, _ = sums.shape
    o, longest = first.shape[2], max(lags)
    window = np.zeros((past.shape[1], longest, o))
    for k, lag in enumerate(lags):
        window[:, longest - lag] = past[k * o : (k + 1) * o].T
    matrix = window.reshape(len(window), -1)
    shares = np.ascontiguousarray(sums.transpose(0, 2, 1))
    y = np.empty((n_steps, o, n_runs))
    y[: len(first)] = first.transpose(0, 2, 1)
    layers = [(w.T, b[:, None]) for w, b in zip(net.weights[1:], net.biases[1:])]
    with np.errstate(over="ignore", invalid="ignore"):
        for t in range(len(first), n_steps):
            z = matrix @ y[t - longest : t].reshape(-1, n_runs)
            z += shares[t]
            for w, b in layers:
                z = w @ (np.tanh(z, out=z) if net.activation == "tanh" else activate(net.activation, z))
                z += b
            y[t] = z
    return y.transpose(0, 2, 1)


def newton_in_time(net: Net, sums: np.ndarray, first: np.ndarray, lags: Sequence[int]) -> np.ndarray:
    """Free run of one run with one output: all steps of a chunk at once.

    The recursion is ``r(y) = y[t] - f(y[t-1], ..., sums[t]) = 0``; its Jacobian is unit lower triangular and banded, so
    one Newton step is one LAPACK ``dtbtrs``. Where Newton does not settle the chunk is run step by step.

    Parameters
    ----------
    net : Net
    sums : ndarray (n_steps, n_units)
        The first layer's sums without the past outputs.
    first : ndarray (n_first,)
    lags : sequence of int

    Returns
    -------
    ndarray (n_steps,)
    """
    past = net.folded()[0][: len(lags)]
    y = np.empty(len(sums))
    y[: len(first)] = first
    start = len(first)
    while start < len(y):
        stop = min(start + CHUNK, len(y))
        if not _newton_chunk(net, past, sums, y, lags, start, stop):
            chunk = _abreast(
                net, past, sums[:stop, None][start - max(lags) :], y[start - max(lags) : start, None, None], lags
            )
            y[start:stop] = chunk[max(lags) :, 0, 0]
            if not np.isfinite(y[stop - 1]):
                y[stop:] = np.nan
                break
        start = stop
    return y


def _newton_chunk(
    net: Net, past: np.ndarray, sums: np.ndarray, y: np.ndarray, lags: Sequence[int], start: int, stop: int
) -> bool:
    """Solve rows start:stop of y in place; whether Newton settled."""
    y[start:stop] = y[start - 1]
    band = np.zeros((max(lags) + 1, stop - start))
    before = np.inf
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(25):
            z = sums[start:stop].copy()
            for k, lag in enumerate(lags):
                z += y[start - lag : stop - lag, None] * past[k]
            values = net.tail(z)
            back = np.ones((1, 1))
            for w, value in zip(reversed(net.weights[1:]), reversed(values[:-1])):
                back = (back @ w.T) * slope(net.activation, value)
            slopes = np.broadcast_to(back @ past.T, (stop - start, len(lags)))
            for k, lag in enumerate(lags):
                band[lag, : max(stop - start - lag, 0)] = -slopes[lag:, k]
            step, info = dtbtrs(band, values[-1] - y[start:stop, None], uplo="L", diag="U")
            size = np.abs(step).max()
            if info or not np.isfinite(size) or size > 1e12:
                return False
            y[start:stop] += step[:, 0]
            # quadratic: once small it is exact; a last step is taken anyway, so the recursion holds to rounding
            if size <= 1e-11 * (1.0 + np.abs(y[start:stop]).max()) or (size >= before and size < 1e-9):
                return True
            before = size
    return False


def free_run_jacobian(net: Net, known: np.ndarray, y: np.ndarray, n_first: int, lags: Sequence[int]) -> np.ndarray:
    """Slopes of a free run by the weights: one banded triangular solve a run with n_theta right-hand sides.

    Parameters
    ----------
    net, known, lags
        As for :func:`free_run`.
    y : ndarray (n_steps, n_runs, n_outputs)
        Its result.
    n_first : int
        Rows that were given.

    Returns
    -------
    ndarray (n_steps - n_first, n_runs, n_outputs, n_theta)
    """
    n_steps, n_runs, o = y.shape
    n, width = n_steps - n_first, (max(lags) + 1) * o
    out = np.empty((n, n_runs, o, net.theta.size))
    for r in range(n_runs):
        phi = np.concatenate([*(y[n_first - k : n_steps - k, r] for k in lags), known[n_first:, r]], axis=1)
        _, by_phi, by_theta = net.jacobians(phi)
        band = np.zeros((width, n * o))
        for k, lag in enumerate(lags):
            for j in range(o):
                for i in range(o):
                    band[lag * o + j - i, i : max(n - lag, 0) * o : o] = -by_phi[lag:, j, k * o + i]
        out[:, r] = dtbtrs(band, by_theta.reshape(n * o, -1), uplo="L", diag="U")[0].reshape(n, o, -1)
    return out


def fit_free_run(
    net: Net,
    known: np.ndarray,
    target: np.ndarray,
    n_first: int,
    lags: Sequence[int],
    alpha: float = 0.0,
    max_iter: int = 100,
    tol: float = 1e-7,
) -> tuple[Net, float]:
    """Levenberg-Marquardt on the free run: ``sum (y - y_hat)^2 + alpha * sum w^2``.

    Parameters
    ----------
    net : Net
        Starting weights.
    known : ndarray (n_steps, n_runs, n_known)
    target : ndarray (n_steps, n_runs, n_outputs)
        Measured outputs, the first ``n_first`` of which start the runs; nan rows (ends of shorter runs) do not count.
    n_first, lags
    alpha : float
        Penalty on weights, not on biases.
    max_iter, tol
        Steps at most; relative decrease below which it stops.

    Returns
    -------
    net : Net
    cost : float
    """
    first, wanted = target[:n_first], target[n_first:]
    counts = np.isfinite(wanted)
    penalised = np.arange(net.theta.size) < sum(w.size for w in net.weights)

    def cost_of(candidate: Net) -> tuple[float, np.ndarray]:
        y = free_run(candidate, known, first, lags)
        error = np.where(counts, y[n_first:] - np.where(counts, wanted, 0.0), 0.0)
        with np.errstate(over="ignore", invalid="ignore"):
            total = float((error**2).sum() + alpha * (candidate.theta[penalised] ** 2).sum())
        return (total if np.isfinite(total) else np.inf), y

    cost, y = cost_of(net)
    damping = 1e-3
    for _ in range(max_iter if np.isfinite(cost) else 0):
        J = free_run_jacobian(net, known, y, n_first, lags)[counts]
        if not np.all(np.isfinite(J)):
            break
        theta = net.theta
        gradient = J.T @ (y[n_first:] - wanted)[counts] + alpha * penalised * theta
        normal = J.T @ J + alpha * np.diag(penalised.astype(float))
        size = np.maximum(np.diag(normal), 1e-10 * np.diag(normal).max() + 1e-300)
        before = cost
        for _ in range(12):
            trial = net.at(theta - np.linalg.solve(normal + damping * np.diag(size), gradient))
            new, y_new = cost_of(trial)
            if new < cost:
                net, cost, y, damping = trial, new, y_new, max(damping / 5, 1e-12)
                break
            damping *= 4
        if before - cost <= tol * before:
            break
    return net, cost
