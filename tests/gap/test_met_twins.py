"""Effects that do what some of a set do, and the sets that meet them: closed forms on linear plants, and slopes where a plant is not linear."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.screen._twins import twins
from sksurrogate.gap.search._base import EQUAL
from sksurrogate.gap.search._met_twins import met_twins
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS, NOISE = 0.1, 200, 3, 0.01


def motor(t, x, u, p):
    """Current and speed: L = J = 1, R = 1, torque constant 0.8, friction 0.5."""
    return u[0] - x[0] - 0.8 * x[1], 0.8 * x[0] - 0.5 * x[1]


def cubic(t, x, u, p):
    """A cubic loss of what comes in; the second input is small."""
    return (u[0] - x[0] ** 3,)


def plant_of(rhs, states, inputs):
    return ODESimulator(rhs, states=states, inputs=inputs, outputs=states, params={}, dt=DT, x0=[0.5] * len(states))


def problem_of(simulator, effect, values, sizes, seed=0):
    """What a plant with an effect was measured to do, for the simulator without it; the smoothed trajectory too."""
    rng, inputs = np.random.default_rng(seed), len(sizes)
    U = np.repeat(rng.uniform(-1.0, 1.0, (RUNS, N // 10, inputs)), 10, axis=1) * sizes
    plant = AugmentedSimulator(simulator, [effect], [values])
    Y = np.stack([plant.simulate(u) for u in U])
    Y = Y + NOISE * rng.normal(size=Y.shape)
    record = Record.from_runs(list(U), list(Y), [DT * np.arange(N)] * RUNS, DT)
    described = describe(simulator, n_inputs=inputs, n_outputs=Y.shape[2], dt=DT)
    return build_problem(PlantModel(described), record, (), described.states)


def test_a_bias_of_the_input_does_what_a_load_and_a_wrong_reading_do():
    """A bias b of the volts moves both states to where A x = - B b; a load that moves the speed as far, and a reading that is off by the
    rest of the current, give the same outputs after the initial states have followed."""
    simulator, bias = plant_of(motor, ["current", "speed"], ["volts"]), 0.3
    problem, smoothed = problem_of(simulator, CATALOGUE["input_bias"]("volts"), {"value": bias}, [1.0])
    pair = CATALOGUE["sensor_bias"]("current"), CATALOGUE["constant_bias"]("speed")
    A, volts, load = np.array([[-1.0, -0.8], [0.8, -0.5]]), np.array([1.0, 0.0]), np.array([0.0, 1.0])
    moved, by_load = np.linalg.solve(-A, volts) * bias, np.linalg.solve(-A, load)
    size = moved[1] / by_load[1]
    named = problem.fit(pair, np.array([moved[0] - size * by_load[0], size]), smoothed.x)
    others = [
        CATALOGUE["input_bias"]("volts"),
        CATALOGUE["sensor_bias"]("speed"),
        CATALOGUE["linear_loss"]("speed", "speed"),
    ]
    found = [one for one in twins(named, others, smoothed.x, named.fit.cost + EQUAL) if one.places == (0, 1)]
    assert [one.effect.name for one in found] == ["input_bias"]
    assert found[0].theta[0] == pytest.approx(bias, abs=0.01)

    search = OdeSearch(problem, [*pair, *others], smoothed.x)
    search.fit_null()
    stands = met_twins(search, search.stand(search.polish(named)))
    assert [effect.name for effect in stands.effects] == ["input_bias"]
    assert stands.candidate.fit.theta[0] == pytest.approx(bias, abs=0.01)


def test_slopes_tell_twins_where_the_plant_is_not_linear():
    """- c u2 in the balance is u1 - c u2 at the input: to first order and exactly, also where an input as large as the first would send
    the plant far away along its cubic."""
    simulator, c = plant_of(cubic, ["x"], ["u1", "u2"]), 0.5
    loss, coupling = CATALOGUE["linear_loss"]("x", "u2"), CATALOGUE["input_coupling"]("u1", "u2")
    problem, smoothed = problem_of(simulator, loss, {"coefficient": c}, [3.0, 0.05])
    named = problem.fit((loss,), np.array([c]), smoothed.x)
    (found,) = twins(named, [coupling], smoothed.x, np.inf)
    assert found.left == pytest.approx(named.fit.cost, rel=1e-6)
    assert found.theta[0] == pytest.approx(-c, rel=0.2)


def test_a_set_pays_for_each_name():
    """Of two sets of as many numbers that leave the same, the one of fewer names is likelier, by the choice of one more."""
    simulator = plant_of(motor, ["current", "speed"], ["volts"])
    problem, smoothed = problem_of(simulator, CATALOGUE["input_bias"]("volts"), {"value": 0.3}, [1.0])
    one = CATALOGUE["coulomb_friction"]("speed", "speed"), CATALOGUE["power_law"]("speed", "speed")
    library = [*one, CATALOGUE["linear_loss"]("speed", "speed"), CATALOGUE["constant_bias"]("speed")]
    search = OdeSearch(problem, library, smoothed.x)
    single = problem.fit((one[1],), np.array([0.1, 1.5]), smoothed.x)
    several = problem.fit((library[2], library[3]), np.array([0.1, 0.0]), smoothed.x)
    assert single.n_parameters == several.n_parameters
    assert search.price(several) - search.price(single) == pytest.approx(np.log(len(library)))
