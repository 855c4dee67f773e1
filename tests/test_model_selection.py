"""Selection on the free run."""

import numpy as np
import pytest
import sklearn
from scipy.signal import lfilter
from scipy.stats import norm
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV, GroupKFold
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.compose import RecursivePredictor, StateSpaceRegressor
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.exceptions import DataError
from sksurrogate.metrics import cross_correlation_test, fit_percent, whiteness_test
from sksurrogate.model_selection import FreeRunScorer


def planted(n_runs=6, n=60):
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(n_runs * n, 1)), rng.normal(size=n_runs * n)
    for t in range(2, n_runs * n):
        if t % n > 1:
            y[t] = 1.2 * y[t - 1] - 0.5 * y[t - 2] + X[t, 0]
    return X, y, np.repeat(np.arange(n_runs), n)


@pytest.mark.parametrize("routing", [True, False])
def test_a_search_picks_the_true_order(routing):
    X, y, groups = planted()
    with sklearn.config_context(enable_metadata_routing=routing):
        data = X if routing else np.column_stack([groups, X])
        model = RecursivePredictor(LinearRegression(), 1, run=None if routing else 0)
        search = GridSearchCV(
            model, {"output_lags": [1, 2]}, cv=GroupKFold(3), scoring=FreeRunScorer("neg_rmse", n_initial=3)
        )
        search.fit(data, y, groups=groups)
    assert search.best_params_ == {"output_lags": 2} and search.best_score_ > -1e-8


def test_scorer_and_score_agree():
    X, y, groups = planted()
    model = RecursivePredictor(LinearRegression(), 1, 1).fit(X, y, groups=groups)
    assert FreeRunScorer()(model, X, y, groups=groups) == pytest.approx(model.score(X, y, groups=groups))
    with pytest.raises(DataError, match="needs 1 first rows"):
        FreeRunScorer(n_initial=0).score(model, X, y, groups=groups)


def test_fit_percent_and_whiteness_against_closed_forms():
    assert fit_percent([1.0, 3.0], [2.0, 2.0])[0] == pytest.approx(0.0)
    e = np.zeros(200)
    rng = np.random.default_rng(0)
    for t in range(1, 200):
        e[t] = 0.8 * e[t - 1] + rng.normal()
    assert whiteness_test(e).p_value < 1e-6
    false_alarms = [whiteness_test(rng.normal(size=400)).p_value < 0.05 for _ in range(400)]
    assert 0.02 < np.mean(false_alarms) < 0.09  # 5 % +- 3.5 standard errors


def test_what_lies_under_a_mask_is_no_measurement():
    values = np.random.default_rng(0).normal(size=60)
    masked = np.ma.masked_where(np.arange(60) == 3, np.where(np.arange(60) == 3, 1e6, values))
    assert np.isnan(fit_percent(masked, values)).all() and np.isnan(fit_percent(values, masked)).all()
    with pytest.raises(DataError, match="residual has 60 rows, 59 finite"):
        whiteness_test(masked)
    with pytest.raises(DataError, match="u has 60 rows, 59 finite"):
        cross_correlation_test(values, masked)


@pytest.mark.filterwarnings(
    "ignore:the free runs of"
)  # of a network with too few nodes: the search is there to pass it over
def test_a_search_chooses_estimator_nodes_and_lags_by_runs():
    X, y, groups = make_reactor_runs(8, 80, u_range=(0.1, 0.2), random_state=0)
    net = MLPRegressor(activation="tanh", solver="lbfgs", alpha=1e-3, max_iter=400, random_state=0)
    grid = [
        {"estimator": [LinearRegression()], "output_lags": [1, 2], "input_lags": [1]},
        {"estimator": [make_pipeline(StandardScaler(), net)], "output_lags": [1],
         "estimator__mlpregressor__hidden_layer_sizes": [(2,), (8,)]},
    ]  # fmt: skip
    with sklearn.config_context(enable_metadata_routing=True):
        search = GridSearchCV(
            RecursivePredictor(LinearRegression(), 1, 1), grid, cv=GroupKFold(2),
            scoring=FreeRunScorer("neg_rmse", n_initial=2), error_score=-np.inf,
        )  # fmt: skip
        search.fit(X, y, groups=groups)
    assert "estimator__mlpregressor__hidden_layer_sizes" in search.best_params_
    assert search.best_score_ > 2 * search.cv_results_["mean_test_score"][:2].max()  # less than half the error


def test_a_search_chooses_the_order_of_a_state_space_model():
    X, y, groups = planted()
    with sklearn.config_context(enable_metadata_routing=True):
        search = GridSearchCV(
            StateSpaceRegressor(n_initial=6, feedthrough=True), {"n_states": [1, 2]}, cv=GroupKFold(3),
            scoring=FreeRunScorer("neg_rmse", n_initial=6),
        )  # fmt: skip
        search.fit(X, y, groups=groups)
    assert search.best_params_ == {"n_states": 2} and search.best_score_ > -1e-2


def test_residuals_of_two_columns_are_refused():
    with pytest.raises(DataError, match=r"residual has shape \(30, 2\), expected \(n_samples,\): test one column"):
        whiteness_test(np.random.default_rng(0).normal(size=(30, 2)))
    with pytest.raises(DataError, match="n_lags=0 must be an int of at least 1"):
        whiteness_test(np.arange(30.0), 0)


def test_a_scorer_of_free_runs_names_the_model_that_cannot():
    X, y = np.random.default_rng(0).normal(size=(20, 1)), np.arange(20.0)
    with pytest.raises(DataError, match=r"FreeRunScorer needs a fitted model that runs freely.*LinearRegression"):
        FreeRunScorer()(LinearRegression().fit(X, y), X, y)


@pytest.mark.parametrize("n_initial", [None, 3])
def test_a_scorer_sees_all_outputs(n_initial):
    X, y, groups = planted()
    both = np.column_stack([y, np.roll(y, 1) + 0.3 * np.sin(np.arange(len(y)))])
    model = RecursivePredictor(LinearRegression(), 1, 1).fit(X, both, groups=groups)
    scorer = FreeRunScorer("neg_rmse", n_initial=n_initial)
    skip, missed = n_initial or 1, []
    for label in np.unique(groups):
        u, v = X[groups == label], both[groups == label]
        free = model.predict(u[skip - 1 :], y0=v[skip - 1 : skip])
        missed.append(free[1:] - v[skip:])
    assert scorer.score(model, X, both, groups=groups) == pytest.approx(-np.sqrt(np.mean(np.concatenate(missed) ** 2)))


def test_a_scorer_takes_groups_before_the_run_column_of_the_model():
    """Two runs of the column that follow each other without a break are scored as one run."""
    X, y, groups = planted()
    table = np.column_stack([X, np.arange(len(X)) // 20])  # half a run each
    model = RecursivePredictor(LinearRegression(), 1, 1, run=X.shape[1]).fit(table, y)
    plain = RecursivePredictor(LinearRegression(), 1, 1).fit(X, y, groups=table[:, -1])
    scorer = FreeRunScorer()
    assert scorer.score(model, table, y, groups=groups) == pytest.approx(scorer.score(plain, X, y, groups=groups))
    assert scorer.score(model, table, y) == pytest.approx(scorer.score(plain, X, y, groups=table[:, -1]))


def test_correlations_of_independent_signals_stay_within_their_band_in_99_of_100():
    rng = np.random.default_rng(0)
    found = [cross_correlation_test(*rng.normal(size=(2, 400)), n_lags=10) for _ in range(200)]
    assert found[0].bound == pytest.approx(norm.ppf(0.995) / np.sqrt(400), rel=1e-3)
    outside = np.mean([np.abs(one.correlation) > one.bound for one in found])
    assert outside == pytest.approx(0.01, abs=5 * np.sqrt(0.01 / 2200))
    copies = cross_correlation_test(found[0].correlation, found[0].correlation, n_lags=2)
    assert copies.correlation[0] == pytest.approx(1.0)


def test_a_coloured_residual_raises_no_more_alarms_than_a_white_one():
    rng = np.random.default_rng(0)
    pairs = lfilter([1.0], [1.0, -0.9], rng.normal(size=(200, 2, 300)))
    false_alarms = np.mean([cross_correlation_test(e, u).p_value < 0.05 for e, u in pairs])
    assert false_alarms < 0.05 + 3.5 * np.sqrt(0.05 * 0.95 / 200)
    found = [cross_correlation_test(e + 0.5 * u, u).p_value < 0.05 for e, u in pairs]
    assert np.mean(found) > 0.99
