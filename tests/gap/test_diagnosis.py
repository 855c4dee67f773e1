"""Planted effects are named, a plant without a gap gets none, an effect outside the catalogue gets unknown."""

import pickle
import warnings

import numpy as np
import pytest

from sksurrogate.exceptions import DataError, RunError, SimulationDiverged, SimulatorError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator


def oscillator_rhs(t, x, u, p):
    q, v = x
    return v, p["b"] * u[0] - p["k"] * q - p["c"] * v


def oscillator(**params):
    return ODESimulator(
        oscillator_rhs, states=["position", "velocity"], inputs=["force"], outputs=["position"],
        params={"b": 1.0, "k": 9.0, "c": 0.6, **params}, dt=0.05,
    )  # fmt: skip


def measure(term, seed=0, n_runs=6, n_samples=300, noise=0.01, actuator=lambda u: u):
    """Runs of the oscillator with an extra acceleration ``term(q, v, u)``; own integrator, ten times finer."""
    rng = np.random.default_rng(seed)
    t = 0.05 * np.arange(n_samples)
    U = sum(
        rng.normal(size=(n_runs, 1)) * np.sin(w * t + rng.uniform(0, 6, (n_runs, 1))) for w in rng.uniform(0.5, 6, 10)
    )
    x = rng.normal(size=(2, n_runs)) * [[0.3], [0.8]]
    Y = np.empty((n_runs, n_samples))

    def f(x, u):
        return np.stack([x[1], actuator(u) - 9 * x[0] - 0.6 * x[1] + term(x[0], x[1], u)])

    h = 0.005
    for k in range(n_samples):
        Y[:, k] = x[0]
        for _ in range(10):
            a = f(x, U[:, k])
            b = f(x + h / 2 * a, U[:, k])
            c = f(x + h / 2 * b, U[:, k])
            d = f(x + h * c, U[:, k])
            x = x + h / 6 * (a + 2 * b + 2 * c + d)
    Y += noise * Y.std() * rng.normal(size=Y.shape)
    return U.reshape(-1, 1), Y.reshape(-1, 1), np.repeat(np.arange(n_runs), n_samples)


def diagnose(term, simulator=None, **kwargs):
    X, y, runs = measure(term, **{k: kwargs.pop(k) for k in ("seed", "actuator") if k in kwargs})
    return GapDiagnoser(simulator or oscillator(), random_state=0, **kwargs).fit(X, y, groups=runs)


@pytest.mark.slow
def test_cubic_stiffness_is_named_with_its_coefficient():
    diagnoser = diagnose(lambda q, v, u: -8 * q**3)
    report = diagnoser.report_
    assert report.verdict == "explained"
    assert [(e.name, e.location, e.variable) for e in report.effects] == [("cubic_stiffness", "velocity", "position")]
    low, high = report.effects[0].intervals["coefficient"]
    assert low < 8 < high
    assert list(report.effects[0].intervals) == list(report.effects[0].params)
    assert report.where.location == "velocity" and report.where.kind == "state"
    assert report.shrink.fraction > 0.97
    assert report.shrink.interval[0] <= report.shrink.fraction <= report.shrink.interval[1]
    again = pickle.loads(pickle.dumps(report))
    assert str(again) == str(report) and report.to_html().startswith("<!doctype html>")
    Y = diagnoser.augmented_.simulate(np.zeros((5, 1)), x0=[0.1, 0.0])
    assert Y.shape == (5, 1) and np.isfinite(Y).all()


@pytest.mark.slow
def test_two_effects_are_named_together():
    report = diagnose(lambda q, v, u: -8 * q**3 - 0.3 * np.tanh(v / 1e-3)).report_
    assert {e.name for e in report.effects} == {"cubic_stiffness", "coulomb_friction"}
    assert report.verdict == "explained"


def test_no_gap_gets_none():
    report = diagnose(lambda q, v, u: 0.0 * q, seed=3).report_
    assert report.verdict == "none" and report.effects == []
    assert report.where.location is None


@pytest.mark.slow
def test_an_effect_outside_the_catalogue_is_unknown_and_placed():
    report = diagnose(
        lambda q, v, u: 2.5 * np.sin(6 * q) * np.cos(2 * v),
        effects=["constant_bias", "linear_loss", "input_gain", "sensor_bias"],
    ).report_
    assert report.verdict == "unknown"
    assert report.where.location == "velocity"
    assert report.missing_term is not None and report.missing_term.curves


@pytest.mark.slow
def test_a_missing_law_of_the_input_alone_is_placed_at_the_input_and_one_of_a_state_in_its_balance():
    few = ["sensor_bias", "input_gain", "periodic_disturbance"]
    stuck = diagnose(lambda q, v, u: 0.0, actuator=lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.8, 0), effects=few)
    assert (stuck.report_.verdict, stuck.report_.where.location) == ("unknown", "force")
    bent = diagnose(lambda q, v, u: -6 * np.abs(v) * v, effects=few)
    assert (bent.report_.verdict, bent.report_.where.location) == ("unknown", "velocity")


@pytest.mark.slow
def test_richer_forms_that_predict_the_same_stay_in_the_class():
    report = diagnose(
        lambda q, v, u: -0.3 * np.tanh(100 * v), effects=["coulomb_friction", "stribeck_friction", "linear_loss"]
    ).report_
    assert report.effects[0].name == "coulomb_friction"
    assert ("stribeck_friction", "velocity", "velocity") in report.effects[0].equivalents


@pytest.mark.slow
def test_detuned_parameters_are_not_mistaken_for_an_effect():
    report = diagnose(lambda q, v, u: -8 * q**3, oscillator(k=9.5, c=0.57), free_params="all").report_
    assert [e.name for e in report.effects] == ["cubic_stiffness"]
    by_name = {row["parameter"]: row for row in report.retuned}
    assert by_name["k"]["low"] < 9.0 < by_name["k"]["high"]


@pytest.mark.slow
def test_a_far_retuning_that_imitates_an_effect_does_not_hide_it():
    """A loss of a speed is the damping, exactly: whichever is named, the other is said, and both add up."""
    report = diagnose(lambda q, v, u: -0.5 * v, oscillator(k=9.4), free_params=["k", "c"]).report_
    assert report.verdict == "explained"
    members = {key[:2] for e in report.effects for key in [(e.name, e.location), *e.equivalents]}
    assert ("linear_loss", "velocity") in members
    lost = sum(e.params["coefficient"] for e in report.effects if e.name == "linear_loss")
    moved = {row["parameter"]: row["value"] for row in report.retuned}
    assert moved["c"] + lost == pytest.approx(1.1, abs=0.02)


@pytest.mark.slow
def test_retuning_alone_is_reported_as_parameter_error():
    report = diagnose(lambda q, v, u: 0.0 * q, oscillator(k=9.9), free_params=["k"]).report_
    assert report.verdict == "explained"
    assert [(e.name, e.location) for e in report.effects] == [("parameter_error", "k")]
    low, high = report.effects[0].intervals["relative_error"]
    assert low < 9.0 / 9.9 - 1 < high


@pytest.mark.slow
def test_effects_that_the_retuning_would_hide_are_told():
    """A stiffness that is off is a force in the position, exactly; damping and a cubic spring are not."""
    report = diagnose(lambda q, v, u: -0.9 * q, free_params=["k"]).report_
    assert [(e.name, e.location) for e in report.effects] == [("parameter_error", "k")]
    hidden = report.effects[0].equivalents
    assert ("linear_loss", "velocity", "position") in hidden
    assert not {("linear_loss", "velocity", "velocity"), ("cubic_stiffness", "velocity", "position")} & {*hidden}
    assert "hide" in report.effects[0].why


@pytest.mark.slow
def test_an_interrupt_keeps_what_is_known(monkeypatch):
    from sksurrogate.gap.decide import _equivalence

    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(_equivalence, "_class_in_place", interrupted)
    X, y, runs = measure(lambda q, v, u: -8 * q**3)
    with pytest.warns(UserWarning, match="interrupted"):
        report = GapDiagnoser(oscillator(), random_state=0).fit(X, y, groups=runs).report_
    assert not report.complete
    assert [e.name for e in report.effects] == ["cubic_stiffness"]


def test_bad_input_says_where_and_what_to_do():
    X, y, runs = measure(lambda q, v, u: 0.0 * q, n_runs=2, n_samples=40)
    plant = oscillator()
    with pytest.raises(DataError, match="X has 80 rows and y has 79"):
        GapDiagnoser(plant).fit(X, y[:-1], groups=runs)
    with pytest.raises(RunError, match=r"run 0 is in two pieces: rows 0\.\.39 and again from row 60"):
        GapDiagnoser(plant).fit(X, y, groups=np.r_[runs[:60], np.zeros(20, int)])
    bad = y.copy()
    bad[7] = np.inf
    with pytest.raises(DataError, match="Input y contains infinity: row 7"):
        GapDiagnoser(plant).fit(X, bad, groups=runs)
    with pytest.raises(SimulatorError, match="no parameter 'mass'"):
        GapDiagnoser(plant, free_params=["mass"]).fit(X, y, groups=runs)
    with pytest.raises(SimulatorError, match="X has 2 columns, but the simulator has 1 inputs"):
        GapDiagnoser(plant).fit(np.hstack([X, X]), y, groups=runs)
    with pytest.raises(SimulatorError, match="must return 2 components"):
        wrong = ODESimulator(
            lambda t, x, u, p: [x[0]], states=["a", "b"], inputs=["force"], outputs=["a"], params={}, dt=0.05
        )
        GapDiagnoser(wrong).fit(X, y, groups=runs)


@pytest.mark.slow
def test_a_simulation_that_blows_up_names_time_and_state():
    with pytest.raises(SimulationDiverged, match="state 'position'") as caught:
        oscillator(k=-2000.0).simulate(np.ones((900, 1)))
    assert caught.value.time > 0


def test_a_branching_rhs_works_and_one_that_takes_single_points_alone_warns_once():
    def rhs(t, x, u, p):
        return [-x[0] if x[0] > 0 else u[0]]

    def of_one_point(t, x, u, p):
        return [-x[0].item()]

    plant = ODESimulator(rhs, states=["a"], inputs=["u"], outputs=["a"], params={}, dt=0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Y = plant.simulate(np.ones((4, 1)), x0=[1.0])
    np.testing.assert_allclose(Y[:, 0], np.exp(-0.1 * np.arange(4)), rtol=1e-7)
    plant = ODESimulator(of_one_point, states=["a"], inputs=["u"], outputs=["a"], params={}, dt=0.1)
    with pytest.warns(UserWarning, match=r"np\.where"):
        Y = plant.simulate(np.ones((4, 1)), x0=[1.0])
    np.testing.assert_allclose(Y[:, 0], np.exp(-0.1 * np.arange(4)), rtol=1e-7)


@pytest.mark.slow
def test_the_report_is_the_same_for_a_seed():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        first = diagnose(lambda q, v, u: -0.5 * v * np.abs(v), effects=["quadratic_drag", "linear_loss"]).report_
        second = diagnose(lambda q, v, u: -0.5 * v * np.abs(v), effects=["quadratic_drag", "linear_loss"]).report_
    assert first.shrink == second.shrink and first.effects[0].params == second.effects[0].params
