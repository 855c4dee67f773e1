"""Recurrent networks: the contract of scikit-learn, masks, a planted system, free runs of any length."""

import pickle

import numpy as np
import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.exceptions import DataError
from sksurrogate.neural import RecurrentRegressor
from sksurrogate.neural._recurrent import _classes

ORDER = "row order matters to a model of runs"
EXPECTED = {"check_methods_sample_order_invariance": ORDER, "check_methods_subset_invariance": ORDER}


@parametrize_with_checks(
    [RecurrentRegressor(hidden_size=2, n_initial=1, max_epochs=2, random_state=0)],
    expected_failed_checks=lambda estimator: EXPECTED,
)
def test_sklearn_contract(estimator, check):
    check(estimator)


def planted(n_runs=12, n=80, seed=0):
    """A first-order lag of tanh(2 u)."""
    rng = np.random.default_rng(seed)
    U = np.repeat(rng.uniform(-1, 1, size=(n_runs, n // 10)), 10, axis=1)
    y = np.empty((n_runs, n))
    y[:, 0] = rng.uniform(-1, 1, size=n_runs)
    for t in range(1, n):
        y[:, t] = 0.8 * y[:, t - 1] + 0.2 * np.tanh(2 * U[:, t - 1])
    return U.reshape(-1, 1), y.ravel(), np.repeat(np.arange(n_runs), n)


@pytest.mark.slow
@pytest.mark.parametrize("cell", ["gru", "lstm"])
def test_a_planted_lag_is_learned_and_run_freely(cell):
    X, y, groups = planted()
    X1, y1, groups1 = planted(seed=1)
    model = RecurrentRegressor(cell, 8, n_initial=2, max_epochs=60, batch_size=4, learning_rate=0.02, random_state=0)
    model.fit(X, y, groups=groups)
    assert model.loss_curve_[-1] < 0.05 * model.loss_curve_[0]
    assert model.score(X1, y1, groups=groups1) > 0.95
    again = pickle.loads(pickle.dumps(model))
    first = y1.reshape(12, 80)[:, :2, None]
    free = again.predict(X1, y0=first, groups=groups1)
    np.testing.assert_array_equal(free, model.predict(X1, y0=first, groups=groups1))
    np.testing.assert_array_equal(free.reshape(12, 80)[:, :2], first[:, :, 0])


def test_seeds_decide_and_the_generator_of_torch_stays():
    import torch

    X, y, groups = planted(4, 40)
    before = torch.get_rng_state()
    fits = [RecurrentRegressor(hidden_size=4, max_epochs=3, random_state=s).fit(X, y, groups=groups) for s in (0, 0, 1)]
    assert torch.equal(before, torch.get_rng_state())
    curves = [fit.loss_curve_ for fit in fits]
    assert curves[0] == curves[1] != curves[2]


def test_rows_that_are_not_there_do_not_count():
    import torch

    error = _classes()["MaskedError"]()
    target = torch.tensor([[1.0, float("nan")], [3.0, float("nan")]])
    assert float(error(torch.tensor([[2.0, 9.0], [5.0, 9.0]]), target)) == pytest.approx(2.5)


def test_runs_of_unequal_length_equal_runs_alone():
    X, y, groups = planted(6, 60)
    keep = np.r_[0:60, 60:100, 120:200]
    groups = groups[keep]
    X, y = X[keep], y[keep]
    model = RecurrentRegressor(hidden_size=4, max_epochs=3, window=30, random_state=0).fit(X, y, groups=groups)
    labels = np.unique(groups)
    first = np.stack([y[groups == r][:5] for r in labels])[:, :, None]
    together = model.predict(X, y0=first, groups=groups)
    alone = [model.predict(X[groups == r], y0=f) for r, f in zip(labels, first)]
    np.testing.assert_allclose(together, np.concatenate(alone), atol=1e-5)  # float32
    ahead = model.predict_ahead(X, y, 3, groups=groups)
    assert np.isnan(ahead[:7]).all() and np.isfinite(ahead[7:60]).all()
    window = model.predict(X[3:11], y0=y[3:8])
    assert ahead[10] == pytest.approx(window[7], abs=1e-5)


def test_what_is_wrong_is_said():
    X, y, groups = planted(2, 20)
    for given in ({"cell": "rnn"}, {"alpha": -1}, {"init": "x"}, {"hidden_size": 0}):
        with pytest.raises(ValueError, match=f"'{next(iter(given))}' parameter of RecurrentRegressor"):
            RecurrentRegressor(**given).fit(X, y)
    model = RecurrentRegressor(hidden_size=2, max_epochs=1, random_state=0).fit(X, y, groups=groups)
    with pytest.raises(DataError, match=r"expected \(5, 1\)"):
        model.predict(X, y0=[1.0])


def test_units_and_zeros_of_the_columns_do_not_matter():
    X, y, groups = planted(4, 40)
    first = y.reshape(4, 40)[:, :2, None]
    model = RecurrentRegressor(hidden_size=4, n_initial=2, max_epochs=4, random_state=0)
    plain = model.fit(X, y, groups=groups).predict(X, y0=first, groups=groups)
    other = model.fit(40 * X + 300, 0.5 * y - 7, groups=groups).predict(40 * X + 300, y0=0.5 * first - 7, groups=groups)
    np.testing.assert_allclose((other + 7) / 0.5, plain, atol=1e-4)
