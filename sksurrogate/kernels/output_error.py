"""Free-run fits of many candidates with unknown initial states: lifted Gauss-Newton.

All samples of all runs are unknowns at first; one linearisation of the step map over the whole time axis and one banded
solve give the correction of the trajectory and its sensitivities to parameters and initial states together. A few open
steps close the defects and move the parameters at once; then every step is closed by Newton in time, so that the cost is
the free-run cost and the merit function is exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from sksurrogate.kernels.arrow import Arrow
from sksurrogate.kernels.banded import recursion_band, solve_recursion
from sksurrogate.kernels.free_run_model import BoundFreeRunModel, FreeRunModel
from sksurrogate.kernels.integrate import DIFFERENCE, close
from sksurrogate.kernels.linearised import Linearised, linearise
from sksurrogate.kernels.windows import run_by_samples, run_in_windows

#: Slopes of a point nearby end a descent only where they promise this share of what would do otherwise.
_STRICTER = 1e-2
#: Open steps diverged where they lead so many times further (squared error) from the data than the trajectory to fall back on.
DIVERGED_STEPS = 4.0
#: A step moves the initial states of a run by at most so many times their sizes: those that no output shows would go anywhere.
LARGEST_START_STEP = 10.0
#: Correction, over the size of each state, at which a run by Newton in time counts as closed.
NEWTON_CLOSED = 1e-9
#: Open steps end where parameters and trajectory move by less than this share of their size.
OPEN_STEPS_SETTLED = 1e-3
#: A step that takes at least the first share of what its slopes promise is followed by one with less damping, and by one with the
#: same slopes, where these lead on, if it takes the second: so much of what is left falls in the time of one more run.
KEPT_PROMISE, SAME_SLOPES_LEAD_ON = 0.5, 0.9
#: Newton steps in which hidden states settle along a trajectory.
SETTLING_STEPS = 8


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted free run."""

    theta: np.ndarray  #: (n_theta,)
    x: np.ndarray  #: (n_states, n_samples): the free run
    y: np.ndarray  #: (n_outputs, n_samples): its outputs
    cost: float  #: Sum of squares of (y - free run) / sd, with the prior
    n_iterations: int
    converged: bool
    linearised: Linearised | None  #: At the solution, or as ``near`` to it as was allowed
    fell_back: bool = False  #: Whether it began along the trajectory to fall back on, from its first parameters


def settle_hidden(model: FreeRunModel, theta: np.ndarray, x: np.ndarray) -> np.ndarray:
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
    for _ in range(SETTLING_STEPS):
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


def free_run(model: FreeRunModel, theta: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """Free run from initial states (n_states, n_runs), by the simulator itself or window by window: (n_states, n_samples)."""
    bound, record = model.bind(theta[:, None]), model.record
    own = bound.run(x0)
    return own if own is not None else run_in_windows(bound, x0, record.starts, record.lengths, model.scale)


def run_near(model: FreeRunModel, theta: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Free run from the first rows of a trajectory (n_states, n_samples): by Newton in time from there, else window by window."""
    starts = model.record.starts
    x, closed, _ = close(model.bind(theta[:, None]), near, starts, model.scale, NEWTON_CLOSED)
    return x if closed else free_run(model, theta, near[:, starts])


def approached(
    model: FreeRunModel, theta: np.ndarray, x: np.ndarray, sd: np.ndarray, *, open_steps: int, **options: Any
) -> tuple[np.ndarray, np.ndarray] | None:
    """Where open steps alone lead: parameters and a trajectory whose defects are closed to first order.

    Arguments as for :func:`output_error`; None where the steps diverge or do not settle.
    """
    with np.errstate(all="ignore"):
        end = _OutputError(model, sd, **options).opened(theta, x, open_steps)
    return (end.theta, end.x) if end.moved < options.get("settled", OPEN_STEPS_SETTLED) else None


def output_error(
    model: FreeRunModel,
    theta: np.ndarray,
    x: np.ndarray,
    sd: np.ndarray,
    *,
    unit: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    within: Callable[[np.ndarray], np.ndarray] | None = None,
    prior: np.ndarray | None = None,
    centre: np.ndarray | None = None,
    open_steps: int = 3,
    max_steps: int = 25,
    most: float = np.inf,
    fit_start: bool = True,
    fallback: np.ndarray | None = None,
    reach: float = np.inf,
    settled: float = OPEN_STEPS_SETTLED,
    tries: int = 6,
    near: float = 0.0,
    lead_on: bool = False,
    idle: float = 0.0,
    idle_above: float = np.inf,
) -> Fit | None:
    """Fit parameters and initial states through the free run.

    ``theta`` (n_theta,): start.
    ``x`` (n_states, n_samples): start of the trajectory (from the smoother); its first rows start the initial states.
    ``sd`` (n_outputs,): standard deviation of the noise.
    ``unit`` (n_theta,): size of each parameter, for differences near 0.
    ``bounds`` (low, high), each ndarray (n_theta,).
    ``within``: the nearest parameters that a step may end at; by default those within the bounds.
    ``prior`` (n_theta,): standard deviation of a prior; inf for none.
    ``centre`` (n_theta,): mean of the prior; 0 by default.
    ``open_steps``: undamped steps that close the trajectory and move the parameters at once.
    ``most``: a fit that three more steps like its last would leave above this cost is abandoned.
    ``fit_start``: whether initial states are fitted.
    ``fallback`` (n_states, n_samples): a closed trajectory near the start, used where the open steps diverge (to no
        free run, or to one much further from the data); by default one is made by a loop over time.
    ``reach``: a step moves a parameter by at most as many times its size.
    ``settled``: open steps end where parameters and trajectory move by less than this share of their size; closed steps
        go on.
    ``tries``: dampings of a closed step, each ten times the last, before the descent ends.
    ``near``: after a step that moves parameters and trajectory by less than this share of their size, its slopes serve
        again. The fit does not end with slopes of a point farther away than that.
    ``lead_on``: slopes cost as much as many free runs: they serve again as long as steps with them keep their promise.
    ``idle, idle_above``: where the cost is above ``idle_above``, two steps in a row that take less than the share
        ``idle`` of it end the descent.
    Returns None where no finite free run was found.
    """
    with np.errstate(all="ignore"):
        fit = _OutputError(
            model, sd, unit, bounds, prior, fit_start, reach, settled, tries, near, centre, idle, idle_above, lead_on, within,
        )  # fmt: skip
        return fit.run(theta, x, open_steps, max_steps, most, fallback)


#: Parameters and a trajectory at which slopes were taken.
_Point: TypeAlias = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class _Opened:
    """Where open steps end."""

    theta: np.ndarray
    x: np.ndarray
    moved: float = np.inf  #: By what share the last one moved
    lin: Linearised | None = None  #: The linearisation it came from
    at: _Point | None = None  #: Where that was made
    run: tuple[np.ndarray, np.ndarray, float] | None = None  #: The free run there, where slopes led to it


class _OutputError:
    """One fit."""

    def __init__(
        self, model: FreeRunModel, sd: np.ndarray, unit: np.ndarray, bounds: tuple, prior: np.ndarray | None = None, fit_start: bool = True,
        reach: float = np.inf, settled: float = OPEN_STEPS_SETTLED, tries: int = 6, near: float = 0.0,
        centre: np.ndarray | None = None, idle: float = 0.0, idle_above: float = np.inf, lead_on: bool = False,
        within: Callable[[np.ndarray], np.ndarray] | None = None,
    ):  # fmt: skip
        self.model, self.record, self.sd, self.unit = model, model.record, sd, unit
        self.low, self.high = bounds
        self.within = within or partial(np.clip, min=self.low, max=self.high)
        self.reach = reach
        self.share, self.tries, self.near, self.lead_on = settled, tries, near, lead_on
        self.idle, self.idle_above = idle, idle_above
        self.fixed = self.low == self.high
        self.precision = np.zeros(model.n_theta) if prior is None else 1.0 / prior**2
        self.centre = np.zeros(model.n_theta) if centre is None else centre
        self.free = model.free_states if fit_start else np.zeros(model.n_states, bool)
        self.weight = model.closing_weight(sd)
        self.jumps = False  # whether Newton's method has failed on a map that may jump

    def cost(self, y: np.ndarray, theta: np.ndarray) -> float:
        held = np.sum(self.precision * (theta - self.centre) ** 2)
        value = float(np.sum((self.record.residual(y) / self.sd[:, None]) ** 2) + held)
        return value if np.isfinite(value) else np.inf

    def arrow(self, lin: Linearised, theta: np.ndarray) -> Arrow:
        Jt = np.where(self.fixed[:, None], 0.0, lin.J_theta) if self.fixed.any() else lin.J_theta
        Jx = lin.J_x if self.free.all() else lin.J_x[:, self.free]
        pull = self.precision * (self.centre - theta)
        return Arrow.build(Jt, Jx, self.record.residual(lin.y), self.sd, self.record.starts, self.precision, pull)

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
            end = self.within(np.clip(new, low, high))
            out = np.isnan(held) & (end != new) & np.isfinite(new)
            if not out.any():
                return dt, dx, drop
            held[out] = (end - theta)[out]

    def share_of(self, dtheta: np.ndarray, dx: np.ndarray, theta: np.ndarray) -> float:
        """By what share of their size parameters and trajectory move."""
        size = np.maximum(np.abs(theta), self.unit)
        largest = np.maximum(dx.max(axis=1), -dx.min(axis=1))
        return float(np.max(np.abs(dtheta) / size, initial=largest @ (1.0 / self.model.scale)))

    def moved(
        self, lin: Linearised, theta: np.ndarray, dt: np.ndarray, dx: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Parameters within their bounds, and the trajectory that the sensitivities predict, of initial states not too far off."""
        new = self.within(theta + dt)
        x = lin.x + np.einsum("ikt,k->it", lin.Z_theta, new - theta)
        if self.free.any():
            far = np.max(np.abs(dx) / self.model.scale[self.free, None], axis=0)
            dx = dx * np.minimum(1.0, LARGEST_START_STEP / np.maximum(far, LARGEST_START_STEP))
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
        x, ok = self.run_from(bound, x, band)
        if not ok:
            return x, self.record.y, np.inf
        y = bound.outputs(x[:, None])[:, 0]
        return x, y, self.cost(y, theta)

    def run_from(self, bound: BoundFreeRunModel, x: np.ndarray, band: np.ndarray | None) -> tuple[np.ndarray, bool]:
        """Free run from the first rows of x, and whether there is one: by the simulator itself, else by Newton's method near x.

        Own steps may jump, as contacts do: where that fails, samples are taken one by one, or in windows where one call takes many.
        """
        record = self.record
        runs = x[:, record.starts], record.starts, record.lengths
        own, failed = bound.run(runs[0]), x
        if own is None and not self.jumps:
            closed, ok, _ = close(bound, x, record.starts, self.weight, 1e-3, band=band)
            if ok or not self.model.may_jump:
                return closed, ok
            self.jumps, failed = not self.model.steps_many, closed
        if own is None:
            own = run_by_samples(bound, *runs) if self.jumps else run_in_windows(bound, *runs, self.model.scale)
        ok = bool(np.isfinite(own).all())
        return own if ok else failed, ok

    def opened(self, theta: np.ndarray, x: np.ndarray, most: int) -> _Opened:
        """Open steps until one moves next to nothing: closed steps do the rest."""
        theta = self.within(theta)
        end = _Opened(theta, x)
        for _ in range(most):
            lin = linearise(self.model, end.theta, end.x, self.unit)
            if not np.all(np.isfinite(lin.x)):
                break
            dt, dx, drop = self.step(self.arrow(lin, end.theta), end.theta, 1e-6)
            if not (np.all(np.isfinite(dt)) and np.all(np.isfinite(dx))):
                break
            theta, x = self.moved(lin, end.theta, dt, dx)
            share, run = self.share_of(theta - end.theta, x - end.x, theta), None
            if self.lead_on:
                run = self.closed(theta, x, lin.band)
                run = run if self.cost(lin.y, end.theta) - run[2] > SAME_SLOPES_LEAD_ON * drop else None
            end = _Opened(theta, x, share, lin, (end.theta, end.x), run)
            if end.moved < self.share or run is not None:
                break
        return end

    def run(
        self,
        theta: np.ndarray,
        x: np.ndarray,
        open_steps: int,
        max_steps: int,
        most: float,
        fallback: np.ndarray | None,
    ) -> Fit | None:
        first = self.within(theta), x
        end = self.opened(theta, x, open_steps)
        lin = end.lin if end.moved < self.near or end.run is not None else None
        theta, fell_back = end.theta, False
        x, y, cost = end.run or self.closed(theta, end.x, None if lin is None else lin.band)
        if not np.isfinite(cost) or self.diverged(cost, first[0], fallback):
            # The open steps diverged: closed steps from the start.
            opened = theta, x, y, cost, lin
            theta, lin = first[0], None
            near = first[1] if fallback is None else fallback
            if fallback is not None:
                x, y, cost = self.closed(theta, fallback, None)
            fell_back = fallback is not None and not opened[3] < cost
            if opened[3] < cost:
                theta, x, y, cost, lin = opened
            if not np.isfinite(cost):  # no trajectory near leads to the free run (a hard limit): step by step
                x = free_run(self.model, theta, near[:, self.record.starts])
                if np.all(np.isfinite(x)):
                    y = self.model.bind(theta[:, None]).outputs(x[:, None])[:, 0]
                    cost = self.cost(y, theta)
        if not np.isfinite(cost):
            return None
        fit = self.descend(theta, x, y, cost, max_steps, most, lin, end.at)
        return fit and replace(fit, fell_back=fell_back)

    def diverged(self, cost: float, theta: np.ndarray, fallback: np.ndarray | None) -> bool:
        """Whether a free run is much further from the data than the trajectory to fall back on."""
        if fallback is None:
            return False
        y = self.model.bind(theta[:, None]).outputs(fallback[:, None])[:, 0]
        return cost > DIVERGED_STEPS * self.cost(y, theta)

    def descend(
        self,
        theta: np.ndarray,
        x: np.ndarray,
        y: np.ndarray,
        cost: float,
        max_steps: int,
        most: float,
        lin: Linearised | None,
        at: _Point | None,
    ) -> Fit | None:
        """Closed Levenberg-Marquardt steps: the cost is that of the free run. ``lin``: slopes at the point ``at``, known before."""
        damping, done, steps, idle = 1e-3, False, 0, 0
        for steps in range(1, max_steps + 1):
            stale = lin is not None
            if lin is None:
                lin, at = linearise(self.model, theta, x, self.unit), (theta, x)
            else:
                lin = replace(lin, x=x, y=y)
            if not (np.all(np.isfinite(lin.J_theta)) and np.all(np.isfinite(lin.J_x))):
                lin = None
                break
            arrow = self.arrow(lin, theta)
            enough = (1e-4 * cost + 0.01) * (_STRICTER if stale else 1.0)
            accepted, raised = False, False
            for _ in range(1 if stale else self.tries):
                dt, dx, drop = self.step(arrow, theta, damping)
                if drop < enough:
                    done = True
                    break
                new_theta, new_x = self.moved(lin, theta, dt, dx)
                new_x, new_y, new_cost = self.closed(new_theta, new_x, lin.band)
                if new_cost < cost:
                    accepted = True
                    break
                damping, raised = min(damping * 10, 1e6), True
            if stale and not accepted and not (done and self.is_near(at, theta, x)):
                lin, done = None, False
                continue
            if not accepted:
                break
            share, fell = self.share_of(new_theta - theta, new_x - x, new_theta), cost - new_cost
            again = share < self.near or (self.lead_on and fell > SAME_SLOPES_LEAD_ON * drop)
            theta, x, y, cost, lin = new_theta, new_x, new_y, new_cost, lin if again else None
            if not raised and fell > KEPT_PROMISE * drop:  # a damping that has just failed fails again as a rule
                damping = max(damping / 10, 1e-9)
            if cost - 3 * fell > most:
                break
            idle = idle + 1 if cost > self.idle_above and fell < self.idle * cost else 0
            if idle == 2:
                break
            if fell < 1e-5 * cost + 0.002:
                done = not stale or self.is_near(at, theta, x)
                if done:
                    break
                lin = None
        kept = None if lin is None or not self.is_near(at, theta, x) else lin.kept()
        return Fit(theta, x, y, cost, steps, done, kept)

    def is_near(self, at: _Point | None, theta: np.ndarray, x: np.ndarray) -> bool:
        """Whether slopes of a point count as those of another."""
        if at is None:
            return False
        own = theta is at[0] and x is at[1]
        return own or self.share_of(theta - at[0], x - at[1], theta) < self.near
