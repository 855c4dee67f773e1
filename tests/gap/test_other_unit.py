"""A sample time in another unit than the simulator's rates is said so."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.exceptions import SimulatorError
from sksurrogate.gap import GapDiagnoser, _pipeline
from sksurrogate.gap._pipeline import DiagnosisPipeline
from sksurrogate.gap.fit._explained import OtherWriting, explained
from sksurrogate.gap.fit._other_columns import divided
from sksurrogate.gap.fit._other_unit import _slower, other_unit
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

U = np.repeat(np.random.default_rng(0).uniform(-1, 1, (40, 1)), 8, axis=0)
RUNS = np.repeat([0, 1], 160)


def swing(t, x, u, p):
    return x[1], u[0] - 4.0 * x[0] - 0.6 * x[1]


def plant(dt):
    return ODESimulator(swing, states=["q", "v"], inputs=["u"], outputs=["q"], params={}, dt=dt)


def measured(gain=1.0):
    y = np.concatenate([plant(0.1).simulate(gain * U[k == RUNS]) for k in (0, 1)])
    return y + 2e-3 * np.random.default_rng(1).normal(size=y.shape)


def said(dt, y):
    runs = [[v[k == RUNS] for k in (0, 1)] for v in (U, y)]
    record = Record.from_runs(*runs, [dt * np.arange(160)] * 2, dt)
    return other_unit(PlantModel(describe(plant(dt))), record).sentence


@pytest.mark.parametrize(
    ("dt", "words"),
    [
        (1e-4, "1000 times longer"),
        (100.0, "1000 times shorter"),
        (0.1 / 60, "60 times longer"),
        (6.0, "60 times shorter"),
        (0.1 / 3600, "3600 times longer"),
        (360.0, "3600 times shorter"),
        (1e-7, "1e+06 times longer"),
        (1e5, "1e+06 times shorter"),
        (0.1 / 86400, "86400 times longer"),
        (2.4, "24 times shorter"),
    ],
)
def test_another_unit_of_time_is_found(dt, words):
    assert words in said(dt, measured()) and "dt=0.1." in said(dt, measured())
    assert words in said(dt, measured(0.7))  # beside a real gap


def test_the_right_unit_of_time_is_not_doubted():
    assert said(0.1, measured()) == said(0.1, measured(0.5)) == said(0.1, measured(-1.0)) == ""
    assert said(0.1, np.random.default_rng(3).normal(size=(320, 1))) == ""


def test_a_simulator_that_stands_still_is_in_no_other_unit_of_time():
    """It grows without the missing cube; runs that settle near their starts are explained by any time in which it hardly moves."""
    simulator = ODESimulator(lambda t, x, u, p: [4.0 * x[0]], states=["x"], inputs=[], outputs=["x"], params={}, dt=0.1)
    starts, t = np.array([-1.3, -0.8, 0.7, 1.2]), 0.1 * np.arange(60)
    y = [(s / np.sqrt(s**2 + (1.0 - s**2) * np.exp(-8.0 * t)))[:, None] for s in starts]  # of dx/dt = 4 (x - x^3)
    record = Record.from_runs([np.zeros((60, 0))] * 4, y, [t] * 4, 0.1)
    model = PlantModel(describe(simulator))
    assert explained(model, _slower(record, 1e-3)) > 0.9 and explained(model, record) < 0.0
    assert other_unit(model, record).sentence == ""


class Stepper:
    """The same plant as a simulator that takes its own steps, and counts them."""

    states, inputs, outputs, x0, dt = ["q", "v"], ["u"], ["q"], [0.0, 0.0], 0.1
    params: dict = {}
    timestep, exact_step = 0.05, True

    def __init__(self, dt=0.1):
        self.dt, self.longest = dt, 0.0

    def step(self, t, x, u, p, dt):
        self.longest = max(self.longest, dt)
        n = max(1, round(dt / self.timestep))
        for _ in range(n):
            k1 = np.array(swing(t, x, u, p))
            x = x + dt / n * np.array(swing(t, x + 0.5 * dt / n * k1, u, p))
        return x

    def simulate(self, U, x0=None, t=None):
        x, out = np.zeros(2) if x0 is None else np.array(x0, dtype=float), []
        for u in U:
            out.append(x[:1])
            x = self.step(0.0, x, u, {}, self.dt)
        return np.array(out)


@pytest.mark.slow
def test_a_simulator_with_its_own_step_is_asked_for_no_longer_sample():
    simulator, y = Stepper(), np.random.default_rng(3).normal(size=(320, 1))
    runs = [[v[k == RUNS] for k in (0, 1)] for v in (U, y)]
    record = Record.from_runs(*runs, [0.1 * np.arange(160)] * 2, 0.1)
    assert other_unit(PlantModel(describe(simulator)), record).sentence == ""
    assert simulator.longest <= 0.1  # 3600 times longer would cost 3600 times as much
    record = Record.from_runs(
        [runs[0][0], runs[0][1]], [measured()[k == RUNS] for k in (0, 1)], [100.0 * np.arange(160)] * 2, 100.0
    )
    assert "1000 times shorter" in other_unit(PlantModel(describe(Stepper(100.0))), record).sentence


@pytest.mark.slow
def test_a_diagnosis_says_so_in_a_note_or_in_the_error():
    with pytest.raises(SimulatorError, match=r"1000 times shorter .* Write dt=0\.1\."):
        GapDiagnoser(plant(100.0), effects=["input_gain"], n_jobs=1).fit(U, measured(), groups=RUNS)
    for effects in (["input_gain"], None):
        diagnoser = GapDiagnoser(plant(1e-4), effects=effects, n_jobs=1, random_state=0)
        report = diagnoser.fit(U, measured(), groups=RUNS).report_
        assert (report.verdict, report.reasons.rule, report.effects) == ("unknown", "other_unit", [])
        assert any("1000 times longer" in note for note in report.notes)
        assert "another unit" in report.sentence and "with a sample time 1000 times longer." in report.sentence


def pendulums(t, x, u, p):
    return x[2], x[3], u[0] - 9.0 * np.sin(x[0]) - 0.6 * x[2], 9.0 * (u[1] - np.sin(x[1])) - 0.5 * x[3]


NAMES = {"states": ["q1", "q2", "v1", "v2"], "inputs": ["torque", "target"], "outputs": ["q1", "q2"]}


def looked_at(U, Y):
    record = Record.from_runs(U, Y, [0.05 * np.arange(120)] * 2, 0.05)
    return other_unit(PlantModel(describe(ODESimulator(pendulums, **NAMES, params={}, dt=0.05))), record).sentence


def swinging():
    rng = np.random.default_rng(4)
    U = [np.repeat(rng.uniform(-6, 6, (10, 2)) * [1.0, 0.15], 12, axis=0) for _ in range(2)]
    simulator = ODESimulator(pendulums, **NAMES, params={}, dt=0.05)
    Y = [simulator.simulate(u, x0=[0.4, -0.3, 0.0, 0.0]) for u in U]
    return U, [y + 2e-3 * rng.normal(size=y.shape) for y in Y]


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ((180 / np.pi, 180 / np.pi), "q1, q2 taken from degrees to radians"),
        ((1.0, 180 / np.pi), "q2 taken from degrees to radians"),
        ((1000.0, 1.0), "q1 divided by 1000"),
        ((0.01, 0.01), "q1, q2 times 100"),
    ],
)
def test_readings_in_another_unit_are_found(factors, words):
    U, Y = swinging()
    found = looked_at(U, [y * factors for y in Y])
    assert f"With {words} the simulator alone explains 100 %" in found and "Convert these columns" in found


def test_readings_and_inputs_in_degrees_are_found():
    U, Y = swinging()
    U, Y = [np.degrees(u) for u in U], [np.degrees(y) for y in Y]
    assert "With torque, target, q1, q2 taken from degrees to radians" in looked_at(U, Y)


def test_readings_in_the_right_unit_are_not_doubted():
    U, Y = swinging()
    assert looked_at(U, Y) == looked_at(U, [0.7 * y for y in Y]) == looked_at(U, [-y for y in Y]) == ""


@pytest.mark.slow
def test_a_diagnosis_of_degrees_says_so():
    U, Y = swinging()
    simulator = ODESimulator(pendulums, **NAMES, params={}, dt=0.05)
    diagnoser = GapDiagnoser(simulator, n_jobs=1, random_state=0)
    report = diagnoser.fit(np.concatenate(U), np.degrees(np.concatenate(Y)), groups=np.repeat([0, 1], 120)).report_
    assert (report.verdict, report.reasons.rule, report.effects) == ("unknown", "other_unit", [])
    assert any("from degrees to radians" in note for note in report.notes)
    assert "Diagnose again with q1, q2 taken from degrees to radians." in report.sentence


@pytest.mark.slow
def test_a_plant_that_only_moves_less_is_in_no_other_unit():
    """A bumper keeps a pendulum from falling over: the simulator of small motions does better than the simulator, in any small unit."""

    def falling(t, x, u, p):
        bumper = p["k"] * np.logaddexp(0.0, (x[0] - 0.8) / 0.03) * 0.03
        return x[1], 2.5 * u[0] - 1.25 * x[1] - 15.0 * np.sin(x[0]) - 2.5 * bumper

    plant = ODESimulator(falling, states=["q", "v"], inputs=["torque"], outputs=["q"], params={"k": 80.0}, dt=0.02)
    U = [np.repeat(np.random.default_rng(seed).uniform(-5, 5.5, (12, 1)), 20, axis=0) for seed in range(3)]
    record = Record.from_runs(U, [plant.simulate(u) for u in U], [0.02 * np.arange(240)] * 3, 0.02)
    nominal = PlantModel(describe(plant.set_params(params__k=0.0)))
    assert explained(nominal, record) < 0.0
    assert explained(nominal, divided(record, np.full(1, 1000.0), np.full(1, 1000.0))) > 0.5
    assert other_unit(nominal, record).sentence == ""


@pytest.mark.slow
def test_a_simulator_at_its_limits_is_in_no_other_unit():
    """A drag is missing. With all signals a thousand times larger the input of the simulator stands at its limit: its sign is left."""

    def rhs(drag):
        return lambda t, x, u, p: (
            x[1],
            np.maximum(u[0], -100.0) - 4.0 * x[0] - 0.3 * x[1] - drag * np.abs(x[1]) * x[1],
        )

    names = {"states": ["q", "v"], "inputs": ["u"], "outputs": ["q"], "params": {}, "dt": 0.05}
    U = [np.repeat(np.random.default_rng(seed).uniform(-3, 3, (20, 1)), 15, axis=0) for seed in range(4)]
    Y = [ODESimulator(rhs(0.8), **names).simulate(u) for u in U]
    record, nominal = (
        Record.from_runs(U, Y, [0.05 * np.arange(300)] * 4, 0.05),
        PlantModel(describe(ODESimulator(rhs(0.0), **names))),
    )
    assert (
        explained(nominal, divided(record, np.full(1, 1e-3), np.full(1, 1e-3)))
        > max(explained(nominal, record), 0.0) + 0.5
    )
    assert other_unit(nominal, record).sentence == ""


def heated(t, x, u, p):
    return 0.1 * u[0] - 0.2 * (x[0] - x[1]), 0.1 * (x[0] - x[1]) - 0.05 * (x[1] - u[1])


def room(change):
    """A heater in a room, its power and the temperature outside given, as ``change`` writes them down."""
    rng = np.random.default_rng(5)
    simulator = ODESimulator(
        heated, states=["heater", "air"], inputs=["power", "outside"], outputs=["heater", "air"], params={}, dt=1.0
    )
    U = [np.repeat(np.c_[rng.uniform(0, 100, 12), rng.uniform(0, 15, 12)], 10, axis=0) for _ in range(2)]
    Y = [simulator.simulate(u, x0=[20.0, 15.0]) for u in U]
    U, Y = zip(*(change(u.copy(), y + 0.1 * rng.normal(size=y.shape)) for u, y in zip(U, Y)))
    record = Record.from_runs(list(U), list(Y), [np.arange(120.0)] * 2, 1.0)
    return other_unit(PlantModel(describe(simulator)), record).sentence


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda u, y: (u * [1000.0, 1.0], y), "power divided by 1000"),
        (lambda u, y: (u + [0.0, 273.15], y), "273.15 taken from outside"),
        (lambda u, y: (u, y + 273.15), "273.15 taken from heater, air"),
        (lambda u, y: (u, y + [273.15, 0.0]), "273.15 taken from heater"),
        (lambda u, y: (u, y[:, ::-1]), "'heater' and 'air' exchanged"),
        (lambda u, y: (y, u), "inputs and outputs exchanged"),
    ],
)
def test_single_columns_written_otherwise_are_found(change, words):
    assert f"With {words} the simulator alone explains" in room(change)


def test_exchanged_inputs_are_found():
    U, Y = swinging()
    assert "With 'torque' and 'target' exchanged the simulator alone explains 100 %" in looked_at(
        [u[:, ::-1] for u in U], Y
    )


def test_an_input_without_a_part_is_in_no_other_unit():
    # A heater that is off: a hundredth of its power explains the record, none of it does too.
    dead = lambda u, y: (u, np.full_like(y, 15.0) + 0.1 * np.random.default_rng(6).normal(size=y.shape))  # noqa: E731
    assert room(dead) == "" and room(lambda u, y: (u, y)) == ""


# ---- units that are given, and names that explain more ------------------------------------------------------------------
def leaking(units):
    """A store whose nominal model knows no leak: its free run, and readings that are 57 times larger in a model that saturates."""
    simulator = ODESimulator(
        lambda t, x, u, p: [u[0] - 30.0 * x[0] / (500.0 + x[0])],
        states=["store"], inputs=["dose"], outputs=["store"], params={}, dt=1.0, units=units,
    )  # fmt: skip
    return PlantModel(describe(simulator))


def test_only_angles_are_written_in_degrees():
    """Numbers that are 57.3 times larger, in a simulator without a unit, and in one whose unit is no angle."""
    U = [np.repeat(np.random.default_rng(k).uniform(5.0, 25.0, 12), 20)[:, None] for k in range(2)]
    Y = [np.degrees(leaking({}).plant.simulator.simulate(u, [300.0])) for u in U]
    record = Record.from_runs(U, Y, [np.arange(240.0)] * 2, 1.0)
    assert "degrees" in other_unit(leaking({}), record).sentence
    assert "degrees" in other_unit(leaking({"store": "rad"}), record).sentence
    assert "degrees" not in other_unit(leaking({"store": "ppm"}), record).sentence


@pytest.mark.parametrize(("explains", "asked", "named"), [(0.97, False, False), (0.6, True, True), (0.6, True, False)])
def test_a_unit_stands_only_where_no_names_explain_more(explains, asked, named, monkeypatch):
    null, final = (SimpleNamespace(fit=SimpleNamespace(y=y)) for y in ("alone", "with names"))
    search = SimpleNamespace(standing=null, problem=SimpleNamespace(record="record"), look_for_onsets=lambda: None)
    search.look_for_more, search.final = (lambda: setattr(search, "standing", final)), None
    search.look_for_one, search.among_signals = (lambda: None), (lambda law: nullcontext())
    pipeline = DiagnosisPipeline.__new__(DiagnosisPipeline)
    pipeline.search, pipeline.problem = search, search.problem
    search.fitted_null, pipeline.access = (
        null,
        SimpleNamespace(
            other_unit=OtherWriting(explains, "in degrees"),
            law_of_the_gap=None,
            ask_for_the_law_of_the_gap=lambda: None,
        ),
    )
    monkeypatch.setattr(_pipeline, "share_explained", lambda record, y: 0.9 if named else 0.5)
    pipeline.look_for_names()
    assert (search.standing is final) is asked
    assert bool(pipeline.access.other_unit.sentence) is not named
    assert (search.final is null) is (asked and not named)


def test_three_outputs_in_another_order_are_found():
    """Readings of surge, sway and yaw, written as yaw, surge and sway."""
    rng = np.random.default_rng(3)
    boat = ODESimulator(
        lambda t, x, u, p: [u[0] - 0.4 * x[0], 0.3 * x[2] - 0.8 * x[1], u[1] - 1.5 * x[2]],
        states=["surge", "sway", "yaw"], inputs=["thrust", "moment"], outputs=["surge", "sway", "yaw"], params={}, dt=0.2,
    )  # fmt: skip
    U = np.repeat(rng.uniform(-2, 2, (20, 2)), 10, axis=0)
    y = boat.simulate(U)[:, [2, 0, 1]] + 0.01 * rng.normal(size=(200, 3))
    record = Record.from_runs([U], [y], [0.2 * np.arange(200)], 0.2)
    said = other_unit(PlantModel(describe(boat)), record).sentence
    assert "With 'surge', 'sway', 'yaw' in the order 'sway', 'yaw', 'surge' the simulator alone explains" in said


@pytest.mark.parametrize(("factor", "unit", "words"), [
    (1e5, "bar", "pressure taken from pascal to bar"),
    (1e5, "", None),  # of a column whose unit is not known nobody says pascal
    (60 / (2 * np.pi), "rad/s", "pressure taken from revolutions per minute to radians per second"),
])  # fmt: skip
def test_pascal_and_revolutions_are_found_where_the_unit_is_known(factor, unit, words):
    rng = np.random.default_rng(7)
    vessel = ODESimulator(
        lambda t, x, u, p: [0.5 * u[0] - 0.3 * x[0]],
        states=["pressure"], inputs=["pump"], outputs=["pressure"], params={}, dt=0.5, units={"pressure": unit} if unit else None,
    )  # fmt: skip
    U = np.repeat(rng.uniform(1, 5, (20, 1)), 10, axis=0)
    y = factor * (vessel.simulate(U) + 0.02 * rng.normal(size=(200, 1)))
    record = Record.from_runs([U], [y], [0.5 * np.arange(200)], 0.5)
    said = other_unit(PlantModel(describe(vessel)), record).sentence
    assert (f"With {words} the simulator alone explains" in said) if words else "pascal" not in said
