"""What a linear model says of its coefficients is kept by a fit through the free run, or refused; found ones predict."""

import pickle

import numpy as np
import pytest
from scipy.optimize import least_squares
from sklearn.base import clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.decomposition import PCA
from sklearn.linear_model import BayesianRidge, ElasticNet, Lasso, LinearRegression, PoissonRegressor, Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from sksurrogate.compose import HybridRegressor, RecursivePredictor
from sksurrogate.datasets import linear_reactor, make_reactor_runs
from sksurrogate.exceptions import DataError
from sksurrogate.linear import Bounds, PenalizedRegressor, SparseRegressor
from sksurrogate.physics import ODESimulator
from sksurrogate.runs import stack_runs


def quadratic(last):
    return make_pipeline(PolynomialFeatures(2, include_bias=False), last)


def spring(cubic=0.0, push=0.0, gain=1.0):
    def rhs(t, x, u, p):
        return x[1], p["gain"] * u[0] - x[0] - 0.4 * x[1] - p["cubic"] * x[0] ** 3 + p["push"]

    params = {"cubic": cubic, "push": push, "gain": gain}
    return ODESimulator(rhs, states=["q", "v"], inputs=["f"], outputs=["q"], params=params, dt=0.05)


def spring_runs(simulator, n_runs=4, n=160):
    rng = np.random.default_rng(0)
    U = [np.repeat(rng.normal(size=n // 10), 10)[:, None] for _ in range(n_runs)]
    return stack_runs(U, [simulator.simulate(u)[:, 0] for u in U])


def recursion(noise=0.0, seed=0):
    """y[t] = 0.6 y[t-1] + u[t] + 0.3 u[t-1] from inputs about 2: the outputs are far from zero, without a constant."""
    rng = np.random.default_rng(seed)
    X, y = 2 + rng.normal(size=(3, 80)), np.zeros((3, 80))
    y[:, 0] = 8.0
    for t in range(1, 80):
        y[:, t] = 0.6 * y[:, t - 1] + X[:, t] + 0.3 * X[:, t - 1]
    return X.reshape(-1, 1), (y + noise * rng.normal(size=y.shape)).ravel(), np.repeat(range(3), 80)


DEMANDS = [
    (LinearRegression(positive=True), r"LinearRegression\(positive=True\)", "leave positive out"),
    (Ridge(positive=True), r"Ridge\(positive=True\)", "leave positive out"),
    (PenalizedRegressor(constraints=[Bounds(lower=0)]), r"PenalizedRegressor\(constraints=\[Bounds\]\)", "leave constraints out"),
    (SparseRegressor(), "leaves no term out, as SparseRegressor does", "such as Ridge"),
    (Lasso(), "leaves no term out, as Lasso does", "such as Ridge"),
]  # fmt: skip


@pytest.mark.parametrize(("last", "said", "way_out"), DEMANDS)
@pytest.mark.parametrize(
    "around", [clone, quadratic, lambda last: TransformedTargetRegressor(last, transformer=StandardScaler())]
)
def test_shooting_refuses_what_it_would_not_keep(last, said, way_out, around):
    X, y, groups = recursion()
    with pytest.raises(DataError, match=rf'^loss="shooting".*{said}.*use loss="one_step".*{way_out}'):
        RecursivePredictor(around(last), 1, 1, loss="shooting").fit(X, y, groups=groups)


@pytest.mark.parametrize(("last", "said", "way_out"), DEMANDS)
@pytest.mark.parametrize("form", ["dynamics", "input"])
@pytest.mark.parametrize("loss", [None, "one_step"])
def test_a_term_inside_refuses_what_it_would_not_keep(last, said, way_out, form, loss):
    X, y, groups = spring_runs(spring(0.5))
    with pytest.raises(DataError, match=rf'^form="{form}".*{said}.*use form="static" or "output".*{way_out}'):
        HybridRegressor(spring(), quadratic(last), form, loss=loss).fit(X, y, groups=groups)


@pytest.mark.parametrize(("last", "said", "way_out"), DEMANDS)
def test_a_correction_through_the_free_run_refuses_what_it_would_not_keep(last, said, way_out):
    X, y, groups = make_reactor_runs(3, 60, random_state=0)
    with pytest.raises(DataError, match=rf'^loss="shooting".*{said}.*use loss="one_step".*{way_out}'):
        HybridRegressor(linear_reactor(), last, loss="shooting").fit(X, y, groups=groups)


def test_the_ways_out_keep_what_is_demanded():
    X, y, groups = make_reactor_runs(3, 60, noise=0.02, random_state=0)
    positive = LinearRegression(positive=True)
    one_step = RecursivePredictor(positive, 2, 2).fit(X, y, groups=groups)
    assert (one_step.estimator_.coef_ >= 0).all()
    for form in ("static", "output", "auto"):  # "auto" leaves out the forms that refuse
        hybrid = HybridRegressor(linear_reactor(), positive, form).fit(X, y, groups=groups)
        assert hybrid.form_ in ("static", "output") and (hybrid.residual_.coef_ >= 0).all()


def test_an_elastic_net_without_its_sparse_part_is_a_ridge():
    X, y, groups = recursion(0.1)
    shot = [
        RecursivePredictor(last, 1, 1, loss="shooting", alpha=0.0).fit(X, y, groups=groups)
        for last in (ElasticNet(1e-3, l1_ratio=0.0), Ridge(1e-3))
    ]
    np.testing.assert_allclose(*(model.estimator_.coef_ for model in shot), rtol=1e-4)


# ---- no intercept -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "estimator",
    [
        LinearRegression(fit_intercept=False),
        PenalizedRegressor(fit_intercept=False),
        make_pipeline(StandardScaler(), LinearRegression(fit_intercept=False)),
        make_pipeline(PCA(3), LinearRegression(fit_intercept=False)),
        quadratic(LinearRegression(fit_intercept=False)),
        PenalizedRegressor(fit_intercept=False, features=PolynomialFeatures(2, include_bias=False)),
    ],
)
@pytest.mark.parametrize("n_outputs", [1, 2])
@pytest.mark.filterwarnings("ignore:the free runs of")  # centred features without a constant miss the mean
def test_a_horizon_of_one_step_is_least_squares_through_the_origin(estimator, n_outputs):
    X, y, groups = recursion(noise=0.3)
    y = y if n_outputs == 1 else np.c_[y, 0.05 * y**2 + 3]
    one, shot = (
        RecursivePredictor(estimator, 1, 1, **settings).fit(X, y, groups=groups)
        for settings in ({}, {"loss": "shooting", "horizon": 1, "alpha": 0.0})
    )
    a, b = (getattr(model.estimator_, "steps", [(0, model.estimator_)])[-1][1] for model in (one, shot))
    np.testing.assert_array_equal(b.intercept_, np.zeros_like(b.intercept_))
    np.testing.assert_allclose(b.coef_, a.coef_, atol=1e-4 * np.abs(a.coef_).max())
    assert shot.one_step_rmse_ == pytest.approx(one.one_step_rmse_, rel=1e-6)


@pytest.mark.parametrize("alpha", [None, 0.0, "evidence"])
def test_a_planted_recursion_without_a_constant_is_found(alpha):
    X, y, groups = recursion()
    model = RecursivePredictor(LinearRegression(fit_intercept=False), 1, 1, loss="shooting", alpha=alpha)
    model.fit(X, y, groups=groups)
    np.testing.assert_allclose(model.estimator_.coef_, [0.6, 1.0, 0.3], atol=1e-5)
    assert model.estimator_.intercept_ == 0.0 and model.compiled_


def test_the_free_run_is_that_of_the_best_recursion_without_a_constant():
    X, y, groups = recursion(noise=0.5)
    model = RecursivePredictor(LinearRegression(fit_intercept=False), 1, 1, loss="shooting", alpha=0.0)
    model.fit(X, y + 1.0, groups=groups)  # a constant would help
    U, target = X.reshape(3, 80), (y + 1.0).reshape(3, 80)

    def errors(coef):
        run = target.copy()
        for t in range(1, 80):
            run[:, t] = coef[0] * run[:, t - 1] + coef[1] * U[:, t] + coef[2] * U[:, t - 1]
        return (run - target).ravel()

    best = least_squares(errors, [0.5, 0.5, 0.5], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    np.testing.assert_allclose(model.estimator_.coef_, best.x, atol=1e-4)
    assert np.sum(errors(model.estimator_.coef_) ** 2) <= 2 * best.cost * (1 + 1e-6)


def test_a_fit_without_an_intercept_knows_its_noise():
    X, y, groups = recursion(noise=0.3)
    model = RecursivePredictor(LinearRegression(fit_intercept=False), 1, 1, loss="shooting").fit(X, y, groups=groups)
    assert model.noise_ == pytest.approx(0.3, rel=0.15)
    mean, std = model.predict(X, groups=groups, return_std=True)
    assert mean.shape == std.shape and 0.25 < np.median(std) < 0.5
    with pytest.raises(DataError, match='alpha="auto" is for networks and linear models with an intercept'):
        model.set_params(alpha="auto").fit(X, y, groups=groups)


def test_a_scaled_target_without_an_intercept_is_refused():
    X, y, groups = recursion()
    scaled = TransformedTargetRegressor(LinearRegression(fit_intercept=False), transformer=StandardScaler())
    with pytest.raises(DataError, match=r"LinearRegression\(fit_intercept=False\) behind a scaled target"):
        RecursivePredictor(scaled, 1, 1, loss="shooting").fit(X, y, groups=groups)


@pytest.mark.slow
@pytest.mark.parametrize("scaler", [(), (StandardScaler(),)])
def test_a_correction_without_an_intercept_is_shot_without_one(scaler):
    X, y, groups = make_reactor_runs(5, 80, noise=0.05, random_state=0)
    plain, without = (make_pipeline(*scaler, LinearRegression(fit_intercept=given)) for given in (True, False))
    one = HybridRegressor(linear_reactor(), without).fit(X, y, groups=groups)
    shot, free = (
        HybridRegressor(linear_reactor(), r, loss="shooting").fit(X, y, groups=groups) for r in (without, plain)
    )
    assert shot.residual_[-1].intercept_ == 0.0 and abs(free.residual_[-1].intercept_) > 1e-6
    assert np.abs(shot.residual_[-1].coef_ - one.residual_[-1].coef_).max() > 1e-6
    phi = np.random.default_rng(0).normal(size=(7, 12))
    np.testing.assert_allclose(shot.residual_.predict(phi), shot.correction_.step(phi)[:, 0], rtol=1e-9)


# ---- the term inside a simulator ----------------------------------------------------------------------------------------
RESIDUALS = {
    "polynomials": quadratic(Ridge()),
    "penalised": quadratic(PenalizedRegressor()),
    "its own features": PenalizedRegressor(features=PolynomialFeatures(2, include_bias=False)),
    "features behind a scaler": make_pipeline(StandardScaler(), PenalizedRegressor(features=PolynomialFeatures(2))),
    "linear": Ridge(),
    "linear, no constant": LinearRegression(fit_intercept=False),
    "no constant": quadratic(LinearRegression(fit_intercept=False)),
    "one output": quadratic(BayesianRidge()),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RESIDUALS)
@pytest.mark.parametrize("form", ["dynamics", "input"])
@pytest.mark.filterwarnings("ignore:.*nearly dependent")
def test_the_residual_predicts_the_term_that_is_used(name, form):
    cubic, push = 0.3 if form == "dynamics" else 0.0, 0.0 if "no constant" in name else 0.4
    X, y, groups = spring_runs(spring(cubic, push, gain=1.3))
    hybrid = HybridRegressor(spring(), RESIDUALS[name], form).fit(X, y, groups=groups)
    rng = np.random.default_rng(1)
    x, u = 0.2 * rng.normal(size=(2, 30)), 0.2 * rng.normal(size=(1, 30))  # among the data: nothing fades
    added = hybrid.correction_.rhs(0.0, x, u) - np.asarray(spring().rhs(0.0, x, u, spring().params))
    seen = u.T if form == "input" else np.concatenate([x, u]).T
    np.testing.assert_allclose(added[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(hybrid.residual_.predict(seen)[:, 0], added[1], rtol=1e-7, atol=1e-10)
    assert np.abs(added[1]).max() > 0.01
    last = getattr(hybrid.residual_, "steps", [(0, hybrid.residual_)])[-1][1]
    if not last.fit_intercept:
        np.testing.assert_array_equal(last.intercept_, [0.0])
    copied = pickle.loads(pickle.dumps(hybrid.residual_))
    np.testing.assert_array_equal(copied.predict(seen), hybrid.residual_.predict(seen))
    assert hybrid.residual_.n_features_in_ == seen.shape[1]


@pytest.mark.slow
@pytest.mark.parametrize("last", [PenalizedRegressor(), BayesianRidge()])
def test_two_terms_are_two_outputs_of_the_residual(last):
    X, y, groups = spring_runs(spring(0.3))
    hybrid = HybridRegressor(spring(), last, "dynamics", states=["q", "v"]).fit(X, y, groups=groups)
    rng = np.random.default_rng(1)
    x, u = 0.2 * rng.normal(size=(2, 30)), 0.2 * rng.normal(size=(1, 30))
    added = hybrid.correction_.rhs(0.0, x, u) - np.asarray(spring().rhs(0.0, x, u, spring().params))
    np.testing.assert_allclose(hybrid.residual_.predict(np.concatenate([x, u]).T), added.T, rtol=1e-7, atol=1e-10)


@pytest.mark.slow
def test_a_term_without_a_constant_has_none():
    X, y, groups = spring_runs(spring(push=0.4))
    linear = [
        HybridRegressor(spring(), LinearRegression(fit_intercept=given), "dynamics").fit(X, y, groups=groups)
        for given in (True, False)
    ]
    assert linear[0].residual_.intercept_[0] == pytest.approx(0.4, abs=0.02)
    assert linear[1].residual_.intercept_[0] == 0.0
    assert linear[0].free_run_rmse_ < 0.2 * linear[1].free_run_rmse_  # the force is a constant


def test_a_model_with_a_link_is_fitted_as_a_force_by_its_own_rules():
    X, y, groups = spring_runs(spring(0.5))
    with pytest.raises(ValueError, match="out of the valid range"):  # a force is negative at times, and a count is not
        HybridRegressor(spring(), quadratic(PoissonRegressor()), "dynamics").fit(X, y, groups=groups)
