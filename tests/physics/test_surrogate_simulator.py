"""Fitted time-series models as nominal models: their own free run is the oracle."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.linear_model import LinearRegression

from sksurrogate.compose import DerivativeRegressor, HybridRegressor, RecursivePredictor, StateSpaceRegressor
from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._structure import kinematic_states
from sksurrogate.exceptions import SimulatorError
from sksurrogate.export import to_graph
from sksurrogate.gap import GapDiagnoser
from sksurrogate.linear import LaggedLinearRegressor
from sksurrogate.physics import ODESimulator, SurrogateSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe
from sksurrogate.testing import check_simulator


def _plant():
    return ODESimulator(
        lambda t, x, u, p: (x[1], 4.0 * u[0] - 4.0 * x[0] - 1.2 * x[1]),
        states=["q", "v"], inputs=["f"], outputs=["q"], params={}, dt=0.1,
    )  # fmt: skip


def _runs(n_runs, n=80, seed=0):
    random = np.random.default_rng(seed)
    U = [np.repeat(random.normal(size=(n // 8, 1)), 8, axis=0) for _ in range(n_runs)]
    return U, [_plant().simulate(u, x0=random.normal(size=2)) for u in U]


U, Y = _runs(6)
X, y, GROUPS = np.concatenate(U), np.concatenate(Y)[:, 0], np.repeat(np.arange(6), 80)


@pytest.fixture(scope="module")
def linear():
    return StateSpaceRegressor(2).fit(X, y, groups=GROUPS)


def test_a_state_space_model_runs_as_by_itself(linear):
    nominal = SurrogateSimulator(linear, dt=0.1, inputs=["f"], outputs=["q"])
    known = describe(nominal)
    assert (known.access, known.states, known.inputs, known.outputs) == ("step", ("x0", "x1"), ("f",), ("q",))
    np.testing.assert_allclose(nominal.simulate(U[0])[:, 0], linear.predict(U[0]), atol=1e-10)
    check_simulator(nominal, U[0])
    x, u = np.array([0.3, -0.2]), U[0][0]
    np.testing.assert_array_equal(to_graph(nominal)(x=x, u=u)["x_next"], to_graph(linear)(x=x, u=u)["x_next"])
    for other in (clone(nominal), pickle.loads(pickle.dumps(nominal))):
        np.testing.assert_array_equal(other.simulate(U[0]), nominal.simulate(U[0]))


def test_a_lag_model_runs_as_by_itself_and_its_older_lags_have_no_balance():
    model = RecursivePredictor(LinearRegression(), input_lags=[0, 1, 2], output_lags=[1, 2, 3]).fit(X, y, groups=GROUPS)
    nominal = SurrogateSimulator(model, dt=0.1)
    start = np.r_[Y[0][2::-1, 0], U[0][2:0:-1, 0]]  # past outputs, past inputs, newest first
    expected = model.predict(U[0], y0=Y[0][:3])
    np.testing.assert_allclose(nominal.simulate(U[0][3:], x0=start)[:, 0], expected[3:], atol=1e-9)
    assert nominal.kinematic == ("x1", "x2", "x3", "x4")
    assert kinematic_states(PlantModel(describe(nominal))) == nominal.kinematic
    np.testing.assert_allclose(describe(nominal).x0, [*3 * [y.mean()], 0.0, 0.0], atol=1e-12)
    check_simulator(nominal, U[0])


@pytest.mark.filterwarnings("ignore:the free runs of")  # one output of two states
def test_other_models_run_as_by_themselves():
    slow = DerivativeRegressor(LinearRegression(), dt=0.1).fit(X, np.concatenate(Y), groups=GROUPS)
    start = Y[0][0]
    found = SurrogateSimulator(slow, dt=0.1).simulate(U[0], x0=start)[:, 0]
    np.testing.assert_allclose(found, np.ravel(slow.predict(U[0], y0=Y[0][:1])), atol=1e-9)
    filtered = LaggedLinearRegressor(lags=[0, 1, 2, 3]).fit(X, y, groups=GROUPS)
    nominal = SurrogateSimulator(filtered, dt=0.1)
    found = nominal.simulate(U[0][3:], x0=U[0][2::-1, 0])[:, 0]
    np.testing.assert_allclose(found, np.ravel(filtered.predict(U[0]))[3:], atol=1e-9)
    assert nominal.kinematic == ("x0", "x1", "x2")
    hybrid = HybridRegressor(_plant(), LinearRegression(), form="output").fit(X, y + 0.1 * X[:, 0], groups=GROUPS)
    nominal = SurrogateSimulator(hybrid, dt=0.1)
    n = 12
    found = nominal.simulate(U[0][n:], x0=hybrid.graph_state(U[0], y0=Y[0][:n, 0]))[:, 0]
    graph, x, expected = hybrid.to_graph(), hybrid.graph_state(U[0], y0=Y[0][:n, 0]), []
    for u in U[0][n:]:
        out = graph(x=x, u=u)
        x = out["x_next"]
        expected.append(out["y"][0])
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_model_without_states_says_so():
    with pytest.raises(SimulatorError, match="LinearRegression has no states"):
        describe(SurrogateSimulator(LinearRegression().fit(X, y)))
    with pytest.raises(SimulatorError, match=r"outputs=\['a', 'b'\]: the model has 1 outputs"):
        model = StateSpaceRegressor(1).fit(X[:80], y[:80])
        SurrogateSimulator(model, outputs=["a", "b"]).simulate(U[0])


def test_effects_are_told_around_a_fitted_model(linear):
    nominal, random = SurrogateSimulator(linear, dt=0.1, inputs=["f"], outputs=["q"]), np.random.default_rng(1)
    slow = AugmentedSimulator(nominal, [CATALOGUE["input_lag"]("f")], [{"time_constant": 0.25}])
    V = [np.repeat(random.normal(size=(10, 1)), 8, axis=0) for _ in range(3)]
    measured = np.concatenate([slow.simulate(v) for v in V]) + 0.005 * random.normal(size=(240, 1))
    asked = ["input_lag", "input_gain", "constant_bias", "sensor_bias"]
    diagnoser = GapDiagnoser(nominal, effects=asked, random_state=0)
    report = diagnoser.fit(np.concatenate(V), measured, groups=np.repeat([0, 1, 2], 80)).report_
    assert [(e.name, e.location) for e in report.effects] == [("input_lag", "f")]
    assert report.effects[0].params["time_constant"] == pytest.approx(0.25, abs=0.02)


def _lag_model():
    return RecursivePredictor(LinearRegression(), 1, 2)


@pytest.mark.parametrize("make", [lambda: StateSpaceRegressor(2), _lag_model, lambda: LaggedLinearRegressor(3)])
def test_a_model_that_is_fitted_anew_is_the_new_model(make):
    model = make().fit(X, y, groups=GROUPS)
    used = SurrogateSimulator(model, dt=0.1)
    before = used.simulate(U[0])
    model.fit(X, 2 * y, groups=GROUPS)  # the same object, in other units
    fresh = SurrogateSimulator(model, dt=0.1)
    np.testing.assert_array_equal(used.simulate(U[0]), fresh.simulate(U[0]))
    np.testing.assert_array_equal(used.described()["x0"], fresh.described()["x0"])
    assert np.abs(used.simulate(U[0]) - before).max() > 0.1 * np.ptp(before)


def test_a_step_is_that_of_the_last_fit_too():
    model = _lag_model().fit(X, y, groups=GROUPS)
    nominal, x = SurrogateSimulator(model, dt=0.1), np.array([0.3, 0.2, 0.1])
    nominal.step(0.0, x, U[0][0], {}, 0.1)
    model.fit(X, y + 1.0, groups=GROUPS)
    expected = to_graph(model)(x=x, u=U[0][0])["x_next"]
    np.testing.assert_array_equal(nominal.step(0.0, x, U[0][0], {}, 0.1), expected)


def test_a_model_inside_a_model_may_change_as_well():
    model = _lag_model().fit(X, y, groups=GROUPS)
    nominal = SurrogateSimulator(model, dt=0.1)
    nominal.simulate(U[0])
    model.estimator_.coef_ = 0.5 * model.estimator_.coef_
    np.testing.assert_array_equal(nominal.simulate(U[0]), SurrogateSimulator(model, dt=0.1).simulate(U[0]))
