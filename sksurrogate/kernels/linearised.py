"""A model linearised over the whole time axis: slopes of a trajectory by parameters and initial states."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.kernels.banded import recursion_band, solve_recursion
from sksurrogate.kernels.free_run_model import FreeRunModel
from sksurrogate.kernels.integrate import DIFFERENCE, moved_one_by_one

#: Relative step of the forward differences with respect to parameters.
THETA_DIFFERENCE = 1e-4


@dataclass(frozen=True, eq=False)
class Linearised:
    """Sensitivities of a trajectory and of its outputs."""

    x: np.ndarray  #: (n_states, n_samples): the trajectory with its defects closed to first order
    y: np.ndarray  #: (n_outputs, n_samples): its outputs
    #: Z_theta, Z_x: (n_states, n_theta | n_states, n_samples): sensitivities to the parameters and to the initial
    #: states of the run
    Z_theta: np.ndarray
    Z_x: np.ndarray
    #: J_theta, J_x: (n_outputs, ..., n_samples): the same of the outputs, 0 where nothing was measured
    J_theta: np.ndarray
    J_x: np.ndarray
    A: np.ndarray  #: (n_states, n_states, n_samples)
    band: np.ndarray  #: Band of the recursion

    def kept(self) -> Linearised:
        """Without Z and band."""
        none = np.empty(0)
        return replace(self, Z_theta=none, Z_x=none, band=none)


def linearise(model: FreeRunModel, theta: np.ndarray, x: np.ndarray, unit: np.ndarray) -> Linearised:
    """Linearise a model over the whole time axis, by differences of the whole step map.

    Parameters
    ----------
    model : FreeRunModel
    theta : ndarray (n_theta,)
    x : ndarray (n_states, n_samples)
    unit : ndarray (n_theta,)
        Size of each parameter.
    """
    n, k, starts = model.n_states, model.n_theta, model.record.starts
    dx = DIFFERENCE * model.scale
    columns = moved_one_by_one(x, dx, 1 + n + k)
    dtheta = THETA_DIFFERENCE * np.maximum(np.abs(theta), unit)
    values = np.repeat(theta[:, None], 1 + n + k, axis=1)
    values[np.arange(k), 1 + n + np.arange(k)] += dtheta
    after = model.bind(values)(columns)
    A = (after[:, 1 : 1 + n] - after[:, :1]) / dx[:, None]
    band = recursion_band(A, starts)
    b = np.zeros((n, 1 + k + n, x.shape[1]))
    b[:, 0, 1:] = after[:, 0, :-1] - x[:, 1:]
    b[:, 1 : 1 + k, 1:] = (after[:, 1 + n :, :-1] - after[:, :1, :-1]) / dtheta[:, None]
    b[:, :, starts] = 0.0
    for j in range(n):
        b[j, 1 + k + j, starts] = 1.0
    _start_of_hidden(model, values[:, 1 + n :], theta, dtheta, x, b[:, 1 : 1 + k], b[:, 1 + k :])
    Z = solve_recursion(band, b)
    Z_theta, Z_x = Z[:, 1 : 1 + k], Z[:, 1 + k :]
    closed = x + Z[:, 0]
    y, J_theta, J_x = _output_sensitivities(model, theta, closed, Z_theta, Z_x, dtheta)
    seen_of = model.record.seen_of
    return Linearised(closed, y, Z_theta, Z_x, seen_of(J_theta), seen_of(J_x), A, band)


def _start_of_hidden(
    model: FreeRunModel,
    values: np.ndarray,
    theta: np.ndarray,
    dtheta: np.ndarray,
    x: np.ndarray,
    b_theta: np.ndarray,
    b_x: np.ndarray,
) -> None:
    """Hidden states whose start is known follow the nominal initial states and the parameters there."""
    known = ~model.free_states
    if not known.any():
        return
    n, m, k, starts = model.n_states, model.n_nominal, model.n_theta, model.record.starts
    dx = DIFFERENCE * model.scale
    first = moved_one_by_one(x[:m, starts], dx, 1 + m + k)
    base = np.repeat(theta[:, None], 1 + m, axis=1)
    started = model.bind(np.concatenate([base, values], axis=1)).start(first)
    for i in np.flatnonzero(known):
        b_x[i, i, starts] = 0.0
        for j in range(m):
            b_x[i, j, starts] = (started[i, 1 + j] - started[i, 0]) / dx[j]
        for j in range(k):
            b_theta[i, j, starts] = (started[i, 1 + m + j] - started[i, 0]) / dtheta[j]
    assert n >= m


def _output_sensitivities(
    model: FreeRunModel, theta: np.ndarray, x: np.ndarray, Z_theta: np.ndarray, Z_x: np.ndarray, dtheta: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outputs and their sensitivities: rows of Z for plain states, differences along Z with functions and sensor effects."""
    k, n = Z_theta.shape[1], Z_x.shape[1]
    selected = model.plain_outputs
    if selected is not None:
        rows = list(selected)
        return x[rows], Z_theta[rows], Z_x[rows]
    size = np.maximum(np.max(np.abs(Z_x) / model.scale[:, None, None], axis=(0, 2)), 1e-300)
    hx = np.minimum(DIFFERENCE / size, DIFFERENCE * model.scale)
    columns = np.repeat(x[:, None, :], 1 + k + n, axis=1)
    columns[:, 1 : 1 + k] += Z_theta * dtheta[:, None]
    columns[:, 1 + k :] += Z_x * hx[:, None]
    values = np.repeat(theta[:, None], 1 + k + n, axis=1)
    values[np.arange(k), 1 + np.arange(k)] += dtheta
    y = model.bind(values).outputs(columns)
    J = (y[:, 1:] - y[:, :1]) / np.concatenate([dtheta, hx])[:, None]
    return y[:, 0], J[:, :k], J[:, k:]
