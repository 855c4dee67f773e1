"""Shooting fits by the evidence: planted models, noise, fits that run away refused, starts from noisy rows, intervals."""

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.neural_network import MLPRegressor

from sksurrogate.compose import RecursivePredictor
from sksurrogate.compose._other_starts import OtherStarts
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.exceptions import DataError
from sksurrogate.kernels import shooting_evidence
from sksurrogate.kernels.net import LagNet, Net
from sksurrogate.kernels.rollout import free_run
from sksurrogate.kernels.shooting import FreeRunLoss
from sksurrogate.neural import FNNRegressor


def planted(n_runs=4, n=100, noise=0.0, seed=0):
    """y[t] = 1.2 y[t-1] - 0.5 y[t-2] + u[t] + 0.3 u[t-1], and white noise on what is seen."""
    rng = np.random.default_rng(seed)
    U = rng.normal(size=(n_runs, n, 1))
    y = np.zeros((n_runs, n, 1))
    y[:, :2] = rng.normal(size=(n_runs, 2, 1))
    for t in range(2, n):
        y[:, t] = 1.2 * y[:, t - 1] - 0.5 * y[:, t - 2] + U[:, t] + 0.3 * U[:, t - 1]
    return U, y, y + noise * rng.normal(size=y.shape), np.repeat(np.arange(n_runs), n)


def linear(noise, seed=0, n_runs=4, **settings):
    U, _, y, groups = planted(n_runs, noise=noise, seed=seed)
    model = RecursivePredictor(LinearRegression(), 1, 2, loss="shooting", **settings)
    return model.fit(U.reshape(-1, 1), y.ravel(), groups=groups)


def test_without_noise_the_penalty_vanishes_and_the_planted_weights_are_found():
    model = linear(0.0)
    np.testing.assert_allclose(model.estimator_.coef_, [1.2, -0.5, 1.0, 0.3], atol=1e-8)
    assert model.alpha_ < 1e-8 and model.noise_[0] < 1e-6


def test_the_noise_is_the_planted_one_and_weights_are_as_sure_as_they_say():
    coefs, stds, noises = [], [], []
    for seed in range(12):
        model = linear(0.3, seed, 8)
        scale = model._posterior.scaling
        factor = np.r_[1.0, 1.0, np.full(2, scale.y_std[0] / scale.u_std[0])]
        coefs.append(model.estimator_.coef_)
        stds.append(factor * np.sqrt(np.diag(model._posterior.fit.evidence.covariance))[:4])
        noises.append(model.noise_[0])
    away = (np.array(coefs) - [1.2, -0.5, 1.0, 0.3]) / np.array(stds)
    assert np.mean(noises) == pytest.approx(0.3, rel=0.06)  # the noise of the first rows counts too
    assert 0.6 < np.sqrt(np.mean(away**2)) < 1.6


def test_intervals_cover_new_measurements():
    model = linear(0.3, 0, 8)
    U, _, y, groups = planted(20, noise=0.3, seed=99)
    mean, std = model.predict(U.reshape(-1, 1), y0=y[:, :2], groups=groups, return_std=True)
    after = np.tile(np.arange(100) >= 2, 20)
    inside = np.abs(mean - y.ravel())[after] < 1.645 * std[after]
    assert np.mean(inside) == pytest.approx(0.9, abs=0.02)
    assert (std[after] > 0.95 * model.noise_[0]).all()
    assert (std[after] > model.noise_[0]).any()  # weights are not known exactly
    _, short = model.predict(U[0, :2].reshape(-1, 1), y0=y[:1, :2], groups=np.zeros(2), return_std=True)
    np.testing.assert_array_equal(np.ravel(short), np.full(2, model.noise_[0]))  # nothing is predicted there
    with pytest.raises(DataError, match='needs a fit with loss="shooting" and alpha="evidence"'):
        linear(0.3, alpha=0.1).predict(U.reshape(-1, 1), groups=groups, return_std=True)


def test_more_rows_find_the_start_better():
    model = linear(0.3, 0, 8)
    U, clean, y, groups = planted(60, noise=0.3, seed=7)
    errors = []
    for rows in (2, 30):
        free = model.predict(U.reshape(-1, 1), y0=y[:, :rows], groups=groups).reshape(clean.shape)
        errors.append(np.sqrt(np.mean((free - clean)[:, 2:12] ** 2)))
        np.testing.assert_array_equal(free[:, :2], y[:, :2])
    assert errors[1] < 0.6 * errors[0]


def test_more_rows_find_the_start_of_any_model():
    U, clean, y, groups = planted(30, noise=0.3, seed=7)
    data = planted(4)
    model = RecursivePredictor(LinearRegression(), 1, 2).fit(data[0].reshape(-1, 1), data[2].ravel(), groups=data[3])
    X = U.reshape(-1, 1)
    few, many = (model.predict(X, y0=y[:, :k], groups=groups).reshape(clean.shape) for k in (2, 30))
    assert np.mean((many - clean)[:, 2:12] ** 2) < 0.5 * np.mean((few - clean)[:, 2:12] ** 2)
    holes = y[:, :30].copy()
    holes[:, 3::4] = np.nan
    assert np.isfinite(model.predict(X, y0=holes, groups=groups)).all()
    with pytest.raises(DataError, match="y0 has 101 rows per run, but run 0 has 100"):
        model.predict(X, y0=np.zeros((30, 101, 1)), groups=groups)


def affine(a, b=1.0, c=0.0):
    """y[t] = a y[t-1] + b u[t] + c."""
    return LagNet(Net((np.array([[a], [b]]),), (np.full(1, c),), (), np.zeros(2), np.ones(2)), (1,), ((0, 0),), 1)


def test_the_way_down_goes_on_while_the_loss_falls(monkeypatch):
    """A tenth of the way a round: after twelve rounds a twelfth of the excess was left."""
    U, _, y, _ = planted(noise=0.3)
    net = Net((np.array([[0.5], [0.0], [0.5], [0.0]]),), (np.zeros(1),), (), np.zeros(4), np.ones(4))
    start, loss = LagNet(net, (1, 2), ((0, 0), (0, 1)), 1), FreeRunLoss(U, y, 2, 1e-3)
    best, least, _ = shooting_evidence.descend(loss, start, 50, 1e-10)

    def slowly(loss, model, n_steps, tol, guess=None):
        model = model.at(model.theta + 0.1 * (best.theta - model.theta))
        free = loss.run(model)
        return model, loss.value(model, free), free

    monkeypatch.setattr(shooting_evidence, "descend", slowly)
    found = shooting_evidence.fit_by_evidence(loss, start)
    excess = (loss.value(found.model, found.y) - least) / found.evidence.noise
    assert 0.0 < excess < 20.0 < 0.1 * (loss.value(start, loss.run(start)) - least) / found.evidence.noise


def test_the_first_penalty_does_not_hang_on_the_guess_except_of_a_model_that_runs_away():
    U, _, y, _ = planted(noise=0.3)
    loss = FreeRunLoss(U, y, 2, 1e-3)
    found = [shooting_evidence.first_penalty(loss, affine(0.6), guess, 50) for guess in (1e-4, 1e2)]
    assert found[0] == pytest.approx(found[1], rel=1e-6)
    with np.errstate(all="ignore"):
        assert shooting_evidence.first_penalty(loss, affine(1e10), 0.7) == 0.7


def test_what_leaves_grows_or_does_not_forget_is_refused():
    rng = np.random.RandomState(0)
    U = rng.normal(size=(5, 80, 1))
    y = free_run(affine(0.8), U, rng.normal(size=(5, 1, 1)))
    guard = OtherStarts(affine(0.7), U, y, 1, rng)
    assert guard.accepts(affine(0.8)) and guard.accepts(affine(0.85))
    assert not guard.accepts(affine(0.999)) and not guard.accepts(affine(1.2))
    bistable = Net(
        (np.array([[3.0], [0.1]]), np.array([[2.0]])), (np.zeros(1), np.zeros(1)), ("tanh",), *np.eye(2)[::-1]
    )
    assert not guard.accepts(LagNet(bistable, (1,), ((0, 0),), 1))
    # a plant that never forgets is not asked to: an integrator beside an integrator
    drift = free_run(affine(1.0, 0.1), U, rng.normal(size=(5, 1, 1)))
    assert OtherStarts(affine(0.99, 0.1), U, drift, 1, rng).accepts(affine(1.0, 0.1))
    assert OtherStarts(affine(0.7), U[:1], y[:1], 1, rng).accepts(affine(0.8))  # one run


@pytest.mark.slow
def test_shooting_is_no_worse_than_one_step_on_unseen_runs():
    # nothing here was chosen: seeds 20, 21, ... were not looked at before
    ratios = []
    for seed in range(20, 24):
        for noise in (0.05, 0.2):
            X, y, groups = make_reactor_runs(8, 200, noise=noise, random_state=seed)
            fresh, truth, labels = make_reactor_runs(10, 200, random_state=6000 + seed)
            first = truth.reshape(10, 200, 1)[:, :5]
            first = first + noise * np.random.default_rng(seed).normal(size=first.shape)
            errors = []
            for loss in ("one_step", "shooting"):
                model = RecursivePredictor(FNNRegressor((3,), random_state=seed), 5, 5, loss=loss, random_state=seed)
                free = model.fit(X, y, groups=groups).predict(fresh, y0=first, groups=labels)
                errors.append(np.sqrt(np.mean((free - truth) ** 2)))
            ratios.append(errors[1] / errors[0])
    assert np.median(ratios) < 0.9 and np.sum(np.array(ratios) <= 1.0) >= 6


def test_two_outputs_unequal_runs_and_layers():
    X, y, groups = make_reactor_runs(4, 60, noise=0.05, u_range=(0.1, 0.15), random_state=0)
    keep = np.r_[:110, 120:240]
    net = MLPRegressor(hidden_layer_sizes=(3, 2), activation="logistic", random_state=0)
    model = RecursivePredictor(net, 1, [1, 2], loss="shooting", random_state=0, n_starts=1)
    Y = np.c_[y, 2 * y + 1]
    model.fit(X[keep], Y[keep], groups=groups[keep])
    mean, std = model.predict(X, y0=Y.reshape(4, 60, 2)[:, :2], groups=groups, return_std=True)
    assert mean.shape == std.shape == Y.shape and model.noise_.shape == (2,)
    assert np.sqrt(np.mean((mean - Y) ** 2)) < 0.3 * Y.std() and np.isfinite(std).all()
