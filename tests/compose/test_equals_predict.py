"""What a regressor is compiled to is its own predict, for every regressor and setting, within the data and far outside."""

import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.cross_decomposition import PLSRegression
from sklearn.decomposition import PCA
from sklearn.ensemble import RandomForestRegressor
from sklearn.linear_model import Lasso, LinearRegression, PoissonRegressor, Ridge, TweedieRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, PolynomialFeatures, RobustScaler, StandardScaler

from sksurrogate.compose import DerivativeRegressor, HybridRegressor, RecursivePredictor
from sksurrogate.exceptions import DataError, SimulationDiverged
from sksurrogate.linear import NonlinearBasisRegressor, PenalizedRegressor
from sksurrogate.model_selection import Remembered
from sksurrogate.neural import FNNRegressor
from sksurrogate.physics import CallableSimulator, ODESimulator

pytestmark = [
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
    pytest.mark.filterwarnings("ignore:the free runs of"),
    pytest.mark.filterwarnings("ignore:the fitted model is stiff"),
    pytest.mark.filterwarnings("ignore:overflow encountered"),
]


class Held(Ridge):
    """A linear model in looks that never predicts below zero."""

    def predict(self, X):
        return np.maximum(super().predict(X), 0.0)


def net(**settings):
    given = {"activation": "tanh", "max_iter": 200, **settings}
    return MLPRegressor(hidden_layer_sizes=(3,), solver="lbfgs", random_state=0, **given)


S = StandardScaler
SCALERS = [
    *(S(with_mean=m, with_std=s) for m in (True, False) for s in (True, False)),
    *(RobustScaler(with_centering=c, with_scaling=s) for c in (True, False) for s in (True, False)),
    MinMaxScaler((-1, 3)),
    MinMaxScaler((-1, 3), clip=True),
    MaxAbsScaler(),
    MaxAbsScaler(clip=True),
]
REGRESSORS = [
    *(make_pipeline(scaler, Ridge(1e-6)) for scaler in SCALERS),
    *(make_pipeline(scaler, net()) for scaler in SCALERS[2:4] + SCALERS[-2:]),
    *(make_pipeline(scaler, PolynomialFeatures(2), scaler, Ridge(1e-6)) for scaler in SCALERS),
    *(TransformedTargetRegressor(LinearRegression(), transformer=scaler) for scaler in SCALERS),
    make_pipeline(S(), PolynomialFeatures(0), S(), Ridge()),
    make_pipeline(S(), PolynomialFeatures((1, 2), interaction_only=True), S(with_std=False), Ridge()),
    make_pipeline(S(with_mean=False), net(activation="logistic")),
    make_pipeline(S(), net(activation="relu")),
    make_pipeline(S(), net(loss="poisson")),
    make_pipeline(S(), net(loss="poisson", activation="logistic")),
    make_pipeline(PCA(2, whiten=True), Ridge(1e-6)),
    make_pipeline(RobustScaler(), FNNRegressor((3,), random_state=0, max_epochs=20)),
    PLSRegression(2),
    PLSRegression(1, scale=False),
    PoissonRegressor(alpha=1e-6),
    TweedieRegressor(power=0, link="log", alpha=1e-6),
    TweedieRegressor(power=0, link="identity", alpha=1e-6),
    Held(1e-6),
    Lasso(1e-3, positive=True),
    RandomForestRegressor(5, random_state=0),
    PenalizedRegressor(features=PolynomialFeatures(2)),
    NonlinearBasisRegressor("gaussian", 2, n_starts=1, max_iter=20, random_state=0),
    make_pipeline(S(), NonlinearBasisRegressor("gaussian", 3, n_starts=1, max_iter=20, random_state=0)),
]
EVERY = pytest.mark.parametrize("regressor", REGRESSORS, ids=lambda model: " ".join(str(model).split())[:110])

RNG = np.random.default_rng(0)
DT, N = 0.05, 300
U = np.repeat(RNG.uniform(2, 4, (N // 10, 1)), 10, axis=0)
Y = np.empty(N)
Y[0] = 3.0
for k in range(N - 1):  # dy/dt = 1 - 2 y + 3 u, exactly
    Y[k + 1] = np.exp(-2 * DT) * Y[k] + (1 - np.exp(-2 * DT)) * (1 + 3 * U[k, 0]) / 2
FAR = [
    (U, Y),
    *((3.0 + reach * RNG.uniform(-1, 1, (20, 1)), 3.0 + reach * RNG.uniform(-1, 1, 20)) for reach in (5, 40)),
]


def close(found, wanted):
    with np.errstate(invalid="ignore"):
        np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-9 * np.nanmax(np.abs(wanted)))


@EVERY
@pytest.mark.parametrize("measured", [True, False], ids=["derivatives", "weak form"])
def test_a_derivative_model_is_its_regressor(regressor, measured):
    slopes = np.exp(0.3 - 0.2 * Y + 0.1 * U[:, 0])  # positive, as a link wants it
    if not measured and any(word in str(regressor) for word in ("poisson", "Poisson", "log'")):
        return  # a loss for positive targets; those of the weak form have both signs
    model = DerivativeRegressor(regressor, dt=DT, n_sub=1).fit(U, Y, dydt=slopes if measured else None)
    for X, y in FAR:
        wanted = model.estimator_.predict(np.c_[y, X])
        close(model.derivative(X, y), np.ravel(wanted))


@EVERY
def test_a_free_run_is_a_step_by_step_run_of_its_regressor(regressor):
    model = RecursivePredictor(regressor, input_lags=0, output_lags=1).fit(U, Y)
    inputs = 3.0 + 3.0 * (U[::5] - 3.0)  # beyond the training inputs
    free = [Y[0]]
    for k in range(1, len(inputs)):
        free.append(float(np.ravel(model.estimator_.predict([[free[-1], inputs[k, 0]]]))[0]))
    if np.abs(free).max() > 1e3 * np.ptp(Y):
        with pytest.raises(SimulationDiverged):
            model.predict(inputs, y0=Y[:1])
        return
    close(model.predict(inputs, y0=Y[:1]), free)


@EVERY
@pytest.mark.parametrize("form", ["static", "output"])
def test_a_hybrid_is_its_simulator_and_its_residual(regressor, form):
    X = RNG.uniform(5, 6, (120, 1))
    y = 4 + X[:, 0] + np.exp(0.3 * X[:, 0])  # the simulator says u
    model = HybridRegressor(CallableSimulator(lambda U: U), regressor, form, loss="one_step", fade=np.inf, n_lags=1)
    model.fit(X, y)
    share = model.shrinkage_[0]
    for inputs in (X[:30], 5.5 + 3.0 * (X[:30] - 5.5)):
        found = model.predict(inputs, y0=None if form == "static" else inputs[:1, 0])
        before = np.r_[inputs[:1], inputs[:-1]]
        if form == "static":
            features = np.c_[inputs, before, inputs]
            close(found, inputs[:, 0] + share * np.ravel(model.residual_.predict(features)))
            continue
        d, wanted = 0.0, [inputs[0, 0]]
        for now, past in zip(inputs[1:, 0], before[1:, 0]):
            d = float(np.ravel(model.residual_.predict([[d, now, past, now]]))[0])
            d = float(np.clip(d, -model.correction_.bound[0], model.correction_.bound[0]))
            wanted.append(now + share * d)
        close(found, wanted)


@pytest.mark.parametrize("scaler", [S(with_mean=False), S(with_std=False), RobustScaler(with_centering=False)], ids=str)
def test_a_shooting_fit_behind_a_scaler_is_that_of_its_setting(scaler):
    for model in (Ridge(1e-8), net(max_iter=50)):
        shot = RecursivePredictor(make_pipeline(scaler, clone(model)), [1], 1, loss="shooting").fit(U, Y)
        assert shot.compiled_
        free = [Y[0]]
        for k in range(1, 30):
            free.append(float(shot.estimator_.predict([[free[-1], U[k - 1, 0]]])[0]))
        close(shot.predict(U[:30], y0=Y[:1]), free)
        assert np.abs(shot.predict(U, y0=Y[:1]) - Y).max() < 0.05 * np.ptp(Y)


def test_slopes_of_what_only_looks_linear_are_not_used_for_a_shooting_fit(tmp_path):
    for model in (
        Held(),
        PoissonRegressor(),
        make_pipeline(S(with_mean=False), PLSRegression(1)),
        Remembered(Ridge(), tmp_path),
    ):
        with pytest.raises(DataError, match='loss="shooting" needs slopes'):
            RecursivePredictor(model, 1, 1, loss="shooting").fit(U, Y)
    for model in (Held(), make_pipeline(MinMaxScaler(clip=True), Ridge()), net(loss="poisson")):
        with pytest.raises(DataError, match='loss="shooting" needs slopes'):
            HybridRegressor(None, model, "output", loss="shooting", n_lags=1).fit(U, Y)


@pytest.mark.slow
def test_a_term_inside_a_plant_is_a_linear_model_only_where_it_predicts_linearly():
    def rhs(t, x, u, p):
        return [u[0] - x[0]]

    plant = ODESimulator(rhs, states=["q"], inputs=["u"], outputs=["q"], params={}, dt=0.1)
    true = ODESimulator(
        lambda t, x, u, p: [u[0] - x[0] + np.exp(0.3 * x[0])],
        states=["q"], inputs=["u"], outputs=["q"], params={}, dt=0.1,
    )  # fmt: skip
    inputs = np.repeat(RNG.uniform(-1, 1, 20), 5)[:, None]
    y = np.ravel(true.simulate(inputs))
    points = np.array([[0.5, 0.2], [1.5, -0.4], [0.1, 0.9]])
    for residual in (
        Ridge(1e-6),
        make_pipeline(S(with_mean=False), PolynomialFeatures(2, include_bias=False), Ridge(1e-6)),
        make_pipeline(MinMaxScaler(clip=True), Ridge(1e-6)),
        PenalizedRegressor(features=PolynomialFeatures(2)),
        make_pipeline(S(), TweedieRegressor(power=0, link="log", alpha=0.01)),
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = HybridRegressor(plant, residual, "dynamics", fade=np.inf).fit(inputs, y)
        x, u = points[:, :1].T, points[:, 1:].T
        term = model.correction_.rhs(0.0, x, u) - (u - x)
        wanted = model.correction_.factor * np.ravel(model.residual_.predict(points))
        np.testing.assert_allclose(np.ravel(term), wanted, rtol=1e-9)
