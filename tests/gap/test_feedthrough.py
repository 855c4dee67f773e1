"""What an input does to a reading at once: a series resistance is a coupling of the sensor, a turbulent drop a law there."""

import numpy as np
import pytest

from sksurrogate import GapDiagnoser, ODESimulator

RESISTANCE, TURBULENT = 0.03, 5.0


def _levels(rng, n, hold, low, high):
    return np.repeat(rng.uniform(low, high, -(-n // hold)), hold)[:n]


def _battery():
    """Charge q and one relaxation v, both with their exact solution for a held current; the model has no series resistance."""
    rng, decay, gain = np.random.default_rng(0), np.exp(-1.0 / 40.0), 0.05
    currents = [_levels(rng, 400, 25, -1.0, 3.0) for _ in range(3)]
    voltages = []
    for current in currents:
        q, v = 0.9 - np.r_[0.0, np.cumsum(current)[:-1]] / 7200.0, np.zeros(400)
        for k in range(399):
            v[k + 1] = decay * v[k] - gain * (1.0 - decay) * current[k]
        voltages.append(3.2 + 0.9 * q + v - RESISTANCE * current)
    y = np.concatenate(voltages) + 0.002 * rng.standard_normal(1200)
    model = ODESimulator(
        lambda t, x, u, p: (-u[0] / p["charge"], -(x[1] + p["gain"] * u[0]) / p["tau"]),
        states=["q", "v"], inputs=["current"], outputs=["voltage"], dt=1.0, x0=[0.9, 0.0],
        output=lambda t, x, u, p: [p["offset"] + p["slope"] * x[0] + x[1]],
        params={"charge": 7200.0, "tau": 40.0, "gain": gain, "offset": 3.2, "slope": 0.9},
    )  # fmt: skip
    return model, np.concatenate(currents)[:, None], y, np.repeat(range(3), 400)


def test_a_series_resistance_is_a_coupling_of_the_current():
    model, X, y, groups = _battery()
    report = GapDiagnoser(model, random_state=0).fit(X, y, groups=groups).report_
    (one,) = report.effects
    assert (report.verdict, one.name, one.location, one.variable) == (
        "explained",
        "sensor_coupling",
        "voltage",
        "current",
    )
    low, high = one.intervals["coefficient"]
    assert low < -RESISTANCE < high and high - low < 0.1 * RESISTANCE


@pytest.mark.slow
def test_a_turbulent_drop_is_a_law_of_the_flow_at_the_sensor():
    """Pressure of a lung: ``E V + R Q`` of the model, ``K Q abs(Q)`` of the tube."""
    rng, dt = np.random.default_rng(0), 0.02
    flow = [
        sum(a * np.sin(w * dt * np.arange(300) + s) for a, w, s in rng.uniform([0.1, 1.3, 0], [0.4, 12.0, 6], (6, 3)))
        for _ in range(3)
    ]
    volume = [np.r_[0.0, dt * np.cumsum(q)[:-1]] for q in flow]
    y = np.concatenate([20.0 * v + 6.0 * q + TURBULENT * q * np.abs(q) for q, v in zip(flow, volume)])
    model = ODESimulator(
        lambda t, x, u, p: (u[0],), states=["V"], inputs=["Q"], outputs=["P"], dt=dt, params={"E": 20.0, "R": 6.0},
        output=lambda t, x, u, p: [p["E"] * x[0] + p["R"] * u[0]],
    )  # fmt: skip
    diagnoser = GapDiagnoser(model, random_state=0)
    diagnoser.fit(np.concatenate(flow)[:, None], y + 0.05 * rng.standard_normal(900), groups=np.repeat(range(3), 300))
    report = diagnoser.report_
    law = report.missing_term.law
    assert not report.effects and (law.location, law.kind, law.variables) == ("P", "output", ("Q",)) and law.certified
    assert law.equation == "Q*abs(Q)" and law.params["c0"] == pytest.approx(TURBULENT, rel=0.02)
    new = 0.8 * np.sin(2.0 * dt * np.arange(200))[:, None]  # the corrected simulator carries it
    expected = model.simulate(new)[:, 0] + TURBULENT * new[:, 0] * np.abs(new[:, 0])
    np.testing.assert_allclose(diagnoser.augmented_.simulate(new)[:, 0], expected, atol=0.1)
