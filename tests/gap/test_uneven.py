"""Stamps that jitter by a fifth of a sample, gaps, clocks that are apart."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.exceptions import DataError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.kernels.record import Record
from sksurrogate.physics import CalibratedSimulator, ODESimulator, StepSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, SD = 0.2, 0.002
PARAMS = {"k": 2.0, "c": 0.3, "d": 0.0}
EFFECTS = ["linear_loss", "cubic_stiffness", "quadratic_drag", "input_gain", "constant_bias"]


def rhs(t, x, u, p):
    return x[1], u[0] - p["k"] * x[0] - p["c"] * x[1] - p["d"] * x[1] * np.abs(x[1])


def oscillator(**changed):
    names = {"states": ["q", "v"], "inputs": ["u"], "outputs": ["q", "v"]}
    return ODESimulator(rhs, **names, params={**PARAMS, **changed}, dt=DT)


class Trajectories:
    """The same seen from outside."""

    inputs, outputs, dt = ("u",), ("q", "v"), DT

    def simulate(self, U, x0=None, t=None):
        return oscillator().simulate(U)


def stamped(n, jitter, drag, seed=0):
    """Stamps, inputs that are held from stamp to stamp, readings: integrated from stamp to stamp in 40 steps."""
    rng = np.random.default_rng(seed)
    t = DT * (np.arange(n) + jitter * rng.uniform(-1, 1, n))
    u = np.repeat(rng.uniform(-2, 2, n // 10 + 1), 10)[:n]
    p, x, y = {**PARAMS, "d": drag}, np.zeros(2), np.zeros((n, 2))
    for k in range(n - 1):
        h = (t[k + 1] - t[k]) / 40
        for _ in range(40):
            middle = x + h / 2 * np.array(rhs(0.0, x, [u[k]], p))
            x = x + h * np.array(rhs(0.0, middle, [u[k]], p))
        y[k + 1] = x
    return t, u, y + SD * rng.normal(size=y.shape)


def test_a_right_hand_side_is_integrated_from_stamp_to_stamp():
    t, u, y = stamped(300, 0.2, 0.3)
    kept = np.delete(np.arange(300), np.arange(155, 163))  # a gap across which the input moves
    X = np.column_stack([u, 100.0 + t])
    diagnoser = GapDiagnoser(oscillator(), effects=EFFECTS, time=1, random_state=0, n_jobs=1).fit(X[kept], y[kept])
    report = diagnoser.report_
    (effect,) = report.effects
    low, high = effect.intervals["coefficient"]
    assert (report.verdict, effect.name) == ("explained", "quadratic_drag")
    assert low < 0.3 < high and high - low < 0.005
    assert report.shrink.after == pytest.approx(report.shrink.floor, rel=0.1)
    assert diagnoser.initial_states_.shape == (1, 2)


def test_a_step_function_is_compared_at_the_stamps():
    """Inputs switch on the simulator's grid here, readings come up to a fifth of a sample late or early."""
    fine = oscillator(d=0.3)
    fine = fine.set_params(dt=DT / 10)
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-2, 2, 30), 10)
    y = fine.simulate(np.repeat(u, 10)[:, None])
    late = np.r_[0, rng.integers(-2, 3, 299)]
    rows = 10 * np.arange(300) + late
    step = StepSimulator(_rk4, states=["q", "v"], inputs=["u"], outputs=["q", "v"], params=PARAMS, dt=DT)
    X = np.column_stack([u, DT / 10 * rows])
    noisy = y[rows] + 5 * SD * rng.normal(size=(300, 2))
    options = {"effects": EFFECTS, "random_state": 0, "n_jobs": 1}
    report = GapDiagnoser(step, time=1, **options).fit(X, noisy).report_
    assert [e.name for e in report.effects] == ["quadratic_drag"]
    assert report.effects[0].params["coefficient"] == pytest.approx(0.3, abs=0.02)


def _rk4(t, x, u, p, dt):
    for _ in range(4):
        h = dt / 4
        a = np.array(rhs(t, x, u, p))
        b = np.array(rhs(t, x + h / 2 * a, u, p))
        c = np.array(rhs(t, x + h / 2 * b, u, p))
        d = np.array(rhs(t, x + h * c, u, p))
        x = x + h / 6 * (a + 2 * b + 2 * c + d)
    return x


def test_calibration_and_prediction_at_stamps():
    t, u, y = stamped(300, 0.2, 0.3)
    X = np.column_stack([u, t])
    found = CalibratedSimulator(oscillator(d=0.1), ["d", "k"], time=1).fit(X, y)
    assert found.intervals_["d"][0] < 0.3 < found.intervals_["d"][1]
    np.testing.assert_allclose(found.noise_, SD, rtol=0.15)
    predicted = found.predict(X, x0=found.x0_)
    np.testing.assert_allclose(np.sqrt(np.mean((predicted - y) ** 2, axis=0)), SD, rtol=0.15)
    assert found.score(X, y) > 0.999


def test_a_sensor_whose_clock_is_ahead():
    plant = oscillator().set_params(dt=0.05)
    rng = np.random.default_rng(4)
    U = np.repeat(rng.uniform(-2, 2, 40), 10)[:, None]
    y = plant.simulate(U)
    ahead = 3
    y[:, 0] = np.r_[y[ahead:, 0], np.full(ahead, np.nan)]  # this sensor shows what is to come
    y += SD * rng.normal(size=y.shape)
    early = CATALOGUE["sensor_delay"]("q", earliest=-0.5)
    options = {"random_state": 0, "n_jobs": 1}
    report = GapDiagnoser(plant, effects=[early, "sensor_gain", "input_gain"], **options).fit(U, y).report_
    (effect,) = report.effects
    assert effect.name == "sensor_delay"
    assert effect.params["delay"] == pytest.approx(-0.05 * ahead, abs=0.002)
    assert CATALOGUE["sensor_delay"]("q").lower_bounds(1.0) == (0.0,)


@pytest.mark.parametrize("simulator", [oscillator(), Trajectories()], ids=["rhs", "simulate"])
def test_clocks_that_may_be_apart(simulator):
    """A sensor that is early is found where the user says that clocks may be apart."""
    rng, fine = np.random.default_rng(4), oscillator().set_params(dt=DT / 10)
    U = np.repeat(rng.uniform(-2, 2, 40), 50)[:, None]
    Y = fine.simulate(U)
    rows, ahead = np.arange(0, len(Y) - 10, 10), 7
    y = np.column_stack([Y[rows + ahead, 0], Y[rows, 1]]) + SD * rng.normal(size=(len(rows), 2))
    options = {"effects": ["sensor_delay", "sensor_gain", "input_gain"], "random_state": 0, "n_jobs": 1}
    (effect,) = GapDiagnoser(simulator, clock_offset=3 * DT, **options).fit(U[rows], y).report_.effects
    assert (effect.name, effect.location) == ("sensor_delay", "q")
    assert effect.params["delay"] == pytest.approx(-0.7 * DT, abs=0.05 * DT)
    late = GapDiagnoser(simulator, **options).fit(U[rows], y).report_.effects
    assert all(effect.params.get("delay", 0.0) >= 0.0 for effect in late)


@pytest.mark.parametrize("value", [-1.0, np.inf, True, "1"])
def test_an_offset_of_clocks_is_a_time(value):
    with pytest.raises(ValueError, match=r"clock_offset=.*: expected a time from 0 on.*write clock_offset=0.0"):
        GapDiagnoser(oscillator(), clock_offset=value).fit(np.zeros((20, 1)), np.zeros((20, 2)))


def test_a_frame_names_its_time_column():
    pandas = pytest.importorskip("pandas")
    t, u, y = stamped(120, 0.2, 0.3)
    X = pandas.DataFrame({"clock": t, "u": u})
    found = CalibratedSimulator(oscillator(d=0.1), ["d"], time="clock").fit(X, y)
    again = CalibratedSimulator(oscillator(d=0.1), ["d"], time=1).fit(np.column_stack([u, t]), y)
    assert found.params_ == again.params_
    with pytest.raises(DataError, match=r"time=.watch. is not a column of X"):
        CalibratedSimulator(oscillator(), ["d"], time="watch").fit(X, y)


def test_readings_that_come_later_show_what_the_plant_does_later():
    names = {"states": ["x"], "inputs": ["u"], "outputs": ["x"]}
    plant = ODESimulator(lambda t, x, u, p: (1.0 + 0.0 * x[0],), **names, params={}, dt=0.1)
    t, later = 0.1 * np.arange(20), np.random.default_rng(0).uniform(-0.04, 0.09, 20)
    later[0] = 0.0
    record = Record.from_runs([np.zeros((20, 1))], [np.zeros((20, 1))], [t], 0.1, offsets=[later])
    model = AugmentedModel(PlantModel(describe(plant)), (), (), record, n_sub=2, scale=np.ones(1))
    shown = model.bind(np.zeros((0, 1))).outputs(t[None, None])
    np.testing.assert_allclose(shown[0, 0], t + later, atol=1e-12)  # a ramp of slope one
