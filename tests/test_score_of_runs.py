"""A score of several runs taken for one says so; that of one run does not."""

import warnings

import numpy as np
import pytest

from sksurrogate.compose import RecursivePredictor
from sksurrogate.exceptions import DataError
from sksurrogate.linear import PCRRegressor
from sksurrogate.model_selection import FreeRunScorer


def runs_of(n_runs, rng, noise=0.002):
    """First-order runs from different starts."""
    X, y = np.repeat(rng.normal(size=(n_runs, 20)), 10, axis=1), np.empty((n_runs, 200))
    for k in range(n_runs):
        level = 4.0 * rng.normal()
        for t in range(200):
            y[k, t] = level
            level = 0.99 * level + 0.01 * X[k, t]
    y += noise * rng.normal(size=y.shape)
    return X.reshape(-1, 1), y.reshape(-1), np.repeat(np.arange(n_runs), 200)


@pytest.fixture
def model():
    X, y, groups = runs_of(4, np.random.default_rng(0))
    return RecursivePredictor(PCRRegressor(), input_lags=1, output_lags=1).fit(X, y, groups=groups)


def test_runs_without_groups_are_said_aloud_with_their_rows(model):
    X, y, groups = runs_of(5, np.random.default_rng(1))
    with pytest.warns(UserWarning, match=r"y jumps at row 200, 400, 600, 800.* seem to hold 5 runs. Pass groups="):
        blind = model.score(X, y)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        informed = model.score(X, y, groups=groups)
    assert informed > 0.9 > blind


def test_one_run_is_scored_without_a_word(model):
    rng = np.random.default_rng(2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for noise in (0.002, 0.5):  # a good score, and a bad one that no jump explains
            X, y, _ = runs_of(1, rng, noise)
            model.score(X, y)


def test_jumps_of_an_output_that_follows_its_input_are_no_runs():
    rng = np.random.default_rng(3)
    X = np.repeat(rng.normal(size=40), 10)[:, None]
    y = 3.0 * X[:, 0] + 0.01 * rng.normal(size=400)
    direct = RecursivePredictor(PCRRegressor(), input_lags=[0], output_lags=1).fit(X, y)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        direct.score(X, y + 5.0 * np.sin(0.02 * np.arange(400)))


@pytest.mark.parametrize("n_initial", [None, 7])
def test_a_run_of_first_rows_alone_leaves_nothing_to_score(model, n_initial):
    X, y, _ = runs_of(1, np.random.default_rng(4))
    n, scorer = n_initial or model.n_initial_, FreeRunScorer(n_initial=n_initial)
    with pytest.raises(DataError, match=str(n + 1)):
        scorer(model, X[:n], y[:n])
    assert np.isfinite(scorer(model, X[: n + 2], y[: n + 2]))
