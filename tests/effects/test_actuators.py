"""Effects on inputs against closed forms, exact solutions and plain recursions."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sksurrogate.effects import CATALOGUE
from sksurrogate.kernels.signals import Signal, hold

ONE = np.array([0])


def act(name, u, value, n_sub=1, order=0, h=1.0, starts=ONE, other=None):
    """One effect on samples ``u`` (n,) -> a signal; arrays (n_sub, n_columns, n)."""
    theta = [np.reshape(np.atleast_1d(value), (-1, 1))]
    v = None if other is None else hold(other, n_sub, order, starts)
    return CATALOGUE[name]("u").transform(hold(u, n_sub, order, starts), v, theta, h, starts)


def levels(name, u, value, **kwargs):
    """Held input in, held input out: (n,)."""
    return act(name, u, value, **kwargs).mean[0, 0]


def moments(w, a, b, order=64):
    """Mean of ``w(t)`` over [a, b], and half the rise of the straight line with its first moment."""
    s, weight = np.polynomial.legendre.leggauss(order)
    values = w((a + b) / 2 + (b - a) / 2 * s)
    return weight @ values / 2, 1.5 * weight @ (values * s)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("input_gain", 0.5, [-3.0, -0.75, 0.0, 1.5, 4.5]),
        ("input_bias", 0.25, [-1.75, -0.25, 0.25, 1.25, 3.25]),
        ("input_curve", 0.1, [-2.4, -0.525, 0.0, 1.1, 3.9]),
        ("input_dead_zone", 0.75, [-1.25, 0.0, 0.0, 0.25, 2.25]),
        ("input_saturation", 1.5, [-1.5, -0.5, 0.0, 1.0, 1.5]),
        ("input_quantization", 0.8, [-1.6, -0.8, 0.0, 0.8, 3.2]),
    ],
)
def test_static_characteristics(name, value, expected):
    u = np.array([-2.0, -0.5, 0.0, 1.0, 3.0])
    np.testing.assert_allclose(levels(name, u, value), expected, atol=1e-15)


def test_coupling_adds_the_other_input():
    u, v = np.array([1.0, 2.0]), np.array([10.0, -10.0])
    np.testing.assert_allclose(levels("input_coupling", u, 0.2, other=v), [3.0, 0.0])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31), half_width=st.floats(0, 2.5))
def test_play_is_the_plain_recursion(seed, half_width):
    u = np.random.default_rng(seed).normal(size=40)
    starts = np.array([0, 17])
    w = u.copy()
    for k in range(1, len(u)):
        if k not in starts:
            w[k] = np.clip(w[k - 1], u[k] - half_width, u[k] + half_width)
    np.testing.assert_allclose(levels("input_backlash", u, half_width, starts=starts), w, atol=1e-12)


def test_rate_limit_on_a_step_is_a_ramp():
    u = np.array([0.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    signal = act("rate_limit", u, 0.4, n_sub=2, h=0.5)
    ramp = lambda t: np.clip(0.4 * (t - 1), 0, 1)  # noqa: E731
    for k in range(len(u)):
        for s in range(2):
            begin, end = k + s / 2, k + (s + 1) / 2
            pieces = np.unique(np.clip([begin, 3.5, end], begin, end))  # the kink at 3.5 splits Gauss's rule
            mean = sum(moments(ramp, a, b)[0] * (b - a) for a, b in pairwise(pieces)) / (end - begin)
            assert signal.mean[s, 0, k] == pytest.approx(mean, abs=1e-14)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31), limit=st.floats(0.05, 3.0))
def test_rate_limit_is_never_faster_and_runs_start_at_their_first_value(seed, limit):
    u = np.random.default_rng(seed).normal(size=30)
    starts = np.array([0, 11])
    signal = act("rate_limit", u, limit, n_sub=3, h=0.1, starts=starts)
    w = signal.mean[:, 0].T.ravel()
    jumps = np.delete(np.abs(np.diff(w)), 11 * 3 - 1)
    assert np.all(jumps <= limit * 0.1 * (1 + 1e-9))
    np.testing.assert_allclose(w[[0, 33]], u[starts], atol=1e-15)


def test_a_rate_limit_that_is_never_reached_leaves_a_linear_input_alone():
    u = np.sin(np.linspace(0, 3, 30))
    signal, given_signal = act("rate_limit", u, 50.0, n_sub=4, order=1, h=0.25), hold(u, 4, 1, ONE)
    np.testing.assert_allclose(signal.mean, given_signal.mean, atol=1e-12)
    np.testing.assert_allclose(signal.half, given_signal.half, atol=1e-12)


@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize("delay", [0.0, 0.25, 0.5, 1.0, 1.37, 3.0, 3.9, 50.0])
def test_delay_has_the_exact_mean_and_moment_of_every_substep(delay, order):
    u, n_sub = np.random.default_rng(0).normal(size=8), 2
    signal = act("input_delay", u, delay, n_sub=n_sub, order=order, h=0.5)
    t = np.arange(len(u))

    def w(now):
        past = np.maximum(now - delay, 0.0)
        return np.interp(past, t, u) if order else u[np.minimum(past.astype(int), len(u) - 1)]

    for k in range(len(u) - 1):
        for s in range(n_sub):
            begin, end = k + s / n_sub, k + (s + 1) / n_sub
            cuts = np.r_[begin, np.sort([c for c in np.arange(-60, 60) + delay if begin < c < end]), end]
            found = [(moments(w, a, b), a, b) for a, b in pairwise(cuts)]
            mean = sum(m * (b - a) for (m, _), a, b in found) / (end - begin)
            centre = (begin + end) / 2
            # first moment about the centre of the substep, put together from those of the pieces
            first = sum(m * (b - a) * ((a + b) / 2 - centre) + r * (b - a) ** 2 / 6 for (m, r), a, b in found)
            assert signal.mean[s, 0, k] == pytest.approx(mean, abs=1e-12)
            assert signal.half[s, 0, k] == pytest.approx(6 * first / (end - begin) ** 2, abs=1e-12)


@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize("constant", [1e-6, 0.03, 0.7, 5.0, 400.0])
def test_lag_has_the_exact_mean_and_moment_of_every_substep(constant, order):
    u, n_sub, h = np.random.default_rng(0).normal(size=6), 2, 0.5
    signal = act("input_lag", u, constant, n_sub=n_sub, order=order, h=h)
    w = u[0]
    for k in range(len(u)):
        rise = (u[min(k + 1, len(u) - 1)] - u[k]) if order else 0.0
        for s in range(n_sub):
            start, slope = u[k] + rise * s * h, rise

            def exact(t, w=w, start=start, slope=slope):  # particular solution and what is left of the difference
                ramp = start + slope * (t - constant)
                return ramp + (w - start + slope * constant) * np.exp(-t / constant)

            if constant > 0.01:  # Gauss's rule sees shorter transients no more
                mean, half = moments(exact, 0.0, h)
                assert signal.mean[s, 0, k] == pytest.approx(mean, abs=1e-11)
                assert signal.half[s, 0, k] == pytest.approx(half, abs=1e-9)
            else:
                assert signal.mean[s, 0, k] == pytest.approx(start + slope * h / 2, abs=1e-5)
            w = exact(h)


@pytest.mark.parametrize("name", ["input_delay", "input_lag"])
def test_delay_and_lag_are_smooth_in_their_size(name):
    """A Gauss-Newton step needs a derivative at 0 and across multiples of the sample time."""
    u = np.random.default_rng(0).normal(size=20)
    sizes = np.linspace(0, 2.5, 501)
    mean = act(name, u, sizes, n_sub=2, h=0.5).mean
    first = np.diff(mean, axis=1)
    assert np.max(np.abs(first)) < 12 * (sizes[1] - sizes[0]) * np.max(np.abs(np.diff(u)))
    assert np.max(np.abs(first[:, 0, 1:-1])) > 1e-3


def test_effects_on_one_input_act_in_the_order_of_the_table(make_oscillator):
    """Bias before dead zone before saturation before delay, however they are listed."""
    from sksurrogate.effects import AugmentedSimulator

    plant, u = make_oscillator(), 2 * np.random.default_rng(3).normal(size=(60, 1))
    effects = [CATALOGUE[name]("u") for name in ("input_delay", "input_saturation", "input_dead_zone", "input_bias")]
    wide = AugmentedSimulator(plant, effects, [(0.04,), (1.0,), (0.5,), (0.3,)])
    w = u + 0.3
    w = np.sign(w) * np.maximum(np.abs(w) - 0.5, 0)
    w = np.clip(w, -1, 1)
    w = np.r_[w[:1], w[:1], w[:-2]]
    np.testing.assert_allclose(wide.simulate(u), plant.simulate(w), atol=1e-9)


def test_signals_are_not_written():
    u = hold(np.random.default_rng(0).normal(size=10), 2, 1, ONE)
    kept = Signal(u.mean.copy(), u.half.copy())
    for name, cls in CATALOGUE.items():
        if cls.kind == "input":
            cls("u").transform(u, u, [np.array([[0.3]])] * len(cls.parameters), 0.5, ONE)
            assert np.array_equal(u.mean, kept.mean) and np.array_equal(u.half, kept.half), name


@pytest.mark.parametrize("n_sub", [1, 3])
@pytest.mark.parametrize("starts", [ONE, np.array([0, 17])])
@pytest.mark.parametrize(
    "name, value", [("input_delay", 0.3), ("input_delay", 2.0), ("input_lag", 0.6), ("rate_limit", 0.8)]
)
def test_what_an_output_shows_at_a_sample_is_exact(name, value, n_sub, starts):
    """A held input: whatever the substeps keep of it, outputs that show it see the actuator as it stands at the sample."""
    u, expected = np.random.default_rng(2).normal(size=40), np.zeros(40)
    for a, b in pairwise([*starts, 40]):
        w = u[a]
        for k in range(a, b):
            expected[k] = u[max(k - int(np.ceil(value)), a)] if name == "input_delay" else w
            w += (u[k] - w) * -np.expm1(-1 / value) if name == "input_lag" else np.clip(u[k] - w, -value, value)
    found = act(name, u, value, n_sub=n_sub, h=1 / n_sub, starts=starts)
    np.testing.assert_allclose(found.at_samples()[0], expected, atol=1e-12)


@pytest.mark.parametrize("n_sub", [1, 3])
@pytest.mark.parametrize(
    ("name", "value"), [("input_backlash", 0.4), ("rate_limit", 0.15), ("input_delay", 2.6), ("input_lag", 3.0)]
)
def test_an_actuator_at_rest_before_a_run_is_the_end_of_a_longer_run(name, value, n_sub):
    rest, ahead = 0.7, 100
    runs = np.random.default_rng(3).normal(size=(2, 30))
    long = np.concatenate([np.r_[np.full(ahead, rest), run] for run in runs])
    theta, starts = [np.array([[value]])], np.array([0, 30])
    short = CATALOGUE[name]("u", before=rest).transform(
        hold(np.concatenate(runs), n_sub, 0, starts), None, theta, 0.5, starts
    )
    whole = act(name, long, value, n_sub, h=0.5, starts=np.array([0, ahead + 30]))
    kept = np.r_[ahead : ahead + 30, 2 * ahead + 30 : 2 * ahead + 60]
    np.testing.assert_allclose(short.mean, whole.mean[..., kept], atol=1e-12)
    np.testing.assert_allclose(short.at_samples(), whole.at_samples()[..., kept], atol=1e-12)
