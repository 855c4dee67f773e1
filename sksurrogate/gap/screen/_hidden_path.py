"""Hidden states of an effect along a given path of the plant: their own rows alone, all starting values at once."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._families import HiddenEffect
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.gap.fit._pushes import at_end
from sksurrogate.kernels.banded import recursion_band, solve_recursion
from sksurrogate.kernels.integrate import rk4

#: Newton steps; difference of a hidden state and step that ends them, in units of the size of the variable.
NEWTON_STEPS, DIFFERENCE_OF_STATE, CONVERGED = 5, 1e-6, 1e-6


def hidden_paths(effect: HiddenEffect, model: AugmentedModel, theta: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Hidden states driven by the states ``x``, which are taken as straight between samples: Newton in time.

    ``effect``: the last effect of ``model``.
    ``theta`` (n_parameters, n_starts): values of its parameters.
    ``x`` (n_nominal_states or more, n_samples).
    Returns (n_hidden, n_starts, n_samples).
    """
    record, wire, n = model.record, model.wires[-1], effect.n_hidden
    n_starts, n_samples = theta.shape[1], record.n_samples
    size = float(model.scale[-1])
    mean, half, slope, first = _driver(model, x)
    width = record.dt / model.n_sub if wire.width is None else wire.width
    h = record.dt / model.n_sub
    columns = theta

    def rates(t: np.ndarray, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        parameters = [row[:, None] for row in columns]
        v, dv = np.broadcast_to(v[0], z.shape[1:]), np.broadcast_to(slope, z.shape[1:])
        return np.stack(
            [np.broadcast_to(r, z.shape[1:]) for r in effect.rates_within(z, t, v, dv, parameters, width, h)]
        )

    rest = effect.rest(np.broadcast_to(first, (n_starts, n_samples)), [row[:, None] for row in theta])
    z = np.stack([np.array(np.broadcast_to(row, (n_starts, n_samples))) for row in rest])
    all_starts = (np.arange(n_starts)[:, None] * n_samples + record.starts).ravel()  # one start behind the other
    band = np.zeros(0)
    for k in range(2 * NEWTON_STEPS):
        fresh = 0 if k % 2 else n  # every other step keeps the slopes: enough where the hidden states are linear
        varied = np.repeat(z, 1 + fresh, axis=1)
        for j in range(fresh):
            varied[j, 1 + j :: 1 + n] += DIFFERENCE_OF_STATE * size
        columns = np.repeat(theta, 1 + fresh, axis=1)
        after = rk4(rates, record.t, varied, mean, half, h).reshape(n, n_starts, 1 + fresh, n_samples)
        if fresh:
            A = (after[:, :, 1:] - after[:, :, :1]) / (DIFFERENCE_OF_STATE * size)
            band = recursion_band(A.transpose(0, 2, 1, 3).reshape(n, n, -1), all_starts)
        defect = np.zeros_like(z)
        defect[:, :, 1:] = after[:, :, 0, :-1] - z[:, :, 1:]
        defect[:, :, record.starts] = 0.0
        step = solve_recursion(band, defect.reshape(n, 1, -1)).reshape(z.shape)
        lost = ~np.isfinite(step).all(axis=(0, 2))
        step[:, lost] = 0.0
        z += step
        if np.max(np.abs(step)) < CONVERGED * size:
            break
    z[:, lost] = np.nan
    return z


def _driver(model: AugmentedModel, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The variable of the last effect in every substep: mean and half difference (n_sub, 1, 1, n_samples); slope; start."""
    record, n_sub = model.record, model.n_sub
    drivers = model.wires[-1].drivers
    v = np.prod([(x if is_state else record.u)[place] for is_state, place in drivers], axis=0)
    moves = drivers[0][0] or record.order_of_inputs(model.plant.hold)
    change = at_end(record, v[None])[0] - v if moves else np.zeros_like(v)  # an input is held
    share = (np.arange(n_sub) + 0.5)[:, None] / n_sub
    mean = (v + share * change)[:, None, None]
    half = np.broadcast_to(change / (2 * n_sub), (n_sub, len(v)))[:, None, None]
    return mean, half, change / record.dt, v[record.starts][record.run_of_row]
