"""Few readings: what counts of a gain whose noise level is estimated from them."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import gain_under_estimated_noise
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, NOISE = 0.05, 21, 0.03


def fall(drag=0.0):
    return ODESimulator(
        lambda t, x, u, p: [x[1], -p["g"] - drag * x[1] * np.abs(x[1])],
        states=["height", "speed"], inputs=[], outputs=["height"], params={"g": 9.81}, dt=DT, x0=[48.0, -5.0],
    )  # fmt: skip


def test_least_squares_of_p_numbers_leave_as_many_free_values_less():
    """Two ways to one number: the gain of Student's law with N - p free values, for a small gain."""
    N, p, gain = 30, 6, 1e-3
    ratio = np.exp(-2.0 * gain / N)  # of the squares, under the likeliest noise of each fit
    assert gain_under_estimated_noise(gain, p, N) == pytest.approx(-0.5 * (N - p) * np.log(ratio), rel=1e-12)
    assert gain_under_estimated_noise(5.0, 40, 30) == 0.0


def test_all_that_is_fitted_counts():
    rng, runs = np.random.default_rng(0), 3
    Y = [fall().simulate(np.zeros((N, 0))).reshape(-1, 1) + NOISE * rng.normal(size=(N, 1)) for _ in range(runs)]
    record = Record.from_runs([np.zeros((N, 0))] * runs, Y, [DT * np.arange(N)] * runs, DT)
    plant = describe(fall(), n_inputs=0, n_outputs=1, dt=DT)
    problem, smoothed = build_problem(PlantModel(plant), record, ("g",), ("speed",))
    null = problem.fit((), np.zeros(1), smoothed.x)
    assert null.n_starts == 2 * runs and null.n_fitted == 2 * runs + 1


def test_the_gain_of_a_name_counts_by_the_values_that_are_left_free():
    rng = np.random.default_rng(1)
    y = fall(0.02).simulate(np.zeros((N, 0))).reshape(-1, 1) + NOISE * rng.normal(size=(N, 1))
    record = Record.from_runs([np.zeros((N, 0))], [y], [DT * np.arange(N)], DT)
    plant = describe(fall(), n_inputs=0, n_outputs=1, dt=DT)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("speed",))
    library = [CATALOGUE[name]("speed", "speed") for name in ("linear_loss", "quadratic_drag", "power_law")]
    search = OdeSearch(problem, library, smoothed.x)
    search.look_for_one()
    search.look_for_more()
    for candidate in search.first_round:
        free = 1.0 - (2 + candidate.n_parameters) / N  # two initial states
        whole = 2.0 * (search.evidence(candidate) - search.evidence(search.fitted_null.candidate))
        assert search.gain(candidate) == pytest.approx(free * whole, rel=1e-9)
        assert whole > 1.0
