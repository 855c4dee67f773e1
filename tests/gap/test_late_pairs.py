"""A late effect and a second one in a controlled plant: three or four other names imitate the two, one of them at a wrong place."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS = 0.2, 600, 2
STRENGTH, SLOPE, ERROR, CLOSED = 5.0, 0.0997, -0.0586, 0.013


def tank(t, x, u, p):
    """Level and salt of a tank that water and brine flow into."""
    level, salt = np.maximum(x[0], 0.1), x[1]
    water, brine = u
    return water + brine - p["outflow"] * np.sqrt(level), (p["strength"] * brine - (water + brine) * salt) / level


def plant(t, x, u, p):
    """The brine is the stronger the more flows, and the first 0.013 of the water's valve lets nothing through."""
    return tank(t, x, [np.maximum(u[0] - CLOSED, 0.0), u[1]], {**p, "strength": STRENGTH * (1 + SLOPE * u[1] + ERROR)})


def simulator(rhs):
    return ODESimulator(
        rhs, states=["level", "salt"], inputs=["water", "brine"], outputs=["level", "salt"],
        params={"outflow": 0.8, "strength": STRENGTH}, dt=DT, x0=[3.5, 2.0],
    )  # fmt: skip


def recorded(seed):
    """Runs in which the water holds the level."""
    rng, one = np.random.default_rng(seed), simulator(plant)
    U, Y = np.zeros((RUNS, N, 2)), np.zeros((RUNS, N, 2))
    for u, y in zip(U, Y):
        aim, x = np.repeat(rng.uniform(2.2, 5.5, N // 30), 30), np.array([3.5, 2.0])
        u[:, 1] = np.repeat(rng.uniform(0.3, 0.9, N // 24), 24)
        for i in range(N):
            u[i, 0] = np.clip(1.0 + 1.2 * (aim[i] - x[0] - 0.02 * rng.normal()), 0.1, 2.5)
            y[i], x = x, one.simulate(u[[i, i]], x0=x)[1]
    X, y = U.reshape(-1, 2), Y.reshape(-1, 2)
    return X, y + 0.01 * y.std(axis=0) * rng.normal(size=y.shape), np.repeat(np.arange(RUNS), N)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4])
def test_two_names_in_place_of_those_that_imitate_them(seed):
    X, y, groups = recorded(seed)
    report = GapDiagnoser(simulator(tank), n_jobs=1, random_state=0).fit(X, y, groups=groups).report_
    found = {
        key
        for effect in report.effects
        for key in [(effect.name, effect.location, effect.variable), *(tuple(one[:3]) for one in effect.equivalents)]
    }
    assert report.verdict == "explained" and len(report.effects) == 2
    assert {("parameter_dependence", "strength", "brine"), ("input_dead_zone", "water", None)} <= found
