"""How a parameter depends on a signal: in a straight line, exponentially, as one over it, as a root; fitted, carried, said, stored."""

import re

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.render._code import code_of
from sksurrogate.physics import ODESimulator

Dependence = CATALOGUE["parameter_dependence"]
DT, N, RUNS, NOISE, RATE, SLOPE, WARM = 0.5, 200, 3, 0.003, 0.4, 0.04, 20.0
CURVES = {-1.0: lambda s: np.sqrt(1.0 + 2.0 * s), 0.0: lambda s: 1.0 + s, 1.0: np.exp, 2.0: lambda s: 1.0 / (1.0 - s)}
REACTOR = ODESimulator(
    lambda t, x, u, p: (u[0] * (1.0 - x[0]) - p["rate"] * x[0],),
    states=["c"], inputs=["flow", "warmth"], outputs=["c"], params={"rate": RATE}, dt=DT, x0=[0.5],
)  # fmt: skip


@pytest.mark.parametrize("curvature", [-1.0, 0.5, 1.0, 1.5, 2.0])
def test_another_curvature_has_the_same_value_and_slope_at_a_point(curvature):
    theta, at = (0.03, -0.7), 20.0
    straight, curved = Dependence("k", "T"), Dependence("k", "T", curvature=curvature)
    own = straight.as_curved(theta, at, curvature)
    near = np.array([at - 1e-4, at, at + 1e-4])
    line, curve = straight.value(2.0, 0.0, theta, 0.0, near), curved.value(2.0, 0.0, own, 0.0, near)
    np.testing.assert_allclose([curve[1], curve[2] - curve[0]], [line[1], line[2] - line[0]], rtol=1e-6)


@pytest.mark.parametrize("curvature", CURVES)
def test_the_named_curves_are_those_of_the_family(curvature):
    s = np.linspace(-0.4, 0.8, 9)
    for near in (curvature - 1e-7, curvature, curvature + 1e-7):
        found = Dependence("k", "T", curvature=near).value(3.0, 0.0, (1.0, 0.0), 0.0, s)
        np.testing.assert_allclose(found, 3.0 * CURVES[curvature](s), rtol=1e-5)


def recorded(curvature):
    """Concentrations of a tank by their exact solution over every sample; the warmth moves the rate by a half to twice."""
    rng, out = np.random.default_rng(1), []
    for _ in range(RUNS):
        flow, warmth = (np.repeat(rng.uniform(*ends, N // 10), 10) for ends in ((0.2, 1.0), (WARM - 12.0, WARM + 12.0)))
        k, c = RATE * CURVES[curvature](SLOPE * (warmth - WARM)), np.full(N, 0.5)
        for i in range(N - 1):
            total = flow[i] + k[i]
            c[i + 1] = flow[i] / total + (c[i] - flow[i] / total) * np.exp(-total * DT)
        out.append((np.c_[flow, warmth], c + NOISE * rng.standard_normal(N)))
    return np.concatenate([u for u, _ in out]), np.concatenate([y for _, y in out]), np.repeat(range(RUNS), N)


@pytest.fixture(scope="module", params=CURVES)
def diagnosed(request):
    X, y, groups = recorded(request.param)
    return request.param, GapDiagnoser(REACTOR, n_jobs=1, random_state=0).fit(X, y, groups=groups)


def test_the_curve_is_found_with_its_slope(diagnosed):
    curvature, report = diagnosed[0], diagnosed[1].report_
    (effect,) = report.effects
    assert (report.verdict, effect.name, effect.location, effect.variable) == (
        "explained", "parameter_dependence", "rate", "warmth",
    )  # fmt: skip
    assert effect.curvature == curvature
    assert effect.params["slope"] == pytest.approx(SLOPE, rel=0.03)
    assert effect.params["relative_error"] == pytest.approx(-SLOPE * WARM, abs=0.03)


def test_the_report_says_the_curve_and_what_the_parameter_becomes(diagnosed):
    curvature, report = diagnosed[0], diagnosed[1].report_
    said = {
        -1.0: "driven by warmth, as a square root (",
        0.0: "driven by warmth (",
        1.0: "driven by warmth, exponentially (",
        2.0: "as one over a straight line (",
    }
    text = " ".join(str(report).split())
    assert said[curvature] in text and "rate: 0.4 -> " in text and " at warmth = " in text
    assert ("curvature=" in code_of(report)) == (curvature != 0)


def test_the_corrected_simulator_carries_it_and_is_stored(diagnosed, tmp_path):
    curvature, diagnoser = diagnosed
    run = np.c_[np.full(40, 0.6), np.repeat([WARM - 10.0, WARM + 10.0], 20)]
    found = diagnoser.augmented_.simulate(run, x0=[0.5])
    expected = AugmentedSimulator(
        REACTOR, [Dependence("rate", "warmth", curvature=curvature)], [(SLOPE, -SLOPE * WARM)]
    )
    np.testing.assert_allclose(found, expected.simulate(run, x0=[0.5]), atol=0.005)
    save_augmented(diagnoser.augmented_, tmp_path / "reactor.json")
    again = load_augmented(REACTOR, tmp_path / "reactor.json")
    np.testing.assert_allclose(again.simulate(run, x0=[0.5]), found, atol=1e-12)


def test_a_curve_has_the_same_free_run_as_a_graph():
    whole = AugmentedSimulator(REACTOR, [Dependence("rate", "c", curvature=1.0)], [(0.8, -0.4)])
    graph, run = whole.to_graph(), np.c_[np.linspace(0.2, 1.0, 40), np.zeros(40)]
    state, found = whole.start_state(), []
    for u in run:
        now = graph(x=state, u=u)
        state, found = np.ravel(now["x_next"]), [*found, float(np.ravel(now["y"])[0])]
    np.testing.assert_allclose(found, np.ravel(whole.simulate(run)), atol=1e-6)


def test_a_parameter_that_is_re_tuned_too_is_reported_as_it_acts():
    """Only the product of the free rate and its dependence shows; the report gives the rate at both ends of the warmth."""
    X, y, groups = recorded(1.0)
    report = GapDiagnoser(REACTOR, free_params=["rate"], n_jobs=1, random_state=0).fit(X, y, groups=groups).report_
    found = re.search(
        r"rate: 0\.4 -> (\S+) at warmth = (\S+), (\S+) at warmth = ([\d.]+)", " ".join(report.sentence.split())
    )
    for rate, warmth in (found.group(1, 2), found.group(3, 4)):
        assert float(rate) == pytest.approx(RATE * np.exp(SLOPE * (float(warmth) - WARM)), rel=0.03)
