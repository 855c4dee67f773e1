"""A fit that has left what its parameters show comes back: of friction at rest below that in motion no reading tells."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, starting
from sksurrogate.effects._stribeck_curve import LEAST_RATIO, stribeck_curve
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.kernels.arrow import Arrow
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N = 0.05, 200
CART = ODESimulator(
    lambda t, x, u, p: [x[1], u[0] - 2.0 * x[0] - 0.1 * x[1]],
    dt=DT, x0=[0.0, 0.0], states=["place", "speed"], inputs=["force"], outputs=["place"], params={},
)  # fmt: skip
STRIBECK, LUGRE = (CATALOGUE[name]("speed", "speed") for name in ("stribeck_friction", "lugre_friction"))
TRUTH = (0.3, 0.6, 0.4)
FLAT = (0.45, 0.0, 0.4)  #: Where neither the level at rest nor the velocity moves anything


@pytest.fixture(scope="module")
def problem():
    """A cart with friction that falls with its speed, and the smoothed states."""
    rng = np.random.default_rng(0)
    U = [np.repeat(rng.uniform(-3.0, 3.0, N // 20), 20)[:, None] for _ in range(2)]
    whole = AugmentedSimulator(CART, [STRIBECK], [TRUTH])
    Y = [whole.simulate(u).reshape(N, 1) + 0.002 * rng.normal(size=(N, 1)) for u in U]
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * 2, DT)
    plant = describe(CART, n_inputs=1, n_outputs=1, dt=DT)
    return build_problem(PlantModel(plant), record, (), ("speed",))


def test_a_fit_comes_back_from_where_parameters_do_nothing(problem):
    backend, smoothed = problem
    near = backend.fit((STRIBECK,), np.array(TRUTH), smoothed.x)
    flat = backend.fit((STRIBECK,), np.array(FLAT), smoothed.x)
    assert flat.fit.cost == pytest.approx(near.fit.cost, rel=1e-3)
    assert flat.fit.theta == pytest.approx(near.fit.theta, rel=1e-2)
    assert near.fit.theta[:2] == pytest.approx(TRUTH[:2], rel=0.1)


def test_what_ends_at_the_edge_is_no_stribeck_friction(problem):
    backend, smoothed = problem
    candidate = backend.fit((STRIBECK,), np.array(FLAT), smoothed.x, max_steps=1, open_steps=0)
    edge = backend.within((STRIBECK,), np.array(FLAT))
    assert edge == pytest.approx((FLAT[0], LEAST_RATIO * FLAT[0], FLAT[2]))
    assert candidate.fit.theta[1] >= LEAST_RATIO * candidate.fit.theta[0] * (1 - 1e-12)


@pytest.mark.parametrize("effect", [STRIBECK, LUGRE, starting(STRIBECK, ("onset",)), starting(LUGRE, ("onset", "end"))])
def test_every_parameter_moves_something_at_the_nearest_values(effect):
    """Of all parameters but those of the window, by the curve between the levels."""
    n = len(effect.parameters) - len(getattr(effect, "span", ()))
    flat = np.r_[np.array([2.0, *FLAT])[-n:], np.arange(len(effect.parameters) - n) + 1.0]
    nearest = np.array(effect.identifiable(flat))
    assert np.array_equal(nearest, effect.identifiable(nearest)), "it is its own nearest"
    assert np.array_equal(nearest[n:], flat[n:]), "the window stays"
    level, static, velocity = nearest[n - 3 : n]
    curve = stribeck_curve(np.linspace(0.0, 1.0, 50), level, static, velocity)
    for changed in (
        (level * 1.001, static, velocity),
        (level, static * 1.001, velocity),
        (level, static, velocity * 1.1),
    ):
        assert np.max(np.abs(stribeck_curve(np.linspace(0.0, 1.0, 50), *changed) - curve)) > 1e-5


def test_a_step_within_the_bounds_holds_no_parameter(problem, monkeypatch):
    """A sum of two numbers, less one of them, is not the other one to the last digit."""
    backend, smoothed = problem
    held, step = [], Arrow.step

    def watched(self, damping, hold):
        held.append(bool(np.isfinite(hold).any()))
        return step(self, damping, hold)

    monkeypatch.setattr(Arrow, "step", watched)
    backend.fit((STRIBECK,), np.array(TRUTH) * 1.05, smoothed.x)
    assert held and not any(held)
