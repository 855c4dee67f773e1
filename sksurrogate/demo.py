"""Two stories about the paper's plant, Eq. (9), on data that the package makes itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sksurrogate.compose import HybridRegressor
from sksurrogate.datasets import linear_reactor, make_reactor, make_reactor_runs
from sksurrogate.gap import GapDiagnoser, GapReport

__all__ = ["Story", "story_actuator_and_sensor", "story_linearised"]


@dataclass(frozen=True)
class Story:
    """A diagnosis and how it ends.

    Attributes
    ----------
    title : str
    report : GapReport
    ending : str
    closed : float
        Share of the gap above the noise that the augmented simulator or the hybrid closes on unseen runs.

    Examples
    --------
    >>> from sksurrogate.demo import story_actuator_and_sensor
    >>> given = story_actuator_and_sensor()   # doctest: +SKIP
    >>> print(given.report, given.ending)   # doctest: +SKIP
    """

    title: str
    report: GapReport
    ending: str
    closed: float


def _closed(before: np.ndarray, after: np.ndarray, truth: np.ndarray, noise: float) -> float:
    """``1 - gap_after / gap_before`` above the noise."""
    gaps = [np.sqrt(max(float(np.mean((p - truth) ** 2)) - noise**2, 0.0)) for p in (before, after)]
    return 1.0 - gaps[1] / gaps[0]


def story_actuator_and_sensor(
    n_runs: int = 6, n_samples: int = 200, noise: float = 0.02, lag: float = 0.05, offset: float = 0.3
) -> Story:
    """Plant: Eq. (9) behind an actuator lag and with a sensor offset; simulator: Eq. (9).

    The lag is simulated with ten times shorter samples and an exact first-order filter, not with the package's effect.

    Parameters
    ----------
    n_runs, n_samples : int, default=6, 200
    noise : float, default=0.02
        Standard deviation of the sensor's noise, in units of y.
    lag : float, default=0.05
        Time constant of the actuator, in units of time.
    offset : float, default=0.3
        Of the sensor, in units of y.

    Examples
    --------
    >>> from sksurrogate.demo import story_actuator_and_sensor
    >>> story_actuator_and_sensor().report.verdict   # doctest: +SKIP
    'explained'
    """
    X, _, groups = make_reactor_runs(n_runs, n_samples, random_state=1)
    fine, rng = 10, np.random.default_rng(2)
    decay = np.exp(-0.02 / fine / lag)
    u = np.repeat(X.reshape(n_runs, n_samples), fine, axis=1)
    w, state = np.empty_like(u), u[:, 0]
    for k in range(u.shape[1]):  # all runs at once; the plant acts on the mean over a short sample
        following = u[:, k] + (state - u[:, k]) * decay
        w[:, k], state = (state + following) / 2, following
    start = rng.uniform(1, 14, (n_runs, 1))
    y = make_reactor(0.02 / fine).simulate_batch(w[:, :, None], start)[:, ::fine, 0].reshape(-1)
    y += offset + noise * rng.normal(size=len(y))
    diagnoser = GapDiagnoser(make_reactor(), random_state=0).fit(X, y, groups=groups)
    report = diagnoser.report_
    ending = (
        f"True effects: an input lag of {lag:g} and a sensor offset of {offset:g}. "
        f"The augmented simulator closes {100 * report.shrink.fraction:.1f} % of the gap on runs left out."
    )
    return Story("an actuator lag and a sensor offset, both named", report, ending, float(report.shrink.fraction))


def story_linearised(n_runs: int = 10, n_samples: int = 200, noise: float = 0.02) -> Story:
    """The paper's Figure 8: the simulator is the linearisation at u = 0.15; no named effect, but a hybrid model.

    Parameters
    ----------
    n_runs, n_samples : int, default=10, 200
    noise : float, default=0.02
        Standard deviation of the sensor's noise, in units of y.

    Examples
    --------
    >>> from sksurrogate.demo import story_linearised
    >>> story_linearised().report.verdict   # doctest: +SKIP
    'unknown'
    """
    X, y, groups = make_reactor_runs(n_runs, n_samples, noise=noise, random_state=0)
    simulator = linear_reactor()
    report = GapDiagnoser(simulator, random_state=0).fit(X, y, groups=groups).report_
    hybrid = HybridRegressor(simulator).fit(X, y, groups=groups)
    X_new, y_new, new = make_reactor_runs(8, n_samples, noise=noise, random_state=1)
    first = np.stack([y_new[new == run][: hybrid.n_initial_] for run in range(8)])[:, :, None]
    after = hybrid.predict(X_new, y0=first, groups=new)
    before = simulator.simulate_batch(X_new.reshape(8, n_samples, 1), y_new.reshape(8, n_samples)[:, :1]).reshape(-1)
    closed = _closed(before, after, y_new, noise)
    ending = f"The hybrid (simulator plus a learned correction on five past deviations) closes {100 * closed:.1f} % of the gap on unseen runs."
    law = report.certified_law
    if law is not None:
        closed_by_law = f"{100 * report.shrink.fraction_law:.1f} %"
        ending += f" The law closes {closed_by_law} on runs left out: in {law.place} the linear model lacks {law}"
    return Story("a linear model of a nonlinear reactor (the paper's Figure 8)", report, ending, closed)
