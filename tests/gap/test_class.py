"""The class of a name: every effect whose prediction these data cannot tell from it."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator
from sksurrogate.runs import stack_runs

DT, N, RUNS = 0.05, 300, 4


def mass(gain=2.0, seen=1.0):
    return ODESimulator(
        lambda t, x, u, p: (x[1], p["gain"] * u[0] - p["stiffness"] * x[0] - p["damping"] * x[1]),
        states=["q", "v"], inputs=["f"], outputs=["q"], output=lambda t, x, u, p: (seen * x[0],),
        params={"gain": gain, "stiffness": 4.0, "damping": 0.5}, dt=DT,
    )  # fmt: skip


def recorded(plant, noise, seed):
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.normal(size=N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [np.array(plant.simulate(u)).reshape(N, 1) for u in U]
    sd = np.std(np.concatenate(Y))
    return stack_runs(U, [y + noise * sd * rng.normal(size=y.shape) for y in Y])


def names(effect):
    return {(effect.name, effect.location, effect.variable), *effect.equivalents}


@pytest.mark.slow
@pytest.mark.parametrize("gain, seen", [(0.3, 1.0), (2.0, 0.15)])
def test_the_gain_of_an_actuator_is_that_of_the_only_sensor_of_a_linear_plant(gain, seen):
    """Also a large one: what forces and initial states would do is distinguished, what the inputs do is not."""
    X, y, groups = recorded(mass(gain, seen), 0.005, 0)
    effects = [CATALOGUE["input_gain"]("f"), CATALOGUE["sensor_gain"]("q"), CATALOGUE["cubic_stiffness"]("v", "q")]
    report = GapDiagnoser(mass(), effects=effects, free_params="all", random_state=0).fit(X, y, groups=groups).report_
    (effect,) = report.effects
    assert {("input_gain", "f", None), ("sensor_gain", "q", None)} <= names(effect)
    assert not any(name == "cubic_stiffness" for name, *_ in names(effect))


def tank(exponent=1.0, coefficient=0.0):
    return ODESimulator(
        lambda t, x, u, p: (u[0] - p["out"] * x[0] - coefficient * np.maximum(x[0], 0.0) ** exponent,),
        states=["h"], inputs=["flow"], outputs=["h"], params={"out": 0.5}, x0=[2.0], dt=DT,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 4])
def test_a_power_that_the_data_hardly_tell_from_other_laws_is_in_their_class(seed):
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.uniform(0.5, 2.0, N // 30), 30)[:, None] for _ in range(RUNS)]
    Y = [np.array(tank(1.4, 0.002).simulate(u)).reshape(N, 1) for u in U]
    X, y, groups = stack_runs(U, [one + 0.03 * rng.normal(size=one.shape) for one in Y])
    effects = [
        CATALOGUE["bilinear"]("h", "flow*h"),
        CATALOGUE["power_law"]("h", "h"),
        CATALOGUE["linear_loss"]("h", "flow"),
    ]
    report = GapDiagnoser(tank(), effects=effects, random_state=0).fit(X, y, groups=groups).report_
    (effect,) = report.effects
    assert ("power_law", "h", "h") in names(effect)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance, simpler", [(0.1, [("quadratic_drag", "v", "v")]), (1e-3, [])])
def test_a_special_case_that_is_as_good_up_to_the_tolerance_is_of_the_class(tolerance, simpler):
    """A drag to the power 1.85 is a power law; up to a tenth of the gap it is a quadratic drag, up to a thousandth it is not."""

    def car(power):
        def rates(t, x, u, p):
            return (
                u[0] - p["c"] * x[0] - 0.2 * np.sign(x[0]) * np.abs(x[0]) ** power if power else u[0] - p["c"] * x[0],
            )

        return ODESimulator(rates, states=["v"], inputs=["u"], outputs=["v"], params={"c": 0.1}, dt=0.1)

    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(-1, 3, (2, 15, 1)), 10, axis=1)
    Y = [car(1.85).simulate(u) for u in U]
    X, y, groups = stack_runs(list(U), [y + 0.01 * np.std(Y) * rng.normal(size=y.shape) for y in Y])
    names = ["power_law", "quadratic_drag", "linear_loss"]
    diagnoser = GapDiagnoser(car(None), effects=names, tolerance=tolerance, random_state=0)
    (effect,) = diagnoser.fit(X, y, groups=groups).report_.effects
    assert (effect.name, effect.simpler, effect.equivalents) == ("power_law", simpler, simpler)
    assert effect.params["exponent"] == pytest.approx(1.85, abs=0.01)
    assert ("as good up to the tolerance" in str(diagnoser.report_)) == bool(simpler)
