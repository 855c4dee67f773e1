"""Hidden states along a given path: against the same states in the whole model's free run."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.gap.screen._hidden_path import hidden_paths
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

SHAPES = {
    "hidden_relaxation": [(2.0, 0.5), (1.0, 3.0)],
    "hidden_mode": [(2.0, 1.5, 0.1), (3.0, 4.0, 2.0)],
    "hysteresis": [(2.0, 0.3), (1.0, 1.0)],
    "lugre_friction": [(20.0, 0.3, 0.5, 0.2), (5.0, 0.2, 0.2, 0.1)],
}


@pytest.mark.parametrize("size", [1.0, 1e-3])
@pytest.mark.parametrize(("name", "values"), SHAPES.items())
def test_hidden_states_are_those_of_the_whole_models_free_run(name, values, size):
    """Also where they are a thousand times larger than the size that is known beforehand."""

    def rhs(t, x, u, params):
        return np.stack([x[1], -2.0 * x[0] - 0.4 * x[1] + u[0]])

    plant = ODESimulator(rhs, states=["q", "v"], inputs=["force"], outputs=["q"], params={}, dt=0.05)
    t = 0.05 * np.arange(400)
    u = np.sin(1.3 * t) + 0.5 * np.sin(4.0 * t)
    record = Record(u[None], np.zeros((1, 400)), t, np.array([0, 200]), 0.05)
    effect = CATALOGUE[name]("v", "q" if name == "hidden_mode" else "v")
    model = AugmentedModel(
        PlantModel(describe(plant)), (effect,), (), record, n_sub=4, scale=size * np.array([0.5, 0.8])
    )
    theta = np.array(values).T
    for k in range(2):
        first = model.bind(theta[:, [k]]).start(np.array([[[0.5, -0.3]], [[0.0, 0.4]]]))[:, 0]
        whole = free_run(model, theta[:, k], first)
        found = hidden_paths(effect, model, theta, whole[:2])[:, k]
        spread = np.std(whole[2:], axis=1)
        assert np.all(np.sqrt(np.mean((found - whole[2:]) ** 2, axis=1)) < 0.02 * spread)
