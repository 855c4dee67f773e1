"""A force that hardly moves the outputs is numerics, whatever law it follows."""

import numpy as np

from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.unnamed._latent_force import LatentForce, law_of, moved_by
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS = 0.1, 300, 3


def relaxing(t, x, u, p):
    return u[0] - p["a"] * x[0], u[0] - p["b"] * x[1]


def test_a_law_counts_only_where_its_force_moves_the_outputs():
    rng = np.random.default_rng(2)
    plant = ODESimulator(
        relaxing, dt=DT, x0=[0.0, 0.0], states=["p", "q"], inputs=["u"], outputs=["p", "q"], params={"a": 1.0, "b": 0.7}
    )
    U = [np.repeat(rng.uniform(-1, 1, (N // 15, 1)), 15, axis=0) for _ in range(RUNS)]
    Y = [plant.simulate(u) + 0.01 * rng.normal(size=(N, 2)) for u in U]
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    described = describe(plant, n_inputs=1, n_outputs=2, dt=DT)
    problem, smoothed = build_problem(described, PlantModel(described), record, (), ("p", "q"))
    candidate = problem.fit((), np.zeros(0), smoothed.x)
    lawful, noise = 0.1 * smoothed.x[1] ** 3, 0.1 * rng.normal(size=record.n_samples)
    for size, counts in ((1.0, True), (0.01, False)):
        force = np.stack([noise, size * lawful])
        moved = moved_by(candidate.disturbance, force, problem.sd)
        latent = LatentForce(smoothed.x, force, problem.first_noise(), force.std(axis=1) / problem.rate + 0.01, moved)
        assert (moved[1] > 0.0225 * moved.sum()) == counts
        law = law_of(candidate, latent, 0)
        assert (law[1] > 0.5) if counts else law[1] == 0.0
        assert law[0] < 0.1
