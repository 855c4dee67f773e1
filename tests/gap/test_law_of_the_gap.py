"""Where one law explains the gap, further names have its signals: names of others would only imitate it."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.decide._gap_of_one_law import law_of_the_gap
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.unnamed._law_left import LawLeft
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

RUNS, ROWS, DT = 4, 200, 0.05


def mass(missing=lambda x, v: 0.0):
    """A mass on a spring, with a force that its model lacks."""
    return ODESimulator(
        lambda t, x, u, p: [x[1], u[0] - p["k"] * x[0] - p["c"] * x[1] + missing(x[0], x[1])],
        states=["position", "speed"], inputs=["force"], outputs=["position", "speed"], params={"k": 4.0, "c": 0.4}, dt=DT,
    )  # fmt: skip


def recorded(missing):
    rng = np.random.default_rng(5)
    U = [np.repeat(rng.uniform(-4, 4, ROWS // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [mass(missing).simulate(u) for u in U]
    return U, [y + 0.02 * rng.normal(size=y.shape) for y in Y]


def bump(x, v):
    return 1.5 * np.exp(-(((v - 0.6) / 0.5) ** 2))


def friction(x, v):
    return -0.8 * np.tanh(v / 0.01)


def stiff(x, v):
    return -3.0 * x**3


def lossy(x, v):
    return -0.3 * v * np.abs(v) - 0.5 * np.tanh(v / 0.01)


def searched(missing):
    U, Y = recorded(missing)
    record = Record.from_runs(U, Y, [DT * np.arange(ROWS)] * RUNS, DT)
    problem, smoothed = build_problem(PlantModel(describe(mass())), record, (), ("speed",))
    forms = ("linear_loss", "quadratic_drag", "coulomb_friction", "cubic_stiffness", "constant_bias")
    library = [CATALOGUE[name]("speed", v) for name in forms[:-1] for v in ("speed", "position")]
    search = OdeSearch(problem, [*library, CATALOGUE[forms[-1]]("speed")], smoothed.x)
    search.look_for_one()
    return search


@pytest.mark.parametrize(
    ("missing", "signals"), [(bump, {"speed"}), (lossy, {"speed"}), (friction, None), (lambda *xv: friction(*xv) + stiff(*xv), None)]
)  # fmt: skip
def test_one_law_explains_what_is_a_function_of_one_signal_and_no_effect_alone(missing, signals):
    """Not what one effect is, nor two of different signals."""
    law = law_of_the_gap(searched(missing))
    assert (None if law is None else law.signals) == signals
    assert law is None or (law.location, law.kind) == ("speed", "state")


def test_two_effects_of_its_signal_are_named_and_none_of_another_is_fitted_beside_one():
    search = searched(lossy)
    with search.among_signals(law_of_the_gap(search)):
        found = search.look_for_more()
    assert {effect.key for effect in found.effects} == {
        (name, "speed", "speed") for name in ("quadratic_drag", "coulomb_friction")
    }
    larger = [one for one in search.fitted.values() if len(one.effects) > 1]
    assert larger and {effect.variable for one in larger for effect in one.effects[1:]} <= {"speed", None}
    assert search.of_signals is None


def test_without_a_law_sets_are_made_of_all():
    search = searched(lambda *xv: friction(*xv) + stiff(*xv))
    with search.among_signals(law_of_the_gap(search)):
        found = search.look_for_more()
    assert {effect.name for effect in found.effects} == {"coulomb_friction", "cubic_stiffness"}


def test_signals_end_with_the_question_also_when_it_is_interrupted():
    search = searched(friction)
    with pytest.raises(KeyboardInterrupt), search.among_signals(LawLeft("speed", "state", "speed")):
        assert search.of_signals == {"speed"}
        raise KeyboardInterrupt
    assert search.of_signals is None


@pytest.mark.slow
def test_a_bump_is_told_as_a_law_and_not_as_another_timing_of_the_inputs():
    U, Y = recorded(bump)
    groups = np.repeat(np.arange(RUNS), ROWS)
    some = [
        "linear_loss",
        "quadratic_drag",
        "coulomb_friction",
        "cubic_stiffness",
        "input_lag",
        "input_gain",
        "sensor_gain",
    ]
    report = (
        GapDiagnoser(mass(), effects=some, random_state=0, n_jobs=1)
        .fit(np.vstack(U), np.vstack(Y), groups=groups)
        .report_
    )
    assert report.verdict == "unknown" and not report.effects and not report.data
    assert (report.where.location, report.where.kind) == ("speed", "state")
    assert report.shrink.fraction_law > 0.95
