"""Terms inside the plant: planted ones come back, none is invented, unmeasured states are no hindrance."""

import numpy as np
import pytest
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures

from sksurrogate.compose import HybridRegressor
from sksurrogate.datasets import linear_reactor, make_reactor, make_reactor_runs
from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.physics import CallableSimulator, ODESimulator, StepSimulator
from sksurrogate.runs import stack_runs


def oscillator(t, x, u, p):
    return x[1], p["gain"] * u[0] + p["bend"] * u[0] ** 2 - x[0] - p["cubic"] * x[0] ** 3 - 0.4 * x[1]


def plant(**changes):
    params = {"gain": 1.0, "bend": 0.0, "cubic": 0.0, **changes}
    return ODESimulator(oscillator, states=["q", "v"], inputs=["f"], outputs=["q"], params=params, dt=0.05)


def runs(simulator, n_runs=5, n=160, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.normal(size=n // 10), 10)[:, None] for _ in range(n_runs)]
    Y = [simulator.simulate(u)[:, 0] for u in U]
    return stack_runs(U, [y + noise * rng.normal(size=n) for y in Y])


@pytest.mark.slow
def test_a_missing_cubic_spring_is_found_in_the_dynamics_of_the_unmeasured_speed():
    X, y, groups = runs(plant(cubic=0.5), noise=0.01)
    residual = make_pipeline(PolynomialFeatures(3, include_bias=False), Ridge())
    hybrid = HybridRegressor(plant(), residual, "dynamics").fit(X, y, groups=groups)
    assert hybrid.correction_.terms.targets == (1,)  # dq/dt = v is an identity
    names = hybrid.residual_[:-1].get_feature_names_out(["q", "v", "f"]).tolist()
    coef = hybrid.residual_[-1].coef_[0]
    assert coef[names.index("q^3")] == pytest.approx(-0.5, abs=0.08)
    new_X, new_y, new = runs(plant(cubic=0.5), seed=1)
    alone = np.concatenate([plant().simulate(new_X[new == k])[:, 0] for k in range(5)])
    error = np.std(hybrid.predict(new_X, groups=new) - new_y)
    assert error < 0.1 * np.std(alone - new_y)


@pytest.mark.slow
def test_a_bent_input_is_found_by_the_input_form():
    X, y, groups = runs(plant(bend=0.3), noise=0.005)
    hybrid = HybridRegressor(plant(), form="input").fit(X, y, groups=groups)
    new_X, new_y, new = runs(plant(bend=0.3), seed=1)
    alone = np.concatenate([plant().simulate(new_X[new == k])[:, 0] for k in range(5)])
    assert np.std(hybrid.predict(new_X, groups=new) - new_y) < 0.1 * np.std(alone - new_y)


@pytest.mark.slow
def test_a_perfect_simulator_gets_next_to_no_term():
    X, y, groups = runs(plant(), noise=0.01)
    hybrid = HybridRegressor(plant(), form="dynamics").fit(X, y, groups=groups)
    new_X, new_y, new = runs(plant(), seed=1)
    assert np.std(hybrid.predict(new_X, groups=new) - new_y) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["one_step", "shooting"])
def test_figure_8_from_inside(loss):
    X, y, groups = make_reactor_runs(8, 120, random_state=0)
    new_X, new_y, new = make_reactor_runs(6, 120, random_state=1)
    hybrid = HybridRegressor(linear_reactor(), form="dynamics", loss=loss, states=["y"]).fit(X, y, groups=groups)
    first = np.stack([new_y[new == k][:1] for k in range(6)])[:, :, None]
    alone = np.concatenate([linear_reactor().simulate(new_X[new == k], x0=first[k, 0])[:, 0] for k in range(6)])
    assert np.std(hybrid.predict(new_X, y0=first, groups=new) - new_y) < 0.15 * np.std(alone - new_y)
    one = hybrid.predict_one_step(new_X, new_y, groups=new)
    assert np.isnan(one[::120]).all() and np.nanstd(one - new_y) < 0.05


@pytest.mark.slow
def test_the_error_of_free_runs_is_that_of_predictions_from_the_first_measurement():
    X, y, groups = make_reactor_runs(3, 30, random_state=0)
    hybrid = HybridRegressor(linear_reactor(), form="dynamics", states=["y"]).fit(X, y, groups=groups)
    inputs, measured = ([v[groups == k] for k in range(3)] for v in (X, y[:, None]))
    error = np.mean((hybrid.predict(X, y0=np.stack([v[:1] for v in measured]), groups=groups) - y) ** 2)
    assert hybrid.correction_._error(inputs, measured) == pytest.approx(error, rel=1e-9)
    assert hybrid.correction_.judge(inputs, measured).rmse ** 2 == pytest.approx(error, rel=1e-9)


@pytest.mark.slow
def test_the_right_hand_side_with_the_term_is_the_simulators_plus_the_term():
    X, y, groups = make_reactor_runs(4, 80, random_state=0)
    hybrid = HybridRegressor(linear_reactor(), form="dynamics", fade=float("inf")).fit(X, y, groups=groups)
    x, u = np.array([[5.0, 6.0]]), np.array([[0.1, 0.15]])
    inner = linear_reactor()
    term = hybrid.correction_.coef @ hybrid.residual_(np.concatenate([x, u]))
    plain = np.asarray(inner.rhs(0.0, x, u, inner.params))
    np.testing.assert_allclose(hybrid.correction_.rhs(0.0, x, u), plain + term, rtol=1e-12)


def test_a_step_function_is_corrected_too():
    def step(t, x, u, p, dt):
        return [0.8 * x[0] + u[0] + p["bend"] * x[0] ** 2]

    def make(bend):
        return StepSimulator(step, states=["x"], inputs=["u"], outputs=["x"], params={"bend": bend})

    rng = np.random.default_rng(0)
    X, groups = 0.3 * rng.normal(size=(400, 1)), np.repeat([0, 1, 2, 3], 100)
    y = np.concatenate([make(0.03).simulate(X[groups == k])[:, 0] for k in range(4)])
    hybrid = HybridRegressor(make(0.0), form="dynamics").fit(X, y, groups=groups)
    np.testing.assert_allclose(hybrid.predict(X, groups=groups), y, atol=5e-3)


def test_trajectories_alone_cannot_be_corrected_inside():
    simulator = CallableSimulator(lambda U: U[:, :1])
    with pytest.raises(SimulatorError, match='form="dynamics" needs a simulator with rhs or step'):
        HybridRegressor(simulator, form="dynamics").fit(np.ones((30, 1)), np.ones(30))


def test_mistakes_speak():
    X, y, groups = make_reactor_runs(2, 60, random_state=0)
    with pytest.raises(SimulatorError, match="no state 'z'"):
        HybridRegressor(make_reactor(), form="dynamics", states=["z"]).fit(X, y, groups=groups)
    with pytest.raises(DataError, match="is not a regressor: it has no method predict"):
        HybridRegressor(make_reactor(), PolynomialFeatures(2), "dynamics").fit(X, y, groups=groups)
    X, y, groups = runs(plant(), n_runs=2)
    with pytest.raises(DataError, match="one step ahead needs all states"):
        HybridRegressor(plant(), form="dynamics", loss="one_step").fit(X, y, groups=groups)
