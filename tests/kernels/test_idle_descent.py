"""A descent that creeps: two residuals whose Gauss-Newton steps are known in closed form (Dennis, Schnabel, 1983, example 10.2.4)."""

import numpy as np
import pytest

from sksurrogate.kernels.output_error import output_error
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

ROWS, CURVATURE = 20, 0.8
#: The cost at the minimum: both residuals are 1 at ``a = 0``.
LEAST = 2.0 * ROWS


def fitted(**options):
    """``a + 1`` and ``0.8 a^2 + a - 1`` in every row: Gauss-Newton comes nearer by a factor 0.8 a step."""
    plant = ODESimulator(
        lambda t, x, u, p: [0.0 * x[0]], states=["q"], inputs=["u"], outputs=["first", "second"], params={"a": 0.3}, dt=1.0,
        output=lambda t, x, u, p: [p["a"] + 0.0 * x[0], CURVATURE * p["a"] ** 2 + p["a"] + 0.0 * x[0]],
    )  # fmt: skip
    inner = PlantModel(describe(plant))
    inner.probe(np.zeros(1))
    record = Record.from_runs([np.zeros((ROWS, 1))], [np.tile([-1.0, 1.0], (ROWS, 1))], [np.arange(float(ROWS))], 1.0)
    model = FitModel(inner, ["a"], record, 1, np.ones(1))
    bounds = np.array([-2.0]), np.array([2.0])
    return output_error(
        model, np.array([0.3]), np.zeros((1, ROWS)), np.ones(2), unit=np.ones(1), bounds=bounds, open_steps=0,
        max_steps=60, fit_start=False, **options,
    )  # fmt: skip


@pytest.mark.parametrize("idle", [2e-2, 5e-3])
def test_a_creeping_descent_ends_where_two_steps_take_next_to_nothing(idle):
    whole, early = fitted(), fitted(idle=idle, idle_above=0.0)
    assert whole.cost == pytest.approx(LEAST, rel=2e-3) and whole.converged
    assert early.n_iterations < whole.n_iterations and not early.converged
    # excess costs fall by 0.64 a step: what is left is a geometric series that begins below ``idle``
    assert early.cost - LEAST < idle * early.cost * 0.64 / (1.0 - 0.64)


def test_near_the_data_every_descent_goes_on():
    whole, near = fitted(), fitted(idle=1e-2, idle_above=10.0 * LEAST)
    assert near.n_iterations == whole.n_iterations and near.cost == whole.cost
