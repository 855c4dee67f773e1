"""A change that makes the plant stiff: steps that the nominal plant allows are too long for it, also far from the data."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator
from sksurrogate.runs import stack_runs

DT, N, RUNS = 0.2, 250, 4
CHANGE, WHEN = -0.985, 27.0


def rhs(t, x, u, p):
    return (p["gain"] * u[0] - x[0]) / p["slow"], (x[0] - x[1]) / p["lag"] + 0.2 * u[0]


SIMULATOR = ODESimulator(
    rhs, states=["a", "b"], inputs=["u"], outputs=["b"], params={"gain": 1.0, "slow": 2.0, "lag": 4.0}, dt=DT
)


def switched(u, change, substeps=200):
    """The same whose second lag falls at one moment, by short steps."""
    (a, b), h, out, t = (0.0, 0.0), DT / substeps, [], 0.0
    for value in u:
        out.append(b)
        for _ in range(substeps):
            lag = 4.0 * (1.0 + change if t >= WHEN else 1.0)
            a, b, t = a + h * (value - a) / 2.0, b + h * ((a - b) / lag + 0.2 * value), t + h
    return np.array(out)[:, None]


def test_a_time_constant_that_falls_below_a_step_is_named():
    rng = np.random.default_rng(0)
    U = [np.repeat(rng.normal(size=N // 10), 10)[:, None] for _ in range(RUNS)]
    X, y, groups = stack_runs(U, [switched(u[:, 0], CHANGE) + 2e-3 * rng.normal(size=(N, 1)) for u in U])
    effects = [
        CATALOGUE[name](place) for name in ("parameter_step", "parameter_error") for place in ("gain", "slow", "lag")
    ]
    report = GapDiagnoser(SIMULATOR, effects=effects, random_state=0).fit(X, y, groups=groups).report_
    assert report.verdict == "explained"
    (effect,) = report.effects
    assert (effect.name, effect.location) == ("parameter_step", "lag")
    assert 1.0 + effect.params["relative_error"] == pytest.approx(1.0 + CHANGE, rel=0.5)
    assert effect.params["time"] == pytest.approx(WHEN, abs=DT)
