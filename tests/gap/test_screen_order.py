"""The screen orders all candidates, and the search all fits, whatever one of them does."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, BalanceEffect, Parameter
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.screen._screen import screen
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.kernels.linearised import linearise
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N = 0.1, 150


class Burst(BalanceEffect):
    """A force beyond all squares."""

    name = "burst"
    parameters = (Parameter("size"),)
    equation = "- 1e200 c v"
    linear = True

    def term(self, t, x, v, theta, width):
        return -1e200 * theta[0] * v

    def starts(self, probe):
        return [(1.0,)]


def linear(t, x, u, p):
    return (u[0] - x[0],)


def dragged(t, x, u, p):
    return (u[0] - x[0] - 0.3 * x[0] * np.abs(x[0]),)


def simulator(rhs):
    return ODESimulator(rhs, states=["x"], inputs=["u"], outputs=["x"], params={}, dt=DT)


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(0)
    u = rng.normal(size=(N, 1)).cumsum(axis=0)
    y = simulator(dragged).simulate(u).reshape(N, 1) + 0.01 * rng.normal(size=(N, 1))
    plant = describe(simulator(linear), n_inputs=1, n_outputs=1, dt=DT)
    return build_problem(PlantModel(plant), Record.from_runs([u], [y], [DT * np.arange(N)], DT), (), ("x",))


def effects(*names):
    return [CATALOGUE[name]("x", "x") for name in names]


def test_a_column_beyond_the_arithmetic_leaves_the_order_of_the_others(problem):
    problem, smoothed = problem
    null = problem.fit((), np.zeros(0), smoothed.x)
    others = effects("linear_loss", "quadratic_drag", "cubic_stiffness")
    starts = screen([others[0], Burst("x", "x"), *others[1:]], null, smoothed.x, None).starts
    assert all(np.isfinite([start.white, start.forced, start.left]).all() for start in starts)
    assert [start.effect.name for start in starts] == [effect.name for effect in others]
    assert max(starts, key=lambda start: start.white).effect.name == "quadratic_drag"


def test_a_fit_that_diverged_is_none(problem):
    """Its likelihood is a difference of astronomical numbers."""
    problem, smoothed = problem
    search = OdeSearch(problem, effects("linear_loss", "quadratic_drag"), smoothed.x)
    null = search.null = search.judge(estimate_noise(problem.fit((), np.zeros(0), smoothed.x), problem.first_noise()))
    fits = [problem.fit((effect,), np.array([0.1]), smoothed.x) for effect in search.library]
    diverged = replace(fits[0], fit=replace(fits[0].fit, cost=1e80))
    assert [candidate.effects[0].name for candidate in search.ranked([diverged, fits[1]], null.candidate)] == [
        "quadratic_drag"
    ]
    assert search.ranked([diverged], null.candidate) == []


def test_a_base_without_a_linearisation_has_no_screen_however_short_its_list(problem, monkeypatch):
    """Slopes beyond all squares along the measured path (blind case effect_disturbed:12574145481006727361)."""
    problem, smoothed = problem
    null = problem.fit((), np.zeros(0), smoothed.x)
    first = screen(effects("linear_loss", "quadratic_drag"), null, smoothed.x, None)
    base = problem.fit(effects("linear_loss"), np.array([0.1]), smoothed.x)

    def burst(*given):
        lin = linearise(*given)
        return replace(lin, J_theta=np.full_like(lin.J_theta, 1e200))

    monkeypatch.setattr("sksurrogate.gap.screen._responses.linearise", burst)
    nothing = screen(effects("quadratic_drag"), base, smoothed.x, None, first=first)
    assert nothing.starts == [] and nothing.low.size == nothing.high.size == 0
    np.testing.assert_array_equal(nothing.left_by, base.fit.cost)
