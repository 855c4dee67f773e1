"""A drift goes on, or levels off as what warms up does: of a sensor, of a force, of a parameter; fitted, carried, said, stored."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.render._code import code_of
from sksurrogate.physics import BaseSimulator, ODESimulator

DT, N, RUNS, TAU, SLOWER = 0.1, 300, 3, 8.0, 4.0
NAMES = {"states": ["h", "q"], "inputs": ["u"], "outputs": ["h", "q"], "params": {"b": 0.8}, "dt": DT, "x0": [0.0, 0.0]}


def _rhs(t, x, u, p):
    return x[1] - 0.3 * x[0], u[0] - p["b"] * x[1]


TANKS = ODESimulator(_rhs, **NAMES)
#: name -> place, and what the rate at the start is.
PLANTED = {"sensor_drift": ("q", 0.15), "drift": ("q", 0.05), "parameter_drift": ("b", -0.06)}


@pytest.mark.parametrize("name", PLANTED)
def test_it_begins_with_its_rate_and_ends_at_rate_times_time_constant(name):
    effect = CATALOGUE[name](PLANTED[name][0], levelling=1.0 / TAU)
    t = np.array([0.0, 1e-6, 1e3])
    assert effect.elapsed(t) == pytest.approx([0.0, 1e-6, TAU], rel=1e-6)
    assert type(effect)(PLANTED[name][0]).elapsed(7.5) == 7.5
    assert type(effect)(PLANTED[name][0], levelling=1e-9).elapsed(7.5) == pytest.approx(7.5, rel=1e-6)


def recorded(name, levels):
    """Runs of Runge-Kutta's method in twenty steps a sample."""
    rng, (_, rate), h = np.random.default_rng(0), PLANTED[name], DT / 20
    gone = (lambda t: TAU * (1.0 - np.exp(-t / TAU))) if levels else (lambda t: t / SLOWER)

    def f(t, x, u):
        b = 0.8 * (1.0 + rate * gone(t)) if name == "parameter_drift" else 0.8
        return np.array([x[1] - 0.3 * x[0], u - b * x[1] + (rate * gone(t) if name == "drift" else 0.0)])

    U = np.repeat(rng.uniform(-1.0, 2.0, (RUNS, N // 15)), 15, axis=1)
    Y = np.zeros((RUNS, N, 2))
    for y, u in zip(Y, U):
        x = np.zeros(2)
        for k in range(N):
            y[k] = x
            for t in k * DT + h * np.arange(20):
                k1 = f(t, x, u[k])
                k2 = f(t + h / 2, x + h / 2 * k1, u[k])
                k3 = f(t + h / 2, x + h / 2 * k2, u[k])
                x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(t + h, x + h * k3, u[k]))
    Y[:, :, 1] += rate * gone(DT * np.arange(N)) if name == "sensor_drift" else 0.0
    return U.reshape(-1, 1), Y.reshape(-1, 2) + 0.01 * rng.standard_normal((RUNS * N, 2)), np.repeat(range(RUNS), N)


def diagnosed(simulator, name, levels, **settings):
    X, y, groups = recorded(name, levels)
    return GapDiagnoser(simulator, n_jobs=1, random_state=0, **settings).fit(X, y, groups=groups)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTED)
def test_one_that_levels_off_is_named_with_its_time_constant_and_rate(name, tmp_path):
    diagnoser, (place, rate) = diagnosed(TANKS, name, True), PLANTED[name]
    report = diagnoser.report_
    (effect,) = report.effects
    assert (report.verdict, effect.name, effect.location) == ("explained", name, place)
    assert 1.0 / effect.levelling == pytest.approx(TAU, rel=0.1)
    assert effect.params["rate"] == pytest.approx(rate, rel=0.1)
    assert "levelling off with a time constant of" in " ".join(str(report).split()) and "levelling=" in code_of(report)
    run = np.ones((80, 1))
    carried = diagnoser.augmented_.simulate(run)
    expected = AugmentedSimulator(TANKS, [CATALOGUE[name](place, levelling=1.0 / TAU)], [(rate,)]).simulate(run)
    np.testing.assert_allclose(carried, expected, atol=0.02)
    save_augmented(diagnoser.augmented_, tmp_path / "tanks.json")
    np.testing.assert_allclose(load_augmented(TANKS, tmp_path / "tanks.json").simulate(run), carried, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTED)
def test_one_that_goes_on_is_straight(name):
    (effect,) = diagnosed(TANKS, name, False).report_.effects
    assert (effect.name, effect.location) == (name, PLANTED[name][0])
    assert effect.levelling < 0.1 / (N * DT)
    assert effect.params["rate"] == pytest.approx(PLANTED[name][1] / SLOWER, rel=0.05)


class ByRuns(BaseSimulator):
    """The tanks through ``simulate`` alone."""

    inputs, outputs, dt, params = ["u"], ["h", "q"], DT, {}

    def simulate(self, U, x0=None, t=None):
        return TANKS.simulate(U)


def test_a_sensor_that_warms_up_is_named_through_simulate_alone():
    report = diagnosed(ByRuns(), "sensor_drift", True).report_
    (effect,) = report.effects
    assert (report.verdict, effect.name, effect.location) == ("explained", "sensor_drift", "q")
    assert 1.0 / effect.levelling == pytest.approx(TAU, rel=0.1)


def test_one_that_levels_off_has_the_same_free_run_as_a_graph():
    effects = [CATALOGUE[name](place, levelling=0.5) for name, (place, _) in PLANTED.items()]
    whole = AugmentedSimulator(TANKS, effects, [(rate,) for _, rate in PLANTED.values()])
    graph, run = whole.to_graph(), np.linspace(0.2, 1.0, 50)[:, None]
    state, found = whole.start_state(), []
    for u in run:
        now = graph(x=state, u=u)
        state, found = np.ravel(now["x_next"]), [*found, np.ravel(now["y"])]
    np.testing.assert_allclose(found, whole.simulate(run), atol=1e-6)
