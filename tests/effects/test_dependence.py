"""A parameter that depends on a signal: in the equations, in files and exports, and in a diagnosis."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator, StepSimulator

SIGNALS = {
    "states": ["cold", "hot"],
    "inputs": ["flow"],
    "outputs": ["cold", "hot"],
    "params": {"UA": 0.5, "M": 2.0},
    "dt": 0.3,
}
Dependence = CATALOGUE["parameter_dependence"]


def exchanger(t, x, u, p):
    heat = p["UA"] * (x[1] - x[0])
    return (u[0] * (20 - x[0]) + heat) / p["M"], (70 - x[1] - heat) / p["M"]


def turbulent(t, x, u, p):
    return exchanger(t, x, u, {**p, "UA": p["UA"] * (u[0] / 0.8) ** 0.8})


def decay(t, x, u, p):
    return (-p["k"] * x[0],)


ONE = {"states": ["x"], "inputs": ["u"], "outputs": ["x"], "params": {"k": 0.7}, "dt": 0.1, "x0": [2.0]}


def test_on_a_constant_input_it_is_a_wrong_parameter():
    plant = AugmentedSimulator(
        ODESimulator(decay, **ONE), [Dependence("k", "u")], [{"slope": 0.3, "relative_error": -0.1}]
    )
    found = plant.simulate(np.full((40, 1), 1.5))[:, 0]
    np.testing.assert_allclose(found, 2.0 * np.exp(-0.7 * (1 + 0.3 * 1.5 - 0.1) * 0.1 * np.arange(40)), rtol=1e-6)


def test_on_its_own_state_it_is_a_logistic_decay():
    plant = AugmentedSimulator(
        ODESimulator(decay, **ONE), [Dependence("k", "x")], [{"slope": 0.5, "relative_error": 0.0}]
    )
    t, a, c = 0.1 * np.arange(60), 0.7, 0.35  # dx/dt = - a x - c x^2
    np.testing.assert_allclose(
        plant.simulate(np.zeros((60, 1)))[:, 0], a / ((a / 2.0 + c) * np.exp(a * t) - c), rtol=1e-5
    )


def test_a_simulator_that_steps_has_it_amid_each_step():
    def step(t, x, u, p, dt):
        return (x[0] * np.exp(-p["k"] * dt),)

    plant = AugmentedSimulator(
        StepSimulator(step, **ONE), [Dependence("k", "x")], [{"slope": 0.2, "relative_error": 0.1}]
    )
    t, a, c = 0.1 * np.arange(20), 0.7 * 1.1, 0.7 * 0.2  # dx/dt = - a x - c x^2
    expected = a / ((a / 2.0 + c) * np.exp(a * t) - c)
    np.testing.assert_allclose(plant.simulate(np.zeros((20, 1)))[:, 0], expected, rtol=2e-4)


def test_the_right_hand_side_of_the_simulator_with_it_has_it():
    plant = AugmentedSimulator(
        ODESimulator(exchanger, **SIGNALS), [Dependence("UA", "flow")], [{"slope": 0.6, "relative_error": -0.5}]
    )
    x, u = np.array([30.0, 50.0]), np.array([1.2])
    expected = exchanger(0.0, x, u, {"UA": 0.5 * (1 + 0.6 * 1.2 - 0.5), "M": 2.0})
    np.testing.assert_allclose(plant.rhs(0.0, x, u, {"UA": 0.5, "M": 2.0}), expected, rtol=1e-12)


def test_there_is_one_for_each_parameter_that_is_not_zero_and_each_signal():
    """And for the difference across the wall."""
    from sksurrogate.effects import build_effects
    from sksurrogate.physics._simulator import describe

    plant = ODESimulator(exchanger, **{**SIGNALS, "params": {"UA": 0.5, "M": 2.0, "none": 0.0}})
    found = {effect.key[1:] for effect in build_effects(describe(plant), ["cold"], ["parameter_dependence"])}
    across = {("UA", "abs(cold - hot)"), ("UA", "(cold - hot)^2")}
    assert found == {(p, v) for p in ("UA", "M") for v in ("cold", "hot", "flow")} | across


def record(rhs, seed=0, runs=3, n=160, outputs=("cold", "hot")):
    rng = np.random.default_rng(seed)
    plant = ODESimulator(rhs, **{**SIGNALS, "outputs": list(outputs)})
    U = [np.repeat(rng.uniform(0.3, 1.6, (n // 16, 1)), 16, axis=0) for _ in range(runs)]
    y = np.concatenate([plant.simulate(u, x0=rng.uniform(25, 50, 2)) for u in U])
    return np.concatenate(U), y + 0.05 * rng.normal(size=y.shape), np.repeat(np.arange(runs), n)


OTHERS = ["parameter_error", "linear_loss", "quadratic_loss", "exchange", "input_gain", "sensor_bias", "bilinear"]


@pytest.mark.slow
def test_a_heat_transfer_that_grows_with_the_flow_is_named():
    X, y, groups = record(turbulent)
    diagnoser = GapDiagnoser(
        ODESimulator(exchanger, **SIGNALS), effects=[*OTHERS, "parameter_dependence"], n_jobs=1, random_state=0
    )
    report = diagnoser.fit(X, y, groups=groups).report_
    assert [(e.name, e.location, e.variable) for e in report.effects] == [("parameter_dependence", "UA", "flow")]
    effect = report.effects[0].params
    for flow in (0.5, 0.8, 1.1, 1.4):  # the straight line through the power law
        assert 1 + effect["slope"] * flow + effect["relative_error"] == pytest.approx((flow / 0.8) ** 0.8, abs=0.06)
    assert report.verdict in ("explained", "partial") and report.shrink.fraction > 0.85


@pytest.mark.slow
def test_it_may_depend_on_a_state_that_is_not_measured():
    def warmer(t, x, u, p):
        return exchanger(t, x, u, {**p, "UA": p["UA"] * (0.5 + 0.012 * x[1])})

    X, y, groups = record(warmer, outputs=["cold"])
    plant = ODESimulator(exchanger, **{**SIGNALS, "outputs": ["cold"]})
    report = (
        GapDiagnoser(plant, effects=["input_bias", "parameter_dependence"], n_jobs=1, random_state=0)
        .fit(X, y, groups=groups)
        .report_
    )
    assert ("parameter_dependence", "UA", "hot") in [
        key for e in report.effects for key in ((e.name, e.location, e.variable), *e.equivalents)
    ]


@pytest.mark.slow
def test_it_does_not_join_the_search_where_another_effect_explains_all(monkeypatch):
    from sksurrogate.gap.search._ode_search import OdeSearch

    def asked(self, base, left):
        raise AssertionError("asked")

    def leaking(t, x, u, p):
        cold, hot = exchanger(t, x, u, p)
        return cold - 0.15 * x[0], hot

    monkeypatch.setattr(OdeSearch, "late_ones", asked)
    X, y, groups = record(leaking)
    diagnoser = GapDiagnoser(
        ODESimulator(exchanger, **SIGNALS), effects=[*OTHERS, "parameter_dependence"], n_jobs=1, random_state=0
    )
    assert [e.name for e in diagnoser.fit(X, y, groups=groups).report_.effects] == ["linear_loss"]


@pytest.mark.slow
def test_a_small_gap_is_not_left_to_names_that_imitate_a_dependence():
    """A motor's resistance that grows with its temperature: a wrong resistance comes near to the noise, and leaves a little."""

    def motor(per_degree):
        def rhs(t, x, u, p):
            resistance = p["R"] * (1 + per_degree * (x[1] - 20))
            current = (u[0] - 0.5 * x[0]) / resistance
            return (0.5 * current - 0.02 * x[0]) / 0.02, (resistance * current**2 - (x[1] - 20) / 1.5) / 20

        names = {"states": ["w", "T"], "inputs": ["V"], "outputs": ["w", "T"]}
        return ODESimulator(rhs, params={"R": 1.0}, dt=0.1, **names)

    rng, runs = np.random.default_rng(2), []
    for _ in range(4):
        u = np.repeat(rng.uniform(2, 12, 12), 25)[:, None]
        runs.append((u, motor(0.0117).simulate(u, x0=[0.0, 20 + rng.uniform(0, 10)])))
    X, y = (np.concatenate(one) for one in zip(*runs))
    y = y + 0.005 * y.std(axis=0) * rng.normal(size=y.shape)
    names = ["bilinear", "linear_loss", "parameter_dependence", "parameter_error", "constant_bias"]
    diagnoser = GapDiagnoser(motor(0.0), effects=names, random_state=0, n_jobs=1)
    report = diagnoser.fit(X, y, groups=np.repeat(np.arange(4), 300)).report_
    assert report.verdict == "explained"
    assert [(e.name, e.location, e.variable) for e in report.effects] == [("parameter_dependence", "R", "T")]
    slope, offset = (report.effects[0].params[k] for k in ("slope", "relative_error"))
    assert slope == pytest.approx(0.0117, rel=0.05) and 1 + offset + 20 * slope == pytest.approx(1.0, abs=0.01)
