"""A law that starts far too large comes back from a part of its coefficients: it holds the simulator alone, and need not be worse."""

import numpy as np
import pytest

from sksurrogate.effects._formula import Term
from sksurrogate.effects._law import LawEffect
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.search._fit_from_starts import fit_part
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N = 0.1, 200


def tank(loss):
    return ODESimulator(
        lambda t, x, u, p: [u[0] - p["k"] * x[0] - loss * x[0] ** 2],
        states=["level"], inputs=["flow"], outputs=["level"], params={"k": 0.7}, dt=DT, x0=[1.0],
    )  # fmt: skip


def problem_of(free):
    """A problem whose plant lacks a loss, and the null fitted to it."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(0.5, 1.5, N // 10), 10)[:, None]
    y = tank(0.2).simulate(u) + 0.005 * rng.normal(size=(N, 1))
    plant = describe(tank(0.0), n_inputs=1, n_outputs=1, dt=DT)
    record = Record.from_runs([u], [y], [DT * np.arange(N)], DT)
    problem, smoothed = build_problem(PlantModel(plant), record, free, ("level",))
    return problem, smoothed.x, problem.fit((), np.zeros(len(free)), smoothed.x)


def test_a_law_that_runs_away_is_fitted_from_a_part_of_it():
    problem, _, null = problem_of(())
    law = LawEffect("level", "level", (Term((("square", "level", 0.0, 0.0),)),), (1.0,), False)
    assert problem.fit((law,), np.array([1.0]), null.fit.x, open_steps=0) is None  # level^2 is infinite within the run
    found = fit_part(problem, null, law, np.array([1.0]))
    assert found.fit.cost < null.fit.cost and found.theta_of(0)[0] == pytest.approx(-0.2, abs=0.01)


@pytest.mark.parametrize("free", [(), ("k",)])
def test_a_fit_that_fell_back_is_the_one_from_there(free):
    problem, x, null = problem_of(free)
    law, fallen = LawEffect("level", "level", (Term((("cube", "level", 0.0, 0.0),)),), (1.0,), False), 0
    for size in (0.1, -0.3, -1.0, -3.0, -10.0):
        theta = null.theta_with(np.array([size]))
        one = problem.fit((law,), theta, x, fallback=null.fit.x)
        if one.fit.fell_back:
            again = problem.fit((law,), theta, null.fit.x, open_steps=0)
            assert again.fit.cost == one.fit.cost and np.array_equal(again.fit.theta, one.fit.theta)
            fallen += 1
    assert 0 < fallen < 5
