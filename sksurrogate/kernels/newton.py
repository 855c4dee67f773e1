"""Newton over time: all steps of a free run at once, and the slopes of a free run by its weights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg.lapack import dtbtrs

from sksurrogate.kernels.net import LagNet

#: Newton gives up where a correction is this many times the size of the outputs.
TOO_FAR = 1e6


def newton_runs(
    model: LagNet, sums: np.ndarray, y: np.ndarray, n_first: int, max_iter: int = 20, rtol: float = 1e-12
) -> bool:
    """Free runs of equal length, in place.

    The recursion is ``r(y) = y[t] - f(y[t-1], ..., u[t], ...) = 0``; its Jacobian is unit lower triangular and banded,
    so one Newton step for all runs together is one LAPACK ``dtbtrs``.

    ``model``: folded.
    ``sums`` (n_units, n_runs * n): share of inputs and bias in the first layer's sums, run by run, without the first
        rows.
    ``y`` (n_runs, n_steps, n_outputs): first rows and a guess of the others; the solution on return.
    ``n_first``: rows that are given.
    ``rtol``: expected remaining error, relative to the largest output.
    Returns whether Newton settled; if not, y holds nothing of use.
    """
    n_runs, n_steps, o = y.shape
    net = model.net
    W = np.ascontiguousarray(net.weights[0][: model.n_past].T)
    band = np.zeros((n_runs, n_steps - n_first, o, (max(model.output_lags) + 1) * o))
    before, held = np.inf, np.empty_like(sums)
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(max_iter):
            np.matmul(W, model.past_rows(y, n_first), out=held)
            held += sums
            values = net.layers(held)
            for j in range(o):
                fill_band(band, model.output_lags, W.T @ net.back(values, j)[0], j)
            rest = values[-1].reshape(o, n_runs, -1).transpose(1, 2, 0) - y[:, n_first:]
            step, info = solve_band(band, rest.reshape(-1, 1))
            size, scale = float(np.abs(step).max()), float(np.abs(y).max())
            if info or not size <= TOO_FAR * (1.0 + scale):
                return False
            y[:, n_first:] += step.reshape(rest.shape)
            scale = max(scale, float(np.abs(y).max()), 1e-300)
            # Newton is quadratic: the next correction is about size * (size / before^2) * size
            growth = size / max(before, 1e-150) ** 2 if before < np.inf else 1e3 / scale
            if size <= rtol * scale or (growth * size * size <= rtol * scale and size < 1e-3 * scale):
                return True
            before = size
    return False


def fill_band(band: np.ndarray, lags: Sequence[int], slopes: np.ndarray, j: int) -> None:
    """Write minus the slopes (n_past, n_runs * n) of output j below the diagonal of the band."""
    n_runs, n, o, _ = band.shape
    slopes = slopes.reshape(-1, n_runs, n)
    for k, lag in enumerate(lags):
        for i in range(o):
            np.negative(slopes[k * o + i, :, lag:], out=band[:, : max(n - lag, 0), i, lag * o + j - i])


def solve_band(
    band: np.ndarray, rest: np.ndarray, transposed: str = "N", *, in_place: bool = False
) -> tuple[np.ndarray, int]:
    """Solution of the unit lower banded system, (n_rows, n_right); ``in_place``: a ``rest`` in Fortran order is lost."""
    lower = band.reshape(-1, band.shape[-1]).T
    return dtbtrs(lower, rest, uplo="L", diag="U", trans=transposed, overwrite_b=in_place)


def _band_at(model: LagNet, U: np.ndarray, y: np.ndarray, n_first: int) -> tuple:
    """Band of the recursion at a trajectory, with the layers' values, their slopes and the scaled features."""
    net, o = model.net, model.n_outputs
    x = np.concatenate([model.past_rows(y, n_first), model.input_rows(U, n_first)])
    x -= net.mean[:, None]
    x /= net.scale[:, None]
    values = net.layers(net.weights[0].T @ x + net.biases[0][:, None])
    band = np.zeros((y.shape[0], y.shape[1] - n_first, o, (max(model.output_lags) + 1) * o))
    inward = net.weights[0][: model.n_past] / net.scale[: model.n_past, None]
    backs = [net.back(values, j) for j in range(o)]
    for j in range(o):
        fill_band(band, model.output_lags, inward @ backs[j][0], j)
    return band, x, values, backs


def sensitivities(model: LagNet, U: np.ndarray, y: np.ndarray, n_first: int) -> np.ndarray:
    """Slopes of free runs by the weights: one banded triangular solve with n_theta right-hand sides.

    ``model``: as it stands, scaling included.
    ``U`` (n_runs, n_steps, n_inputs).
    ``y`` (n_runs, n_steps, n_outputs): the free runs.
    ``n_first``: rows that were given.
    Returns (n_runs, n_steps - n_first, n_outputs, n_theta).
    """
    band, x, values, backs = _band_at(model, U, y, n_first)
    n_runs, n, o, _ = band.shape
    right = np.empty((model.net.theta.size, n_runs * n, o))
    for j in range(o):
        model.net.by_theta(x, values, backs[j], right[:, :, j])
    found, _ = solve_band(band, right.reshape(len(right), -1).T, in_place=True)
    return found.reshape(n_runs, n, o, -1)


def adjoint_gradient(model: LagNet, U: np.ndarray, y: np.ndarray, n_first: int, weight: np.ndarray) -> np.ndarray:
    """``sum weight * dy/dtheta`` by one transposed banded solve.

    ``model, U, y, n_first``: as for :func:`sensitivities`.
    ``weight`` (n_runs, n_steps - n_first, n_outputs).
    Returns (n_theta,).
    """
    band, x, values, backs = _band_at(model, U, y, n_first)
    adjoint = solve_band(band, weight.reshape(-1, 1), "T")[0].reshape(-1, model.n_outputs)
    by_layer = [sum(back * adjoint[:, j] for j, back in enumerate(layer)) for layer in zip(*backs)]
    parts = [(below @ back.T).ravel() for below, back in zip([x, *values[:-1]], by_layer)]
    return np.concatenate([*parts, *(back.sum(axis=1) for back in by_layer)])
