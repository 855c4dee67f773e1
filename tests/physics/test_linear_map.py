"""Plants that are linear along their data are stepped exactly where parameters are fitted."""

import numpy as np
import pytest

from sksurrogate.kernels.record import Record
from sksurrogate.physics import CalibratedSimulator, ODESimulator
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._linear_map import LinearMap
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe


def oscillator(t, x, u, p):
    return x[1], u[0] + p["w"] - p["k"] * x[0] - p["d"] * x[1]


def simulator(rhs=oscillator, **options):
    params = {"k": 40.0, "d": 0.3, "w": 0.2, "c": 0.0}
    return ODESimulator(rhs, states=["q", "v"], inputs=["f"], outputs=["q"], params=params, dt=0.2, **options)


def model(plant, u, names=("k", "c"), n_sub=1):
    """A model over two runs of one input."""
    runs = np.array_split(u[:, None], 2)
    times = [np.arange(len(run)) * 0.2 for run in runs]
    record = Record.from_runs(runs, [np.zeros((len(run), 1)) for run in runs], times, 0.2, None, False)
    return FitModel(PlantModel(describe(plant)), list(names), record, n_sub, np.ones(2))


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_a_step_is_that_of_the_matrix_exponential(hold):
    """Two ways to one number: the simulator's own exact run, and one substep of this map, which Runge-Kutta misses by far."""
    u = np.random.default_rng(0).normal(size=60)
    fit = model(simulator(hold=hold), u)
    exact = simulator(hold=hold, method="exact", output=lambda t, x, u, p: x).set_params(outputs=["a", "b"])
    x = exact.simulate(u[:30, None], x0=[0.4, -1.0]).T
    both = np.concatenate([x, x], axis=1)
    after = fit.bind(np.array([[40.0], [0.0]]))(both[:, None])[:, 0]
    assert np.allclose(after[:, :29], x[:, 1:], rtol=0, atol=1e-12)
    fit.inner.bent = True
    assert np.max(np.abs(fit.bind(np.array([[40.0], [0.0]]))(both[:, None])[:, 0, :29] - x[:, 1:])) > 1e-3


def test_every_column_has_its_own_parameters():
    """Columns of other parameters are those of a plant with these parameters, and columns of moved states those of its map."""
    u = np.random.default_rng(1).normal(size=60)
    fit = model(simulator(), u)
    x = np.random.default_rng(2).normal(size=(2, 4, 60))
    theta = np.array([[40.0, 40.0, 44.0, 50.0], np.zeros(4)])
    together = fit.bind(theta)(x)
    for j in range(4):
        assert np.allclose(together[:, j], fit.bind(theta[:, j : j + 1])(x[:, j : j + 1])[:, 0], rtol=0, atol=1e-12)


def cubic(t, x, u, p):
    return x[1], u[0] - p["k"] * x[0] - p["c"] * x[0] ** 3


def stop(t, x, u, p):
    return x[1], u[0] - p["k"] * x[0] - 100.0 * np.maximum(x[0] - 0.9, 0.0)


def clock(t, x, u, p):
    return x[1], u[0] - p["k"] * x[0] + 0.1 * np.sin(t)


@pytest.mark.parametrize(("rhs", "theta"), [(cubic, [0.0, 0.0]), (stop, [40.0, 0.0]), (clock, [40.0, 0.0])])
def test_what_is_linear_in_a_part_only_is_not_stepped_as_linear(rhs, theta):
    """A spring that is linear at the first parameters, a stop that few samples reach, a force of time."""
    rng = np.random.default_rng(3)
    fit = model(simulator(rhs), rng.normal(size=60), n_sub=4)
    columns = np.repeat(np.array(theta)[:, None], 3, axis=1)
    columns[1, 2] += 1e-4  # as differences by parameters have it
    x = rng.uniform(-0.5, 0.5, (2, 3, 60))
    x[0, 0, 41] = 1.0
    moved = fit.bind(columns)(x)
    assert fit.inner.bent
    again = model(simulator(rhs), fit.record.u[0], n_sub=4)
    again.inner.bent = True
    assert np.array_equal(moved, again.bind(columns)(x))


def test_a_stiff_network_is_fitted_exactly():
    """Recovery: two capacitors, time constants 2e4 apart; Runge-Kutta would need ten thousand substeps."""

    def network(t, x, u, p):
        return 1e4 * p["a"] * (u[0] - x[0]), p["b"] * (x[0] - x[1])

    plant = ODESimulator(
        network,
        states=["fast", "slow"],
        inputs=["u"],
        outputs=["slow"],
        params={"a": 1.3, "b": 0.6},
        dt=0.5,
        method="exact",
    )
    U = np.repeat(np.random.default_rng(4).normal(size=40), 5)[:, None]
    Y = plant.simulate(U, x0=[0.2, -0.4])
    fitted = CalibratedSimulator(plant.set_params(params__b=1.0, method="auto"), params=["b"]).fit(U, Y[:, 0])
    assert fitted.params_["b"] == pytest.approx(0.6, rel=1e-4)


def test_signals_that_stand_still_need_no_range():
    """An input that never moves, and a state that does not."""
    still = LinearMap(lambda t, x, u, theta: -theta * x + u, np.arange(5.0), np.full((1, 5), 2.0), None, 0.1)
    after = still.after(np.full((1, 1, 5), 2.0), np.ones((1, 1)))
    assert np.allclose(after, 2.0, rtol=0, atol=1e-15)


def test_rates_that_are_roundings_near_rest_do_not_hide_a_linear_plant():
    """Three parts warm up together, in kelvin, until one is heated: until then what flows between them is a difference of equal numbers."""
    flows = lambda t, x, u, theta: np.array([u[0], u[0], theta[0] * (0.1 * x[0] + 0.2 * x[1] - 0.3 * x[2])])  # noqa: E731
    late = np.arange(40) >= 30
    x = 293.7 + 0.01 * np.arange(40) + np.array([[0.0], [0.0], [1.0]]) * late
    parts = LinearMap(flows, np.arange(40.0), np.full((1, 40), 0.1), None, 0.1)
    assert parts.after(x[:, None], np.ones((1, 1))) is not None
