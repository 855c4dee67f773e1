"""The likelihood of a noise fit has a top for coloured sensors and one for forces: from either start the higher is found."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

SIGMA, N = 0.01, 900


def ringing(t, x, u, p):
    return x[1], u[0] - p["stiffness"] * x[0] - p["damping"] * x[1]


@pytest.fixture
def shaken():
    """An oscillator that rings under a coloured force which nobody measures."""
    rng = np.random.default_rng(3)
    force = np.zeros(N)
    for k in range(1, N):
        force[k] = 0.9 * force[k - 1] + 0.1 * rng.normal()
    u = np.repeat(rng.uniform(-1, 1, (30, 1)), 30, axis=0)
    simulator = ODESimulator(
        ringing, dt=0.05, x0=[0.0, 0.0], states=["q", "v"], inputs=["u"], outputs=["q"],
        params={"stiffness": 9.0, "damping": 0.2},
    )  # fmt: skip
    y = simulator.simulate(u + force[:, None]).reshape(N, 1) + SIGMA * rng.normal(size=(N, 1))
    plant = describe(simulator, n_inputs=1, n_outputs=1, dt=0.05)
    record = Record.from_runs([u], [y], [0.05 * np.arange(N)], 0.05)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("v",))
    return problem, problem.fit((), np.zeros(0), smoothed.x)


def test_a_noise_fit_finds_the_force_from_a_start_that_blames_the_sensor(shaken):
    problem, candidate = shaken
    residual = float(np.std(problem.record.y - candidate.fit.y))
    assert residual > 2 * SIGMA
    forces = replace(problem.first_noise(), coloured=1e-2 * problem.sd)
    sensors = replace(forces, force=1e-5 * problem.force_unit(), coloured=np.array([residual]))
    found = [estimate_noise(candidate, start) for start in (forces, sensors)]
    assert found[0].log_likelihood == pytest.approx(found[1].log_likelihood, abs=1.0)
    for one in found:
        assert one.noise.sigma[0] == pytest.approx(SIGMA, rel=0.15)
        assert one.noise.coloured[0] < SIGMA
