"""The penalty of a network by the evidence: no worse than a grid that sees the truth, and honest about its error."""

import numpy as np
import pytest

from sksurrogate.exceptions import DataError
from sksurrogate.neural import FNNRegressor, _evidence


def curve(n, noise, seed):
    rng = np.random.default_rng(seed)
    X = rng.uniform(-2, 2, size=(n, 1))
    return X, np.sin(2 * X[:, 0]) + noise * rng.normal(size=n)


def test_the_penalty_needs_no_grid_and_the_noise_is_found():
    fresh = np.linspace(-2, 2, 200)[:, None]
    truth, ratios, noises = np.sin(2 * fresh[:, 0]), [], []
    for seed in range(4):
        X, y = curve(40, 0.3, seed)
        errors = []
        for alpha in ("evidence", 0.0, 1e-4, 1e-3, 1e-2, 1e-1):
            model = FNNRegressor((8,), alpha=alpha, random_state=seed).fit(X, y)
            errors.append(np.sqrt(np.mean((model.predict(fresh) - truth) ** 2)))
            if alpha == "evidence":
                noises.append(model.noise_[0])
        ratios.append((errors[0] / min(errors[1:]), errors[0] / errors[1]))
    # the best of the grid is known only to who knows the truth
    assert np.median(ratios, axis=0)[0] < 1.5 and np.median(ratios, axis=0)[1] < 0.8
    assert np.mean(noises) == pytest.approx(0.3, rel=0.15)


def test_intervals_cover_fresh_rows_and_widen_outside():
    inside = []
    for seed in range(8):
        X, y = curve(200, 0.2, seed)
        model = FNNRegressor((6,), alpha="evidence", random_state=seed).fit(X, y)
        V, z = curve(500, 0.2, 100 + seed)
        mean, std = model.predict(V, return_std=True)
        inside.append(np.mean(np.abs(z - mean) < 1.645 * std))
    assert np.mean(inside) == pytest.approx(0.9, abs=0.02)
    far = model.predict([[0.0], [4.0]], return_std=True)[1]
    assert far[1] > 1.5 * far[0]


def test_linear_networks_two_outputs_and_weights():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(80, 3))
    Y = X @ rng.normal(size=(3, 2)) * [1.0, 10.0] + 0.1 * rng.normal(size=(80, 2)) * [1.0, 10.0]
    model = FNNRegressor((), alpha="evidence", solver="lm").fit(X, Y)
    np.testing.assert_allclose(model.noise_, [0.1, 1.0], rtol=0.25)
    mean, std = model.predict(X, return_std=True)
    assert mean.shape == std.shape == (80, 2) and (std > model.noise_).all()
    one = FNNRegressor((), alpha="evidence").fit(X, Y, sample_weight=np.full(80, 2.0))
    two = FNNRegressor((), alpha="evidence").fit(np.r_[X, X], np.r_[Y, Y])
    np.testing.assert_allclose(one.coefs_[0], two.coefs_[0], rtol=1e-6)


def test_the_steps_of_all_rounds_count(monkeypatch):
    outcomes = []

    def kept(function):
        def counted(*given, **more):
            found = function(*given, **more)
            outcomes.append(getattr(found, "outcome", found))
            return found

        return counted

    for name in ("train", "train_least_squares"):
        monkeypatch.setattr(_evidence, name, kept(getattr(_evidence, name)))
    model = FNNRegressor((8,), alpha="evidence", random_state=0).fit(*curve(40, 0.3, 0))
    assert len(outcomes) > 1 and model.n_iter_ == sum(one.n_iter for one in outcomes)
    assert model.loss_curve_ == [loss for one in outcomes for loss in one.curve]


def test_what_has_no_hessian_says_so():
    X, y = curve(30, 0.1, 0)
    for settings in ({"solver": "lbfgs"}, {"activation": ("binary_step",)}, {"slope": 0.1}):
        with pytest.raises(DataError, match='alpha="evidence" needs the Hessian'):
            FNNRegressor((3,), alpha="evidence", **settings).fit(X, y)
    with pytest.raises(DataError, match="take one of them"):
        FNNRegressor((3,), alpha="evidence", early_stopping=True).fit(X, y)
    with pytest.raises(DataError, match="use fit"):
        FNNRegressor((3,), alpha="evidence").partial_fit(X, y)
    with pytest.raises(DataError, match="return_std=True needs a fit"):
        FNNRegressor((3,), random_state=0).fit(X, y).predict(X, return_std=True)
