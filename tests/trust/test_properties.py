"""What must hold whatever the numbers: properties, on examples that hypothesis chooses."""

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.dummy import DummyRegressor
from sklearn.ensemble import RandomForestRegressor
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from sksurrogate import cut_runs, stack_runs, unstack_runs
from sksurrogate.compose import HybridRegressor, RecursivePredictor
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.effects import AugmentedSimulator, build_effects
from sksurrogate.exceptions import SimulationDiverged
from sksurrogate.features import FourierFeatures, GaussianFeatures, HeavisideFeatures, LagEmbedding, SplineFeatures
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._simulator import describe

#: Random plants, rows and learners: that a random fit leaves its own training runs is said, and is not what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore:the free runs of")

SOME = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**31 - 1)
lengths = st.lists(st.integers(8, 30), min_size=1, max_size=5)


def printed(report):
    """The terminal page without when it was made and how long it took."""
    return re.sub(r"date:\s+\S+\s+[0-9:]+;\s+time\s+taken:\s+[0-9.]+\s+s", "", str(report))


def recordings(seed, rows, n_inputs=2, n_outputs=1):
    """Runs of the given lengths of a stable linear plant with noise, shuffled labels."""
    rng = np.random.default_rng(seed)
    Xs, ys = [], []
    for n in rows:
        u = rng.normal(size=(n, n_inputs))
        y = np.zeros((n, n_outputs))
        for t in range(1, n):
            y[t] = 0.6 * y[t - 1] + 0.3 * np.tanh(u[t].sum()) + 0.05 * rng.normal(size=n_outputs)
        Xs.append(u)
        ys.append(y[:, 0] if n_outputs == 1 else y)
    return Xs, ys


LEARNERS = {
    "linear": LinearRegression(),
    "scaled ridge": make_pipeline(StandardScaler(), Ridge(1e-3)),
    "polynomial": make_pipeline(StandardScaler(), PolynomialFeatures(2), Ridge(0.1)),
    "forest": RandomForestRegressor(5, random_state=0),
}
ALL = pytest.mark.parametrize("learner", LEARNERS)


def model(learner):
    return RecursivePredictor(LEARNERS[learner], input_lags=2, output_lags=2)


@SOME
@given(seed=seeds, rows=lengths, lag=st.integers(0, 3))
def test_lags_are_shifts_and_never_cross_a_run(seed, rows, lag):
    Xs, _ = recordings(seed, rows)
    X, _, groups = stack_runs(Xs)
    wide = LagEmbedding([lag]).fit(X, groups=groups).transform(X, groups=groups)
    for part, run in zip(unstack_runs(wide, groups), Xs):
        np.testing.assert_array_equal(part[lag:], run[: len(run) - lag])
        # what pads the first rows comes from this run or is not a number
        assert all(np.isnan(value) or value in run or value == 0 for value in part[:lag].ravel())


@SOME
@given(rows=lengths, n_blocks=st.integers(1, 3), gap=st.integers(0, 2))
def test_cut_runs_keep_every_row_but_the_gaps(rows, n_blocks, gap):
    groups = np.repeat(np.arange(len(rows)), rows)
    cut = cut_runs(groups, n_blocks, gap=gap)
    assert (cut == -1).sum() == len(rows) * gap * (n_blocks - 1)
    for label in set(cut.tolist()) - {-1}:
        assert len(set(groups[cut == label].tolist())) == 1
        assert np.ptp(np.flatnonzero(cut == label)) == (cut == label).sum() - 1


@ALL
@settings(max_examples=6, deadline=None)
@given(seed=seeds, rows=lengths)
def test_a_free_run_is_the_loop_of_its_steps(learner, seed, rows):
    X, y, groups = stack_runs(*recordings(seed, [20, 25, *rows]))
    fitted = model(learner).fit(X, y, groups=groups)
    u, truth = X[groups == 2], y[groups == 2]
    try:
        free = fitted.predict(u, y0=truth[:2])
    except SimulationDiverged:
        assume(False)  # a polynomial may well run away
    loop = list(truth[:2])
    for t in range(2, len(u)):
        past = [loop[t - 1], loop[t - 2]]
        inputs = [u[t - lag, j] for j in range(2) for lag in range(3)]
        loop.append(float(fitted.estimator_.predict(np.array([past + inputs]))[0]))
    np.testing.assert_allclose(free, loop, rtol=1e-7, atol=1e-9)


@ALL
@settings(max_examples=6, deadline=None)
@given(seed=seeds, rows=lengths)
def test_many_runs_at_once_are_each_run_alone(learner, seed, rows):
    Xs, ys = recordings(seed, [20, *rows])
    X, y, groups = stack_runs(Xs, ys)
    fitted = model(learner).fit(X, y, groups=groups)
    y0 = np.stack([part[:2, None] for part in ys])
    try:
        together = unstack_runs(fitted.predict(X, y0=y0, groups=groups), groups)
    except SimulationDiverged:
        assume(False)
    for part, u, first in zip(together, Xs, ys):
        np.testing.assert_allclose(part, fitted.predict(u, y0=first[:2]), rtol=1e-7, atol=1e-9)


@settings(max_examples=10, deadline=None)
@given(seed=seeds, rows=lengths, data=st.data())
def test_the_order_of_the_runs_does_not_matter(seed, rows, data):
    Xs, ys = recordings(seed, [20, *rows])
    order = data.draw(st.permutations(range(len(Xs))))
    X, y, groups = stack_runs(Xs, ys)
    X2, y2, groups2 = stack_runs([Xs[i] for i in order], [ys[i] for i in order])
    one, other = model("linear").fit(X, y, groups=groups), model("linear").fit(X2, y2, groups=groups2)
    a, b = unstack_runs(one.predict(X, groups=groups), groups), unstack_runs(other.predict(X2, groups=groups2), groups2)
    for place, i in enumerate(order):
        np.testing.assert_allclose(b[place], a[i], rtol=1e-6, atol=1e-8)


@settings(max_examples=10, deadline=None)
@given(seed=seeds, u_unit=st.floats(1e-4, 1e4), y_unit=st.floats(1e-4, 1e4))
def test_a_change_of_units_scales_the_answer(seed, u_unit, y_unit):
    # not LinearRegression: its tol cuts directions that are small in the units given
    X, y, groups = stack_runs(*recordings(seed, [30, 25]))
    y0 = y[:2]
    plain = model("scaled ridge").fit(X, y, groups=groups).predict(X[:30], y0=y0)
    scaled = model("scaled ridge").fit(u_unit * X, y_unit * y, groups=groups).predict(u_unit * X[:30], y0=y_unit * y0)
    np.testing.assert_allclose(scaled, y_unit * plain, rtol=1e-5, atol=1e-7 * y_unit)


@SOME
@given(seed=seeds, degree=st.integers(0, 3), n_knots=st.integers(3, 8))
def test_splines_are_shares_of_one(seed, degree, n_knots):
    """Within the knots: not negative, they sum to one, and at most degree + 1 of them are not nil."""
    x = np.random.default_rng(seed).uniform(-3, 5, (40, 1))
    Phi = SplineFeatures(n_knots=n_knots, degree=degree).fit(x).transform(x)
    assert Phi.min() >= -1e-12
    np.testing.assert_allclose(Phi.sum(axis=1), 1.0, atol=1e-9)
    assert (np.abs(Phi) > 1e-12).sum(axis=1).max() <= degree + 1


@SOME
@given(seed=seeds, shift=st.floats(-100, 100), unit=st.floats(1e-3, 1e3))
def test_splines_do_not_know_the_unit_of_their_input(seed, shift, unit):
    x = np.random.default_rng(seed).uniform(0, 1, (30, 2))
    basis = SplineFeatures(n_knots=5)
    plain, moved = basis.fit_transform(x), basis.fit_transform(shift + unit * x)
    np.testing.assert_allclose(moved, plain, atol=1e-6 * max(1.0, abs(shift) / unit))


@SOME
@given(seed=seeds)
def test_the_order_of_the_rows_does_not_matter_to_static_features(seed):
    rng = np.random.default_rng(seed)
    x, order = rng.normal(size=(30, 2)), rng.permutation(30)
    for features in (SplineFeatures(n_knots=4), FourierFeatures(2), GaussianFeatures(4), HeavisideFeatures(3)):
        fitted = clone(features).fit(x)
        np.testing.assert_allclose(fitted.transform(x[order]), fitted.transform(x)[order], rtol=1e-12, atol=1e-14)


# ---- simulators ---------------------------------------------------------------------------------------------------------
def pendulum(t, x, u, p):
    return [x[1], u[0] - p["k"] * np.sin(x[0]) - p["c"] * x[1]]


PENDULUM = ODESimulator(
    pendulum, states=["angle", "speed"], inputs=["torque"], outputs=["angle"], params={"k": 4.0, "c": 0.3}, dt=0.05
)


@SOME
@given(seed=seeds, n_runs=st.integers(1, 5), n=st.integers(2, 30))
def test_a_batch_of_simulations_is_each_of_them(seed, n_runs, n):
    rng = np.random.default_rng(seed)
    U, x0 = rng.normal(size=(n_runs, n, 1)), rng.normal(size=(n_runs, 2))
    batch = PENDULUM.simulate_batch(U, x0)
    single = np.stack([PENDULUM.simulate(u, x0=start) for u, start in zip(U, x0)])
    np.testing.assert_allclose(batch, single, rtol=0, atol=3e-6)  # substeps are chosen for the whole batch


@SOME
@given(seed=seeds, n=st.integers(4, 30), data=st.data())
def test_a_simulation_can_be_cut_and_resumed(seed, n, data):
    rng = np.random.default_rng(seed)
    U, x0 = rng.normal(size=(n, 1)), rng.normal(size=2)
    cut = data.draw(st.integers(1, n - 2))
    states, _ = PENDULUM.simulate_states(U, x0)
    rest, _ = PENDULUM.simulate_states(U[cut:], states[cut])
    np.testing.assert_allclose(rest, states[cut:], rtol=0, atol=3e-6)  # substeps are chosen for the whole run


EFFECTS = [effect for effect in build_effects(describe(PENDULUM), ("speed",)) if effect.parameters]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: "-".join(str(k) for k in e.key))
def test_an_effect_at_its_null_value_leaves_the_simulator_as_it_is(effect):
    rng = np.random.default_rng(0)
    U, x0 = np.repeat(rng.normal(size=(8, 1)), 5, axis=0), [0.3, -0.2]
    same = AugmentedSimulator(PENDULUM, [effect], [tuple(p.null for p in effect.parameters)])
    np.testing.assert_allclose(same.simulate(U, x0=x0), PENDULUM.simulate(U, x0=x0), rtol=1e-5, atol=1e-6)


def test_a_hybrid_with_nothing_to_add_is_the_simulator():
    X, y, groups = make_reactor_runs(4, 60, random_state=0)
    hybrid = HybridRegressor(make_reactor(), DummyRegressor(strategy="constant", constant=0.0)).fit(X, y, groups=groups)
    first = y[groups == 0]
    free = hybrid.predict(X[groups == 0], y0=first[: hybrid.n_initial_])
    np.testing.assert_allclose(free, make_reactor().simulate(X[groups == 0], x0=first[:1])[:, 0], atol=1e-4)


def heated(t, x, u, p):
    return [p["gain"] * u[0] - p["loss"] * x[0]]


def tank(gain, loss=1.0):
    return ODESimulator(
        heated, states=["T"], inputs=["power"], outputs=["T"], params={"gain": gain, "loss": loss}, dt=0.1, x0=[0.0]
    )


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_a_diagnosis_in_other_units_says_the_same(unit):
    """Output and input in other units, the gain with them: same verdict and name, offset in the new unit."""
    rng = np.random.default_rng(1)
    U = np.repeat(rng.uniform(0, 2, (6, 10, 1)), 10, axis=1)
    y = np.concatenate([tank(1.0).simulate(u, x0=[0.5])[:, 0] for u in U]) + 0.01 * rng.normal(size=600)
    y += 0.4 * np.abs(y) * y
    groups = np.repeat(np.arange(6), 100)
    names = ["quadratic_loss", "sensor_gain", "sensor_nonlinearity", "input_lag", "linear_loss"]
    reports = [
        GapDiagnoser(tank(1.0), effects=names, random_state=0).fit(s * U.reshape(-1, 1), s * y, groups=groups).report_
        for s in (1.0, unit)
    ]
    assert reports[0].verdict == reports[1].verdict
    assert [e.name for e in reports[0].effects] == [e.name for e in reports[1].effects]
    assert reports[1].shrink.before == pytest.approx(reports[0].shrink.before, rel=1e-3)
    assert reports[1].shrink.after == pytest.approx(reports[0].shrink.after, rel=0.05)


@pytest.mark.slow
def test_a_diagnosis_does_not_depend_on_the_labels_of_the_runs():
    X, y, groups = make_reactor_runs(4, 80, noise=0.02, random_state=0)
    names = ["parameter_error", "sensor_bias"]
    simulator = make_reactor(second=80.0)
    one = GapDiagnoser(simulator, effects=names, random_state=0).fit(X, y, groups=groups).report_
    other = (
        GapDiagnoser(simulator, effects=names, random_state=0).fit(X, y, groups=np.array(list("dbca"))[groups]).report_
    )
    assert printed(one) == printed(other).replace("run 'd'", "run 0")
