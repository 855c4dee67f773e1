"""Exact slopes of whole pipelines against central differences."""

import numpy as np
import pytest
from sklearn.compose import TransformedTargetRegressor
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import (
    MaxAbsScaler,
    MinMaxScaler,
    PolynomialFeatures,
    RobustScaler,
    SplineTransformer,
    StandardScaler,
)

from sksurrogate.exceptions import DataError, SurrogateError
from sksurrogate.export import Graph, input_jacobian
from sksurrogate.features import FourierFeatures, GaussianFeatures, SplineFeatures
from sksurrogate.linear import NonlinearBasisRegressor, PCRRegressor, PenalizedRegressor, Ridge
from sksurrogate.neural import FNNRegressor

rng = np.random.default_rng(0)
X = rng.normal(size=(80, 3)) * [1.0, 5.0, 0.1] + [0.0, 10.0, 1.0]
Y = np.column_stack([np.sin(X[:, 0]) + 0.1 * X[:, 1], X[:, 0] * X[:, 2]])
MODELS = [
    make_pipeline(SplineFeatures(), PCRRegressor()),
    make_pipeline(StandardScaler(), SplineFeatures(sparse_output=True), LinearRegression()),
    make_pipeline(MinMaxScaler((-1, 1)), PolynomialFeatures(3), PenalizedRegressor([Ridge()])),
    make_pipeline("passthrough", PCA(2), GaussianFeatures(4), PenalizedRegressor([Ridge(1e-3)])),
    make_pipeline(RobustScaler(), FNNRegressor((4,), "softplus", random_state=0, max_epochs=20)),
    make_pipeline(
        StandardScaler(), MLPRegressor(hidden_layer_sizes=(8,), random_state=0, max_iter=20, activation="tanh")
    ),
    TransformedTargetRegressor(
        make_pipeline(MaxAbsScaler(), FourierFeatures(2), LinearRegression()), transformer=MinMaxScaler()
    ),
    GridSearchCV(make_pipeline(SplineFeatures(), PCRRegressor()), {"splinefeatures__n_knots": [3, 5]}, cv=3),
    PenalizedRegressor([Ridge()], features=make_pipeline(StandardScaler(), PolynomialFeatures(2))),
    NonlinearBasisRegressor(n_basis=2, random_state=0, max_iter=20),
    LinearRegression(),
]


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("model", MODELS, ids=lambda model: str(model).replace("\n", "")[:40])
@pytest.mark.parametrize("flat", [True, False])
def test_slopes_of_whole_models_agree_with_differences(model, flat):
    if not flat and isinstance(model, NonlinearBasisRegressor):
        pytest.skip("two outputs take the same road as in the pipelines")
    y = Y[:, 0] if flat else Y
    model.fit(X, y)
    inside = np.all((X.min(axis=0) < X) & (X.max(axis=0) > X), axis=1)  # splines have a kink at their ends
    rows = X[inside][:20]
    exact = input_jacobian(model, rows)
    steps = 1e-6 * X.std(axis=0)
    moves = np.diag(steps)
    parts = [(model.predict(rows + h) - model.predict(rows - h)) / (2 * step) for h, step in zip(moves, steps)]
    assert exact.shape == ((20, 3) if flat else (20, 2, 3))
    np.testing.assert_allclose(exact, np.stack(parts, axis=-1), rtol=1e-5, atol=1e-5 * np.abs(exact).max())


def test_parts_without_slopes_are_named():
    with pytest.raises(SurrogateError, match="SplineTransformer"):
        input_jacobian(make_pipeline(SplineTransformer(), LinearRegression()).fit(X, Y), X)
    odd = TransformedTargetRegressor(LinearRegression(), func=np.exp, inverse_func=np.log).fit(X, Y)
    with pytest.raises(SurrogateError, match="FunctionTransformer"):
        input_jacobian(odd, X)
    with pytest.raises(DataError, match="give finite rows"):
        input_jacobian(LinearRegression().fit(X, Y), X[:, 0])


def test_a_graph_asks_for_its_inputs_and_no_others():
    graph = Graph()
    graph.outputs["y"] = graph.binary("add", graph.input("x", 1), graph.input("u", 1))
    assert graph(x=[1.0], u=[2.0])["y"] == 3.0
    for given in ({"x": [1.0]}, {"x": [1.0], "u": [2.0], "p": [0.0]}, {"x": [1.0], "p": [0.0]}):
        with pytest.raises(ValueError, match=r"the graph needs the inputs \['x', 'u'\] by name, but"):
            graph(**given)
