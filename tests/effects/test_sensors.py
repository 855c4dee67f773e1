"""Effects on outputs: closed forms, exact solutions of lag and delay between the samples, orders of convergence."""

import numpy as np
import pytest
from scipy.integrate import quad

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, Probe, SensorPath
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.effects._sensor import EXCESS, ceiling, lag_moments
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel

ONE = np.array([0])


def path_of(y, slope, n, dt):
    """A smooth output (functions of time) at n samples."""
    t = dt * np.arange(n)
    return SensorPath(y(t)[None], slope(t)[None], slope(t)[None])


def follow(name, path, value, dt, starts=ONE):
    return CATALOGUE[name]("y").follow(path, [np.reshape(np.atleast_1d(value), (-1, 1))], dt, starts)


@pytest.mark.parametrize(
    ("name", "theta", "expected"),
    [
        ("sensor_coupling", (2.0,), [-1.0, 2.0, 7.0]),
        ("sensor_nonlinearity", (0.5,), [-0.5, 0.0, 4.0]),
        ("sensor_gain", (0.5,), [-1.5, 0.0, 3.0]),
        ("sensor_bias", (0.5,), [-0.5, 0.5, 2.5]),
        ("sensor_drift", (0.1,), [-1.0, 0.1, 2.2]),
        ("sensor_rectification", (), [1.0, 0.0, 2.0]),
        ("sensor_saturation", (1.5,), [-1.0, 0.0, 1.5]),
        ("sensor_quantization", (0.6,), [-1.2, 0.0, 1.8]),
    ],
)
def test_static_readings(name, theta, expected):
    y, v, t = np.array([-1.0, 0.0, 2.0]), np.array([0.0, 1.0, 2.5]), np.array([0.0, 1.0, 2.0])
    np.testing.assert_allclose(CATALOGUE[name]("y", "v").read(y, v, t, theta), expected, atol=1e-15)


@pytest.mark.parametrize("ratio", [0.0, 1e-6, 0.02, 0.4, 0.5, 0.6, 3.0, 1e4])
def test_moments_of_a_lag_are_the_integrals(ratio):
    moments, decay, rate = lag_moments(np.array([[ratio]]))
    if ratio <= 1e-6:
        np.testing.assert_allclose(moments.ravel(), 1 - ratio * np.arange(4), atol=1e-11)
        assert decay == 0 and rate == 0
        return
    for j in range(4):
        value, _ = quad(
            lambda s, j=j: np.exp(-(1 - s) / ratio) / ratio * s**j, 0, 1, points=[1 - ratio, 1 - 10 * ratio]
        )
        assert moments[j, 0, 0] == pytest.approx(value, rel=1e-9, abs=1e-12)


def lagged_cubic(c, a, w0):
    """Exact answer of ``c w' + w = a0 + a1 t + a2 t^2 + a3 t^3`` from ``w0``."""
    b3 = a[3]
    b2 = a[2] - 3 * c * b3
    b1 = a[1] - 2 * c * b2
    b0 = a[0] - c * b1
    return lambda t: b0 + b1 * t + b2 * t**2 + b3 * t**3 + (w0 - b0) * np.exp(-t / c)


@pytest.mark.parametrize("constant", [0.003, 0.05, 0.3, 2.0])
def test_lag_of_a_cubic_is_exact(constant):
    a, n, dt = (0.5, -1.0, 2.0, -0.7), 25, 0.1
    y = lambda t: a[0] + a[1] * t + a[2] * t**2 + a[3] * t**3  # noqa: E731
    slope = lambda t: a[1] + 2 * a[2] * t + 3 * a[3] * t**2  # noqa: E731
    w = lagged_cubic(constant, a, y(0.0))
    found = follow("sensor_lag", path_of(y, slope, n, dt), constant, dt)
    t = dt * np.arange(n)
    np.testing.assert_allclose(found.y[0], w(t), rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(found.left[0, 1:], (y(t) - w(t))[1:] / constant, rtol=1e-7, atol=1e-8)


def sine_lagged(t, w, c):
    """``c z' + z = sin(w t + 1)`` from z(0) = sin(1)."""
    gain, phase = 1 / np.hypot(1, c * w), np.arctan(c * w)
    steady = lambda now: gain * np.sin(w * now + 1 - phase)  # noqa: E731
    return steady(t) + (np.sin(1) - steady(0.0)) * np.exp(-t / c)


@pytest.mark.parametrize("name", ["sensor_lag", "sensor_delay"])
def test_a_sine_is_followed_to_fourth_order(name):
    w, c, errors = 2.0, 0.33, []
    for n in (40, 80, 160):
        dt = 4.0 / n
        t = dt * np.arange(n)
        found = follow(name, path_of(lambda s: np.sin(w * s + 1), lambda s: w * np.cos(w * s + 1), n, dt), c, dt).y[0]
        exact = sine_lagged(t, w, c) if name == "sensor_lag" else np.sin(w * np.maximum(t - c, 0) + 1)
        errors.append(np.max(np.abs(found - exact)))
    assert np.log2(errors[0] / errors[2]) / 2 > 3.9 and errors[2] < 1e-7


@pytest.mark.parametrize("name", ["sensor_lag", "sensor_delay"])
def test_nothing_is_changed_at_zero_and_little_near_it(name):
    random = np.random.default_rng(0)
    path = SensorPath(random.normal(size=(1, 20)), random.normal(size=(1, 20)), random.normal(size=(1, 20)))
    for starts in (ONE, np.array([0, 9])):
        still = follow(name, path, 0.0, 0.1, starts)
        np.testing.assert_allclose(still.y, path.y, rtol=1e-13, atol=1e-13)
        inner = np.setdiff1d(np.arange(20), starts)
        c = 1e-7
        moved = follow(name, path, c, 0.1, starts).y
        np.testing.assert_allclose(
            ((moved - path.y) / c)[0, inner], -path.left[0, inner], atol=2e-5 * np.ptp(path.y) / 0.1
        )
        np.testing.assert_allclose(moved[:, starts], path.y[:, starts], atol=1e-13)


def test_delay_by_whole_samples_shifts_rows_and_slopes():
    random = np.random.default_rng(0)
    path = SensorPath(*random.normal(size=(3, 1, 12)))
    starts = np.array([0, 5])
    found = follow("sensor_delay", path, 0.2, 0.1, starts)
    rows = np.array([0, 0, 0, 1, 2, 5, 5, 5, 6, 7, 8, 9])
    np.testing.assert_allclose(found.y[0], path.y[0, rows], atol=1e-12)
    np.testing.assert_allclose(found.right[0, [2, 3, 8]], path.right[0, [0, 1, 6]], atol=1e-9)
    np.testing.assert_allclose(found.left[0, [3, 4, 9]], path.left[0, [1, 2, 7]], atol=1e-9)


def test_a_delay_longer_than_the_run_shows_the_first_value():
    path = SensorPath(*np.random.default_rng(0).normal(size=(3, 1, 8)))
    np.testing.assert_allclose(
        follow("sensor_delay", path, 1e6, 0.1, np.array([0, 3])).y[0], path.y[0, [0, 0, 0, 3, 3, 3, 3, 3]]
    )


def test_lag_then_delay_of_a_sine():
    """What a lag hands on must be a path again: values, slopes, means."""
    w, c, late, errors = 2.0, 0.2, 0.13, []
    for n in (40, 80, 160):
        dt = 4.0 / n
        path = path_of(lambda s: np.sin(w * s + 1), lambda s: w * np.cos(w * s + 1), n, dt)
        found = follow("sensor_delay", follow("sensor_lag", path, c, dt), late, dt).y[0]
        t = dt * np.arange(n)
        exact = sine_lagged(np.maximum(t - late, 0), w, c)
        errors.append(np.max(np.abs(found - exact)))
    assert errors[0] / errors[2] > 60 and errors[2] < 5e-6  # the start, where the lag's slope jumps, costs an order


def test_columns_abreast_and_one_path_for_many_columns():
    path = SensorPath(*np.random.default_rng(0).normal(size=(3, 1, 15)))
    for name in ("sensor_lag", "sensor_delay"):
        sizes = np.array([0.0, 0.01, 0.1, 0.25])
        together = follow(name, path, sizes, 0.1)
        for k, size in enumerate(sizes):
            alone = follow(name, path, size, 0.1)
            for part in ("y", "right", "left"):
                np.testing.assert_allclose(getattr(together, part)[k], getattr(alone, part)[0], rtol=1e-12, atol=1e-12)


def test_sensors_act_in_the_order_of_the_table_and_coupling_reads_the_plain_output(make_tanks):
    from sksurrogate.effects import AugmentedSimulator

    plant, U = make_tanks(), np.abs(np.random.default_rng(0).normal(size=(40, 2)))
    names = ("sensor_quantization", "sensor_saturation", "sensor_bias", "sensor_gain", "sensor_nonlinearity")
    effects = [CATALOGUE[name]("level") for name in names] + [CATALOGUE["sensor_coupling"]("level", "scale")]
    effects += [CATALOGUE["sensor_gain"]("scale")]
    values = [(0.1,), (2.0,), (0.2,), (0.3,), (0.05,), (0.1,), (9.0,)]
    y, s = plant.simulate(U).T
    expected = y + 0.1 * s
    expected = expected + 0.05 * expected**2
    expected = np.minimum(1.3 * expected + 0.2, 2.0)
    found = AugmentedSimulator(plant, effects, values).simulate(U)
    np.testing.assert_allclose(found[:, 1], 10 * s, atol=1e-7)
    rounded = 0.1 * np.round(expected / 0.1)
    assert np.mean(np.abs(found[:, 0] - rounded) < 1e-7) > 0.95  # a value on the edge of a step may round either way


def test_a_soft_staircase_is_continuous_and_differs_on_its_flanks_only():
    effect, y, t = CATALOGUE["sensor_quantization"]("q"), np.linspace(-2, 2, 40001), None
    sharp, soft = effect.read(y, None, t, (0.6,)), effect.soft(y[None], None, t, (0.6,), 0.02)[0]
    assert np.max(np.abs(np.diff(soft))) < 51 * (y[1] - y[0])
    flank = np.abs(y / 0.6 - np.floor(y / 0.6) - 0.5) <= 0.0101
    np.testing.assert_allclose(soft[~flank], sharp[~flank], atol=1e-12)
    assert 0.015 < np.mean(flank) < 0.025 and np.max(np.abs(soft - sharp)) <= 0.3 + 1e-9
    np.testing.assert_array_equal(effect.soft(y[None], None, t, (0.0,), 0.02), y[None])


def test_a_difference_of_columns_sees_the_slope_of_many_steps_not_that_of_a_flank():
    effect, y = CATALOGUE["sensor_quantization"]("q"), np.linspace(-2, 2, 4001)
    columns = np.stack([y, y + 1e-6, y - 1e-4])
    soft = effect.soft(columns, None, None, (np.full((3, 1), 0.6),), 0.02)
    np.testing.assert_allclose(soft - soft[:1], columns - y, rtol=0, atol=1e-12)
    far = effect.soft(np.stack([y, y + 0.3]), None, None, (np.full((2, 1), 0.6),), 0.02)
    np.testing.assert_allclose(far[1], effect.soft(y[None] + 0.3, None, None, (0.6,), 0.02)[0], atol=1e-12)


def test_a_simulator_reads_whole_steps(oscillator, force):
    from sksurrogate.effects import AugmentedSimulator

    y = AugmentedSimulator(oscillator, [CATALOGUE["sensor_quantization"]("q")], [(0.05,)]).simulate(force)
    np.testing.assert_allclose(y / 0.05, np.round(y / 0.05), atol=1e-9)


def test_readings_that_show_their_steps_are_interval_censored():
    """Within its interval a value is not an error, outside it is a share of the way back, never a whole step."""
    effect, step = CATALOGUE["sensor_quantization"]("q"), 0.5
    true = np.linspace(-2.0, 2.0, 2001)
    readings = step * np.round(true / step)
    fits = effect.soft(true[None], None, None, (np.array([[step]]),), 0.02, readings)
    np.testing.assert_allclose(fits[0], readings, atol=0.02 * step)
    beyond = effect.soft(true[None] + 0.06, None, None, (np.array([[step]]),), 0.02, readings)[0] - readings
    excess = np.maximum(true + 0.06 - readings - step / 2, 0.0)
    np.testing.assert_allclose(beyond, EXCESS * excess, atol=0.02 * step)
    assert excess.max() > 0.05


def test_readings_without_steps_are_fitted_by_the_staircase():
    effect, y = CATALOGUE["sensor_quantization"]("q"), np.linspace(-2, 2, 4001)
    noisy = y + 0.3 * np.random.default_rng(0).normal(size=y.shape)
    given = (y[None], None, None, (np.array([[0.6]]),), 0.02)
    np.testing.assert_array_equal(effect.soft(*given, noisy), effect.soft(*given))


@pytest.mark.parametrize("limit", [0.2, 0.7, 0.95])
def test_readings_that_end_show_where(limit):
    rng = np.random.default_rng(2)
    noise = 0.01
    x = np.minimum(np.sin(0.05 * np.arange(800)), limit) + noise * rng.normal(size=800)
    assert ceiling(x, noise) == pytest.approx(limit, abs=noise)
    ((found,),) = CATALOGUE["sensor_saturation"]("y").evident(Probe(None, x, 0.0, 0.1, 80.0, ONE, (), noise))
    assert found == ceiling(x, noise)


def test_no_end_is_seen_of_a_sine_a_ramp_or_noise():
    rng = np.random.default_rng(2)
    e = 0.01 * rng.normal(size=800)
    for x in (np.sin(0.05 * np.arange(800)), np.linspace(-1.0, 1.0, 800), np.zeros(800), np.arange(800) % 40 / 40.0):
        assert ceiling(x + e, 0.01) is None
    assert ceiling(e, 0.0) is None


@pytest.mark.parametrize("name", ["sensor_lag", "sensor_delay"])
@pytest.mark.parametrize("value", [0.03, 0.1, 0.25, 0.37])
def test_an_output_that_shows_an_input_jumps_with_it(name, value):
    """``dx/dt = u - x``, ``y = x + 2 u`` with u held: the reading in closed form from sample to sample."""
    dt, n = 0.1, 12
    u = np.random.default_rng(3).normal(size=n)
    plant = ODESimulator(
        lambda t, x, u, p: (u[0] - x[0],), states=["x"], inputs=["u"], outputs=["y"], params={}, dt=dt, x0=[0.4],
        output=lambda t, x, u, p: (x[0] + 2 * u[0],),
    )  # fmt: skip
    found = AugmentedSimulator(plant, [CATALOGUE[name]("y")], [(value,)]).simulate(u[:, None])[:, 0]
    x = [0.4]
    for k in range(n - 1):
        x.append(u[k] + (x[k] - u[k]) * np.exp(-dt))

    def output(t):
        k = int(np.floor(t / dt + 1e-9))
        return u[k] + (x[k] - u[k]) * np.exp(-(t - k * dt)) + 2 * u[k]

    if name == "sensor_delay":
        expected = [output(max(dt * k - value, 0.0)) for k in range(n)]
    else:  # c dw/dt + w = 3 u + (x - u) exp(-t) over every sample
        expected, share = [output(0.0)], np.exp(-dt / value)
        for k in range(n - 1):
            forced = (x[k] - u[k]) * (np.exp(-dt) - share) / (1.0 - value)
            expected.append(share * expected[k] + 3 * u[k] * (1.0 - share) + forced)
    np.testing.assert_allclose(found, expected, atol=2e-6)


def test_a_jump_of_a_reading_is_spread_over_one_part_in_the_sharpness():
    from sksurrogate.effects._readings import read_sensors
    from sksurrogate.physics._simulator import describe

    given = []

    class Seen(CATALOGUE["sensor_quantization"]):
        def soft(self, y, v, t, theta, width, readings=None):
            given.append(width)
            return y

    plant = ODESimulator(lambda t, x, u, p: [u[0]], states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1)
    record = Record.from_runs([np.ones((6, 1))], [np.ones((6, 1))], [0.1 * np.arange(6)], 0.1)
    augmented = AugmentedModel(
        PlantModel(describe(plant)), [Seen("x")], [], record, n_sub=1, scale=np.ones(1), sharpness=20.0
    )
    bound = augmented.bind(np.full((1, 1), 0.5))
    x = np.zeros((1, 1, 6))
    read_sensors(bound, x, x, [(augmented.effects[0], [np.full((1, 1), 0.5)])], sharp=False)
    assert given == [0.05]
