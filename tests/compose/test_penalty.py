"""The penalty of a shooting fit: chosen on runs left out, refused where first rows are not forgotten."""

import numpy as np
import pytest
from scipy.signal import lfilter
from sklearn.linear_model import LinearRegression
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import SplineTransformer

import sksurrogate.compose._penalty as penalty
from sksurrogate.compose import RecursivePredictor
from sksurrogate.compose._free_fit import Scaling
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.net import LagNet, Net
from sksurrogate.runs import resolve_runs


def linear(a, b):
    """y[t] = a y[t-1] + b u[t]."""
    net = Net((np.array([[a], [b]]),), (np.zeros(1),), (), np.zeros(2), np.ones(2))
    return LagNet(net, (1,), ((0, 0),), 1)


def runs_of(n_runs=4, n=60, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    U = rng.normal(size=(n_runs, n))
    Y = lfilter([1.0], [1, -0.8], U, axis=1) + noise * rng.normal(size=U.shape)
    return U.reshape(-1, 1), Y.ravel(), np.repeat(np.arange(n_runs), n)


def test_what_is_forgotten_is_the_power_of_the_pole():
    X, y, groups = runs_of()
    runs = list(resolve_runs(X, y, groups=groups))
    scaling = Scaling(runs)
    left = penalty.forgetting(linear(0.8, 1.0), runs, scaling, 1)
    levels = np.quantile(y, [0, 0.5, 1])
    away = max(abs(level - run.y[0, 0]) for level in levels for run in runs)
    t = np.arange(30, 60)
    assert left == pytest.approx(away * np.sqrt(np.mean(0.8 ** (2 * t))) / y.std(), rel=1e-6)
    assert penalty.forgetting(linear(1.0, 1.0), runs, scaling, 1) > 0.5  # an integrator forgets nothing
    assert penalty.forgetting(linear(80.0, 1.0), runs, scaling, 1) > 1e6


def test_the_penalty_is_that_of_the_least_error_left_out_or_larger():
    X, y, groups = runs_of(noise=1.0, n=25)
    model = RecursivePredictor(LinearRegression(), 0, 1, loss="shooting", alpha="auto").fit(X, y, groups=groups)
    fixed = RecursivePredictor(LinearRegression(), 0, 1, loss="shooting", alpha=model.alpha_).fit(X, y, groups=groups)
    np.testing.assert_allclose(model.predict(X, groups=groups), fixed.predict(X, groups=groups), atol=1e-6)
    fresh = runs_of(n_runs=20, n=25, seed=1)
    assert model.score(fresh[0], fresh[1], groups=fresh[2]) > 0.9


def test_a_penalty_whose_model_does_not_forget_is_left(monkeypatch):
    X, y, groups = runs_of()
    left = iter([5.0, 0.01, 0.02, 0.01])  # smaller penalty, the next larger one: left; then kept
    monkeypatch.setattr(penalty, "forgetting", lambda *given: next(left))
    monkeypatch.setattr(penalty, "_held_out", lambda *given: 0.003)
    model = RecursivePredictor(LinearRegression(), 0, 1, loss="shooting", alpha="auto").fit(X, y, groups=groups)
    assert model.alpha_ == 0.01


@pytest.mark.slow
def test_one_run_is_cut_and_networks_are_chosen_for(monkeypatch):
    monkeypatch.setattr(penalty, "ALPHAS", (0.1, 0.03))
    X, y, _ = make_reactor_runs(1, 80, y0_range=(4.0, 6.0), u_range=(0.1, 0.15), random_state=0)
    net = MLPRegressor(hidden_layer_sizes=(2,), activation="tanh", solver="lbfgs", random_state=0)
    for rows in (80, 7):  # seven rows cannot be cut
        model = RecursivePredictor(net, 1, 1, loss="shooting", alpha="auto", n_starts=1, random_state=0)
        model.fit(X[:rows], y[:rows])
        assert model.alpha_ in penalty.ALPHAS
    fixed = RecursivePredictor(net, 1, 1, loss="shooting", alpha=0.02, n_starts=1, random_state=0).fit(X[:30], y[:30])
    assert fixed.alpha_ == 0.02


def test_features_want_a_number():
    X, y, groups = runs_of()
    features = make_pipeline(SplineTransformer(4), LinearRegression())
    with pytest.raises(DataError, match="give a number"):
        RecursivePredictor(features, 0, 1, loss="shooting", alpha="auto").fit(X, y, groups=groups)
