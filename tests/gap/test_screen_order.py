"""The screen orders all candidates, whatever one of them does."""

import numpy as np

from sksurrogate.effects import CATALOGUE, BalanceEffect, Parameter
from sksurrogate.gap._problem import build_problem
from sksurrogate.gap._screen import screen
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


def test_a_column_beyond_the_arithmetic_leaves_the_order_of_the_others():
    plant = ODESimulator(
        lambda t, x, u, p: (u[0] - x[0],), states=["x"], inputs=["u"], outputs=["x"], params={}, dt=DT
    )  # fmt: skip
    rng = np.random.default_rng(0)
    u = rng.normal(size=(N, 1)).cumsum(axis=0)
    y = ODESimulator(
        lambda t, x, u, p: (u[0] - x[0] - 0.3 * x[0] * np.abs(x[0]),), states=["x"], inputs=["u"], outputs=["x"], params={}, dt=DT
    ).simulate(u).reshape(N, 1) + 0.01 * rng.normal(size=(N, 1))  # fmt: skip
    described = describe(plant, n_inputs=1, n_outputs=1, dt=DT)
    record = Record.from_runs([u], [y], [DT * np.arange(N)], DT)
    problem, smoothed = build_problem(described, PlantModel(described), record, (), ("x",))
    null = problem.fit((), np.zeros(0), smoothed.x)
    others = [CATALOGUE[name]("x", "x") for name in ("linear_loss", "quadratic_drag", "cubic_stiffness")]
    starts = screen(problem, [others[0], Burst("x", "x"), *others[1:]], null, smoothed.x, None).starts
    assert all(np.isfinite([start.white, start.forced, start.left]).all() for start in starts)
    assert [start.effect.name for start in starts] == [effect.name for effect in others]
    assert max(starts, key=lambda start: start.white).effect.name == "quadratic_drag"
