"""Large plants and many runs: what is near is asked first, columns are made in blocks, a value in every run costs no square."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._onset import starting
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.faults._corrections import Gains, Hum
from sksurrogate.gap.faults._proposals import proposals
from sksurrogate.gap.fit import _neighbours as neighbourhood
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.screen import _screen
from sksurrogate.gap.unnamed._law_places import in_all_places
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, RUNS, N = 0.2, 3, 60


def row(t, x, u, p):
    """Each state is driven by the one before."""
    return [u[0] - x[0], x[0] - x[1], x[1] - x[2]]


def masses(t, x, u, p):
    """Two masses on springs; the second is pulled by the spring between them."""
    return [x[1], u[0] - 2.0 * x[0] + x[2], x[3], x[0] - 2.0 * x[2]]


def simulator(law=row, states=("a", "b", "c"), outputs=("a", "b", "c")):
    return ODESimulator(law, states=list(states), inputs=["u"], outputs=list(outputs), params={}, dt=DT)


def runs(effect, values, seed=0):
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.uniform(-2, 2, N // 6), 6)[:, None] for _ in range(RUNS)]
    plant = AugmentedSimulator(simulator(), [effect], [values])
    Y = [plant.simulate(u) + 0.01 * rng.normal(size=(N, 3)) for u in U]
    return U, Y


def problem_of(U, Y):
    plant = describe(simulator(), n_inputs=1, n_outputs=3, dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    return build_problem(PlantModel(plant), record, (), plant.states)


@pytest.fixture
def small(monkeypatch):
    """Plants of more than two states are large."""
    monkeypatch.setattr(neighbourhood, "SMALL_PLANT", 2)


def test_neighbours_are_the_states_that_a_rate_sees_or_that_see_it(small):
    x, u, t = np.random.default_rng(0).normal(size=(3, 50)), np.ones((1, 50)), DT * np.arange(50)
    near = neighbourhood.neighbours(PlantModel(describe(simulator(), n_inputs=1, n_outputs=3, dt=DT)), t, x, u)
    assert near == {"a": frozenset("ab"), "b": frozenset("abc"), "c": frozenset("bc")}


def test_a_position_and_its_speed_are_one_neighbour(small):
    plant = describe(simulator(masses, ["q", "v", "r", "w"], ["q", "r"]), n_inputs=1, n_outputs=2, dt=DT)
    x, u, t = np.random.default_rng(0).normal(size=(4, 50)), np.ones((1, 50)), DT * np.arange(50)
    near = neighbourhood.neighbours(PlantModel(plant), t, x, u)
    assert near["v"] == near["w"] == {"q", "v", "r", "w"}  # the rates of v and w see positions only


def test_all_states_of_a_small_plant_are_near():
    x, u, t = np.zeros((3, 50)), np.ones((1, 50)), DT * np.arange(50)
    assert not neighbourhood.neighbours(PlantModel(describe(simulator(), n_inputs=1, n_outputs=3, dt=DT)), t, x, u)


def test_laws_stand_where_their_signals_are_near(small):
    problem, smoothed = problem_of(*runs(CATALOGUE["linear_loss"]("b", "b"), {"coefficient": 0.3}))
    places = {law.place for law in in_all_places(problem.fit((), np.zeros(0), smoothed.x)) if law.kind == "state"}
    assert {("a", "b"), ("a", "u"), ("a", "b*u"), ("b", "a*c")} <= places
    assert not {("a", "c"), ("c", "a"), ("a", "a*c"), ("c", "c*a")} & places


@pytest.mark.slow
@pytest.mark.parametrize("place, signal", [("a", "b"), ("a", "c")])
def test_an_effect_is_named_whether_its_signal_is_near_or_not(small, place, signal):
    U, Y = runs(CATALOGUE["cubic_stiffness"](place, signal), {"coefficient": 0.8})
    diagnoser = GapDiagnoser(simulator(), n_jobs=1, random_state=0)
    report = diagnoser.fit(np.concatenate(U), np.concatenate(Y), groups=np.repeat(np.arange(RUNS), N)).report_
    assert report.verdict == "explained"
    assert [(e.name, e.location, e.variable) for e in report.effects] == [("cubic_stiffness", place, signal)]


def test_a_screen_in_blocks_is_the_screen_of_all(monkeypatch):
    problem, smoothed = problem_of(*runs(CATALOGUE["cubic_stiffness"]("b", "b"), {"coefficient": 0.3}))
    null = problem.fit((), np.zeros(0), smoothed.x)
    library = [
        CATALOGUE[n](a, b) for n in ("linear_loss", "coulomb_friction", "hysteresis") for a in "abc" for b in "abc"
    ]
    whole = _screen.screen(library, null, smoothed.x, problem.first_noise())
    monkeypatch.setattr(_screen, "MOST_NUMBERS_AT_ONCE", 10_000)
    parts = _screen.screen(library, null, smoothed.x, problem.first_noise())
    assert [s.effect for s in parts.starts] == [s.effect for s in whole.starts]
    for name in ("white", "forced", "left"):
        ours, wanted = ([getattr(s, name) for s in one.starts] for one in (parts, whole))
        np.testing.assert_allclose(ours, wanted, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(parts.columns, whole.columns)
    np.testing.assert_allclose(parts.left_by, whole.left_by, rtol=1e-4)
    # With little room the best starting values of every effect stay.
    monkeypatch.setattr(_screen, "MOST_NUMBERS_KEPT", whole.columns[0].size * len(library))
    few = _screen.screen(library, null, smoothed.x, problem.first_noise())
    best = {}
    for one in whole.starts:
        best[one.effect.key] = max(best.get(one.effect.key, 0.0), one.white, one.forced)
    assert {one.effect.key: max(one.white, one.forced) for one in few.starts} == pytest.approx(best)
    assert len(few.columns) == len(best)


def test_a_screen_holds_its_columns_hardly_more_than_twice():
    """As they come and over the noise, of many starting values of one effect; some temporary arrays beside."""
    problem, smoothed = problem_of(*runs(CATALOGUE["cubic_stiffness"]("b", "b"), {"coefficient": 0.3}))
    null, library = (
        problem.fit((), np.zeros(0), smoothed.x),
        [starting(CATALOGUE["input_quantization"]("u"), ("onset", "end"))],
    )
    tracemalloc.start()
    found = _screen.screen(library, null, smoothed.x, None)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(found.starts) > 1000 and peak < 2.5 * 8 * found.columns.size


def test_a_fault_has_values_in_the_runs_that_are_seen():
    """Of a long record the diagnosis sees some of the runs."""
    n, rng = 40, np.random.default_rng(0)
    run = np.repeat([2, 5, 9], n)
    starts, t = n * np.arange(3), np.tile(DT * np.arange(n), 3)
    phase = 2.0 * t + np.repeat([0.0, 1.0, 2.0], n)
    y = np.sin(phase)[None] + 0.01 * rng.normal(size=(1, 3 * n))
    record = Record(y, np.zeros((0, 3 * n)), t, starts, DT)
    found = list(proposals(record, run, 1.0 + 0.0 * y, y))
    hum, gains = (
        found[-1],
        next(one for one in found if one.n_weights == 1 and isinstance(one.fault(np.ones(1) * 0.1), Gains)),
    )
    assert hum.n_weights == 6 and hum.columns.shape[1] == 2
    fault = hum.fault(np.arange(6.0))
    assert isinstance(fault, Hum)
    np.testing.assert_array_equal(fault.values[[2, 5, 9]], np.arange(6.0).reshape(3, 2))
    assert len(fault.values) == 10 and not fault.values[[0, 1, 3, 4, 6, 7, 8]].any()
    np.testing.assert_array_equal(gains.fault(np.array([0.1])).values, 0.1 * (np.arange(10) == 2))


def test_of_many_starting_values_the_best_of_every_effect_are_kept():
    """Of a sine both quadratures of its best frequencies, and what is evident."""
    sine, lag = CATALOGUE["periodic_disturbance"]("x"), CATALOGUE["hidden_relaxation"]("x", "x")

    def start(effect, theta, white, evident=False):
        return SimpleNamespace(effect=effect, theta=np.array(theta), promises=white, evident=evident)

    starts = [
        *(start(sine, (1.0, w, phase), 10.0 * w + phase) for w in (3.0, 1.0, 2.0) for phase in (0.0, 1.5)),
        start(lag, (1.0, 5.0), 1.0),
        start(lag, (1.0, 6.0), 2.0),
        start(lag, (1.0, 7.0), 0.0, evident=True),
    ]
    assert list(_screen._best_of_each(starts, 1)) == [0, 1, 7, 8]
    assert list(_screen._best_of_each(starts, 2)) == [0, 1, 4, 5, 6, 7, 8]


def test_in_a_robot_speed_and_position_of_a_joint_are_near_each_other(small):
    pytest.importorskip("mujoco")
    from sksurrogate.physics import MuJoCoSimulator

    link = '<body name="{0}"><joint name="{0}" axis="0 1 0"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="1"/>{1}</body>'
    body = link.format("upper", link.format("lower", ""))
    motor = '<actuator><motor name="motor" joint="upper"/></actuator>'
    arm = MuJoCoSimulator(f"<mujoco><worldbody>{body}</worldbody>{motor}</mujoco>", dt=0.01)
    plant = describe(arm, n_inputs=1, n_outputs=4, dt=0.01)
    near = neighbourhood.neighbours(PlantModel(plant), np.zeros(1), np.zeros((4, 1)), np.zeros((1, 1)))
    joints = ({f"{name}.pos", f"{name}.vel"} for name in ("upper", "lower"))
    assert near == {name: joint for joint in joints for name in joint}
