"""Starting values lead to a fit where the free run cannot start from them, or where they run to where nothing depends on them."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._parts import Probe
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS = 0.05, 200, 4


def circuit():
    """A coil whose current needs an inductance that is not 0."""
    return ODESimulator(
        lambda t, x, u, p: [(u[0] - p["R"] * x[0]) / p["L"]],
        states=["i"], inputs=["volt"], outputs=["i"], params={"R": 1.0, "L": 0.5}, dt=DT,
    )  # fmt: skip


def recorded(plant, seed=0, noise=0.005):
    rng = np.random.default_rng(seed)
    U = [2.0 * np.repeat(rng.uniform(-1, 1, N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [plant.simulate(u, x0=np.zeros(1)).reshape(N, 1) for u in U]
    return U, [y + noise * rng.normal(size=y.shape) for y in Y]


@pytest.mark.parametrize("final", [0.15, 0.3])
def test_a_drift_to_a_small_share_of_the_parameter_is_named(final):
    """The tangent at the nominal value points beyond 0, where the coil has no free run."""
    drift = CATALOGUE["parameter_drift"]("L")
    U, Y = recorded(AugmentedSimulator(circuit(), [drift], [{"rate": (final - 1.0) / (N * DT)}]))
    report = (
        GapDiagnoser(circuit(), effects=["parameter_drift", "parameter_step", "parameter_error"], random_state=0)
        .fit(np.concatenate(U), np.concatenate(Y), groups=np.repeat(range(RUNS), N))
        .report_
    )
    assert [effect.name for effect in report.effects] == ["parameter_drift"]
    assert 1.0 + report.effects[0].params["rate"] * N * DT == pytest.approx(final, abs=0.02)


def test_a_stribeck_friction_is_found_with_its_velocity():
    """Where no velocity is near 0 for long, static level and velocity say nothing; a start there leads nowhere."""
    friction = CATALOGUE["stribeck_friction"]("i", "i")
    true = {"level": 0.3, "static_level": 0.7, "velocity": 0.3}
    U, Y = recorded(AugmentedSimulator(circuit(), [friction], [true]))
    asked = ["stribeck_friction", "coulomb_friction", "linear_loss", "power_law"]
    report = (
        GapDiagnoser(circuit(), effects=asked, random_state=0)
        .fit(np.concatenate(U), np.concatenate(Y), groups=np.repeat(range(RUNS), N))
        .report_
    )
    assert [effect.name for effect in report.effects] == ["stribeck_friction"]
    assert report.effects[0].params == pytest.approx(true, rel=0.1)


def test_rare_jumps_of_an_input_are_starts_of_a_rate_limit_too():
    rng = np.random.default_rng(0)
    u = 0.01 * rng.normal(size=400) + np.repeat(rng.uniform(-1, 1, 8), 50)
    probe = Probe(u, u, 0.0, 0.1, 40.0, np.array([0]))
    limits = [start[0] for start in CATALOGUE["rate_limit"]("u").starts(probe)]
    assert min(limits) < 0.02
    assert max(limits) > np.max(np.abs(np.diff(u))) / 0.1
    assert sum(0.5 < limit < 10.0 for limit in limits) >= 3
