"""Two names that both have exact twins: what stands holds one of each pair, and both classes are kept."""

import numpy as np

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS = 0.05, 120, 4
LIBRARY = ["linear_loss", "parameter_error", "sensor_bias", "drift", "input_gain", "quadratic_loss"]


def circuit(t, x, u, p):
    """Series circuit: current and voltage of the capacitor."""
    return (u[0] - p["R"] * x[0] - x[1]) / p["L"], x[0] / p["C"]


def test_twins_stand_beside_one_another():
    """A bias of the only sensor is a ramp of the balance, and a wrong resistance is a loss: no class loses its member."""
    nominal, plant = (
        ODESimulator(
            circuit, states=["current", "voltage"], inputs=["source"], outputs=["current"],
            params={"R": R, "L": 0.5, "C": 0.4}, dt=DT,
        )
        for R in (0.8, 0.7)
    )  # fmt: skip
    rng = np.random.default_rng(2)
    t = DT * np.arange(N)
    runs = [np.sin((1.0 + 0.7 * k) * t)[:, None] + 0.3 * np.sign(np.sin(0.9 * t + k))[:, None] for k in range(RUNS)]
    y = np.concatenate([plant.simulate(run, x0=np.zeros(2)) + 0.05 for run in runs])
    X, groups = np.concatenate(runs), np.repeat(np.arange(RUNS), N)
    report = (
        GapDiagnoser(nominal, effects=LIBRARY, n_jobs=1, random_state=0)
        .fit(X, y + 0.002 * rng.normal(size=y.shape), groups=groups)
        .report_
    )
    assert report.verdict == "explained" and len(report.effects) == 2
    classes = [{effect.name, *(one[0] for one in effect.equivalents)} for effect in report.effects]
    assert {"parameter_error", "linear_loss"} in classes and {"sensor_bias", "drift"} in classes
