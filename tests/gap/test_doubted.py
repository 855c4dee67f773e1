"""One name of one parameter, at the noise, in the place of a law that is far likelier."""

import numpy as np

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS = 0.1, 200, 8


def simulator(loss):
    return ODESimulator(
        lambda t, x, u, p: (u[0] - p["k"] * x[0] - loss(x[0]),), states=["v"], inputs=["f"], outputs=["v"],
        params={"k": 0.3}, dt=DT,
    )  # fmt: skip


def test_a_name_at_the_noise_is_doubted_where_a_law_is_far_likelier():
    rng = np.random.default_rng(4)
    X = np.repeat(rng.uniform(0.6, 2.4, (RUNS, N // 10, 1)), 10, axis=1)
    y = np.concatenate([simulator(lambda v: 0.008 * v**3).simulate(U, x0=np.array([4.0]))[:, 0] for U in X])
    y += 0.3 * rng.normal(size=y.shape)
    effects = [CATALOGUE["quadratic_loss"]("v", "v")]
    diagnoser = GapDiagnoser(simulator(lambda v: 0.0 * v), effects=effects, random_state=0)
    report = diagnoser.fit(X.reshape(-1, 1), y, np.repeat(np.arange(RUNS), N)).report_
    assert (report.verdict, report.where.location) == ("unknown", "v")
