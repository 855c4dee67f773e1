"""Two laws of one variable that vary against each other imitate a third one."""

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


@pytest.mark.parametrize(
    ("extra", "names", "verdict"),
    [
        (lambda v: -0.5 + 0.0 * v, ("sqrt_leak", "linear_loss"), "unknown"),
        (lambda v: -0.2 * v - 0.02 * v**3, ("cubic_stiffness", "linear_loss"), "explained"),
    ],
)
def test_a_pair_that_nearly_cancels_is_unknown_and_one_that_adds_up_is_named(extra, names, verdict):
    rng = np.random.default_rng(4)
    X = np.repeat(rng.uniform(1.8, 2.4, (RUNS, N // 10, 1)), 10, axis=1)
    y = np.concatenate([simulator(extra).simulate(U, x0=np.array([5.0]))[:, 0] for U in X])
    y += 0.02 * rng.normal(size=y.shape)
    effects = [CATALOGUE[name]("v", "v") for name in names]
    found = GapDiagnoser(simulator(lambda v: 0.0 * v), effects=effects, random_state=0)
    report = found.fit(X.reshape(-1, 1), y, np.repeat(np.arange(RUNS), N)).report_
    assert report.verdict == verdict, [(e.name, e.params) for e in report.effects]
