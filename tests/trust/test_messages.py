"""The ten worst mistakes, each at several doors: the message says what, where, what is expected, and the way out."""

import numpy as np
import pandas as pd
import pytest
from scipy.sparse import csr_matrix
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LinearRegression, Ridge

from sksurrogate.compose import HybridRegressor, RecursivePredictor
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.exceptions import DataError, RunError, SimulationDiverged, SimulatorError
from sksurrogate.features import LagEmbedding
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import CalibratedSimulator, ODESimulator

X, y, groups = make_reactor_runs(4, 60, noise=0.01, random_state=0)


def door(name):
    """A fresh estimator."""
    simulator = make_reactor()
    return {
        "recursive": lambda: RecursivePredictor(Ridge(), 2, 2),
        "hybrid": lambda: HybridRegressor(simulator),
        "gap": lambda: GapDiagnoser(simulator, effects=["sensor_bias"]),
        "calibrated": lambda: CalibratedSimulator(simulator, params=["feed"]),
    }[name]()


DOORS = ["recursive", "hybrid", "gap", "calibrated"]
ALL = pytest.mark.parametrize("name", DOORS)


# 1. not fitted
@pytest.mark.parametrize("name", ["recursive", "hybrid", "calibrated"])
def test_unfitted(name):
    with pytest.raises(NotFittedError, match="Call 'fit'"):
        door(name).predict(X)


def test_unfitted_lags():
    with pytest.raises(NotFittedError, match="Call 'fit'"):
        LagEmbedding(2).transform(X)


# 2. a run that is too short
@ALL
def test_short_run(name):
    with pytest.raises(RunError, match=r"run 9 has 1 rows .*but .*: give longer runs"):
        door(name).fit(np.r_[X, X[:1]], np.r_[y, y[:1]], groups=np.r_[groups, 9])


# 3. missing values
@ALL
def test_missing_value(name):
    holed = X.copy()
    holed[70] = np.nan
    with pytest.raises(ValueError, match="Input X contains NaN"):
        door(name).fit(holed, y, groups=groups)


@ALL
def test_masked_value(name):
    hidden = np.zeros(len(y), dtype=bool)
    hidden[70] = True
    with pytest.raises(ValueError, match="Input X contains NaN"):
        door(name).fit(np.ma.masked_array(X, hidden[:, None]), y, groups=groups)
    if name not in ("gap", "calibrated"):  # there a reading that is missing was not measured
        with pytest.raises(ValueError, match="y contains NaN"):
            door(name).fit(X, np.ma.masked_array(y, hidden), groups=groups)
    with pytest.raises(ValueError, match="U is not finite in row 70"):
        make_reactor().simulate(np.ma.masked_array(X[:99], hidden[:99, None]))


@pytest.mark.parametrize("name", ["recursive", "gap", "calibrated"])
def test_missing_value_says_row_run_and_way_out(name):
    holed = y.copy()
    holed[70] = np.inf
    with pytest.raises(DataError, match=r"y contains infinity: row 70, column 0 \(run 1\); 1 .*Remove or interpolate"):
        door(name).fit(X, holed, groups=groups)


# 4. one dimension where two are needed
@ALL
def test_one_dimension(name):
    with pytest.raises(ValueError, match=r"(?s)1.?[dD].*reshape\(-1, 1\)"):
        door(name).fit(X[:, 0], y, groups=groups)


# 5. lengths that do not match
@pytest.mark.parametrize("name", ["recursive", "gap", "calibrated"])
def test_lengths(name):
    with pytest.raises(DataError, match="X has 240 rows and y has 239"):
        door(name).fit(X, y[:-1], groups=groups)


@ALL
def test_length_of_groups(name):
    with pytest.raises(DataError, match=r"groups has shape \(239,\), but X has 240 rows: give one label per row"):
        door(name).fit(X, y, groups=groups[:-1])


def test_wrong_first_outputs():
    model = door("recursive").fit(X, y, groups=groups)
    with pytest.raises(ValueError, match=r"y0 has shape \(5,\), expected \(2, 1\) or \(4, 2, 1\)"):
        model.predict(X, y0=y[:5], groups=groups)


# 6. a run in two pieces
@ALL
def test_broken_run(name):
    broken = groups.copy()
    broken[10] = 3
    with pytest.raises(RunError, match=r"run 0 is in two pieces: rows 0..9 and again from row 11.*sort by run"):
        door(name).fit(X, y, groups=broken)


# 7. a column that is not there, or in another order
@pytest.mark.parametrize("name", ["gap", "calibrated"])
def test_missing_column(name):
    frame = pd.DataFrame({"y": y, "v": X[:, 0]})
    simulator = ODESimulator(
        lambda t, x, u, p: [p["k"] * (u[0] - x[0]) + u[1]],
        states=["y"], inputs=["u", "v"], outputs=["y"], params={"k": 1.0}, dt=0.02,
    )  # fmt: skip
    estimator = door(name).set_params(simulator=simulator)
    with pytest.raises(DataError, match=r"column 'u' of the simulator is not in the data; columns are .*Rename it"):
        estimator.fit(frame, y, groups=groups)


def test_missing_run_column():
    with pytest.raises(DataError, match=r"run='experiment' is not a column of X; columns are \['u'\]"):
        door("recursive").set_params(run="experiment").fit(pd.DataFrame({"u": X[:, 0]}), y)


def filling(t, x, u, p):
    return [u[0] - p["k"] * u[1] * x[0]]


def test_columns_in_another_order_are_found_by_name():
    simulator = ODESimulator(
        filling, states=["level"], inputs=["flow", "valve"], outputs=["level"], params={"k": 1.0}, dt=0.1
    )
    rng = np.random.default_rng(0)
    frame = pd.DataFrame(np.repeat(rng.uniform(0.5, 1.5, (30, 2)), 8, axis=0), columns=["flow", "valve"])
    level = simulator.simulate(frame.to_numpy())[:, 0]
    build = CalibratedSimulator(simulator, params=["k"])
    straight = build.fit(frame, level).predict(frame)
    turned = build.fit(frame[["valve", "flow"]], level).predict(frame[["valve", "flow"]])
    np.testing.assert_allclose(turned, straight, rtol=1e-10)


# 8. sparse input
@ALL
def test_sparse(name):
    with pytest.raises((TypeError, ValueError), match=r"[Ss]parse.*toarray\(\)"):
        door(name).fit(csr_matrix(X), y, groups=groups)


# 9. text among the numbers
@ALL
def test_text(name):
    words = X.astype(object)
    words[3, 0] = "closed"
    with pytest.raises(ValueError, match="closed"):
        door(name).fit(words, y, groups=groups)


# 10. a free run that leaves the numbers
@pytest.mark.slow
def test_simulator_that_blows_up():
    simulator = ODESimulator(
        lambda t, x, u, p: [x[0] ** 2], states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1, x0=[5.0]
    )
    with pytest.raises(SimulationDiverged, match=r"row 2, t = 0.2, state 'x'. Check x0, the units") as caught:
        simulator.simulate(np.zeros((100, 1)))
    assert caught.value.state == "x" and caught.value.row == 2


def test_learned_model_that_blows_up():
    grows = 1.9 ** np.arange(60)
    model = RecursivePredictor(LinearRegression(), [0], [1]).fit(np.zeros((60, 1)), grows)
    with pytest.raises(SimulationDiverged, match=r'free run diverged: run 0, step \d+.*Fit with loss="shooting"'):
        model.predict(np.zeros((4000, 1)), y0=[[1.0]])


# and those that only this package can be asked
def test_no_outputs():
    for name in ("gap", "calibrated"):
        with pytest.raises(DataError, match="y is missing"):
            door(name).fit(X, None, groups=groups)


def test_an_effect_that_is_spelt_wrong():
    with pytest.raises(ValueError, match="did you mean 'coulomb_friction'"):
        GapDiagnoser(make_reactor(), effects=["coulomb_fricton"]).fit(X, y, groups=groups)


def test_a_parameter_that_is_not_there():
    with pytest.raises(SimulatorError, match=r"no parameter 'fed'; it has \['feed', 'first', 'flow', 'second'\]"):
        GapDiagnoser(make_reactor(), free_params=["fed"]).fit(X, y, groups=groups)


@pytest.mark.parametrize(
    ("free", "message"),
    [
        (5, r"free_params=5: 5 is not a name; expected a list of names out of \['feed', 'first'.*or \"all\""),
        ([None], r"free_params=\[None\]: None is not a name"),
        (["feed", "flow", "feed"], r"free_params=.*: 'feed' is listed twice; list each parameter once"),
    ],
)
def test_free_parameters_that_are_no_names(free, message):
    with pytest.raises(SimulatorError, match=message):
        GapDiagnoser(make_reactor(), free_params=free).fit(X, y, groups=groups)


def test_no_free_parameters_may_be_none():
    reports = [
        GapDiagnoser(make_reactor(), effects=["sensor_bias"], free_params=free, random_state=0)
        .fit(X[:120], y[:120] + 0.5, groups=groups[:120])
        .report_
        for free in (None, ())
    ]
    assert reports[0].effects == reports[1].effects and len(reports[0].retuned) == 0


@pytest.mark.parametrize("jobs", [0, 1.5, "2"])
def test_a_number_of_workers_that_is_none(jobs):
    with pytest.raises(
        ValueError, match=rf"n_jobs={jobs!r}: expected None, -1 .* or a positive integer; write n_jobs=1"
    ):
        GapDiagnoser(5, n_jobs=jobs).fit(X, y, groups=groups)  # said before the simulator is looked at


def test_something_that_is_no_simulator():
    with pytest.raises(SimulatorError, match=r"no method simulate\(U, x0=None, t=None\): wrap it"):
        GapDiagnoser(5).fit(X, y, groups=groups)


def test_a_right_hand_side_of_the_wrong_shape():
    wrong = ODESimulator(lambda t, x, u, p: [x[0], x[0]], states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1)
    with pytest.raises(SimulatorError, match="must return 1 components, one for each of"):
        wrong.simulate(np.zeros((5, 1)))


def test_a_parameter_that_the_right_hand_side_wants():
    wrong = ODESimulator(
        lambda t, x, u, p: [p["k"] * x[0]], states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1
    )
    with pytest.raises(SimulatorError, match="parameter 'k' is not in params"):
        wrong.simulate(np.zeros((5, 1)))
