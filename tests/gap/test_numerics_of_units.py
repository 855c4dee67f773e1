"""Substeps of a diagnosis do not depend on the unit of a state."""

import numpy as np
import pytest

from sksurrogate.gap.fit._build import build_problem
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

T = 0.2 * np.arange(200)
U = np.sign(np.sin(0.7 * T))[:, None]


def substeps_of(unit):
    """Of a mass on a stiff spring whose speed nobody measures, in another unit."""

    def rhs(t, x, u, p):
        return x[1] / unit, unit * (4.0 * u[0] - 9.0 * x[0] - 0.5 * x[1] / unit)

    plant = ODESimulator(rhs, states=["q", "v"], inputs=["f"], outputs=["q"], params={}, dt=0.2)
    y = plant.simulate(U) + 0.01 * np.random.default_rng(0).normal(size=(200, 1))
    described = describe(plant, n_inputs=1, n_outputs=1, dt=0.2)
    problem, _ = build_problem(PlantModel(described), Record.from_runs([U], [y], [T], 0.2), (), ("v",))
    return problem.numerics.n_sub


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_substeps_are_those_of_another_unit(unit):
    assert substeps_of(unit) == substeps_of(1.0) > 1
