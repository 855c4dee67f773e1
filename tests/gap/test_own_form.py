"""A name whose own place and signal keep a law that is too large for a correction has not the form of what is there."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._model import PlantModel
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.decide._contenders import judged_law
from sksurrogate.gap.decide._one_curve import form_holds
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.unnamed._law_evidence import LawQuestion, law_beside
from sksurrogate.gap.unnamed._law_left import LawLeft
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._simulator import describe

RUNS, N, DT, NOISE = 4, 200, 0.5, 0.03


def room(law=None):
    """A room that loses heat, with a further law of its temperature."""

    def rhs(t, x, u, p):
        return (u[0] - p["loss"] * x[0] - (0.0 if law is None else law(x[0])),)

    return ODESimulator(rhs, states=["room"], inputs=["power"], outputs=["room"], params={"loss": 0.1}, dt=DT)


def recorded(law):
    """Inputs, readings and runs of the room with a law."""
    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(0.5, 4.5, RUNS * N // 20), 20)[:, None]
    groups = np.repeat(np.arange(RUNS), N)
    real = room(law)
    Y = np.concatenate([real.simulate(U[groups == k], x0=[20.0]) for k in range(RUNS)])
    return U, Y + NOISE * rng.normal(size=Y.shape), groups


LEAK = CATALOGUE["sqrt_leak"]("room", "room")


@pytest.mark.parametrize(
    ("law", "holds"),
    [
        (LawLeft("room", "state", "room", size=0.15, spread=0.01), True),
        (LawLeft("room", "state", "room", size=0.3, spread=0.01), False),
        (LawLeft("room", "state", "room and its past", size=0.3, spread=0.01), False),
        (LawLeft("room", "state", "power", size=0.3, spread=0.01), True),
        (LawLeft("heater", "state", "room", size=0.3, spread=0.01), True),
        (LawLeft("room", "output", "room", size=0.3, spread=0.01), True),
    ],
)
def test_a_law_of_the_own_place_and_signal_speaks_against_a_name_beyond_a_correction(law, holds):
    assert (form_holds(LEAK, law, 0.1) > 0.9) == holds


def test_a_force_that_depends_on_no_signal_and_a_parameter_have_no_form():
    law, of_element = (
        LawLeft(name, kind, name, size=0.3, spread=0.01) for name, kind in (("room", "state"), ("loss", "parameter"))
    )
    assert form_holds(CATALOGUE["step_disturbance"]("room"), law, 0.1) == 1.0
    assert form_holds(CATALOGUE["parameter_error"]("loss"), of_element, 0.1) == 1.0


def test_at_two_scales_of_the_prior_of_corrections_both_are_as_likely():
    assert form_holds(LEAK, LawLeft("room", "state", "room", size=0.2, spread=0.02), 0.1) == pytest.approx(0.5)


@pytest.mark.slow
def test_a_loss_that_sets_in_is_a_law_and_no_stop_with_a_correction():
    """An end stop closes 87 % of it, and a law of the same temperature the rest: together they are the law alone."""
    U, y, groups = recorded(lambda x: 0.25 * (1.0 + np.tanh((x - 20.0) / 3.0)))
    report = GapDiagnoser(room(), random_state=0, n_jobs=1).fit(U, y, groups=groups).report_
    assert report.verdict == "unknown" and not report.effects
    law = report.missing_term.law
    assert law.location == "room" and law.variables == ("room",) and law.certified
    assert report.shrink.fraction_law > 0.99
    (said,) = (note for note in report.notes if "comes nearest" in note)
    assert " at room (" in said and re.search(r"alone it leaves 1[3-6]\.\d % of the gap", said)


def test_a_sensor_that_reads_its_own_noise_explains_no_noise():
    """Along the data a gain of the readings, less a law of what the simulator reads, would make up for the noise."""
    U, y, groups = recorded(lambda x: 3.0)
    runs = [groups == k for k in range(RUNS)]
    record = Record.from_runs([U[k] for k in runs], [y[k] for k in runs], [DT * np.arange(N)] * RUNS, DT)
    plant = describe(room(), n_inputs=1, n_outputs=1, dt=DT)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("room",))
    gain = problem.fit((CATALOGUE["sensor_gain"]("room"),), np.full(1, -0.5), smoothed.x)
    evidence = estimate_noise(gain, problem.first_noise())
    noise = (problem.first_noise(),)
    leak = law_beside(LawQuestion(gain, noise, path=record.y.copy(), bare=True), 30.0, 0.1)
    search = SimpleNamespace(x=record.y.copy(), gap_over_noise=30.0, tolerance=0.1, laws=[])
    kept = judged_law(search, evidence, gain, along=True, noises=noise)
    assert leak.left.left < 0.01 and kept.left.left > 0.8  # over the noise
