"""A start as large as its column says: parameters that grow with the magnitude make the whole effect so many times as large."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.gap.screen._screen import grown
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe
from sksurrogate.runs import stack_runs

DT, N, RUNS = 0.05, 300, 3


def rhs(t, x, u, p):
    return x[1], 5.0 * u[0] - 3.0 * x[0] - 0.4 * x[1]


SIMULATOR = ODESimulator(rhs, states=["q", "v"], inputs=["f"], outputs=["q", "v"], params={}, dt=DT)


def bristles(u, stiffness, level, static, velocity, substeps=20):
    """The same with LuGre friction, by short steps."""
    s, h, out = np.zeros(3), DT / substeps, []

    def rates(s, value):
        q, v, z = s
        g = level + (static - level) * np.exp(-((v / velocity) ** 2))
        return np.array([v, 5.0 * value - 3.0 * q - 0.4 * v - stiffness * z, v - stiffness * abs(v) * z / g])

    for value in u:
        out.append(s[:2].copy())
        for _ in range(substeps):
            s = s + h * rates(s + 0.5 * h * rates(s, value), value)
    return np.array(out)


def recorded(seed, noise, *friction):
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.normal(size=N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [bristles(u[:, 0], *friction) for u in U]
    return U, [y + noise * rng.normal(size=y.shape) for y in Y]


@pytest.mark.parametrize("name, variable", [("lugre_friction", "v"), ("hysteresis", "q"), ("linear_loss", "v")])
def test_the_column_of_a_start_twice_as_large_is_twice_the_column(name, variable):
    U, Y = recorded(0, 0.01, 2.0, 0.4, 0.6, 0.5)
    plant = describe(SIMULATOR, n_inputs=1, n_outputs=2, dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("v",))
    null = estimate_noise(problem.fit((), np.zeros(0), smoothed.x), problem.first_noise())
    effect = CATALOGUE[name]("v", variable)
    start = np.array({"lugre_friction": (2.0, 0.4, 0.6, 0.5), "hysteresis": (2.0, 0.3), "linear_loss": (0.2,)}[name])
    columns, _ = Responses(null.candidate, smoothed.x).columns(
        effect, np.stack([start, grown(effect, start, 2.0)], axis=1)
    )
    np.testing.assert_allclose(columns[:, 1], 2.0 * columns[:, 0], rtol=1e-3, atol=1e-3 * np.max(np.abs(columns)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_bristles_that_hardly_give_way_are_told_beside_their_hysteresis(seed):
    """A weak friction: first starts of its levels were as large as the plant's own forces, and the fit ran away."""
    U, Y = recorded(seed, 0.02, 0.24, 0.05, 0.09, 0.25)
    places = [
        ("lugre_friction", "v", "v"),
        ("hysteresis", "v", "q"),
        ("coulomb_friction", "v", "v"),
        ("linear_loss", "v", "v"),
    ]
    effects = [CATALOGUE[name](location, variable) for name, location, variable in places]
    (effect,) = GapDiagnoser(SIMULATOR, effects=effects, random_state=0).fit(*stack_runs(U, Y)).report_.effects
    assert places[0] in {(effect.name, effect.location, effect.variable), *effect.equivalents}
