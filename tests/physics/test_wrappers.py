"""Wrappers against closed forms and against each other."""

import pickle
import warnings
from functools import partial

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.linear_model import LinearRegression

from sksurrogate.datasets import make_reactor
from sksurrogate.exceptions import SimulationDiverged, SimulatorError
from sksurrogate.physics import (
    CallableSimulator,
    ControlSimulator,
    ODESimulator,
    StepSimulator,
    TableSimulator,
    linearise,
    steady_state,
)


def _step(t, x, u, p, dt):
    return [x[0] * np.exp(-p["k"] * dt) + u[0] * (1 - np.exp(-p["k"] * dt)) / p["k"]]


def _rhs(t, x, u, p):
    return [-p["k"] * x[0] + u[0]]


NAMES = {"states": ["x"], "inputs": ["u"], "outputs": ["x"], "params": {"k": 2.0}, "dt": 0.1}


def _inputs(n=40):
    return np.random.default_rng(0).normal(size=(n, 1))


def _gain(U, p):
    return p["gain"] * U


def test_an_exact_step_equals_the_right_hand_side():
    U = _inputs()
    a, b = StepSimulator(_step, **NAMES).simulate(U, x0=[1.0]), ODESimulator(_rhs, **NAMES).simulate(U, x0=[1.0])
    np.testing.assert_allclose(a, b, atol=1e-7)


def test_steps_abreast_equal_steps_one_by_one():
    U, X0 = np.random.default_rng(1).normal(size=(3, 20, 1)), np.array([[0.0], [1.0], [2.0]])
    plant = StepSimulator(_step, **NAMES)
    one_by_one = np.stack([plant.simulate(u, x0) for u, x0 in zip(U, X0)])
    np.testing.assert_array_equal(plant.simulate_batch(U, X0), one_by_one)


def test_a_step_that_blows_up_is_named():
    plant = StepSimulator(lambda t, x, u, p, dt: [x[0] * x[0]], states=["x"], inputs=["u"], outputs=["x"], x0=[1e3])
    with pytest.raises(SimulationDiverged, match="state 'x'"):
        plant.simulate(np.zeros((20, 1)))


@pytest.mark.parametrize("kind", ["continuous", "discrete"])
def test_control_systems_equal_the_closed_form(kind):
    control = pytest.importorskip("control")
    U = _inputs()
    a, b = np.exp(-0.2), (1 - np.exp(-0.2)) / 2
    system = (
        control.ss([[-2.0]], [[1.0]], [[1.0]], [[0.0]])
        if kind == "continuous"
        else control.ss([[a]], [[b]], [[1.0]], [[0.0]], 0.1)
    )
    expected = np.zeros(len(U))
    for k in range(len(U) - 1):
        expected[k + 1] = a * expected[k] + b * U[k, 0]
    np.testing.assert_allclose(ControlSimulator(system, dt=0.1).simulate(U)[:, 0], expected, atol=1e-7)


def test_a_transfer_function_equals_its_realisation():
    control = pytest.importorskip("control")
    system = control.tf([1.0], [1.0, 2.0])
    U = _inputs()
    np.testing.assert_allclose(
        ControlSimulator(system, dt=0.1).simulate(U), ODESimulator(_rhs, **NAMES).simulate(U), atol=1e-7
    )


def test_a_nonlinear_system_equals_the_right_hand_side():
    control = pytest.importorskip("control")
    reactor = make_reactor()

    def update(t, x, u, params):
        return reactor.rhs(t, x, u, reactor.params)

    system = control.nlsys(update, None, inputs=["u"], states=["y"], outputs=["y"], name="reactor")
    wrapped = ControlSimulator(system, dt=reactor.dt, x0=[8.0])
    U = np.random.default_rng(0).uniform(0.1, 0.2, size=(30, 1))
    np.testing.assert_allclose(wrapped.simulate(U), reactor.simulate(U, x0=[8.0]), rtol=1e-7)
    assert (wrapped.states, wrapped.inputs, wrapped.outputs) == (["y"], ["u"], ["y"])


def test_a_linearisation_goes_to_python_control_and_back():
    pytest.importorskip("control")
    reactor = make_reactor()
    local = linearise(reactor, steady_state(reactor, [0.15], x0=[5.0]), [0.15])
    wrapped = ControlSimulator(local.to_control(), dt=reactor.dt)
    U = 1e-5 * np.random.default_rng(0).normal(size=(60, 1))
    deviation = reactor.simulate(0.15 + U, x0=local.x0) - local.y0
    np.testing.assert_allclose(wrapped.simulate(U), deviation, atol=2e-3 * np.abs(deviation).max())


def test_the_table_finds_runs_and_pieces_again():
    U, Y = _inputs(30), np.arange(30.0)
    table = TableSimulator(U, Y, groups=np.repeat([0, 1], 15))
    np.testing.assert_array_equal(table.simulate(U[15:25])[:, 0], Y[15:25])
    with pytest.raises(SimulatorError, match="not in the table"):
        table.simulate(U[10:20])  # across two runs
    with pytest.raises(SimulatorError, match="give x0"):
        TableSimulator(np.ones((4, 1)), np.arange(4.0)).simulate(np.ones((2, 1)))


def test_frames_are_taken_by_their_names():
    pd = pytest.importorskip("pandas")
    U = pd.DataFrame(np.random.default_rng(0).normal(size=(30, 2)), columns=["a", "b"])
    Y = pd.DataFrame({"temp": 20.0 + U.a, "level": U.b})
    wanted = Y[["level", "temp"]].to_numpy()
    for table in (U, U[["b", "a"]]):
        found = TableSimulator(table, Y, inputs=["a", "b"], outputs=["level", "temp"])
        np.testing.assert_array_equal(found.simulate(U), wanted)
        np.testing.assert_array_equal(found.simulate(U[["b", "a"]]), wanted)
        np.testing.assert_array_equal(found.simulate(U.to_numpy()), wanted)
    np.testing.assert_array_equal(TableSimulator(U[["b", "a"]], Y).simulate(U), Y.to_numpy())
    model = LinearRegression().fit(U[["b", "a"]], Y.temp)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(CallableSimulator(model).simulate(U)[:, 0], Y.temp)
        named = CallableSimulator(model, inputs=["a", "b"])
        np.testing.assert_allclose(named.simulate(U.to_numpy())[:, 0], Y.temp)
        np.testing.assert_allclose(named.simulate(U)[:, 0], Y.temp)


def test_the_table_takes_columns_of_the_inputs():
    X = np.arange(6.0).reshape(3, 2)
    np.testing.assert_array_equal(TableSimulator(columns=[1]).simulate(X), X[:, [1]])
    named = TableSimulator(columns=["y"], inputs=["u", "y"])
    np.testing.assert_array_equal(named.simulate(X), X[:, [1]])
    for wrong in ("z", 2):
        with pytest.raises(SimulatorError, match=f"none is {wrong!r}: give numbers of columns, or names"):
            named.set_params(columns=[wrong]).simulate(X)


def test_what_is_no_control_system_is_refused():
    with pytest.raises(SimulatorError, match=r"not a system of python-control: make one with control\.ss"):
        ControlSimulator(np.eye(2), dt=0.1).simulate(np.zeros((3, 1)))


def test_a_fitted_estimator_stays_fitted_in_a_clone():
    X = _inputs()
    fitted = LinearRegression().fit(X, 3 * X[:, 0])
    np.testing.assert_allclose(clone(CallableSimulator(fitted)).simulate(X), 3 * X)


def test_parameters_are_reached_by_name_and_the_dict_is_never_written():
    params = {"gain": 2.0}
    plant = CallableSimulator(_gain, params=params).set_params(params__gain=5.0)
    assert plant.simulate([[1.0]])[0, 0] == 5.0 and params == {"gain": 2.0}
    with pytest.raises(ValueError, match="no parameter 'k'"):
        plant.set_params(params__k=1.0)


def test_a_function_of_the_wrong_length_is_refused():
    with pytest.raises(SimulatorError, match="one row for each row of U"):
        CallableSimulator(lambda U: U[:-1]).simulate(np.ones((4, 1)))


@pytest.mark.parametrize(
    "make",
    [
        partial(StepSimulator, _step, **NAMES),
        partial(CallableSimulator, _gain, params={"gain": 1.5}),
        partial(TableSimulator, _inputs(), _inputs()),
    ],
)
def test_clone_pickle_and_repr_keep_the_simulator(make):
    plant, U = make(), _inputs()
    for other in (clone(plant), pickle.loads(pickle.dumps(plant))):
        np.testing.assert_array_equal(other.simulate(U), plant.simulate(U))
        assert repr(other) == repr(plant)


def test_a_pole_stops_the_stiff_integrator_at_its_row():
    def explode(t, x, u, p):
        return [x[0] ** 2]

    plant = ODESimulator(explode, states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1)
    with pytest.raises(SimulationDiverged) as error:
        plant.simulate(np.zeros((10, 1)), x0=[1.5])  # x = 1 / (1 / 1.5 - t)
    assert error.value.row == 7


def test_small_whole_powers_are_products_with_the_same_value():
    from sksurrogate.physics._rhs import _Points

    x = np.random.default_rng(0).normal(size=(2, 400))
    for n in (2, 3, 4, 5, 7, 8, 3.0, 9, 0.5, -1):
        with np.errstate(invalid="ignore"):
            np.testing.assert_allclose(np.asarray(x.view(_Points) ** n), x**n, rtol=1e-13)


def test_masked_initial_states_and_tables_are_no_numbers():
    U, start = np.ones((4, 1)), np.ma.masked_equal([7.0], 7.0)
    plants = [
        ODESimulator(lambda t, x, u, p: (u[0] - x[0],), states=["v"], inputs=["u"], outputs=["v"], params={}, dt=0.1),
        StepSimulator(lambda t, x, u, p, dt: [0.9 * x[0] + u[0]], states=["v"], inputs=["u"], outputs=["v"]),
    ]
    for plant in plants:
        for run in (
            lambda plant=plant: plant.simulate(U, start),
            lambda plant=plant: plant.simulate_batch(U[None], start[None]),
        ):
            with pytest.raises(SimulationDiverged):
                run()
    found = TableSimulator(U, np.ma.masked_equal([1.0, 7.0, 1.0, 1.0], 7.0)).simulate(U)
    np.testing.assert_array_equal(np.isnan(found[:, 0]), [False, True, False, False])
