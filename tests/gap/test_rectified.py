"""A sensor that loses the sign: the states that are read off it have the wrong sign in places, the true ones are found."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS = 0.05, 300, 4


def circuit(t, x, u, p):
    return x[1], p["gain"] * u[0] - p["stiffness"] * x[0] - p["damping"] * x[1]


@pytest.mark.slow
def test_a_rectified_output_is_named_where_runs_start_below_zero():
    rng = np.random.default_rng(11)
    plant = ODESimulator(
        circuit, dt=DT, x0=[0.0, 0.0], states=["charge", "current"], inputs=["source"], outputs=["current"],
        params={"gain": 4.0, "stiffness": 6.0, "damping": 1.5},
    )  # fmt: skip
    U = np.repeat(rng.uniform(-1, 1, (RUNS, N // 25)), 25, axis=1)
    starts = [(0.4, -1.2), (-0.3, 0.9), (0.2, -0.8), (-0.5, -0.6)]
    clean = np.concatenate([np.ravel(plant.simulate(u[:, None], x0=np.array(x0))) for u, x0 in zip(U, starts)])
    y = np.abs(clean) + 0.01 * clean.std() * rng.normal(size=clean.shape)
    report = GapDiagnoser(plant, random_state=0).fit(U.reshape(-1, 1), y, groups=np.repeat(np.arange(RUNS), N)).report_
    assert report.verdict == "explained"
    assert [(effect.name, effect.location) for effect in report.effects] == [("sensor_rectification", "current")]
    assert report.shrink.fraction > 0.97
