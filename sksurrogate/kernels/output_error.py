"""Free-run fits of many rivals with unknown initial states: lifted Gauss-Newton.

All samples of all runs are unknowns at first; one linearisation of the step map over the whole time axis and one banded
solve give the correction of the trajectory and its sensitivities to parameters and initial states together. A few open
steps close the defects and move the parameters at once; then every step is closed by Newton in time, so that the cost is
the free-run cost and the merit function is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.kernels.arrow import Arrow
from sksurrogate.kernels.banded import recursion_band, solve_recursion
from sksurrogate.kernels.integrate import DIFFERENCE, close

__all__ = ["Fit", "Linearised", "free_run", "linearise", "output_error", "settle_hidden"]

#: Relative step of the forward differences with respect to parameters.
THETA_DIFFERENCE = 1e-4

#: Open steps end where parameters and trajectory move by less than this share of their size.
SETTLED = 1e-3


@dataclass(frozen=True, eq=False)
class Linearised:
    """Sensitivities of a trajectory and of its outputs.

    Attributes
    ----------
    x : ndarray (n_states, n_samples)
        The trajectory with its defects closed to first order.
    y : ndarray (n_outputs, n_samples)
        Its outputs.
    Z_theta, Z_x : ndarray (n_states, n_theta | n_states, n_samples)
        Sensitivities to the parameters and to the initial states of the run.
    J_theta, J_x : ndarray (n_outputs, ..., n_samples)
        The same of the outputs.
    A : ndarray (n_states, n_states, n_samples)
    band : ndarray
        Band of the recursion.
    """

    x: np.ndarray
    y: np.ndarray
    Z_theta: np.ndarray
    Z_x: np.ndarray
    J_theta: np.ndarray
    J_x: np.ndarray
    A: np.ndarray
    band: np.ndarray


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted free run.

    Attributes
    ----------
    theta : ndarray (n_theta,)
    x : ndarray (n_states, n_samples)
        The free run.
    y : ndarray (n_outputs, n_samples)
        Its outputs.
    cost : float
        Sum of squares of (y - free run) / sd, with the prior.
    n_iterations : int
    converged : bool
    linearised : Linearised or None
        At the solution.
    """

    theta: np.ndarray
    x: np.ndarray
    y: np.ndarray
    cost: float
    n_iterations: int
    converged: bool
    linearised: Linearised | None


def linearise(model: Any, theta: np.ndarray, x: np.ndarray, unit: np.ndarray) -> Linearised:
    """Linearise a model over the whole time axis, by differences of the whole step map.

    Parameters
    ----------
    model : augmented model
    theta : ndarray (n_theta,)
    x : ndarray (n_states, n_samples)
    unit : ndarray (n_theta,)
        Size of each parameter.
    """
    n, k, starts = model.n_states, model.n_theta, model.record.starts
    columns = np.repeat(x[:, None, :], 1 + n + k, axis=1)
    dx = DIFFERENCE * model.scale
    for j in range(n):
        columns[j, 1 + j] += dx[j]
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
    return Linearised(closed, y, Z_theta, Z_x, J_theta, J_x, A, band)


def _start_of_hidden(
    model: Any,
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
    first = np.repeat(x[:m, None, starts], 1 + m + k, axis=1)
    dx = DIFFERENCE * model.scale
    for j in range(m):
        first[j, 1 + j] += dx[j]
    base = np.repeat(theta[:, None], 1 + m, axis=1)
    begun = model.bind(np.concatenate([base, values], axis=1)).start(first)
    for i in np.flatnonzero(known):
        b_x[i, i, starts] = 0.0
        for j in range(m):
            b_x[i, j, starts] = (begun[i, 1 + j] - begun[i, 0]) / dx[j]
        for j in range(k):
            b_theta[i, j, starts] = (begun[i, 1 + m + j] - begun[i, 0]) / dtheta[j]
    assert n >= m


def _output_sensitivities(
    model: Any, theta: np.ndarray, x: np.ndarray, Z_theta: np.ndarray, Z_x: np.ndarray, dtheta: np.ndarray
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


def settle_hidden(model: Any, theta: np.ndarray, x: np.ndarray, steps: int = 8) -> np.ndarray:
    """Fill in hidden states along a given nominal trajectory: Newton in time on their rows alone."""
    n, m, starts = model.n_states, model.n_nominal, model.record.starts
    if n == m:
        return x
    bound = model.bind(theta[:, None])
    out = np.zeros((n, x.shape[1]))
    out[:m] = x[:m]
    first = bound.start(x[:m, None, starts])
    out[m:] = np.repeat(first[m:, 0], model.record.lengths, axis=1)
    dx = DIFFERENCE * model.scale[m:]
    for _ in range(steps):
        columns = np.repeat(out[:, None, :], 1 + n - m, axis=1)
        for j in range(n - m):
            columns[m + j, 1 + j] += dx[j]
        after = bound(columns)[m:]
        A = (after[:, 1:] - after[:, :1]) / dx[:, None]
        defect = np.zeros_like(out[m:])
        defect[:, 1:] = after[:, 0, :-1] - out[m:, 1:]
        defect[:, starts] = 0.0
        if not (np.all(np.isfinite(A)) and np.all(np.isfinite(defect))):
            break
        step = solve_recursion(recursion_band(A, starts), defect[:, None])[:, 0]
        out[m:] += np.clip(step, -10 * model.scale[m:, None], 10 * model.scale[m:, None])
        if np.max(np.abs(step) / model.scale[m:, None]) < 1e-6:
            break
    return out


def free_run(model: Any, theta: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """Free run from initial states (n_states, n_runs) by a loop over time, all runs abreast: (n_states, n_samples)."""
    record = model.record
    bound = model.bind(theta[:, None])
    out = np.empty((model.n_states, record.n_samples))
    ends = np.r_[record.starts[1:], record.n_samples] - 1
    x = x0[:, None, :]
    for k in range(int(record.lengths.max())):
        rows = np.minimum(record.starts + k, ends)
        alive = record.starts + k <= ends
        out[:, rows[alive]] = x[:, 0][:, alive]
        x = bound(x, rows)
    return out


def output_error(
    model: Any,
    theta: np.ndarray,
    x: np.ndarray,
    sd: np.ndarray,
    *,
    unit: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    prior: np.ndarray | None = None,
    open_steps: int = 3,
    max_steps: int = 25,
    best: float = np.inf,
    fit_start: bool = True,
    fallback: np.ndarray | None = None,
    reach: float = np.inf,
    settled: float = SETTLED,
    tries: int = 6,
) -> Fit | None:
    """Fit parameters and initial states through the free run.

    Parameters
    ----------
    model : augmented model with its record
    theta : ndarray (n_theta,)
        Start.
    x : ndarray (n_states, n_samples)
        Start of the trajectory (from the smoother); its first rows start the initial states.
    sd : ndarray (n_outputs,)
        Standard deviation of the noise.
    unit : ndarray (n_theta,)
        Size of each parameter, for differences near 0.
    bounds : (low, high), each ndarray (n_theta,)
    prior : ndarray (n_theta,), optional
        Standard deviation of a prior around 0; inf for none.
    open_steps : int
        Undamped steps that close the trajectory and move the parameters at once.
    best : float
        Cost of the best rival so far; one that cannot come near it is abandoned.
    fit_start : bool
        Whether initial states are fitted.
    fallback : ndarray (n_states, n_samples), optional
        A closed trajectory near the start, used where the open steps go astray; by default one is made by a loop over
        time.
    reach : float
        A step moves a parameter by at most as many times its size.
    settled : float
        Open steps end where parameters and trajectory move by less than this share of their size; closed steps go on.
    tries : int
        Dampings of a closed step, each ten times the last, before the descent ends.

    Returns
    -------
    Fit or None
        None where no finite free run was found.
    """
    with np.errstate(all="ignore"):
        return _OutputError(model, sd, unit, bounds, prior, fit_start, reach, settled, tries).run(
            theta, x, open_steps, max_steps, best, fallback
        )


class _OutputError:
    """One fit."""

    def __init__(
        self, model: Any, sd: np.ndarray, unit: np.ndarray, bounds: tuple, prior: np.ndarray | None, fit_start: bool, reach: float,
        settled: float, tries: int,
    ):  # fmt: skip
        self.model, self.record, self.sd, self.unit = model, model.record, sd, unit
        self.low, self.high = bounds
        self.reach = reach
        self.share, self.tries = settled, tries
        self.fixed = self.low == self.high
        self.precision = np.zeros(model.n_theta) if prior is None else 1.0 / prior**2
        self.free = model.free_states if fit_start else np.zeros(model.n_states, bool)
        self.weight = model.closing_weight(sd)

    def cost(self, y: np.ndarray, theta: np.ndarray) -> float:
        value = float(np.sum(((self.record.y - y) / self.sd[:, None]) ** 2) + np.sum(self.precision * theta**2))
        return value if np.isfinite(value) else np.inf

    def arrow(self, lin: Linearised, theta: np.ndarray) -> Arrow:
        Jt = np.where(self.fixed[:, None], 0.0, lin.J_theta) if self.fixed.any() else lin.J_theta
        Jx = lin.J_x if self.free.all() else lin.J_x[:, self.free]
        return Arrow.build(
            Jt, Jx, self.record.y - lin.y, self.sd, self.record.starts, self.precision, -self.precision * theta
        )

    def step(self, arrow: Arrow, theta: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray, float]:
        """A step within the bounds: parameters that would leave stay there, and the others make the best of it."""
        held = np.full(len(theta), np.nan)
        low, high = self.low, self.high
        if np.isfinite(self.reach):
            far = self.reach * np.maximum(np.abs(theta), self.unit)
            low, high = np.maximum(low, theta - far), np.minimum(high, theta + far)
        while True:
            dt, dx, drop = arrow.step(damping, held)
            new = theta + dt
            out = np.isnan(held) & ((new < low) | (new > high))
            if not out.any():
                return dt, dx, drop
            held[out] = (np.clip(new, low, high) - theta)[out]

    def settled(self, dtheta: np.ndarray, dx: np.ndarray, theta: np.ndarray) -> bool:
        """Whether an open step moved next to nothing: closed steps do the rest."""
        size = np.maximum(np.abs(theta), self.unit)
        still = np.max(np.abs(dtheta) / size, initial=0.0) < self.share
        return bool(still and np.max(np.abs(dx), axis=1) @ (1.0 / self.model.scale) < self.share)

    def moved(
        self, lin: Linearised, theta: np.ndarray, dt: np.ndarray, dx: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Parameters within their bounds, and the trajectory that the sensitivities predict."""
        new = np.clip(theta + dt, self.low, self.high)
        x = lin.x + np.einsum("ikt,k->it", lin.Z_theta, new - theta)
        if self.free.any():
            x = x + np.einsum("ijt,jt->it", lin.Z_x[:, self.free], np.repeat(dx, self.record.lengths, axis=1))
        return new, x

    def closed(self, theta: np.ndarray, x: np.ndarray, band: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, float]:
        """Free run near x, its outputs and cost."""
        bound = self.model.bind(theta[:, None])
        known = ~self.model.free_states
        if known.any():
            x = x.copy()
            starts = self.record.starts
            x[np.ix_(known, starts)] = bound.start(x[: self.model.n_nominal, None, starts])[known, 0]
        x, ok, _ = close(bound, x, self.record.starts, self.weight, 1e-3, band=band)
        if not ok:
            return x, self.record.y, np.inf
        y = bound.outputs(x[:, None])[:, 0]
        return x, y, self.cost(y, theta)

    def run(
        self,
        theta: np.ndarray,
        x: np.ndarray,
        open_steps: int,
        max_steps: int,
        best: float,
        fallback: np.ndarray | None,
    ) -> Fit | None:
        theta = np.clip(theta, self.low, self.high)
        first = theta, x
        for _ in range(open_steps):
            lin = linearise(self.model, theta, x, self.unit)
            if not np.all(np.isfinite(lin.x)):
                break
            dt, dx, _ = self.step(self.arrow(lin, theta), theta, 1e-6)
            if not (np.all(np.isfinite(dt)) and np.all(np.isfinite(dx))):
                break
            before, (theta, x) = (theta, x), self.moved(lin, theta, dt, dx)
            if self.settled(theta - before[0], x - before[1], theta):
                break
        x, y, cost = self.closed(theta, x, None)
        if not np.isfinite(cost):
            # The open steps went astray: closed steps from the start.
            theta = first[0]
            if fallback is not None:
                x, y, cost = self.closed(theta, fallback, None)
            else:
                x = free_run(self.model, theta, first[1][:, self.record.starts])
                if np.all(np.isfinite(x)):
                    y = self.model.bind(theta[:, None]).outputs(x[:, None])[:, 0]
                    cost = self.cost(y, theta)
        if not np.isfinite(cost):
            return None
        return self.descend(theta, x, y, cost, max_steps, best)

    def descend(
        self, theta: np.ndarray, x: np.ndarray, y: np.ndarray, cost: float, max_steps: int, best: float
    ) -> Fit | None:
        """Closed Levenberg-Marquardt steps: the cost is that of the free run."""
        damping, done, steps = 1e-3, False, 0
        lin: Linearised | None = None
        for steps in range(1, max_steps + 1):
            lin = linearise(self.model, theta, x, self.unit)
            if not (np.all(np.isfinite(lin.J_theta)) and np.all(np.isfinite(lin.J_x))):
                lin = None
                break
            arrow = self.arrow(lin, theta)
            accepted = False
            for _ in range(self.tries):
                dt, dx, drop = self.step(arrow, theta, damping)
                if drop < 1e-4 * cost + 0.01:
                    done = True
                    break
                new_theta, new_x = self.moved(lin, theta, dt, dx)
                new_x, new_y, new_cost = self.closed(new_theta, new_x, lin.band)
                if new_cost < cost:
                    accepted = True
                    break
                damping = min(damping * 10, 1e6)
            if not accepted:
                break
            fell = cost - new_cost
            theta, x, y, cost, lin = new_theta, new_x, new_y, new_cost, None
            damping = max(damping / 10, 1e-9)
            if cost - 3 * fell > 3 * best:
                break
            if fell < 1e-5 * cost + 0.002:
                done = True
                break
        return Fit(theta, x, y, cost, steps, done, lin)
