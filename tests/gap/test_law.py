"""The missing term as a formula: planted laws come back with their constants, certified, and the augmented simulator carries them."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.effects import AugmentedSimulator, LawEffect, load_augmented, save_augmented
from sksurrogate.effects._formula import Term
from sksurrogate.effects._law import law_effect
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.render._law import law_line
from sksurrogate.gap.results._missing_term import Curve
from sksurrogate.physics import ODESimulator


def level(c, law):
    """A tank whose outflow has one term that the simulator lacks."""
    return ODESimulator(
        lambda t, x, u, p: [u[0] - p["k"] * x[0] - p["c"] * law(x[0])],
        states=["h"], inputs=["flow"], outputs=["h"], params={"k": 1.2, "c": c}, dt=0.1,
        units={"h": "m", "flow": "m/s", "time": "s"},
    )  # fmt: skip


def runs_of(law, c=0.8, noise=0.01, n_runs=4, n=150):
    """Runs of the tank with the law, and the simulator without it."""
    rng = np.random.default_rng(3)
    U = np.repeat(rng.uniform(0.1, 4.0, (n_runs, n // 10)), 10, axis=1)[..., None]
    Y = np.concatenate([level(c, law).simulate(u, x0=[1.0]) for u in U])
    groups = np.repeat(np.arange(n_runs), n)
    return level(0.0, law), np.concatenate(U), Y + noise * rng.normal(size=Y.shape), groups


def diagnosed(law, effects=("sensor_delay",), **options):
    simulator, U, Y, groups = runs_of(law)
    return GapDiagnoser(simulator, effects=list(effects), random_state=0, n_jobs=1, **options).fit(U, Y, groups=groups)


@pytest.fixture(scope="module")
def monod():
    """0.8 h / (0.6 + h) is missing."""
    return diagnosed(lambda h: h / (0.6 + h))


def test_a_planted_law_comes_back_with_its_constants(monod):
    law = monod.report_.missing_term.law
    assert str(law.effect.equation).startswith("h/(") and (law.location, law.kind, law.variables) == (
        "h",
        "state",
        ("h",),
    )
    assert law.params["c0"] == pytest.approx(-0.8, abs=4 * law.standard_errors["c0"])
    assert law.params["k0"] == pytest.approx(0.6, abs=4 * law.standard_errors["k0"])
    assert law.standard_errors["k0"] < 0.1


def test_the_law_closes_the_gap_on_runs_left_out_and_is_a_part_of_the_budget(monod):
    report = monod.report_
    assert report.verdict == "unknown" and report.missing_term.law.certified
    assert report.shrink.fraction_law > 0.95 and report.shrink.after_law < 0.1 * report.shrink.before
    rows = [row for row in report.budget if row["kind"] == "unnamed law"]
    assert sum(row["share"] for row in report.budget) == pytest.approx(1.0)
    assert rows[0]["part"].startswith("law: ") and rows[0]["share"] > 0.9
    assert "augmented_ carries it" in report.sentence and str(report.missing_term.law) in report.sentence


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.003, 0.03])
def test_the_noise_floor_is_that_of_the_simulator_with_the_law(noise):
    """Of the simulator alone forces take a part of it, or it takes a part of the gap."""
    simulator, U, Y, groups = runs_of(lambda h: h / (0.6 + h), noise=noise)
    diagnoser = GapDiagnoser(simulator, effects=["sensor_delay"], random_state=0, n_jobs=1).fit(U, Y, groups=groups)
    assert diagnoser.report_.shrink.floor == pytest.approx(noise / np.std(Y), rel=0.05)


def test_the_augmented_simulator_follows_the_plant_beyond_the_range(monod):
    plant = level(0.8, lambda h: h / (0.6 + h))
    U = np.full((120, 1), 6.0)  # 1.5 times the largest recorded flow
    np.testing.assert_allclose(monod.augmented_.simulate(U, x0=[1.0]), plant.simulate(U, x0=[1.0]), rtol=0.02)


def test_the_law_is_an_effect_that_is_saved_as_text(monod, tmp_path):
    effect = monod.report_.missing_term.law.to_effect()
    assert isinstance(effect, LawEffect) and effect.free
    save_augmented(monod.augmented_, tmp_path / "law.json")
    again = load_augmented(monod.simulator, tmp_path / "law.json")
    U = np.ones((20, 1))
    np.testing.assert_array_equal(again.simulate(U), monod.augmented_.simulate(U))


def test_the_law_is_written_for_latex_and_sympy(monod):
    sympy = pytest.importorskip("sympy")
    law = monod.report_.missing_term.law
    expression, h = law.sympy(), sympy.Symbol("h", real=True)
    assert r"\frac" in law.latex
    assert float(expression.subs(h, 1.3)) == pytest.approx(float(law.value({"h": 1.3})))


def test_the_law_is_drawn_over_its_own_variable(monod):
    at = np.linspace(0.5, 2.0, 7)
    (line,) = law_line(monod.report_, Curve("h", at, at, at, at, 1.0))
    np.testing.assert_allclose(line.y, monod.report_.missing_term.law.value({"h": line.x}))
    assert (line.x[0], line.x[-1]) == (0.5, 2.0)
    assert law_line(monod.report_, Curve("flow", at, at, at, at, 1.0)) == []


def test_only_a_formula_that_is_certified_tells_the_place(monod):
    law = monod.report_.missing_term.law
    assert law.tells_the_place and not replace(law, certified=False).tells_the_place


def test_the_page_shows_the_law_with_its_numbers(monod):
    law = monod.report_.missing_term.law
    assert law.units == {"c0": "m/s", "k0": "m"}
    assert str(law) in monod.report_.to_html() and f"Law in the balance of h: {law}" in " ".join(
        str(monod.report_).split()
    )


@pytest.mark.slow
def test_an_inverse_square_is_found_with_its_unit():
    law = diagnosed(lambda h: -0.4 / h**2).report_.missing_term.law
    assert [[factor[:2] for factor in term.factors] for term in law.to_effect().terms] == [[("inverse_square", "h")]]
    assert law.units == {"c0": "m^3/s"} and "1/h^2" in str(law)
    assert float(law.value({"h": 2.0})) == pytest.approx(0.08, rel=0.05)


def test_the_runs_are_shown_with_what_the_augmented_simulator_carries(monod):
    report = monod.report_
    errors = np.concatenate([trace.measured - trace.corrected for trace in report.traces])
    deviation = np.std(np.concatenate([trace.measured for trace in report.traces]))
    assert np.sqrt(np.mean(errors**2)) / deviation == pytest.approx(report.shrink.after_law, rel=0.01)
    page = report.to_html()
    assert ">with the law<" in page and "initial states fitted" not in page
    pytest.importorskip("matplotlib").use("Agg")
    for kind in ("trace", "residual", "runs"):
        display = report.plot(kind=kind)
        assert "with the law" in [text.get_text() for text in display.ax_.get_legend().get_texts()]
    assert display.ax_.containers[1][0].get_height() < 0.15 * display.ax_.containers[0][0].get_height()
    assert "h with the law" in report.to_frame("traces").columns


@pytest.mark.slow
def test_without_the_law_the_augmented_simulator_stays_as_it_was(monod):
    plain = diagnosed(lambda h: h / (0.6 + h), include_law=False)
    assert all(trace.law is None for trace in plain.report_.traces)
    assert "initial states fitted" in plain.report_.to_html()
    assert not plain.augmented_.effects and "leaves it out" in plain.report_.sentence
    assert str(plain.report_.missing_term.law) == str(monod.report_.missing_term.law)


@pytest.mark.parametrize(
    ("kind", "terms", "theta"),
    [
        ("state", (Term((("tanh", "h", 0.5, 0.0),)),), (-0.4, 0.7)),
        ("state", (Term((("square", "lag(h)", 0.0, 0.0),)),), (-0.3, 0.5)),
        ("input", (Term((("bell", "flow", 1.0, 0.0, 0.4),)),), (0.5, 1.2, 0.3)),
        ("input", (Term((("square", "lag(flow)", 0.0, 0.0),)),), (0.1, 0.4)),
        ("output", (Term((("swing", "h", 2.0, 0.0, 0.1),)),), (0.2, 2.0, 0.3)),
    ],
)
def test_a_law_acts_at_its_place_with_its_own_constants(kind, terms, theta, tmp_path):
    """Against the same law written into the plant, integrated by scipy where it has a state of its own."""
    place = {"state": "h", "input": "flow", "output": "h"}[kind]
    effect = law_effect(kind, place, terms, theta)
    assert len(effect.parameters) == len(theta) and effect.starts(None) == [theta]
    simulator = level(0.0, lambda h: 0.0 * h)
    augmented = AugmentedSimulator(simulator, [effect], [theta])
    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(0.2, 3.0, 6), 10)[:, None]
    save_augmented(augmented, tmp_path / "law.json")
    found = load_augmented(simulator, tmp_path / "law.json").simulate(U, x0=[1.0])

    def rhs(t, x, u, p):
        lag = ([(x[0] if kind == "state" else u[0]) - x[1]][0]) / theta[-1]
        signals = {"h": x[0], "flow": u[0], "lag(h)": x[1], "lag(flow)": x[1]}
        term = effect.added(signals, t, theta[:-1] if "lag" in terms[0].text else theta)
        pushed = term if kind in ("state", "input") else 0.0
        return [u[0] - 1.2 * x[0] + pushed, lag]

    whole = ODESimulator(
        rhs, states=["h", "w"], inputs=["flow"], outputs=["h"], params={}, dt=0.1, method="LSODA"
    )  # fmt: skip
    start = 1.0 if kind == "state" else float(U[0, 0])
    want = whole.simulate(U, x0=[1.0, start])
    if kind == "output":
        want = want + effect.added({"h": want}, 0.0, theta)
    np.testing.assert_allclose(found, want, rtol=2e-3, atol=2e-3)


@pytest.mark.slow
def test_no_law_is_looked_for_where_effects_are_ruled_out():
    effects = ("sensor_delay", "input_delay")
    term = diagnosed(lambda h: h / (0.6 + h), effects, exclude=["h"]).report_.missing_term
    assert term is None or term.law is None or term.law.location == "flow"


@pytest.mark.slow
def test_a_name_stands_beside_a_law_of_another_place():
    """A delay of one of two channels, 0.15, and a ripple of the other, 0.15 sin(6 b): the delay makes up 57 % of the gap's power."""

    def channels(ripple):
        return ODESimulator(
            lambda t, x, u, p: (u[0] - x[0], u[1] - x[1] + ripple * np.sin(6.0 * x[1])),
            states=["a", "b"], inputs=["ua", "ub"], outputs=["a", "b"], params={}, dt=0.05,
        )  # fmt: skip

    rng = np.random.default_rng(3)
    U = np.stack([np.repeat(rng.uniform(-1.0, 1.0, (4, 20)), 10, axis=1) for _ in "ab"], axis=2)
    late = U.copy()
    late[:, 3:, 0], late[:, :3, 0] = U[:, :-3, 0], U[:, :1, 0]
    y = np.concatenate([channels(0.15).simulate(u, x0=[0.0, 0.0]) for u in late])
    y += rng.normal(0.0, 0.005, y.shape)
    names = ["input_delay", "input_lag", "input_gain", "coulomb_friction"]
    diagnoser = GapDiagnoser(channels(0.0), effects=names, n_jobs=1, random_state=0)
    report = diagnoser.fit(U.reshape(-1, 2), y, groups=np.repeat(np.arange(4), 200)).report_
    assert report.verdict == "partial" and [(e.name, e.location) for e in report.effects] == [("input_delay", "ua")]
    assert report.effects[0].params["delay"] == pytest.approx(0.15, rel=0.01)
    law = report.missing_term.law
    assert (law.location, law.kind, law.certified) == ("b", "state", True) and law.variables == ("b",)
    assert report.shrink.after_law < 0.1 * report.shrink.before
