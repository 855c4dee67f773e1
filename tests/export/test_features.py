"""Feature maps as graphs equal ``transform`` and ``jacobian``, also outside the range and on the knots."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.exceptions import SurrogateError
from sksurrogate.export import to_casadi, to_graph, to_onnx
from sksurrogate.features import FourierFeatures, GaussianFeatures, HeavisideFeatures, SplineFeatures
from sksurrogate.linear import PCRRegressor, PenalizedRegressor

RNG = np.random.default_rng(0)
X = RNG.uniform(-1.0, 1.0, size=(60, 2))
EDGES = [-1.0, -0.3, 0.2, 1.0]
MAPS = [
    SplineFeatures(),
    SplineFeatures(6, 1, knots="quantile"),
    SplineFeatures(6, 5, knots="quantile", extrapolation="linear"),
    SplineFeatures(4, 2, extrapolation="continue"),
    SplineFeatures(knots=EDGES, extrapolation="zero"),
    SplineFeatures(degree=0, knots=EDGES, extrapolation="zero"),
    SplineFeatures(2, 0),
    SplineFeatures(2, 3, extrapolation="continue"),
    SplineFeatures(degree=3, knots="data", extrapolation="error"),
    SplineFeatures(3, 2, interaction="tensor", extrapolation="linear"),
    HeavisideFeatures([-0.5, 0.0, 0.25]),
    HeavisideFeatures(3, interaction=True),
    FourierFeatures(3),
    FourierFeatures(2, form="subharmonics", interaction=True),
    GaussianFeatures(4),
    GaussianFeatures(3, [0.3, 0.6], interaction="tensor"),
    GaussianFeatures(5, interaction="radial", random_state=0),
]


@pytest.mark.parametrize("features", MAPS, ids=repr)
def test_graph_equals_transform_and_jacobian(features):
    features = clone(features).fit(X)
    graph = to_graph(features)
    if features.get_params().get("extrapolation") == "error":
        rows = RNG.uniform(-0.9, 0.9, size=(200, 2))
    else:
        on_knots = [[k, k] for k in (-1.0, -0.5, -0.3, 0.0, 0.2, 0.25, 1.0)]
        rows = np.r_[RNG.uniform(-1.6, 1.6, size=(200, 2)), on_knots]
    np.testing.assert_allclose(graph(x=rows)["y"], features.transform(rows), atol=1e-11)
    for row in rows[:20]:
        slopes = graph.jacobian(x=row)["y", "x"]
        np.testing.assert_allclose(slopes, features.jacobian(row[None])[0], atol=1e-9)


@pytest.mark.parametrize(
    "model",
    [
        make_pipeline(SplineFeatures(5, 3, extrapolation="linear"), Ridge(1e-6)),
        make_pipeline(StandardScaler(), FourierFeatures(3), LinearRegression()),
        PCRRegressor(8, features=SplineFeatures(6, 3)),
        PenalizedRegressor(features=GaussianFeatures(5, interaction="radial", random_state=0)),
    ],
    ids=["splines", "waves", "PCR on splines", "bumps"],
)
def test_models_on_features_are_exported_everywhere(model):
    casadi = pytest.importorskip("casadi")
    runtime = pytest.importorskip("onnxruntime")
    y = np.sin(3 * X[:, 0]) * X[:, 1]
    model = clone(model).fit(X, y)
    rows = RNG.uniform(-1.3, 1.3, size=(20, 2))
    expected = model.predict(rows)
    np.testing.assert_allclose(to_graph(model)(x=rows)["y"][:, 0], expected, atol=1e-10)
    function = to_casadi(model)
    found = [float(casadi.DM(function(row) if function.n_in() == 1 else function(x=row)["y"])) for row in rows]
    np.testing.assert_allclose(found, expected, atol=1e-10)
    session = runtime.InferenceSession(to_onnx(model).SerializeToString(), providers=["CPUExecutionProvider"])
    np.testing.assert_allclose(session.run(None, {"x": rows})[0][:, 0], expected, atol=1e-10)


def test_periodic_splines_say_why_not():
    with pytest.raises(SurrogateError, match="cannot be exported, because the graph has no remainder"):
        to_graph(SplineFeatures(extrapolation="periodic").fit(X))
