"""Continuous-time models: exact derivatives against Eq. (9), the weak form, free runs against the simulator."""

import warnings

import numpy as np
import pytest
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, PolynomialFeatures, StandardScaler
from sklearn.tree import DecisionTreeRegressor
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.compose import DerivativeRegressor
from sksurrogate.compose._long_runs import watched
from sksurrogate.compose._weak import WeakForm
from sksurrogate.datasets import make_reactor_runs, simulate_experiments
from sksurrogate.exceptions import DataError, SimulationDiverged
from sksurrogate.physics import ODESimulator
from sksurrogate.runs import resolve_runs

ORDER = "row order matters to a model of runs"
EXPECTED = {"check_methods_sample_order_invariance": ORDER, "check_methods_subset_invariance": ORDER}


# a strong penalty: rows in no order have no dynamics, and a slope that is chance may run away
@pytest.mark.filterwarnings("ignore:the free runs of")  # rows without order
@parametrize_with_checks(
    [
        DerivativeRegressor(Ridge(1e4)),
        DerivativeRegressor(
            MLPRegressor(hidden_layer_sizes=(3,), max_iter=20, solver="lbfgs", alpha=1e3, random_state=0), hold="foh"
        ),
    ],
    expected_failed_checks=lambda estimator: EXPECTED,
)
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning", "ignore:the fitted model is stiff")
def test_sklearn_contract(estimator, check):
    check(estimator)


def reactor_features(rows):
    y, u = rows[:, 0], rows[:, 1]
    rate = np.exp(-1.0 / u)
    return np.column_stack([4 - y, rate * y**2, rate * y])


def true_terms():
    return make_pipeline(FunctionTransformer(reactor_features), LinearRegression(fit_intercept=False))


def test_true_terms_and_true_derivatives_give_equation_9():
    X, y, groups, dydt = make_reactor_runs(6, 100, return_derivative=True, random_state=0)
    model = DerivativeRegressor(true_terms(), dt=0.02).fit(X, y, dydt, groups=groups)
    np.testing.assert_allclose(model.estimator_[-1].coef_, [2.0, -1e2, 1e3], rtol=1e-8)
    first = np.stack([y[groups == r][:1] for r in range(6)])[:, :, None]
    free = model.predict(X, y0=first, groups=groups)
    np.testing.assert_allclose(free, y, atol=2e-3 * y.std())  # n_sub_ is settled to 1e-3 spreads
    assert model.score(X, y, groups=groups) > 0.99999
    np.testing.assert_allclose(model.derivative(X, y), dydt, rtol=1e-6, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_the_weak_form_finds_equation_9_without_derivatives(noise):
    X, y, groups = make_reactor_runs(40, 200, noise=noise, random_state=0)
    coefs = [
        DerivativeRegressor(true_terms(), dt=0.02, window=w).fit(X, y, groups=groups).estimator_[-1].coef_
        for w in (1, 20)
    ]
    difference, weak = (np.abs(c / np.array([2.0, -1e2, 1e3]) - 1).max() for c in coefs)
    # without noise the trapezoidal rule is the only error; with noise, plain differences are far worse
    assert weak < (0.02 if noise == 0 else 0.1)
    assert noise == 0 or weak < difference / 2


def test_windows_integrate_a_known_derivative():
    t = np.linspace(0, 3, 301)
    runs = resolve_runs(np.zeros((301, 1)), np.sin(t), dt=0.01)
    weak = WeakForm(runs, 20, True)
    exact = np.cos(t)[:, None]
    values = np.concatenate([exact[:-1], exact[1:]])
    np.testing.assert_allclose(weak.mean(values), weak.targets, atol=1e-5)  # trapezoidal rule: dt^2 / 12
    np.testing.assert_allclose(weak.mean(np.ones((600, 1))), 1.0)


def test_rounds_remove_the_curvature_of_a_window():
    class Cubic(RegressorMixin, BaseEstimator):
        """Not seen to be linear in its parameters."""

        def fit(self, X, y):
            self.model_ = make_pipeline(PolynomialFeatures(3), LinearRegression()).fit(X, y)
            return self

        def predict(self, X):
            return self.model_.predict(X)

    def rhs(t, x, u, p):
        return [-2 * x[0] - x[0] ** 3 + 4 * u[0]]

    plant = ODESimulator(rhs, states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.02)
    data = simulate_experiments(plant, {"x": (-2, 2)}, {"u": (-1, 1)}, n_runs=20, random_state=0)
    errors = []
    for rounds in (1, 4):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("sksurrogate.compose._derivative.WEAK_FORM_ROUNDS", rounds)
            model = DerivativeRegressor(Cubic(), 0.02, window=20).fit(data.X, data.y, groups=data.groups)
        errors.append(np.sqrt(np.mean((model.derivative(data.X, data.y) - data.dydt) ** 2)))
    assert errors[1] < errors[0] / 4


@pytest.mark.slow
def test_joined_inputs_and_stiff_integrators_agree():
    def rhs(t, x, u, p):
        return [x[1], -4 * x[0] - x[1] + u[0]]

    plant = ODESimulator(rhs, states=["x", "v"], inputs=["u"], outputs=["x", "v"], params={}, dt=0.05, hold="foh")
    data = simulate_experiments(
        plant, {"x": (-1, 1), "v": (-1, 1)}, {"u": (-1, 1)}, design="multisine", n_runs=4, random_state=0
    )
    found = [
        DerivativeRegressor(LinearRegression(), 0.05, hold="foh", method=method).fit(
            data.X, data.y, data.dydt, groups=data.groups
        )
        for method in ("RK4", "LSODA")
    ]
    first = data.x0[:, None, :]
    runs = [model.predict(data.X, y0=first, groups=data.groups) for model in found]
    np.testing.assert_allclose(runs[0], data.y, atol=1e-3)
    np.testing.assert_allclose(runs[1], data.y, atol=1e-4)


@pytest.mark.parametrize("given", [{"window": "a"}, {"n_sub": 0}, {"init": "x"}, {"dt": -1.0}, {"hold": "none"}])
def test_a_parameter_that_is_wrong_is_named(given):
    X, y, groups = make_reactor_runs(2, 30, random_state=0)
    with pytest.raises(ValueError, match=f"'{next(iter(given))}' parameter of DerivativeRegressor"):
        DerivativeRegressor(LinearRegression(), **{"dt": 0.02, **given}).fit(X, y, groups=groups)


def test_substeps_that_were_asked_for_are_no_sign_of_a_stiff_model():
    X, y, groups = make_reactor_runs(2, 30, random_state=0)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "the fitted model is stiff")
        DerivativeRegressor(LinearRegression(), 0.02, n_sub=64).fit(X, y, groups=groups)


def test_steps_ahead_join_into_the_free_run():
    X, y, groups, dydt = make_reactor_runs(3, 60, return_derivative=True, random_state=0)
    model = DerivativeRegressor(true_terms(), 0.02).fit(X, y, dydt, groups=groups)
    one = model.predict_one_step(X, y, groups=groups)
    assert np.isnan(one[[0, 60, 120]]).all() and np.nanmax(np.abs(one - y)) < 0.01
    last = model.predict_ahead(X[:60], y[:60], 59)
    free = model.predict(X[:60], y0=y[:1])
    assert last[59] == pytest.approx(free[59], rel=1e-12) and np.isnan(last[:59]).all()


def test_a_network_runs_as_arrays_as_it_does_through_predict():
    X, y, groups, dydt = make_reactor_runs(4, 60, u_range=(0.05, 0.15), return_derivative=True, random_state=0)
    net = make_pipeline(
        StandardScaler(),
        MLPRegressor(
            hidden_layer_sizes=(6,), activation="tanh", solver="lbfgs", max_iter=3000, alpha=1e-4, random_state=0
        ),
    )
    model = DerivativeRegressor(net, 0.02).fit(X, y, dydt, groups=groups)
    points = np.column_stack([y, X])
    np.testing.assert_allclose(model.derivative(X, y), model.estimator_.predict(points), rtol=1e-10)


def test_a_model_that_runs_away_says_run_and_step():
    X = np.zeros((60, 1))
    y = np.exp(0.5 * np.arange(60.0))
    model = DerivativeRegressor(LinearRegression()).fit(X, y, 0.5 * y)
    with pytest.raises(SimulationDiverged, match=r"run 0, step \d+"):
        model.predict(X, y0=[[1e30]])
    with pytest.raises(DataError, match="dydt has shape"):
        DerivativeRegressor(LinearRegression()).fit(X, y, y[:10])
    with pytest.raises(DataError, match="y0 has shape"):
        model.predict(X, y0=[1.0, 2.0])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["RK4", "LSODA"])
def test_uneven_times_are_integrated(method):
    rng = np.random.default_rng(0)
    n = 150
    tables, outputs, groups = [], [], np.repeat([0, 1, 2], [n, n - 20, n - 50])
    for r in range(3):
        rows = int((groups == r).sum())
        t = np.cumsum(rng.uniform(0.02, 0.1, size=rows))
        u, y = np.repeat(rng.uniform(-1, 1, size=rows // 10 + 1), 10)[:rows], np.empty(rows)
        y[0] = rng.normal()
        for k in range(rows - 1):  # y' = -2 y + u, exactly
            y[k + 1] = 0.5 * u[k] + (y[k] - 0.5 * u[k]) * np.exp(-2 * (t[k + 1] - t[k]))
        tables.append(np.column_stack([t, u]))
        outputs.append(y)
    X, y = np.concatenate(tables), np.concatenate(outputs)
    model = DerivativeRegressor(LinearRegression(), time=0, window=3, method=method).fit(X, y, groups=groups)
    np.testing.assert_allclose(model.estimator_.coef_, [-2.0, 1.0], rtol=5e-3)  # trapezoidal rule over 0.1
    first = np.stack([part[:1] for part in outputs])[:, :, None]
    np.testing.assert_allclose(model.predict(X, y0=first, groups=groups), y, atol=5e-3)
    one = model.predict_one_step(X, y, groups=groups)
    assert np.nanmax(np.abs(one - y)) < 2e-3
    with pytest.raises(DataError, match="time does not increase"):
        model.predict(X[::-1], y0=[y[-1]])


def test_a_model_of_steps_is_not_integrated_ever_finer():
    X, y, groups = make_reactor_runs(6, 60, y0_range=(3.0, 8.0), random_state=0)
    trees = DerivativeRegressor(DecisionTreeRegressor(min_samples_leaf=3), dt=0.02).fit(X, y, groups=groups)
    assert trees.n_sub_ == 1
    assert trees.score(X, y, groups=groups) > 0.9


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_long_runs_window_by_window_are_those_of_the_loop(hold, monkeypatch):
    rng = np.random.default_rng(0)
    X, y = rng.uniform(-1, 1, (90, 1)), rng.normal(size=(90, 1))
    dydt = X - y - 0.5 * y**3
    model = DerivativeRegressor(make_pipeline(PolynomialFeatures(3), LinearRegression()), dt=0.2, hold=hold)
    model.fit(X, y, dydt=dydt)
    groups, first = np.repeat([0, 1], [60, 30]), np.array([[[0.5]], [[-1.0]]])
    loop = model.predict(X, y0=first, groups=groups)
    monkeypatch.setattr("sksurrogate.compose._derivative.LONG_RUN", 10)
    assert np.allclose(model.predict(X, y0=first, groups=groups), loop, rtol=1e-9, atol=1e-11)


def test_a_long_record_is_watched_on_a_part_of_it(monkeypatch):
    """The substeps that some runs ask for are those that all ask for, and the errors are of one size."""
    X, y, groups = make_reactor_runs(8, 100, random_state=0)
    whole = DerivativeRegressor(true_terms(), 0.02).fit(X, y, groups=groups)
    monkeypatch.setattr("sksurrogate.compose._derivative.MOST_WATCHED", 250)
    some = DerivativeRegressor(true_terms(), 0.02).fit(X, y, groups=groups)
    assert some.n_sub_ == whole.n_sub_
    first, last = y[:100], y[700:]  # two runs of eight fit into 250 rows
    free = np.concatenate([some.predict(X[a : a + 100], y0=y[a : a + 1, None]) for a in (0, 700)])
    error = (free - np.r_[first, last])[np.arange(200) % 100 > 0]
    assert some.free_run_rmse_ == pytest.approx(np.sqrt(np.mean(error**2)))
    one = DerivativeRegressor(true_terms(), 0.02).fit(X[:300], y[:300])
    assert one.n_sub_ == whole.n_sub_ and np.isfinite(one.free_run_rmse_)


def test_of_one_long_run_the_first_rows_are_watched_once():
    runs = resolve_runs(np.zeros((100, 1)), np.arange(100.0))
    assert [len(run) for run in watched(runs, 40)] == [40]
    np.testing.assert_array_equal(next(iter(watched(runs, 40))).y[:, 0], np.arange(40.0))
    two = resolve_runs(np.zeros((100, 1)), np.arange(100.0), groups=np.repeat([0, 1], 50))
    assert [len(run) for run in watched(two, 60)] == [50]
    assert watched(two, 100) is two


def test_few_runs_together_are_the_runs_one_by_one():
    """Many samples at a time, or a step for all runs: one free run."""
    X, y, groups = make_reactor_runs(3, 60, random_state=1)
    model = DerivativeRegressor(true_terms(), 0.02).fit(X, y, groups=groups)
    first = y.reshape(3, 60)[:, :1]
    many = model.predict(
        np.tile(X, (20, 1)), y0=np.tile(first, (20, 1))[:, :, None], groups=np.repeat(np.arange(60), 60)
    )
    few = model.predict(X, y0=first[:, :, None], groups=groups)
    np.testing.assert_allclose(many[:180], few, rtol=1e-9, atol=1e-9)
