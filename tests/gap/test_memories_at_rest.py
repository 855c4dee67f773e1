"""Of one set whose memories begin at rest, and with free ones, the likelier is kept: free initial states always leave less."""

import numpy as np
import pytest

from sksurrogate.effects import AugmentedSimulator
from sksurrogate.effects._hidden import HiddenRelaxation
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS, THETA = 0.1, 200, 4, (1.0, 2.0)
PLANT = ODESimulator(
    lambda t, x, u, p: (u[0] - x[0],), states=["v"], inputs=["u"], outputs=["v"], params={}, dt=DT, x0=[0.0]
)


@pytest.mark.parametrize(("before", "at_rest"), [(0, True), (25, False)], ids=["at rest", "under way"])
def test_a_memory_is_kept_at_rest_unless_the_data_begin_elsewhere(before, at_rest):
    """A plant that has run for some time before the record does not begin at rest, and no fit from rest comes near."""
    rng = np.random.default_rng(0)
    rest, free = HiddenRelaxation("v", "v"), HiddenRelaxation("v", "v", settled=False)
    U = [np.repeat(rng.uniform(-1.0, 1.0, (N + before) // 25), 25)[:, None] for _ in range(RUNS)]
    plant = AugmentedSimulator(PLANT, [rest], [THETA])
    Y = [plant.simulate(u).reshape(-1, 1) for u in U]
    Y = [(y + 0.01 * rng.normal(size=y.shape))[before:] for y in Y]
    U = [u[before:] for u in U]
    record = Record.from_runs(U, Y, [DT * np.arange(len(y)) for y in Y], DT)
    problem, smoothed = build_problem(PlantModel(describe(PLANT, n_inputs=1, n_outputs=1, dt=DT)), record, (), ("v",))
    fits = [problem.fit((effect,), np.array(THETA), smoothed.x) for effect in (rest, free)]
    assert fits[1].fit.cost < fits[0].fit.cost
    for order in (fits, fits[::-1]):
        search = OdeSearch(problem, [rest, free], smoothed.x)
        search.remember(order)
        (kept,) = search.fitted.values()
        assert kept.effects[0].at_rest is at_rest
