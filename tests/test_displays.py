"""Displays: what is drawn is what was computed."""

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression

from sksurrogate.compose import RecursivePredictor, coverage_report
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.displays import FreeRunDisplay, ResidualDisplay
from sksurrogate.exceptions import DataError
from sksurrogate.metrics import whiteness_test

plt = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture
def fitted():
    X, y, groups = make_reactor_runs(3, 80, y0_range=(4.0, 6.0), u_range=(0.1, 0.15), random_state=0)
    yield RecursivePredictor(LinearRegression(), 2, 2).fit(X, y, groups=groups), X, y, groups
    plt.close("all")


def test_the_free_run_drawn_is_the_one_predicted(fitted):
    model, X, y, groups = fitted
    display = FreeRunDisplay.from_estimator(model, X, y, groups=groups)
    assert display.ax_.shape == (3, 1)
    line = display.ax_[1, 0].lines[1].get_ydata()
    np.testing.assert_allclose(line, model.predict(X[80:160], y0=y[80:82, None]))
    with pytest.raises(DataError, match="leave ax out"):
        FreeRunDisplay.from_estimator(model, X, y, groups=groups, ax=display.ax_[0, 0])


def test_one_row_behind_the_initial_ones_is_drawn_and_none_is_refused(fitted):
    model, X, y, _ = fitted
    drawn = FreeRunDisplay.from_estimator(model, X[:3], y[:3])
    assert len(drawn.ax_[0, 0].lines[1].get_ydata()) == 3
    with pytest.raises(DataError, match="3"):
        FreeRunDisplay.from_estimator(model, X[:2], y[:2])


def test_the_residual_drawn_is_the_one_tested(fitted):
    model, X, y, groups = fitted
    display = ResidualDisplay.from_estimator(model, X, y, groups=groups)
    assert list(display.tests) == ["residual with itself", "residual with u0"]
    residual = (y - model.predict_one_step(X, y, groups=groups))[2:80]
    assert display.tests["residual with itself"].p_value == pytest.approx(whiteness_test(residual).p_value)


def test_coverage_is_drawn_on_the_axes_given(fitted):
    _, X, y, groups = fitted
    _, ax = plt.subplots()
    display = coverage_report(X, y, groups).plot(ax)
    assert display.ax_ is ax and "within 0.05" in ax.get_title()
