"""Evidence of a law without a name: closed forms, and what it does beside a form that is not exact."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.unnamed._amplitude import KNOWN_TO, amplitude_evidence, known_to_rounding, prior_roots
from sksurrogate.physics import ODESimulator


def test_evidence_of_a_size_is_a_ratio_of_gaussian_densities():
    rng = np.random.default_rng(0)
    F, root = rng.normal(size=(40, 3)), rng.normal(size=(3, 3))
    r = rng.normal(size=40) + F @ [0.4, 0.0, -0.3]
    for size in (0.1, 1.0, 5.0):
        S = size**2 * F @ root @ root.T @ F.T
        ratio = multivariate_normal(cov=np.eye(40) + S).logpdf(r) - np.sum(norm.logpdf(r))
        found = amplitude_evidence(F.T @ F, F.T @ r, root, np.array([size]))[0]
        assert found == pytest.approx(ratio, rel=1e-9)


def test_evidence_of_one_weight_is_its_integral():
    H, g = 3.0, 2.5
    value, _ = quad(lambda c: np.exp(g * c - 0.5 * H * c**2) * norm.pdf(c, scale=0.7), -20, 20)
    found = amplitude_evidence(np.array([[H]]), np.array([g]), np.eye(1), np.array([0.7]))[0]
    assert found == pytest.approx(np.log(value), rel=1e-8)


def test_no_law_is_as_likely_as_none_at_size_nothing():
    assert abs(amplitude_evidence(np.eye(2), np.array([3.0, 1.0]), np.eye(2), np.array([1e-9]))[0]) < 1e-12


def test_a_gram_whose_products_are_differences_of_larger_numbers_tells_nothing():
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(40, 4))
    columns[:, 3] = columns[:, 1] + columns[:, 2]  # collinear: its least eigenvalue is rounding
    G = columns.T @ columns
    assert known_to_rounding(G) and known_to_rounding(1e6 * G)
    G[0, 1:3] = G[1:3, 0] = G[0, 1:3] + 1e-3 * np.sqrt(G[0, 0])  # what rounding would do
    assert known_to_rounding(G) and not known_to_rounding(1e6 * G)


@pytest.mark.parametrize(("nats", "holds"), [(0.8, True), (1.2, False)])
def test_rounding_may_move_the_power_that_is_explained_by_half_of_the_nats_that_count(nats, holds):
    """Of one regressor, correlated by 1 + e: it would explain e more than all of the residual, half of that in nats."""
    e = 1e-3
    G = np.array([[1.0, 1.0 + e], [1.0 + e, 1.0]])
    assert known_to_rounding(2.0 * nats * KNOWN_TO / e * G) == holds


def test_no_direction_explains_more_than_the_residual_holds():
    H, g, sizes = np.diag([1.0, 1e-30]), np.array([1.0, 1e-3]), np.array([1e6])  # the second is rounding alone
    alone = amplitude_evidence(H[:1, :1], g[:1], np.eye(1), sizes, power=4.0)
    assert amplitude_evidence(H, g, np.eye(2), sizes, power=4.0) == pytest.approx(alone)
    assert amplitude_evidence(H, g, np.eye(2), sizes) > 1e5


def runs_of(law, noise=0.003, seed=0):
    """A mass on a spring with a law of its speed, simulated in steps a twentieth as long; the simulator without it."""

    def rhs(t, x, u, p):
        q, v = x
        return [v, u[0] - 4.0 * q - 0.3 * v - p["c"] * law(v)]

    def spring(dt, c):
        return ODESimulator(
            rhs, states=["q", "v"], inputs=["force"], outputs=["q", "v"], params={"c": c}, dt=dt
        )  # fmt: skip

    rng = np.random.default_rng(seed)
    U, Y, groups = [], [], []
    for run in range(4):
        u = np.repeat(rng.uniform(-3.0, 3.0, 25), 10)
        y = spring(0.0025, 0.6).simulate(np.repeat(u, 20)[:, None])[::20]
        U.append(u[:, None])
        Y.append(y + noise * rng.normal(size=y.shape))
        groups += [run] * len(u)
    simulator = ODESimulator(
        lambda t, x, u, p: [x[1], u[0] - p["k"] * x[0] - p["d"] * x[1]], states=["q", "v"], inputs=["force"],
        outputs=["q", "v"], params={"k": 4.0, "d": 0.3}, dt=0.05,
    )  # fmt: skip
    return simulator, np.concatenate(U), np.concatenate(Y), np.array(groups)


@pytest.mark.slow
def test_a_friction_with_a_width_is_named_and_nothing_is_invented_beside_it():
    simulator, U, Y, groups = runs_of(lambda v: np.tanh(v / 0.1))
    names = ["coulomb_friction", "quadratic_drag", "linear_loss", "input_gain", "input_delay", "cubic_stiffness"]
    report = GapDiagnoser(simulator, effects=names, random_state=0).fit(U, Y, groups=groups).report_
    assert report.verdict in ("explained", "partial")
    assert [effect.name for effect in report.effects] == ["coulomb_friction"]
    assert report.effects[0].probability > 0.9
    assert sum(row["share"] for row in report.budget) == pytest.approx(1.0)


@pytest.mark.slow
def test_without_its_name_the_friction_is_a_law_of_the_speed():
    simulator, U, Y, groups = runs_of(lambda v: np.tanh(v / 0.1))
    names = ["input_gain", "input_delay", "cubic_stiffness"]
    report = GapDiagnoser(simulator, effects=names, random_state=0).fit(U, Y, groups=groups).report_
    assert report.verdict == "unknown"
    assert (report.remainder.location, report.remainder.kind) == ("v", "state")
    assert report.remainder.variable.startswith("v")
    assert sum(row["share"] for row in report.budget if row["kind"] == "unnamed law") > 0.8


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_the_prior_of_a_law_does_not_know_the_unit_of_the_outputs(unit):
    rng = np.random.default_rng(0)
    A, B = rng.normal(size=(2, 5, 8))
    metric, rough = A @ A.T, B @ B.T
    for here, there in zip(prior_roots(metric, rough), prior_roots(unit**2 * metric, rough), strict=True):
        np.testing.assert_allclose(there @ there.T, here @ here.T / unit**2, rtol=1e-8)
        # The mean square movement of the outputs is one in every form of the prior.
        assert np.trace(there.T @ (unit**2 * metric) @ there) == pytest.approx(1.0)


def test_a_signal_that_moves_no_output_gets_a_finite_prior():
    metric = np.diag([1.0, 0.0])
    assert all(np.isfinite(root).all() for root in prior_roots(metric, None))
