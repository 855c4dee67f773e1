"""The forms of the hybrid, on plants that each of them can represent."""

import numpy as np
import pytest
from sklearn.dummy import DummyRegressor
from sklearn.linear_model import LinearRegression
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.compose import HybridRegressor
from sksurrogate.compose._hybrid_output import OutputCorrection
from sksurrogate.compose._lagged import barely_fitted
from sksurrogate.datasets import linear_reactor, make_reactor_runs
from sksurrogate.physics import CallableSimulator, ODESimulator


def half(U):
    return 0.5 * U[:, [0]]


@pytest.mark.parametrize("form", ["output", "static", "series"])
def test_every_form_finds_a_static_affine_gap(form):
    rng = np.random.default_rng(0)
    X, groups = rng.normal(size=(200, 1)), np.repeat([0, 1], 100)
    y = X[:, 0] + 0.3
    hybrid = HybridRegressor(CallableSimulator(half), LinearRegression(), form).fit(X, y, groups=groups)
    predicted = hybrid.predict(X, y0=y[:5], groups=np.zeros(200, int))
    np.testing.assert_allclose(predicted[5:], y[5:], atol=1e-8)


@pytest.mark.parametrize("form", ["static", "series"])
def test_forms_without_a_past_do_not_need_the_first_outputs(form):
    X, y, groups = make_reactor_runs(6, 120, random_state=0)
    hybrid = HybridRegressor(linear_reactor(), form=form).fit(X, y, groups=groups)
    assert np.all(np.isfinite(hybrid.predict(X, groups=groups)))


def test_an_unknown_form_speaks():
    with pytest.raises(ValueError, match=r"'form' parameter of HybridRegressor must be.*Got 'nope'"):
        HybridRegressor(linear_reactor(), form="nope").fit(np.ones((20, 1)), np.ones(20))


def pushed(t, x, u, p):
    return x[1], u[0] + p["bent"] * u[0] ** 2 - x[0] - 0.4 * x[1]


def spring(bent):
    return ODESimulator(pushed, states=["q", "v"], inputs=["f"], outputs=["q"], params={"bent": bent}, dt=0.1)


@pytest.mark.slow
def test_the_form_is_chosen_on_what_is_left_out():
    rng = np.random.default_rng(0)
    U = np.repeat(rng.normal(size=(4, 16, 1)), 5, axis=1)
    q = np.stack([spring(0.3).simulate(u)[:, 0] + 0.01 * rng.normal(size=80) for u in U])
    X, y, groups = U[:3].reshape(-1, 1), q[:3].ravel(), np.repeat([0, 1, 2], 80)
    auto, fixed = (HybridRegressor(spring(0.0), form=form).fit(X, y, groups=groups) for form in ("auto", "output"))
    assert auto.form_ == "input" and auto.report_.rmse < fixed.report_.rmse
    errors = [np.std(model.predict(U[3], y0=q[3][: model.n_initial_, None]) - q[3]) for model in (auto, fixed)]
    assert errors[0] < 0.02 and errors[0] < errors[1]  # twice the noise


def test_a_simulator_of_trajectories_alone_has_no_form_inside():
    rng = np.random.default_rng(0)
    X, groups = rng.normal(size=(300, 1)), np.repeat([0, 1, 2], 100)
    hybrid = HybridRegressor(CallableSimulator(half), LinearRegression(), "auto").fit(X, X[:, 0] + 0.3, groups=groups)
    assert hybrid.form_ in ("output", "static")
    assert HybridRegressor(None, LinearRegression(), "auto").fit(X, X[:, 0] + 0.3, groups=groups).form_ == "output"


def test_a_network_that_only_needs_its_shape_is_fitted_for_one_iteration():
    net = make_pipeline(StandardScaler(), MLPRegressor(hidden_layer_sizes=(3,), max_iter=40, random_state=0))
    fitted = barely_fitted(net, np.random.default_rng(0).normal(size=(30, 2)), np.arange(30.0))
    assert fitted[-1].n_iter_ == 1 and fitted[-1].max_iter == 40


def test_a_residual_that_asks_for_more_is_held_at_three_times_what_was_missing():
    X, y, groups = make_reactor_runs(3, 40, random_state=0)
    inputs, measured = ([v[groups == k] for k in range(3)] for v in (X, y[:, None]))
    wild = DummyRegressor(strategy="constant", constant=1e6)
    correction = OutputCorrection(linear_reactor(), wild, "output", "one_step", 1, np.inf, 1.0, 0).fit(inputs, measured)
    alone = [linear_reactor().simulate(u, x0=v[0]) for u, v in zip(inputs, measured)]
    most = max(np.abs(v - a)[1:].max() for v, a in zip(measured, alone))
    for found, base in zip(correction.run(inputs, [v[:1] for v in measured]).y, alone):
        np.testing.assert_allclose(found[1:] - base[1:], 3 * most, rtol=1e-9)
