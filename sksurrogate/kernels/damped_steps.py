"""Levenberg-Marquardt along free runs: every step is closed by Newton in time, so its cost is that of the free run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from sksurrogate.kernels.arrow import Arrow
from sksurrogate.kernels.free_run_model import BoundFreeRunModel, FreeRunModel
from sksurrogate.kernels.integrate import close
from sksurrogate.kernels.linearised import Linearised, linearise
from sksurrogate.kernels.windows import run_by_samples, run_in_windows

#: Damping of the first step, the least and the most; it changes by factors of ten.
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-9, 1e6
#: Slopes of a point nearby end a descent only where they promise this share of what would do otherwise.
STRICTER = 1e-2
#: A step moves the initial states of a run by at most so many times their sizes: those that no output shows would go anywhere.
LARGEST_START_STEP = 10.0
#: Open steps end where parameters and trajectory move by less than this share of their size.
OPEN_STEPS_SETTLED = 1e-3
#: A step that takes at least the first share of what its slopes promise is followed by one with less damping, and by one with the
#: same slopes, where these lead on, if it takes the second: so much of what is left falls in the time of one more run.
KEPT_PROMISE, SAME_SLOPES_LEAD_ON = 0.5, 0.9


@dataclass(frozen=True, eq=False)
class FreeRun:
    """A free run, and how far it is from the data."""

    theta: np.ndarray  #: (n_theta,)
    x: np.ndarray  #: (n_states, n_samples)
    y: np.ndarray  #: (n_outputs, n_samples)
    cost: float  #: Sum of squares of (y - free run) / sd, with the prior; inf where there is none


@dataclass(frozen=True, eq=False)
class Slopes:
    """A linearisation, and where it was taken."""

    lin: Linearised
    theta: np.ndarray
    x: np.ndarray

    @property
    def finite(self) -> bool:
        """Whether all slopes of the outputs are finite."""
        return bool(np.all(np.isfinite(self.lin.J_theta)) and np.all(np.isfinite(self.lin.J_x)))

    def at(self, run: FreeRun) -> Slopes:
        """The same slopes about another run."""
        return replace(self, lin=replace(self.lin, x=run.x, y=run.y))


@dataclass(frozen=True, eq=False)
class Trial:
    """What came of one or several dampings of a step."""

    run: FreeRun | None  #: Nearer to the data; None where none is
    damping: float  #: The last
    drop: float  #: Of the cost, as the slopes promised with it
    raised: bool = False  #: Whether a smaller damping has failed
    done: bool = False  #: Whether the slopes promise next to nothing


@dataclass(eq=False)
class DampedSteps:
    """Steps of one fit (arguments as for :func:`~sksurrogate.kernels.output_error.output_error`)."""

    model: FreeRunModel
    sd: np.ndarray
    unit: np.ndarray
    bounds: tuple[np.ndarray, np.ndarray]
    within: Callable[[np.ndarray], np.ndarray] | None = None
    prior: np.ndarray | None = None
    centre: np.ndarray | None = None
    fit_start: bool = True
    reach: float = np.inf
    settled: float = OPEN_STEPS_SETTLED
    tries: int = 6
    near: float = 0.0
    lead_on: bool = False
    idle: float = 0.0
    idle_above: float = np.inf
    #: Whether Newton's method has failed on a map that may jump
    jumps: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self.record = self.model.record
        self.low, self.high = self.bounds
        self.fixed = self.low == self.high
        self.precision = np.zeros(self.model.n_theta) if self.prior is None else 1.0 / self.prior**2
        self.mean = np.zeros(self.model.n_theta) if self.centre is None else self.centre
        self.free = self.model.free_states if self.fit_start else np.zeros(self.model.n_states, bool)
        self.weight = self.model.closing_weight(self.sd)

    def clipped(self, theta: np.ndarray) -> np.ndarray:
        """The nearest parameters that a step may end at."""
        return np.clip(theta, self.low, self.high) if self.within is None else self.within(theta)

    def cost(self, y: np.ndarray, theta: np.ndarray) -> float:
        held = np.sum(self.precision * (theta - self.mean) ** 2)
        value = float(np.sum((self.record.residual(y) / self.sd[:, None]) ** 2) + held)
        return value if np.isfinite(value) else np.inf

    def arrow(self, lin: Linearised, theta: np.ndarray) -> Arrow:
        Jt = np.where(self.fixed[:, None], 0.0, lin.J_theta) if self.fixed.any() else lin.J_theta
        Jx = lin.J_x if self.free.all() else lin.J_x[:, self.free]
        pull = self.precision * (self.mean - theta)
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
            end = self.clipped(np.clip(new, low, high))
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
        new = self.clipped(theta + dt)
        x = lin.x + np.einsum("ikt,k->it", lin.Z_theta, new - theta)
        if self.free.any():
            far = np.max(np.abs(dx) / self.model.scale[self.free, None], axis=0)
            dx = dx * np.minimum(1.0, LARGEST_START_STEP / np.maximum(far, LARGEST_START_STEP))
            x = x + np.einsum("ijt,jt->it", lin.Z_x[:, self.free], np.repeat(dx, self.record.lengths, axis=1))
        return new, x

    def closed(self, theta: np.ndarray, x: np.ndarray, band: np.ndarray | None) -> FreeRun:
        """The free run near x."""
        bound = self.model.bind(theta[:, None])
        known = ~self.model.free_states
        if known.any():
            x = x.copy()
            starts = self.record.starts
            x[np.ix_(known, starts)] = bound.start(x[: self.model.n_nominal, None, starts])[known, 0]
        x, ok = self.run_from(bound, x, band)
        if not ok:
            return FreeRun(theta, x, self.record.y, np.inf)
        return self.with_cost(theta, x)

    def with_cost(self, theta: np.ndarray, x: np.ndarray) -> FreeRun:
        """A trajectory with its outputs and cost."""
        y = self.model.bind(theta[:, None]).outputs(x[:, None])[:, 0]
        return FreeRun(theta, x, y, self.cost(y, theta))

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

    def descend(
        self, run: FreeRun, max_steps: int, most: float, slopes: Slopes | None
    ) -> tuple[FreeRun, int, bool, Linearised | None]:
        """Closed steps from a free run; ``slopes``: those that are known, of a point near to it.

        Returns the run where they end, their number, whether nothing is left to gain, and the slopes there, where they are known.
        """
        damping, steps, idle, done = FIRST_DAMPING, 0, 0, False
        for steps in range(1, max_steps + 1):
            stale = slopes is not None
            slopes = self.slopes_of(run) if slopes is None else slopes.at(run)
            if not slopes.finite:
                slopes = None
                break
            trial, used = self.tried(run, slopes, damping, stale), slopes
            damping, done = trial.damping, trial.done
            if trial.run is None:
                if not stale or (done and self.is_near(used, run)):
                    break
                slopes, done = None, False
                continue
            before, run = run, trial.run
            fell = before.cost - run.cost
            if (
                not trial.raised and fell > KEPT_PROMISE * trial.drop
            ):  # a damping that has just failed fails again as a rule
                damping = max(damping / 10, LEAST_DAMPING)
            slopes = used if self.lead_on_from(before, trial) else None
            idle = idle + 1 if run.cost > self.idle_above and fell < self.idle * run.cost else 0
            if run.cost - 3 * fell > most or idle == 2:
                break
            if fell < 1e-5 * run.cost + 0.002:
                done = not stale or self.is_near(used, run)
                if done:
                    break
                slopes = None
        known = slopes is not None and self.is_near(slopes, run)
        return run, steps, done, slopes.lin.kept() if slopes is not None and known else None

    def slopes_of(self, run: FreeRun) -> Slopes:
        """Slopes taken at a free run."""
        return Slopes(linearise(self.model, run.theta, run.x, self.unit), run.theta, run.x)

    def tried(self, run: FreeRun, slopes: Slopes, damping: float, stale: bool) -> Trial:
        """A step with more and more damping until it leads nearer to the data; one damping alone with ``stale`` slopes."""
        arrow, enough = self.arrow(slopes.lin, run.theta), (1e-4 * run.cost + 0.01) * (STRICTER if stale else 1.0)
        drop, raised = 0.0, False
        for _ in range(1 if stale else self.tries):
            dt, dx, drop = self.step(arrow, run.theta, damping)
            if drop < enough:
                return Trial(None, damping, drop, raised, done=True)
            new = self.closed(*self.moved(slopes.lin, run.theta, dt, dx), slopes.lin.band)
            if new.cost < run.cost:
                return Trial(new, damping, drop, raised)
            damping, raised = min(damping * 10, MOST_DAMPING), True
        return Trial(None, damping, drop, raised)

    def lead_on_from(self, before: FreeRun, trial: Trial) -> bool:
        """Whether the slopes of a step serve again: it was short, or kept what they promised."""
        run = trial.run
        assert run is not None
        short = self.share_of(run.theta - before.theta, run.x - before.x, run.theta) < self.near
        return short or (self.lead_on and before.cost - run.cost > SAME_SLOPES_LEAD_ON * trial.drop)

    def is_near(self, slopes: Slopes, run: FreeRun) -> bool:
        """Whether slopes count as those of a run."""
        own = run.theta is slopes.theta and run.x is slopes.x
        return own or self.share_of(run.theta - slopes.theta, run.x - slopes.x, run.theta) < self.near
