"""Names meet the effects that are asked late and do the same: closed forms in one balance, where a parameter that depends on a signal is
a product of signals, or a product and a wrong parameter."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.gap.screen._twins import twins
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ClosedLoopSimulator, ODESimulator, StepSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS = 0.1, 200, 3
NAMES = ["bilinear", "linear_loss", "quadratic_loss", "parameter_error", "parameter_dependence"]
DEPENDENCE = ("parameter_dependence", "k", "u")


def tanks(t, x, u, p):
    return p["feed"] - p["k"] * x[0] + 0.3 * u[0], x[0] - 0.8 * x[1]


def simulator():
    return ODESimulator(
        tanks, states=["x", "y"], inputs=["u"], outputs=["x", "y"], params={"k": 0.7, "feed": 1.0}, dt=DT
    )


def recorded(effects, values, seed=0):
    rng = np.random.default_rng(seed)
    plant = AugmentedSimulator(simulator(), effects, values)
    U = np.repeat(rng.uniform(-1.0, 1.0, (RUNS, N // 10, 1)), 10, axis=1)
    Y = np.stack([plant.simulate(u, x0=[1.0, 1.0]) for u in U])
    return U, Y + 0.01 * rng.normal(size=Y.shape)


def reported(effects, values, seed=0):
    U, Y = recorded(effects, values, seed)
    diagnoser = GapDiagnoser(simulator(), effects=NAMES, n_jobs=1, random_state=0)
    return diagnoser.fit(U.reshape(-1, 1), Y.reshape(-1, 2), groups=np.repeat(np.arange(RUNS), N)).report_


def keys(effect):
    return {(effect.name, effect.location, effect.variable), *(tuple(one[:3]) for one in effect.equivalents)}


def test_columns_tell_which_candidates_do_what_is_named():
    """- 0.2 k x - 0.3 k u x: both terms together are one dependence, the second alone too where the first follows, no other."""
    pair = CATALOGUE["parameter_error"]("k"), CATALOGUE["bilinear"]("x", "u*x")
    U, Y = recorded(pair, [{"relative_error": 0.2}, {"coefficient": -0.21}])
    plant = describe(simulator(), n_inputs=1, n_outputs=2, dt=DT)
    record = Record.from_runs(list(U), list(Y), [DT * np.arange(N)] * RUNS, DT)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("x", "y"))
    named = problem.fit(pair, np.array([0.2, -0.21]), smoothed.x)
    late = [CATALOGUE["parameter_dependence"](p, v) for p in ("k", "feed") for v in ("x", "y", "u")]
    found = [(one.places, one.effect.key) for one in twins(named, late, smoothed.x, named.fit.cost + 6.0)]
    assert [key for places, key in found if 1 in places] == [DEPENDENCE, DEPENDENCE]
    assert found.index(((0, 1), DEPENDENCE)) < found.index(((1,), DEPENDENCE))
    of_k = {(p, v) for places, (_, p, v) in found if places == (0,)}
    assert {("k", "x"), ("k", "y"), ("k", "u")} <= of_k  # they contain a wrong k


@pytest.mark.slow
def test_a_dependence_is_of_the_class_of_the_product_that_does_the_same():
    # - k (1 + c u + c2) x = - k x - k c u x, but for a c2 that these data hardly show
    report = reported([CATALOGUE["parameter_dependence"]("k", "u")], [{"slope": 0.3, "relative_error": 0.002}])
    assert report.verdict == "explained" and len(report.effects) == 1
    assert keys(report.effects[0]) >= {("bilinear", "x", "u*x"), DEPENDENCE}


@pytest.mark.slow
def test_a_dependence_takes_the_place_of_two_names_beside_a_third():
    # - k (1 + c u + c2) x = - k x - k c u x - k c2 x: a product and a wrong parameter
    report = reported(
        [CATALOGUE["parameter_dependence"]("k", "u"), CATALOGUE["quadratic_loss"]("y", "y")],
        [{"slope": 0.3, "relative_error": 0.2}, {"coefficient": 0.1}],
        seed=1,  # of some draws the two names are as likely as one time in nine, and no name is certain then
    )
    assert report.verdict == "explained" and len(report.effects) == 2
    found = [keys(effect) for effect in report.effects]
    assert any(DEPENDENCE in one for one in found) and any(("quadratic_loss", "y", "y") in one for one in found)
    slope, offset = next(e.params for e in report.effects if e.name == "parameter_dependence").values()
    assert (slope, offset) == (pytest.approx(0.3, abs=0.01), pytest.approx(0.2, abs=0.01))


def heated_loop(R):
    """A block that is heated by the square of the volts of a controller, which are below zero never and at zero often."""
    plant = ODESimulator(
        lambda t, x, u, p: [(u[0] ** 2 / p["R"] - 0.95 * (x[0] - 23.0)) / 40.0],
        states=["block"], inputs=["volts"], outputs=["block"], params={"R": R}, dt=1.0, x0=[40.0],
    )  # fmt: skip
    controller = StepSimulator(
        lambda t, x, u, p, dt: [np.clip(x[0] + 0.03 * (u[0] - u[1]), 0, 24)], states=["sum"], inputs=["aim", "block"],
        outputs=["volts"], output=lambda t, x, u, p: [np.clip(1.6 * (u[0] - u[1]) + x[0], 0, 24)], dt=1.0, x0=[8.0],
    )  # fmt: skip
    return ClosedLoopSimulator(plant, controller, outputs=["block", "volts"])


def test_no_force_along_the_path_where_a_port_has_no_slope():
    """At zero volts a small lack of heat would take hundreds of volts, and their square would be no small lack."""
    loop, aim = heated_loop(4.6), np.repeat([80.0, 45.0, 70.0, 40.0], 40)[:, None]
    plant = describe(loop, n_inputs=1, n_outputs=2, dt=1.0)
    y = heated_loop(5.6).simulate(aim) + np.random.default_rng(0).normal(0.0, 0.05, (len(aim), 2))
    record = Record.from_runs([aim], [y], [np.arange(float(len(aim)))], 1.0)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("block",))
    responses = Responses(problem.fit((), np.zeros(0), smoothed.x), smoothed.x)
    error, theta, start = CATALOGUE["parameter_error"]("R"), np.array([[0.1]]), smoothed.x[:, [0]]
    column = responses.columns(error, theta)[0][:, 0]
    runs = []
    for effects, values in (((error,), theta), ((), np.zeros((0, 1)))):
        model = problem.augmented(effects)
        runs.append(model.bind(values).outputs(free_run(model, values[:, 0], start)[:, None])[:, 0])
    moved = runs[0] - runs[1]
    assert plant.further_ports and np.abs(responses.along[0][0].values).max() < 24.0
    assert np.linalg.norm(column - moved) < 2.0 * np.linalg.norm(moved)  # to first order, in a loop that saturates
