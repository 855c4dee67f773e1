"""Every estimator of scikit-learn and every setting of a scaler: exports and slopes are those of predict, or are refused."""

import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.cross_decomposition import CCA, PLSRegression
from sklearn.decomposition import PCA
from sklearn.linear_model import (
    GammaRegressor,
    LinearRegression,
    LogisticRegression,
    PoissonRegressor,
    Ridge,
    TweedieRegressor,
)
from sklearn.neural_network import MLPClassifier, MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import (
    FunctionTransformer,
    MaxAbsScaler,
    MinMaxScaler,
    Normalizer,
    PolynomialFeatures,
    PowerTransformer,
    QuantileTransformer,
    RobustScaler,
    StandardScaler,
)
from sklearn.svm import SVR
from sklearn.utils import all_estimators

from sksurrogate.exceptions import SurrogateError
from sksurrogate.export import input_jacobian, to_casadi, to_graph, to_onnx
from sksurrogate.features import SplineFeatures
from sksurrogate.linear import PenalizedRegressor
from sksurrogate.linear import Ridge as RidgePenalty
from sksurrogate.neural import FNNRegressor

RNG = np.random.default_rng(0)
X = RNG.normal(size=(60, 2)) * [1.0, 20.0] + [3.0, 100.0]
y = np.exp(0.3 * X[:, 0]) + 0.02 * X[:, 1]
#: Within the data, and 3 and 100 ranges beyond it, where everything that clips has done so.
ROWS = [X[:10] + 0.01] + [X.mean(axis=0) + far * np.ptp(X, axis=0) * RNG.uniform(-1, 1, (10, 2)) for far in (3, 100)]

SCALERS = [
    *(StandardScaler(with_mean=m, with_std=s) for m in (True, False) for s in (True, False)),
    *(RobustScaler(with_centering=c, with_scaling=s) for c in (True, False) for s in (True, False)),
    *(MinMaxScaler(limits, clip=clip) for limits in ((0, 1), (-3, 5)) for clip in (True, False)),
    MaxAbsScaler(clip=True),
    MaxAbsScaler(),
]


def net(activation="tanh", **settings):
    return MLPRegressor(
        hidden_layer_sizes=(4,),
        activation=activation,
        solver="lbfgs",
        random_state=0,
        max_iter=300,
        tol=1e-6,
        **settings,
    )


MODELS = [
    *(make_pipeline(scaler, Ridge()) for scaler in SCALERS),
    *(TransformedTargetRegressor(Ridge(), transformer=scaler) for scaler in SCALERS),
    *(make_pipeline(scaler, PolynomialFeatures(2), StandardScaler(with_mean=False), Ridge()) for scaler in SCALERS),
    *(make_pipeline(scaler, net()) for scaler in SCALERS[:3] + SCALERS[-2:]),
    *(make_pipeline(StandardScaler(), net(kind, loss="poisson")) for kind in ("tanh", "logistic", "relu", "identity")),
    *(make_pipeline(StandardScaler(), PCA(2, whiten=whiten), Ridge()) for whiten in (True, False)),
    *(make_pipeline(StandardScaler(), PLSRegression(2, scale=scale)) for scale in (True, False)),
    make_pipeline(MinMaxScaler(clip=True), SplineFeatures(4, 3), Ridge()),
    PenalizedRegressor([RidgePenalty(1e-3)], features=make_pipeline(MinMaxScaler(clip=True), PolynomialFeatures(2))),
    make_pipeline(MaxAbsScaler(), FNNRegressor((3,), random_state=0, max_epochs=20)),
    TweedieRegressor(power=0, link="identity"),
    SVR(kernel="linear"),
    LinearRegression(fit_intercept=False),
]
IDS = [" ".join(str(model).split())[:110] for model in MODELS]


def equal_to_predict(found, model, rows):
    wanted = model.predict(rows).reshape(len(rows), -1)
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-10 * np.abs(wanted).max())


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("model", MODELS, ids=IDS)
def test_graphs_and_slopes_are_those_of_predict_near_and_far(model):
    model = clone(model).fit(X, y)
    graph = to_graph(model)
    for rows in ROWS:
        with np.errstate(over="ignore"):
            if not np.isfinite(model.predict(rows)).all():  # exp of a net that is linear far away
                continue
        equal_to_predict(graph(x=rows)["y"], model, rows)
        moves = np.diag(1e-5 * np.ptp(rows, axis=0))
        parts = [(model.predict(rows + h) - model.predict(rows - h)) / (2 * h.sum()) for h in moves]
        slopes = np.stack(parts, axis=-1).reshape(len(rows), 2)
        # a kink within a step of a row has no difference; there is none at these rows
        size = np.abs(slopes).max() + 1e-5 * np.abs(model.predict(rows)).max() / X.std(axis=0).max()
        np.testing.assert_allclose(
            input_jacobian(model, rows).reshape(slopes.shape), slopes, rtol=2e-5, atol=2e-5 * size
        )
        np.testing.assert_allclose(graph.jacobian(x=rows)["y", "x"][:, 0], slopes, rtol=2e-5, atol=2e-5 * size)


def test_the_slope_by_a_clipped_input_is_zero():
    for scaler in (MinMaxScaler((-2, 3), clip=True), MaxAbsScaler(clip=True)):
        model = make_pipeline(scaler, Ridge()).fit(X, y)
        beside = [X[:, 0].max() + 1.0, X[:, 1].mean()]
        slope = input_jacobian(model, [beside])[0]
        assert slope[0] == 0.0 and slope[1] != 0.0
        assert np.all(input_jacobian(model, [X.mean(axis=0)]) != 0.0)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize(
    "model",
    [
        make_pipeline(StandardScaler(with_mean=False), Ridge()),
        make_pipeline(MinMaxScaler((-3, 5), clip=True), Ridge()),
        make_pipeline(MaxAbsScaler(clip=True), Ridge()),
        make_pipeline(StandardScaler(), net(loss="poisson")),
        TransformedTargetRegressor(Ridge(), transformer=RobustScaler(with_centering=False)),
    ],
    ids=lambda model: " ".join(str(model).split())[:60],
)
def test_casadi_and_onnx_are_predict_near_and_far(model, tmp_path):
    pytest.importorskip("casadi")
    pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    model = clone(model).fit(X, y)
    session = runtime.InferenceSession(to_onnx(model).SerializeToString(), providers=["CPUExecutionProvider"])
    for rows in ROWS[:2]:
        equal_to_predict(np.array(to_casadi(model)(rows.T)).T, model, rows)
        equal_to_predict(session.run(["y"], {"x": rows})[0], model, rows)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (PoissonRegressor(), "PoissonRegressor cannot be exported"),
        (GammaRegressor(), "GammaRegressor cannot be exported"),
        (make_pipeline(Normalizer(), Ridge()), "Normalizer cannot be exported"),
        (make_pipeline(QuantileTransformer(n_quantiles=10), Ridge()), "QuantileTransformer cannot be exported"),
        (TransformedTargetRegressor(Ridge(), transformer=PowerTransformer()), "PowerTransformer.*use a scaler"),
    ],
    ids=lambda given: " ".join(str(given).split())[:40],
)
def test_what_has_no_formula_is_refused_by_name(model, message):
    model = clone(model).fit(X, y)
    for export in (to_graph, lambda model: input_jacobian(model, X)):
        with pytest.raises(SurrogateError, match=message.replace("cannot be exported", "")):
            export(model)


@pytest.mark.parametrize("first", [PLSRegression(1), CCA(1)], ids=str)
def test_a_regressor_that_transforms_is_not_its_prediction_inside_a_pipeline(first):
    first.fit(X, y)
    model = make_pipeline(first, Ridge().fit(first.transform(X), y))
    for export in (to_graph, lambda model: input_jacobian(model, X)):
        with pytest.raises(SurrogateError, match=r"before the last step of a pipeline.*use PCA"):
            export(model)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("labels", [[0, 1], [-1, 1], ["low", "high"]], ids=str)
@pytest.mark.parametrize(
    "model", [MLPClassifier(hidden_layer_sizes=(3,), max_iter=20, random_state=0), LogisticRegression()], ids=str
)
def test_classifiers_are_refused(model, labels):
    model = clone(model).fit(X, np.array(labels)[(y > np.median(y)).astype(int)])
    with pytest.raises(SurrogateError, match=r"is a classifier, whose predict gives labels.*predict_proba"):
        to_graph(model)


class Held(Ridge):
    """A linear model in looks that never predicts below zero."""

    def predict(self, X):
        return np.maximum(super().predict(X), 0.0)


class Squared(MLPRegressor):
    """A network in looks that predicts a square."""

    def predict(self, X):
        return super().predict(X) ** 2


def test_looks_do_not_count():
    for model in (Held(), Squared(hidden_layer_sizes=(3,), max_iter=20, random_state=0)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.fit(X, y)
        with pytest.raises(SurrogateError, match=f"{type(model).__name__} cannot be exported"):
            to_graph(model)


SLOW_OR_RANDOM = {"GaussianProcessRegressor", "HistGradientBoostingRegressor", "DummyRegressor"}
#: With their defaults; what asks for arguments or other data has no say.
EVERY_REGRESSOR = [(name, cls) for name, cls in all_estimators("regressor") if name not in SLOW_OR_RANDOM]
EVERY_TRANSFORMER = all_estimators("transformer")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "cls"), EVERY_REGRESSOR + EVERY_TRANSFORMER, ids=[name for name, _ in EVERY_REGRESSOR + EVERY_TRANSFORMER]
)
def test_every_estimator_of_scikit_learn_is_exported_as_it_is_or_refused(name, cls):
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            model = cls() if (name, cls) in EVERY_REGRESSOR else make_pipeline(cls(), Ridge())
            model = model.fit(X, y)
            wanted = [model.predict(rows) for rows in ROWS]
        except (TypeError, ValueError, AttributeError) as error:
            pytest.skip(f"cannot be fitted to these data: {type(error).__name__}")
        try:
            graph = to_graph(model)
        except SurrogateError as error:
            assert "cannot be exported" in str(error) or "before the last step" in str(error)
            return
        for rows, values in zip(ROWS, wanted):
            np.testing.assert_allclose(
                graph(x=rows)["y"][:, 0], np.ravel(values), rtol=1e-9, atol=1e-9 * np.ptp(values)
            )


def test_transformers_with_the_names_of_scalers_are_not_taken_for_them():
    class StandardScaler(FunctionTransformer):  # another package's, which need not do the same
        pass

    odd = StandardScaler(np.sin).fit(X)
    with pytest.raises(SurrogateError, match="StandardScaler cannot be exported"):
        to_graph(make_pipeline(odd, Ridge()).fit(X, y))
