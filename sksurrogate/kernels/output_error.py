"""Free-run fits of many candidates with unknown initial states: lifted Gauss-Newton.

All samples of all runs are unknowns at first; one linearisation of the step map over the whole time axis and one banded
solve give the correction of the trajectory and its sensitivities to parameters and initial states together. A few open
steps close the defects and move the parameters at once; then every step is closed by Newton in time, so that the cost is
the free-run cost and the merit function is exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.kernels.damped_steps import OPEN_STEPS_SETTLED, SAME_SLOPES_LEAD_ON, DampedSteps, FreeRun, Slopes
from sksurrogate.kernels.free_run_model import FreeRunModel
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.linearised import Linearised, linearise

#: Open steps diverged where they lead so many times further (squared error) from the data than the trajectory to fall back on.
DIVERGED_STEPS = 4.0
#: Damping of open steps.
HARDLY_DAMPED = 1e-6


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
            model,
            sd,
            unit,
            bounds,
            within,
            prior,
            centre,
            fit_start,
            reach,
            settled,
            tries,
            near,
            lead_on,
            idle,
            idle_above,
        )
        return fit.run(theta, x, open_steps, max_steps, most, fallback)


@dataclass(frozen=True, eq=False)
class _Opened:
    """Where open steps end."""

    theta: np.ndarray
    x: np.ndarray
    moved: float = np.inf  #: By what share the last one moved
    slopes: Slopes | None = None  #: What it came from
    run: FreeRun | None = None  #: The free run there, where slopes led to it


@dataclass(eq=False)
class _OutputError(DampedSteps):
    """One fit: open steps, then damped ones."""

    def opened(self, theta: np.ndarray, x: np.ndarray, most: int) -> _Opened:
        """Open steps until one moves next to nothing: closed steps do the rest."""
        end = _Opened(self.clipped(theta), x)
        for _ in range(most):
            lin = linearise(self.model, end.theta, end.x, self.unit)
            if not np.all(np.isfinite(lin.x)):
                break
            dt, dx, drop = self.step(self.arrow(lin, end.theta), end.theta, HARDLY_DAMPED)
            if not (np.all(np.isfinite(dt)) and np.all(np.isfinite(dx))):
                break
            theta, x = self.moved(lin, end.theta, dt, dx)
            share, run = self.share_of(theta - end.theta, x - end.x, theta), None
            if self.lead_on:
                closed = self.closed(theta, x, lin.band)
                run = closed if self.cost(lin.y, end.theta) - closed.cost > SAME_SLOPES_LEAD_ON * drop else None
            end = _Opened(theta, x, share, Slopes(lin, end.theta, end.x), run)
            if share < self.settled or run is not None:
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
        """Open steps and damped ones; None where there is no finite free run."""
        theta = self.clipped(theta)
        end = self.opened(theta, x, open_steps)
        slopes = end.slopes if end.moved < self.near or end.run is not None else None
        run, fell_back = end.run or self.closed(end.theta, end.x, None if slopes is None else slopes.lin.band), False
        if not np.isfinite(run.cost) or self.diverged(run.cost, theta, fallback):
            closer = None if fallback is None else self.closed(theta, fallback, None)
            fell_back = closer is not None and not run.cost < closer.cost
            if closer is not None and fell_back:
                run, slopes = closer, None
            if not np.isfinite(run.cost):  # no trajectory near leads to the free run (a hard limit)
                run, slopes = self.step_by_step(theta, x if fallback is None else fallback), None
        if not np.isfinite(run.cost):
            return None
        run, steps, done, kept = self.descend(run, max_steps, most, slopes)
        return Fit(run.theta, run.x, run.y, run.cost, steps, done, kept, fell_back)

    def diverged(self, cost: float, theta: np.ndarray, fallback: np.ndarray | None) -> bool:
        """Whether a free run is much further from the data than the trajectory to fall back on."""
        return fallback is not None and cost > DIVERGED_STEPS * self.with_cost(theta, fallback).cost

    def step_by_step(self, theta: np.ndarray, near: np.ndarray) -> FreeRun:
        """The free run from the first rows of a trajectory."""
        x = free_run(self.model, theta, near[:, self.record.starts])
        return self.with_cost(theta, x) if np.all(np.isfinite(x)) else FreeRun(theta, x, self.record.y, np.inf)
