"""Displays: free runs, residuals, coverage. matplotlib is imported when something is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.exceptions import DataError, require
from sksurrogate.metrics import cross_correlation_test, fit_percent, whiteness_test
from sksurrogate.runs import Runs, resolve_runs

__all__ = ["CoverageDisplay", "FreeRunDisplay", "ResidualDisplay"]

#: Longest list of runs that is drawn.
MOST_RUNS = 6


class FreeRunDisplay:
    """Measured runs, the model's free runs over them, and an interval where one is given.

    Parameters
    ----------
    t, measured, predicted : list of ndarray
        One array per run; outputs (n_samples, n_outputs).
    labels : list
        Names of the runs.
    interval : list of (low, high), optional
        Arrays of the shape of ``predicted``.

    Attributes
    ----------
    ax_ : ndarray of matplotlib Axes (n_runs, n_outputs)
    figure_ : matplotlib Figure

    Examples
    --------
    >>> from sklearn.linear_model import LinearRegression
    >>> from sksurrogate.compose import RecursivePredictor
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> from sksurrogate.displays import FreeRunDisplay
    >>> X, y, groups = make_reactor_runs(2, 60, y0_range=(4.0, 6.0), u_range=(0.1, 0.15), random_state=0)
    >>> model = RecursivePredictor(LinearRegression(), 2, 2).fit(X, y, groups=groups)
    >>> display = FreeRunDisplay.from_estimator(model, X, y, groups=groups)
    """

    def __init__(self, t: Any, measured: Any, predicted: Any, labels: Any, interval: Any = None):
        self.t = t
        self.measured = measured
        self.predicted = predicted
        self.labels = labels
        self.interval = interval

    @classmethod
    def from_estimator(
        cls, estimator: Any, X: Any, y: Any, groups: Any = None, *, intervals: Any = None, ax: Any = None
    ) -> FreeRunDisplay:
        """Run a fitted model freely from the measured first rows and draw it.

        Parameters
        ----------
        estimator : fitted estimator with ``predict(X, y0, groups)`` and ``n_initial_``
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional
        intervals : fitted ConformalFreeRun, optional
            Draws its band.
        ax : matplotlib Axes, optional
            For one run with one output.

        Returns
        -------
        FreeRunDisplay
        """
        n = estimator.n_initial_
        runs = _runs_of(estimator, X, y, groups, n + 1)
        first = np.stack([run.y[:n] for run in runs])
        free = np.asarray(estimator.predict(X, y0=first, groups=groups)).reshape(runs.n_samples, -1)
        band = None
        if intervals is not None:
            low, high = intervals.predict_interval(X, y0=first, groups=groups)
            band = list(
                zip(
                    runs.unstack(low.reshape(runs.n_samples, -1)),
                    runs.unstack(high.reshape(runs.n_samples, -1)),
                )
            )
        parts = [run.t for run in runs], [run.y for run in runs], runs.unstack(free), [run.label for run in runs]
        return cls(*parts, band).plot(ax=ax)

    def plot(self, ax: Any = None) -> FreeRunDisplay:
        """Draw, at most six runs.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            For one run with one output.

        Returns
        -------
        self
        """
        n, o = min(len(self.t), MOST_RUNS), self.measured[0].shape[1]
        self.figure_, self.ax_ = _axes(ax, n, o)
        for r in range(n):
            for k in range(o):
                panel = self.ax_[r, k]
                if self.interval is not None:
                    low, high = self.interval[r]
                    panel.fill_between(self.t[r], low[:, k], high[:, k], color="#0072b2", alpha=0.2, label="interval")
                panel.plot(self.t[r], self.measured[r][:, k], color="#8a8a8a", lw=3, label="measured")
                panel.plot(self.t[r], self.predicted[r][:, k], color="#d55e00", lw=1.2, label="free run")
                fit = fit_percent(self.measured[r][:, k], self.predicted[r][:, k])[0]
                name = "" if self.labels[r] is None else f"run {self.labels[r]}, "
                panel.set_title(f"{name}output {k}: fit {fit:.1f} %", fontsize=9)
        self.ax_[0, 0].legend(frameon=False, fontsize=8)
        for panel in self.ax_[-1]:
            panel.set_xlabel("time")
        return self


class ResidualDisplay:
    """One-step residuals: their own correlation and that with each input, against 99 % bounds.

    Parameters
    ----------
    tests : dict of str -> ResidualTest
        What is drawn, one panel each.

    Attributes
    ----------
    ax_ : ndarray of matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.displays import ResidualDisplay
    >>> from sksurrogate.metrics import whiteness_test
    >>> display = ResidualDisplay({"white": whiteness_test(np.random.default_rng(0).normal(size=500))})
    >>> display.plot().ax_.shape
    (1,)
    """

    def __init__(self, tests: Any):
        self.tests = tests

    @classmethod
    def from_estimator(
        cls, estimator: Any, X: Any, y: Any, groups: Any = None, *, n_lags: int = 20, ax: Any = None
    ) -> ResidualDisplay:
        """Test the one-step residuals of a fitted model on its longest run, first output, and draw them.

        Parameters
        ----------
        estimator : fitted estimator with ``predict_one_step(X, y, groups)``
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional
        n_lags : int, default=20
        ax : ndarray of matplotlib Axes (1 + n_inputs,), optional

        Returns
        -------
        ResidualDisplay
        """
        runs = _runs_of(estimator, X, y, groups, 2)
        found = np.asarray(estimator.predict_one_step(X, y, groups=groups)).reshape(runs.n_samples, -1)
        run = max(runs, key=len)
        residual = run.y[:, 0] - found[run.start : run.stop, 0]
        known = np.isfinite(residual)
        names = runs.input_names or [f"u{j}" for j in range(run.X.shape[1])]
        tests = {"residual with itself": whiteness_test(residual[known], n_lags)}
        for j, name in enumerate(names):
            if np.ptp(run.X[known, j]) > 0:
                tests[f"residual with {name}"] = cross_correlation_test(residual[known], run.X[known, j], n_lags)
        return cls(tests).plot(ax=ax)

    def plot(self, ax: Any = None) -> ResidualDisplay:
        """Draw one panel per test.

        Parameters
        ----------
        ax : ndarray of matplotlib Axes (n_tests,), optional

        Returns
        -------
        self
        """
        if ax is None:
            plt = require("matplotlib.pyplot", "plot")
            self.figure_, ax = plt.subplots(
                len(self.tests), 1, figsize=(7, 2.2 * len(self.tests)), constrained_layout=True, squeeze=False
            )
            ax = ax[:, 0]
        self.ax_ = np.atleast_1d(ax)
        if len(self.ax_) != len(self.tests):
            raise DataError(f"ax has {len(self.ax_)} axes, {len(self.tests)} are needed: one per test.")
        self.figure_ = self.ax_[0].figure
        for panel, (name, test) in zip(self.ax_, self.tests.items()):
            outside = np.abs(test.correlation) > test.bound
            panel.vlines(test.lags, 0, test.correlation, color=np.where(outside, "#d55e00", "#0072b2"), lw=2)
            panel.axhspan(-test.bound, test.bound, color="#8a8a8a", alpha=0.25, lw=0)
            panel.set_title(f"{name}: p = {test.p_value:.2g}", fontsize=9)
        self.ax_[-1].set_xlabel("lag / samples (grey: 99 % bounds)")
        return self


class CoverageDisplay:
    """Data, covered part and holes over the first two variables of a coverage report.

    Parameters
    ----------
    report : CoverageReport

    Attributes
    ----------
    ax_ : matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> from sksurrogate.compose import coverage_report
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> from sksurrogate.displays import CoverageDisplay
    >>> X, y, runs = make_reactor_runs(4, 60, random_state=0)
    >>> CoverageDisplay(coverage_report(X, y, runs)).plot().ax_   # doctest: +SKIP
    <Axes: ...>
    """

    def __init__(self, report: Any):
        self.report = report

    def plot(self, ax: Any = None) -> CoverageDisplay:
        """Draw; with more than two variables the others stay at the middle of their ranges.

        Parameters
        ----------
        ax : matplotlib Axes, optional

        Returns
        -------
        self
        """
        report = self.report
        self.figure_, axes = _axes(ax, 1, 1)
        self.ax_ = axes[0, 0]
        edges = [np.linspace(low, high, 60) for low, high in report.box[:2]]
        first, second = np.meshgrid(*edges, indexing="ij")
        middle = report.box.mean(axis=1)
        grid = np.broadcast_to(middle, (first.size, len(middle))).copy()
        grid[:, 0], grid[:, 1] = first.ravel(), second.ravel()
        distance = report.distance(grid[:, 1:], grid[:, 0]).reshape(first.shape)
        drawn = self.ax_.contourf(second, first, distance, 12, cmap="Greys")
        self.ax_.contour(second, first, distance, [report.radius], colors="#0072b2")
        self.ax_.plot(report.holes[:, 1], report.holes[:, 0], "x", color="#d55e00", label="middle of an empty part")
        self.figure_.colorbar(drawn, ax=self.ax_, label="distance to the data / ranges of the box")
        self.ax_.set(
            xlabel=report.names[1],
            ylabel=report.names[0],
            title=f"{100 * report.share:.0f} % within {report.radius:g} (blue line)",
        )
        if len(report.holes):
            self.ax_.legend(fontsize=8)
        return self


def _runs_of(estimator: Any, X: Any, y: Any, groups: Any, min_rows: int) -> Runs:
    run, time, dt = (getattr(estimator, name, None) for name in ("run", "time", "dt"))
    return resolve_runs(X, y, groups=groups, run=run, time=time, dt=dt, allow_uneven=True, min_rows=min_rows)


def _axes(ax: Any, rows: int, columns: int) -> tuple[Any, np.ndarray]:
    """A figure and its axes (rows, columns); an ``ax`` that is given is the only one."""
    if ax is None:
        plt = require("matplotlib.pyplot", "plot")
        return plt.subplots(
            rows, columns, figsize=(7 * columns, 2.6 * rows + 1), constrained_layout=True, squeeze=False
        )
    if rows * columns != 1:
        raise DataError(f"ax is one axes, but {rows} x {columns} panels are drawn: leave ax out.")
    return ax.figure, np.array([[ax]])
