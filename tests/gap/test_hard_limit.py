"""A hard limit that holds a state for much of the time: no trajectory near leads to its free run, which is then made step by step."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator
from sksurrogate.runs import stack_runs

DT, N, RUNS, LIMIT = 1.0, 300, 4, 0.055


def cell(t, x, u, p):
    return -u[0] / 9000.0, 0.002 * u[0] - x[1] / 30.0, 0.0012 * u[0] - x[2] / 300.0


def voltage(t, x, u, p):
    return (3.4 + 0.8 * x[0] - x[1] - x[2] - 0.01 * u[0],)


SIMULATOR = ODESimulator(
    cell, output=voltage, states=["charge", "fast", "slow"], inputs=["load"], outputs=["voltage"], params={}, dt=DT,
    x0=[0.8, 0.0, 0.0],
)  # fmt: skip


def limited(u, substeps=8):
    """The same with a slow overvoltage that cannot pass its limit."""
    x, h, out = np.array([0.8, 0.0, 0.0]), DT / substeps, []
    for value in u:
        out.append(voltage(0.0, x, [value], None)[0])
        for _ in range(substeps):
            middle = x + 0.5 * h * np.array(cell(0.0, x, [value], None))
            x = x + h * np.array(cell(0.0, middle, [value], None))
            x[2] = min(x[2], LIMIT)
    return np.array(out)[:, None]


@pytest.mark.slow
def test_a_limit_that_holds_for_half_of_the_time_is_named():
    rng = np.random.default_rng(3)
    U = [np.repeat(rng.uniform(-0.3, 1.0, N // 30), 30)[:, None] for _ in range(RUNS)]
    Y = [limited(u[:, 0]) for u in U]
    Y = [y + 2e-4 * rng.normal(size=y.shape) for y in Y]
    effects = [
        CATALOGUE["state_saturation"]("slow"),
        CATALOGUE["end_stop"]("slow", "slow"),
        CATALOGUE["linear_loss"]("slow", "slow"),
    ]
    X, y, groups = stack_runs(U, Y)
    (effect,) = GapDiagnoser(SIMULATOR, effects=effects, random_state=0).fit(X, y, groups=groups).report_.effects
    assert effect.name == "state_saturation"
    assert abs(effect.params["limit"] - LIMIT) < 0.005
