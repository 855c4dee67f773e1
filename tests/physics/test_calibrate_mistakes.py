"""Mistakes around a calibration speak: the parameter as typed, what is expected, what came, the way out."""

import numpy as np
import pytest
from sklearn.utils._param_validation import InvalidParameterError

from sksurrogate.compose import HybridRegressor
from sksurrogate.exceptions import DataError, RunError, SimulatorError
from sksurrogate.physics import CalibratedSimulator, ODESimulator

U = np.random.default_rng(0).normal(size=(40, 1))
RUNS = np.repeat([0, 1], 20)


def lag(t, x, u, p):
    return (p["k"] * (u[0] - x[0]),)


def plant(rhs=lag, **changes):
    return ODESimulator(
        rhs, **{"states": ["x"], "inputs": ["u"], "outputs": ["x"], "params": {"k": 1.0}, "dt": 0.1, **changes}
    )


Y = plant(params={"k": 2.0}).simulate(U)[:, 0]


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"params": "k"}, SimulatorError, r"params='k': expected a list of names, params=\['k'\]"),
        ({"params": ["k", "k"]}, SimulatorError, "'k' is named twice"),
        ({"params": ["kk"]}, SimulatorError, r"no parameter 'kk'; it has \['k'\]"),
        ({"bounds": [(0, 1)]}, DataError, r"expected a dict by name, for instance bounds=\{'k'"),
        ({"bounds": {"k": (3, 1)}}, DataError, r"bounds\['k'\]=\(3, 1\).*low < high"),
        ({"bounds": {"q": (0, 1)}}, DataError, "'q', which is not fitted"),
        ({"confidence": 1.5}, InvalidParameterError, "'confidence'.*Got 1.5"),
        ({"max_iter": 0}, InvalidParameterError, "'max_iter'.*Got 0"),
        ({"fit_x0": "no"}, InvalidParameterError, "'fit_x0'"),
    ],
)
def test_settings(settings, error, message):
    with pytest.raises(error, match=message):
        CalibratedSimulator(plant(), **settings).fit(U, Y)


@pytest.mark.parametrize(
    ("simulator", "message"),
    [
        (None, r"simulator=None has no method simulate"),
        (ODESimulator, r"simulator=ODESimulator is a class: give one simulator of it, ODESimulator\(\.\.\.\)"),
        (plant(params={"k": None}), r"params\['k'\]=None: expected a finite number.*set_params\(params__k="),
        (plant(params={"k": "a"}), r"params\['k'\]='a': expected a finite number"),
        (plant(lambda t, x, u, p: [x[0], x[0]]), r"must return 1 components, one for each of \['x'\]"),
        (plant(lambda t, x, u, p: None), "must return 1 components.*returned None"),
        (
            plant(lambda t, x, u, p: [np.nan * x[0]]),
            "state 'x' is not finite in 40 of 40 samples along the data, first in row 0",
        ),
        (plant(lambda t, x, u, p: [u[0] - x[0]], params={}), "no parameters to fit.*params=\\[\\]"),
        (plant(lambda t, x, u, p: list(x), states=["x", "x"]), r"states=\['x', 'x'\]: 'x' is named twice"),
    ],
)
def test_simulators(simulator, message):
    with pytest.raises(SimulatorError, match=message):
        CalibratedSimulator(simulator).fit(U, Y)


@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        ({"X": U, "y": np.r_[Y[:30], np.inf, Y[31:]], "groups": RUNS}, DataError, r"y contains infinity: row 30, column 0 \(run 1\)"),
        ({"X": np.vstack([U[:30], np.nan * U[30:31], U[31:]]), "y": Y, "groups": RUNS}, DataError, r"X contains NaN: row 30, column 0 \(run 1\).*Interpolator"),
        ({"X": U, "y": np.full(40, np.nan)}, DataError, "no measured value in column 0"),
        ({"X": U, "y": np.r_[Y[:20], np.full(20, np.nan)], "groups": RUNS}, DataError, "run 1 holds no measured value"),
        ({"X": U, "y": np.c_[Y, Y]}, SimulatorError, r"y has 2 columns, but the simulator has 1 outputs \['x'\]"),
        ({"X": np.c_[U, U], "y": Y}, SimulatorError, r"X has 2 columns, but the simulator has 1 inputs \['u'\]"),
        ({"X": U, "y": Y, "groups": RUNS[:-1]}, DataError, r"groups has shape \(39,\), but X has 40 rows"),
        ({"X": U, "y": Y, "groups": np.r_[7, np.zeros(39)]}, RunError, "run 7.0 has 1 rows .* 2 are needed"),
        ({"X": U, "y": Y, "x0": [1.0, 2.0]}, DataError, r"x0 has shape \(2,\), expected \(1,\) or \(1, 1\)"),
        ({"X": U, "y": Y, "x0": [np.nan]}, DataError, r"x0=\[nan\] is not finite"),
    ],
)  # fmt: skip
def test_data(data, error, message):
    with pytest.raises(error, match=message):
        CalibratedSimulator(plant()).fit(**data)


def test_starts_of_a_prediction():
    model = CalibratedSimulator(plant()).fit(U, Y)
    with pytest.raises(DataError, match=r"y0 has shape \(3, 3\), expected \(n_lags, 1\) or \(1, n_lags, 1\)"):
        model.predict(U, y0=np.ones((3, 3)))
    with pytest.raises(DataError, match=r"x0 has shape \(3, 3\)"):
        model.predict(U, x0=np.ones((3, 3)))


def test_the_first_outputs_of_all_runs_are_given_once_or_run_by_run():
    model = CalibratedSimulator(plant()).fit(U, Y, groups=RUNS)
    by_run = model.predict(U, y0=np.full((2, 1, 1), 0.7), groups=RUNS)
    assert by_run[0] == by_run[20] == 0.7
    for once in ([0.7], [[0.7]]):
        np.testing.assert_array_equal(model.predict(U, y0=once, groups=RUNS), by_run)
    for wrong in (np.full((3, 1, 1), 0.7), np.full((2, 1, 1, 1), 0.7)):
        with pytest.raises(DataError, match="y0 has shape"):
            model.predict(U, y0=wrong, groups=RUNS)


def test_rows_of_a_simulation():
    with pytest.raises(SimulatorError, match="U has no rows"):
        plant().simulate(U[:0])
    with pytest.raises(SimulatorError, match="t=1 in row 2 is not later than t=2 before it"):
        plant().simulate(U[:3], t=[0.0, 2.0, 1.0])


def test_a_residual_that_is_no_estimator():
    with pytest.raises(DataError, match="not an estimator: it has no method fit"):
        HybridRegressor(plant(), object(), form="static").fit(U, Y)
