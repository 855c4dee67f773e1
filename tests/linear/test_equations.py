"""Equations as text: the numbers that are printed, put in for the signals, give what the model predicts."""

import re

import numpy as np
import pytest
from sklearn.compose import ColumnTransformer
from sklearn.cross_decomposition import PLSRegression
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression, PoissonRegressor, Ridge
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

from sksurrogate.compose import DerivativeRegressor
from sksurrogate.exceptions import DataError
from sksurrogate.linear import PenalizedRegressor, SparseRegressor

RNG = np.random.default_rng(0)
Y, U = RNG.uniform(2, 6, 300), RNG.uniform(2, 4, (300, 1))
SLOPES = 1 - 2 * Y + 3 * U[:, 0] + 0.1 * Y * U[:, 0]
FAR = np.array([[3.0, 3.0], [50.0, -20.0], [-100.0, 7.0]])  # y, u

S, P = StandardScaler, PolynomialFeatures
SCALERS = [
    *(S(with_mean=m, with_std=s) for m in (True, False) for s in (True, False)),
    *(RobustScaler(with_centering=c, with_scaling=s) for c in (True, False) for s in (True, False)),
    MinMaxScaler((-1, 3)),
    MaxAbsScaler(),
    PCA(2, whiten=True),
    make_pipeline(S(), MinMaxScaler(), PCA(2)),
]


def short(model):
    return " ".join(str(model).split())[:90]


def value(text, **signals):
    """An equation's right-hand side, such as ``1 - 2 y + 0.5 y u^2``, at signals (n_points,)."""
    total = 0.0
    for term in re.split(r" (?=[+-] )", text.split(" = ")[1]):
        sign, number, factors = re.fullmatch(r"([+-]?) ?([\d.e+-]+)((?: \S+)*)", term).groups()
        part = float(sign + number)
        for factor in factors.split():
            name, _, power = factor.partition("^")
            part = part * signals[name] ** int(power or 1)
        total = total + part
    return total


def said_and_predicted(model):
    (text,) = model.equations(digits=14)
    said = value(text, y=FAR[:, 0], u=FAR[:, 1])
    np.testing.assert_allclose(said, model.derivative(FAR[:, 1:], FAR[:, 0]), rtol=1e-8)
    return text


@pytest.mark.parametrize("scaler", SCALERS, ids=short)
@pytest.mark.parametrize("last", [LinearRegression(), Ridge(0.1), SparseRegressor(), PenalizedRegressor()], ids=str)
def test_scalers_before_the_linear_model_are_folded_into_its_coefficients(scaler, last):
    said_and_predicted(DerivativeRegressor(make_pipeline(scaler, last), dt=0.05).fit(U, Y, dydt=SLOPES))
    behind = make_pipeline(P(2, include_bias=False), S(), last)
    text = said_and_predicted(DerivativeRegressor(behind, dt=0.05).fit(U, Y, dydt=SLOPES))
    assert "y u" in text or isinstance(last, Ridge)


def test_the_planted_equation_is_said_in_physical_signals():
    model = DerivativeRegressor(make_pipeline(S(), LinearRegression()), dt=0.05)
    assert model.fit(U, Y, dydt=1 - 2 * Y + 3 * U[:, 0]).equations() == ["dy/dt = 1 - 2 y + 3 u"]
    Z = RNG.normal(size=(200, 1)) * 2 + 5
    sparse = SparseRegressor(features=make_pipeline(P(2, include_bias=False), S())).fit(Z, Z[:, 0] ** 2 - 3)
    assert sparse.equations(["q"]) == ["y = -3 + 1 q^2"]


def test_scalers_inside_the_features_of_a_model_are_folded_too():
    Z = np.c_[Y, U]
    for features in (S(), make_pipeline(P(2, include_bias=False), RobustScaler()), make_pipeline(P(2), MinMaxScaler())):
        model = SparseRegressor(features=features).fit(Z, SLOPES)
        (text,) = model.equations(["y", "u"], digits=14)
        np.testing.assert_allclose(value(text, y=FAR[:, 0], u=FAR[:, 1]), model.predict(FAR), rtol=1e-8)


@pytest.mark.parametrize(
    "scaler", [S(), S(with_std=False), S(with_mean=False), *SCALERS[4:7], *SCALERS[8:10], make_pipeline(S())], ids=short
)
def test_a_scaler_before_features_that_are_not_linear_is_refused(scaler):
    library = make_pipeline(scaler, P(2, include_bias=False))
    model = DerivativeRegressor(make_pipeline(library, SparseRegressor()), dt=0.05).fit(U, Y, dydt=SLOPES)
    message = r"Scaler before PolynomialFeatures .* Put it behind them: make_pipeline\(PolynomialFeatures, \w+Scaler, \.\.\.\)"
    with pytest.raises(DataError, match=message):
        model.equations()
    with pytest.raises(DataError, match=message):
        SparseRegressor(features=library).fit(np.c_[Y, U], SLOPES).equations()


@pytest.mark.parametrize(
    "step",
    [
        QuantileTransformer(n_quantiles=20),
        PowerTransformer(),
        Normalizer(),
        FunctionTransformer(np.cbrt, feature_names_out="one-to-one"),
        ColumnTransformer([("one", S(), [0])], remainder="passthrough", verbose_feature_names_out=False),
        MinMaxScaler(clip=True),
        MaxAbsScaler(clip=True),
    ],
    ids=short,
)
def test_whatever_changes_signals_and_keeps_their_names_is_refused(step):
    model = DerivativeRegressor(make_pipeline(step, LinearRegression()), dt=0.05).fit(U, Y, dydt=SLOPES)
    with pytest.raises(
        DataError, match=rf"{type(step).__name__} changes the signals and keeps their names.*Leave it out"
    ):
        model.equations()
    if getattr(step, "clip", False):
        with pytest.raises(DataError, match=r"Set clip=False"):
            model.equations()


@pytest.mark.slow
@pytest.mark.parametrize(
    "model", [PoissonRegressor(), PLSRegression(1), make_pipeline(S(), PoissonRegressor())], ids=str
)
@pytest.mark.filterwarnings("ignore:the free runs of")
def test_models_with_a_link_or_a_centre_have_no_equation(model):
    model = DerivativeRegressor(model, dt=0.05).fit(U, Y, dydt=np.exp(0.1 * Y))
    with pytest.raises(DataError, match=r"does not predict features @ coef_ \+ intercept_"):
        model.equations()
