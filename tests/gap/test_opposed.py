"""Two laws of one variable in one balance that add up are both named."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS = 0.1, 150, 4


def simulator(extra):
    return ODESimulator(
        lambda t, x, u, p: (u[0] - p["k"] * x[0] + extra(x[0]),), states=["v"], inputs=["f"], outputs=["v"],
        params={"k": 0.3}, dt=DT,
    )  # fmt: skip


@pytest.mark.slow
def test_a_pair_that_adds_up_is_named():
    rng = np.random.default_rng(4)
    X = np.repeat(rng.uniform(1.8, 2.4, (RUNS, N // 10, 1)), 10, axis=1)
    plant = simulator(lambda v: -0.2 * v - 0.02 * v**3)
    y = np.concatenate([plant.simulate(U, x0=np.array([5.0]))[:, 0] for U in X])
    y += 0.02 * rng.normal(size=y.shape)
    effects = [CATALOGUE[name]("v", "v") for name in ("cubic_stiffness", "linear_loss")]
    found = GapDiagnoser(simulator(lambda v: 0.0 * v), effects=effects, random_state=0)
    report = found.fit(X.reshape(-1, 1), y, np.repeat(np.arange(RUNS), N)).report_
    assert report.verdict == "explained"
    assert {effect.name for effect in report.effects} == {"cubic_stiffness", "linear_loss"}
