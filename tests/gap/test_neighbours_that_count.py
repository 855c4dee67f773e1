"""Exchange with a neighbour that does not count is a loss of the state's own."""

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator


@pytest.mark.slow
@pytest.mark.parametrize("planted, named", [("own", ("linear_loss", "T")), ("exchange", ("exchange", "room"))])
def test_a_loss_is_no_exchange_with_a_flow_near_zero(planted, named):
    """A loss ``-0.05 T``, or ``0.05 (room - T)``: the coolant's flow of 0 to 0.02 has no part in either."""
    n, dt, rng = 150, 1.0, np.random.default_rng(0)

    def plant(loss):
        return ODESimulator(
            lambda t, x, u, p: (u[0] - 40.0 * u[1] * x[0] + loss(x[0], u[2]),),
            states=["T"], inputs=["heat", "coolant", "room"], outputs=["T"], params={}, dt=dt,
        )  # fmt: skip

    real = plant(lambda T, room: -0.05 * T if planted == "own" else 0.05 * (room - T))
    U = [
        np.c_[np.repeat(rng.uniform(1, 8, 15), 10), np.repeat(rng.uniform(0, 0.02, 15), 10), np.repeat(rng.uniform(10, 25, 5), 30)]
        for _ in range(3)
    ]  # fmt: skip
    Y = [real.simulate(u, x0=[20.0]).reshape(n, 1) + 0.1 * rng.normal(size=(n, 1)) for u in U]
    report = (
        GapDiagnoser(plant(lambda T, room: 0.0 * T), effects=["linear_loss", "exchange"], random_state=0, n_jobs=1)
        .fit(np.vstack(U), np.vstack(Y), groups=np.repeat(np.arange(3), n))
        .report_
    )
    assert [(effect.name, effect.variable) for effect in report.effects] == [named]
    drawn_to = {row["variable"] for row in report.ranking if row["name"] == "exchange" and row["screen"] > 0}
    assert "coolant" not in drawn_to
    assert planted == "own" or "room" in drawn_to
