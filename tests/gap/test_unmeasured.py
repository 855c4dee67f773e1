"""Readings that were not measured: dropouts, sensors at two rates, an output that fails for a run."""

import numpy as np
import pytest

from sksurrogate.exceptions import DataError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.decide._held_out import HeldOut, measure
from sksurrogate.kernels.record import Record
from sksurrogate.physics import CalibratedSimulator, CallableSimulator, ODESimulator

EFFECTS = ["linear_loss", "cubic_stiffness", "quadratic_drag", "coulomb_friction", "input_gain"]
FRICTION, SD = 0.25, np.array([0.01, 0.02])


def oscillator(friction=0.0):
    def rhs(t, x, u, p):
        q, v = x
        return v, u[0] - p["k"] * q - p["c"] * v - p["f"] * v

    params = {"k": 2.0, "c": 0.3, "f": friction}
    return ODESimulator(rhs, states=["q", "v"], inputs=["u"], outputs=["q", "v"], params=params, dt=0.05)


@pytest.fixture(scope="module")
def measured():
    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(-2, 2, 50), 10)[:, None]
    groups = np.repeat([0, 1], 250)
    Y = np.vstack([oscillator(FRICTION).simulate(U[groups == k]) for k in (0, 1)])
    return U, Y + SD * rng.normal(size=Y.shape), groups


def dropouts(Y):
    return np.random.default_rng(1).random(Y.shape) > 0.2


def two_rates(Y):
    return np.stack([np.arange(len(Y)) % 5 == 0, np.ones(len(Y), bool)], axis=1)


def failed(Y):
    return np.stack([np.ones(len(Y), bool), np.arange(len(Y)) < len(Y) // 2], axis=1)


@pytest.mark.parametrize("seen", [dropouts, two_rates, failed])
def test_the_effect_is_named_and_the_interval_holds_it(measured, seen):
    U, Y, groups = measured
    known = seen(Y)
    diagnoser = GapDiagnoser(oscillator(), effects=EFFECTS, random_state=0, n_jobs=1)
    report = diagnoser.fit(U, np.where(known, Y, np.nan), groups=groups).report_
    (effect,) = report.effects
    low, high = effect.intervals["coefficient"]
    assert (report.verdict, (effect.name, effect.location, effect.variable)) == ("explained", ("linear_loss", "v", "v"))
    assert low < FRICTION < high and high - low < 0.02
    assert report.shrink.after == pytest.approx(report.shrink.floor, rel=0.05)
    np.testing.assert_array_equal(np.isnan(report.traces[0].measured), ~known[: len(report.traces[0].t)])
    assert "nan" not in report._repr_html_().lower()
    assert "NaN" not in report.to_json()


def test_what_stands_where_nothing_was_measured_does_not_matter(measured):
    """The answer is the same to rounding with the rows in which nothing is measured bridged or cut off at the end."""
    U, Y, groups = measured
    short = np.r_[np.arange(230), np.arange(250, 500)]  # the first run ends after 230 rows
    nan = Y.copy()
    nan[230:250] = np.nan
    values = []
    for rows, y in ((np.arange(500), nan), (short, Y)):
        calibrated = CalibratedSimulator(oscillator(0.2), ["f", "k"]).fit(U[rows], y[rows], groups=groups[rows])
        values.append(
            [*calibrated.params_.values(), *np.ravel(list(calibrated.intervals_.values())), *calibrated.noise_]
        )
    np.testing.assert_allclose(*values, rtol=1e-4)


def test_through_simulate_alone(measured):
    U, _, groups = measured
    plant = oscillator()
    only = CallableSimulator(lambda U, x0=None, t=None: plant.simulate(U), inputs=["u"], outputs=["q", "v"], dt=0.05)
    y = np.vstack([plant.simulate(U[groups == k]) for k in (0, 1)]) * [1.0, 1.1]
    y = np.where(dropouts(y), y + SD * np.random.default_rng(2).normal(size=y.shape), np.nan)
    effects = ["sensor_gain", "sensor_bias", "sensor_drift", "input_gain"]
    report = GapDiagnoser(only, effects=effects, random_state=0, n_jobs=1).fit(U, y, groups=groups).report_
    assert [(e.name, e.location) for e in report.effects] == [("sensor_gain", "v")]
    assert report.effects[0].params["relative_error"] == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize("seen", [dropouts, two_rates])
def test_calibration_has_honest_intervals(measured, seen):
    U, Y, groups = measured
    y = np.where(seen(Y), Y, np.nan)
    found = CalibratedSimulator(oscillator(0.2), ["f", "k"]).fit(U, y, groups=groups)
    for name, true in (("f", FRICTION), ("k", 2.0)):
        low, high = found.intervals_[name]
        assert low - 0.2 * (high - low) < true < high + 0.2 * (high - low)
    np.testing.assert_allclose(found.noise_, SD, rtol=0.15)
    assert found.score(U, y, groups=groups) > 0.99


def test_held_out_errors_count_measured_values_alone():
    nan, rng = np.nan, np.random.default_rng(0)
    Y = rng.normal(size=(60, 1))
    Y[10:20], Y[50:] = nan, nan
    runs = [np.zeros((20, 1))] * 3
    record = Record.from_runs(runs, np.split(Y, 3), [np.arange(20.0)] * 3, 1.0)
    before = record.y - 2.0 - 100.0 * ~record.known
    after = record.y - 1.0 + 100.0 * ~record.known
    shrink = measure(HeldOut(record, before, after, after, after), np.zeros(1), ("y",), 0)
    spread = np.nanstd(Y)
    assert shrink.before == pytest.approx(2.0 / spread) and shrink.after == pytest.approx(1.0 / spread)
    assert shrink.fraction == pytest.approx(0.5) and shrink.interval == pytest.approx((0.5, 0.5))


def test_inputs_must_be_known(measured):
    U, Y, groups = measured
    bad = U.copy()
    bad[270] = np.nan
    with pytest.raises(DataError, match=r"X contains NaN: row 270, column 0 \(run 1\).*Interpolator"):
        GapDiagnoser(oscillator()).fit(bad, Y, groups=groups)
    with pytest.raises(DataError, match=r"no measured value in column 1.*Leave this output out"):
        GapDiagnoser(oscillator()).fit(U, np.where([True, False], Y, np.nan), groups=groups)
    with pytest.raises(DataError, match=r"run 1 holds no measured value.*label its rows -1"):
        GapDiagnoser(oscillator()).fit(U, np.where(groups[:, None] == 0, Y, np.nan), groups=groups)
