"""The smooth term inside a plant: its functions, its evidence, and how it is judged on what is left out."""

import numpy as np
import pytest

from sksurrogate._domain import Domain
from sksurrogate.compose import HybridRegressor
from sksurrogate.compose._left_out import Piece
from sksurrogate.compose._term import Basis
from sksurrogate.datasets import linear_reactor, make_reactor_runs
from sksurrogate.physics import StepSimulator


def test_the_smooth_functions_are_a_gaussian_process_of_unit_variance_at_the_centres():
    z = np.random.default_rng(0).normal(size=(200, 2))
    basis = Basis(z, 0.7)
    at = basis.centres.T * basis.scale[:, None] + basis.mean[:, None]
    smooth = basis(at)[basis.group == 1]
    s = basis.centres
    squares = np.sum((s[:, None] - s[None]) ** 2, axis=2)
    np.testing.assert_allclose(smooth.T @ smooth, np.exp(-0.5 * squares / basis.length**2), atol=1e-6)


def test_far_from_the_data_the_linear_part_is_left():
    z = np.random.default_rng(0).normal(size=(200, 2))
    basis = Basis(z, 0.7)
    far = np.array([[40.0], [-30.0]])
    assert np.all(np.abs(basis(far)[basis.group == 1]) < 1e-12)
    np.testing.assert_allclose(basis(far)[1:3, 0], (far[:, 0] - basis.mean) / basis.scale)


def step(t, x, u, p, dt):
    return [0.8 * x[0] + u[0] + p["bend"] * x[0] ** 2]


def bent(bend):
    return StepSimulator(step, states=["x"], inputs=["u"], outputs=["x"], params={"bend": bend})


def test_the_evidence_finds_the_noise_and_takes_the_smoothest_functions_of_a_parabola():
    rng = np.random.default_rng(0)
    X = 0.3 * rng.normal(size=(200, 1))
    y = bent(0.05).simulate(X)[:, 0] + 0.01 * rng.normal(size=200)
    found = HybridRegressor(bent(0.0), form="dynamics").fit(X, y).correction_
    assert found.smooth.sd == pytest.approx(0.01, rel=0.15) and found.length == 2.8


def test_runs_judged_at_once_are_those_judged_one_by_one():
    X, y, _ = make_reactor_runs(1, 60, noise=0.02, random_state=0)
    correction = HybridRegressor(linear_reactor(), form="dynamics").fit(X, y).correction_
    pieces, measured = [Piece(0, 0, 40, 20), Piece(0, 30, 60, 31)], [y[:, None]]
    domain, factors = correction.domain, np.array([0.0, 0.5, 1.0])
    # so that fading acts
    correction.domain = Domain(domain.low + 0.3 * domain.size, domain.high - 0.3 * domain.size, 0.1)
    at_once = correction.errors_at(factors, [X], measured, pieces)
    for k, factor in enumerate(factors):
        correction.factor = factor
        for piece, errors in zip(pieces, at_once):
            rows = slice(piece.start, piece.stop)
            alone = correction.run([X[rows]], [measured[0][rows][:1]]).y[0] - measured[0][rows]
            np.testing.assert_allclose(errors[k], alone[max(piece.judged - piece.start, 1) :], atol=1e-10)


@pytest.mark.slow
def test_with_one_run_the_form_with_the_most_physics_is_chosen_and_beats_the_surrogate():
    X, y, _ = make_reactor_runs(1, 150, noise=0.02, random_state=1)
    new_X, new_y, new = make_reactor_runs(6, 150, random_state=99)
    errors = []
    for simulator in (linear_reactor(), None):
        model = HybridRegressor(simulator, form="auto").fit(X, y)
        first = np.stack([new_y[new == k][: model.n_initial_] for k in range(6)])[:, :, None]
        errors.append(np.sqrt(np.mean((model.predict(new_X, y0=first, groups=new) - new_y) ** 2)))
        assert model.form_ == ("output" if simulator is None else "dynamics")
    assert errors[0] < min(0.1, errors[1])
