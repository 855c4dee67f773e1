"""Frames are read by the names of a simulator's signals at every door, never silently by position."""

import warnings

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import DataConversionWarning
from sklearn.linear_model import LinearRegression

from sksurrogate import GapDiagnoser, HybridRegressor
from sksurrogate._columns import by_name
from sksurrogate.effects import AugmentedSimulator
from sksurrogate.exceptions import DataError
from sksurrogate.physics import CalibratedSimulator, CallableSimulator, ODESimulator, StepSimulator, TableSimulator

N = 120
RNG = np.random.default_rng(0)
U = np.repeat(RNG.normal(size=(N // 10, 2)), 10, axis=0)
FRAME = pd.DataFrame(U, columns=["flow", "heat"])


def rhs(t, x, u, p):
    return (p["a"] * u[0] + p["b"] * u[1] - x[0],)


def plant(inputs=("flow", "heat")):
    return ODESimulator(
        rhs, states=["T"], inputs=list(inputs), outputs=["T"], params={"a": 1.0, "b": -2.0}, dt=0.1, x0=[0.0]
    )


def step(inputs=("flow", "heat")):
    return StepSimulator(
        lambda t, x, u, p, dt: [0.9 * x[0] + u[0] - 2 * u[1]], states=["T"], inputs=inputs, outputs=["T"]
    )


Y = plant().simulate(U)
SIMULATORS = {
    "ode": plant,
    "step": step,
    "function": lambda inputs=("flow", "heat"): CallableSimulator(lambda V: V @ [1.0, -2.0], inputs=inputs),
    "table": lambda inputs=("flow", "heat"): TableSimulator(U, Y, inputs=inputs),
    "effects": lambda inputs=("flow", "heat"): AugmentedSimulator(plant(inputs), []),
}
FITTED = {
    "calibration": CalibratedSimulator,
    "hybrid": lambda simulator: HybridRegressor(simulator, LinearRegression(), form="static"),
    "diagnosis": lambda simulator: GapDiagnoser(simulator, effects=[]),
}


@pytest.mark.parametrize("kind", SIMULATORS)
def test_simulators_take_columns_by_name_in_any_order_and_leave_others_out(kind):
    simulator = SIMULATORS[kind]()
    expected = simulator.simulate(U)
    more = FRAME.assign(other=1.0)[["heat", "other", "flow"]]
    np.testing.assert_array_equal(simulator.simulate(FRAME[["heat", "flow"]]), expected)
    np.testing.assert_array_equal(simulator.simulate(more), expected)
    with pytest.raises(DataError, match="column 'flow' of the simulator is not in the data"):
        simulator.simulate(FRAME.rename(columns={"flow": "F"}))


@pytest.mark.parametrize("kind", SIMULATORS)
def test_simulators_say_so_where_no_name_fits(kind):
    simulator = SIMULATORS[kind]()
    with pytest.warns(DataConversionWarning, match=r"none of the columns \['F', 'Q'\].*\['flow', 'heat'\]") as record:
        found = simulator.simulate(FRAME.set_axis(["F", "Q"], axis=1))
    np.testing.assert_array_equal(found, simulator.simulate(U))
    assert record[0].filename == __file__


@pytest.mark.parametrize("kind", SIMULATORS)
@pytest.mark.parametrize(
    "columns, inputs", [([0, 1], ("flow", "heat")), (["F", "Q"], ("u0", "u1")), (["u0", "u1"], ("F", "Q"))]
)
def test_names_that_nobody_chose_pass_without_a_word(kind, columns, inputs):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        SIMULATORS[kind](inputs).simulate(FRAME.set_axis(columns, axis=1))


@pytest.mark.filterwarnings("ignore:A column-vector y")
@pytest.mark.parametrize("kind", FITTED)
def test_estimators_say_so_once_where_no_name_fits(kind):
    model = FITTED[kind](plant())
    other = FRAME.set_axis(["F", "Q"], axis=1)
    with pytest.warns(DataConversionWarning, match="none of the columns") as record:
        model.fit(other, Y[:, 0])
    assert record[0].filename == __file__
    if hasattr(model, "predict"):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            model.predict(other)  # the names of the fit
    with pytest.warns(DataConversionWarning, match=r"\['level'\] is named like a signal of the simulator, \['T'\]"):
        model.fit(FRAME, pd.DataFrame(Y, columns=["level"]))
    with pytest.raises(DataError, match="column 'flow' of the simulator is not in the data"):
        model.fit(FRAME.rename(columns={"flow": "F"}), Y[:, 0])


@pytest.mark.parametrize("kind", FITTED)
def test_estimators_take_columns_by_name(kind):
    model = FITTED[kind](plant())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.fit(FRAME[["heat", "flow"]], Y[:, 0])
    if kind == "calibration":
        assert model.params_["a"] == pytest.approx(1.0, rel=1e-3)


def test_the_run_column_is_kept_and_not_counted():
    frame = FRAME.set_axis(["F", "Q"], axis=1).assign(run=0)
    with pytest.warns(DataConversionWarning, match=r"none of the columns \['F', 'Q'\] is"):
        assert by_name(frame, ["flow", "heat"], "run") is frame
