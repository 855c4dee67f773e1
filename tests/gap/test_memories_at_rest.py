"""Of one set whose memories begin at rest, and with free ones, the likelier is kept: free initial states always leave less."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._hidden import HiddenRelaxation
from sksurrogate.gap import GapDiagnoser
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


#: An oscillator, and what it lacks.
SPRING = ODESimulator(
    lambda t, x, u, p: (x[1], u[0] - p["c"] * x[1] - 6.0 * x[0] - 2.0 * x[0] ** 3),
    states=["q", "v"], inputs=["f"], outputs=["q", "v"], params={"c": 0.4}, dt=0.02,
)  # fmt: skip
SOME = [
    "hidden_mode",
    "hysteresis",
    "hidden_relaxation",
    "cubic_stiffness",
    "coulomb_friction",
    "linear_loss",
    "sensor_lag",
    "rate_limit",
    "input_lag",
    "parameter_error",
]
LACKING = {
    "hidden_mode": (("v", "q"), (8.0, 9.0, 0.04)),
    "hysteresis": (("v", "q"), (6.0, 0.15)),
    "rate_limit": (("f",), (6.0,)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", LACKING)
def test_runs_cut_out_of_one_record_begin_with_a_memory_in_motion(name):
    """From rest alone a mode went to another signal, a speed limit got a false name beside it, and a hysteresis left half more than the noise."""
    rng, n, (place, theta) = np.random.default_rng(0), 1300, LACKING[name]
    U = np.repeat(rng.uniform(-4.0, 4.0, n // 25), 25)[:, None]
    y = AugmentedSimulator(SPRING, [CATALOGUE[name](*place)], [theta]).simulate(U)
    y += 0.005 * np.ptp(y, axis=0) * rng.normal(size=y.shape)
    rows = np.concatenate([np.arange(a, a + 180) for a in (50, 260, 455, 700, 880, 1090)])
    diagnoser = GapDiagnoser(SPRING, effects=SOME, free_params=[], random_state=0, n_jobs=1)
    report = diagnoser.fit(U[rows], y[rows], groups=np.repeat(np.arange(6), 180)).report_
    (found,) = report.effects
    where = found.location, found.variable
    assert (report.verdict, found.name, where[: len(place)]) == ("explained", name, place), str(report)
    assert not found.settled and found.probability > 0.9
    np.testing.assert_allclose(list(found.params.values()), theta, rtol=0.15)
