"""Fits that no slope leads on: predictions that jump with a parameter."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._onset import Starting
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._rounding import alike
from sksurrogate.kernels.banded import a_sample_later, recursion_band, solve_recursion
from sksurrogate.kernels.linear_fit import linear_least_squares

#: Values nearby that are fitted, best first.
MOST_NEARBY = 3
#: What a fit at another value must remove (squares of errors over the noise).
WORTH_A_FIT = 1.0


def line_searched(candidate: OdeCandidate, i: int = -1) -> OdeCandidate:
    """Fit again from values nearby where the prediction of effect i, of the last by default, jumps with them, or with its window."""
    for _ in range(3):
        before = candidate.fit.cost
        for theta in better_values(candidate, i):
            other = candidate.resumed(candidate.problem, theta, max_steps=6)
            if other is not None and other.fit.cost < candidate.fit.cost:
                candidate = other
        if candidate.fit.cost > before - WORTH_A_FIT:
            break
    return candidate


def better_values(candidate: OdeCandidate, i: int = -1) -> list[np.ndarray]:
    """Parameters with effect i, the last by default, at another value, where less is expected to be left.

    The change of the free run to first order in the states, ``dx' = A dx + f(x; c') - f(x; c)``, all values at once; initial
    states and the other parameters follow by least squares.
    """
    problem, model, fit = candidate.problem, candidate.model, candidate.fit
    record = problem.record
    place = model.slice_of(i % len(candidate.effects))
    effect = candidate.effects[i]
    now = tuple(fit.theta[place])
    values = effect.scan(now)
    if values:
        values = [*values, *alike(problem.plant, record, effect, now)]
    if isinstance(effect, Starting):
        values = [*values, *effect.moved(now, record.dt, record.dt * int(record.lengths.max()))]
    if not values:
        return []
    columns = np.repeat(fit.theta[:, None], 1 + len(values), axis=1)
    columns[place, 1:] = np.array(values).T
    with np.errstate(all="ignore"):
        lin, bound = candidate.linearised, model.bind(columns)
        x = np.repeat(fit.x[:, None], columns.shape[1], axis=1)
        after = bound(x)
        b = a_sample_later(after - after[:, :1], record.starts)
        y = bound.outputs(x + solve_recursion(recursion_band(lin.A, record.starts), b))
    others = np.delete(np.arange(len(fit.theta)), place)
    left = (record.y[:, None] - y).transpose(1, 0, 2)
    whole = np.concatenate([left, lin.J_theta[:, others].transpose(1, 0, 2)])
    if not (np.isfinite(whole).all() and np.isfinite(lin.J_x[:, model.free_states]).all()):
        return []
    flat = candidate.without_starts(whole).reshape(len(whole), -1)
    mean, sd_prior = problem.prior(candidate.effects, fit.theta)
    left = _left(flat[: len(y[0])], flat[len(y[0]) :], sd_prior[others], (fit.theta - mean)[others])
    order = 1 + np.argsort(left[1:])[:MOST_NEARBY]
    return [columns[:, k] for k in order if left[k] < left[0] - WORTH_A_FIT]


def _left(r: np.ndarray, J: np.ndarray, prior: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Squares that residuals (n, n_values) leave when parameters with sensitivities J, ``moved`` from the mean of their prior, follow."""
    if not len(J):
        return np.einsum("kn,kn->k", r, r)
    rows = np.concatenate([J.T, np.diag(1.0 / prior)])
    wanted = np.concatenate([r.T, np.repeat((-moved / prior)[:, None], len(r), axis=1)])
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    rest = wanted - rows @ (linear_least_squares(rows / scale, wanted, rcond=1e-10) / scale[:, None])
    return np.einsum("nk,nk->k", rest, rest)
