"""Values that are missing are named by row and column, whatever the estimator."""

import numpy as np
import pandas as pd
import pytest

from sksurrogate.compose import RecursivePredictor, StateSpaceRegressor
from sksurrogate.exceptions import DataError
from sksurrogate.features import FourierFeatures, GaussianFeatures, HeavisideFeatures, SplineFeatures
from sksurrogate.linear import NonlinearBasisRegressor, PCRRegressor, PenalizedRegressor
from sksurrogate.neural import FNNRegressor

MODELS = [
    SplineFeatures(), HeavisideFeatures(), FourierFeatures(), GaussianFeatures(), PenalizedRegressor(), PCRRegressor(),
    NonlinearBasisRegressor(n_basis=1), FNNRegressor((2,)),
]  # fmt: skip


@pytest.mark.parametrize("frame", [False, True])
@pytest.mark.parametrize("value, word", [(np.nan, "NaN"), (np.inf, "infinity")])
@pytest.mark.parametrize("model", MODELS, ids=lambda model: type(model).__name__)
def test_the_place_of_a_missing_value_is_named(model, value, word, frame):
    X, y = np.random.default_rng(0).normal(size=(2, 12, 2))
    whole, table = X.copy(), X
    table[5, 1] = value
    if frame:
        whole, table = pd.DataFrame(whole, columns=["u", "v"]), pd.DataFrame(table, columns=["u", "v"])
    message = f"Input X contains {word}: row 5, column {'.v.' if frame else '1'}; 1 values.*Interpolator"
    with pytest.raises(DataError, match=message):
        model.fit(table, y)
    fitted = model.fit(whole, y)
    with pytest.raises(DataError, match=message):
        (fitted.predict if hasattr(fitted, "predict") else fitted.transform)(table)


@pytest.mark.parametrize("model", MODELS[4:], ids=lambda model: type(model).__name__)
def test_the_place_of_a_missing_output_is_named(model):
    X, y = np.random.default_rng(0).normal(size=(2, 12, 2))
    y[3, 0] = np.nan
    with pytest.raises(DataError, match="Input y contains NaN: row 3, column 0"):
        model.fit(X, y)
    with pytest.raises(DataError, match="Input y contains NaN: row 3; 1 values"):
        model.fit(X, y[:, 0])


@pytest.mark.parametrize("model", MODELS, ids=lambda model: type(model).__name__)
def test_text_is_named_by_its_place(model):
    X = np.array([["1.0", "2.0"], ["3.0", "cold"], ["5.0", "6.0"]], dtype=object)
    with pytest.raises(DataError, match="X holds 'cold', which is not a number: row 1, column 1"):
        model.fit(X, [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    "model",
    [RecursivePredictor(PCRRegressor(), 1, 1), StateSpaceRegressor(1, max_iter=2)],
    ids=lambda model: type(model).__name__,
)
def test_a_free_run_on_numbers_of_any_kind_is_that_on_floats_and_text_and_complex_ones_are_refused(model):
    X = np.random.default_rng(0).integers(-3, 4, size=(40, 1))
    model.fit(X.astype(float), np.convolve(X[:, 0], [0.0, 1.0, 0.5])[:40])
    free = model.predict(X.astype(float))
    for kind in (int, np.float32, object):
        np.testing.assert_array_equal(model.predict(X.astype(kind)), free)
    with pytest.raises(ValueError, match="Complex data not supported"):
        model.predict(X + 1.0j)
    with pytest.raises(DataError, match="X holds numbers written as text"):
        model.predict(X.astype(str))


@pytest.mark.parametrize("model", MODELS[4:], ids=lambda model: type(model).__name__)
def test_outputs_in_words_are_named_by_their_place(model):
    with pytest.raises(DataError, match="y holds 'warm', which is not a number: row 2"):
        model.fit(np.arange(6.0).reshape(3, 2), np.array([1.0, 2.0, "warm"], dtype=object))


@pytest.mark.parametrize("model", MODELS[4:], ids=lambda model: type(model).__name__)
def test_lengths_that_differ_are_both_told(model):
    with pytest.raises(DataError, match=r"X has 3 rows and y has 2 .*one target a row"):
        model.fit(np.arange(6.0).reshape(3, 2), [1.0, 2.0])


@pytest.mark.parametrize("model", MODELS, ids=lambda model: type(model).__name__)
def test_numbers_without_a_square_are_refused(model):
    X = np.arange(6.0).reshape(3, 2)
    X[1, 0] = 1e200
    with pytest.raises(DataError, match=r"X holds 1e.200, whose square .*row 1, column 0. Change the unit"):
        model.fit(X, [1.0, 2.0, 3.0])


@pytest.mark.parametrize("model", MODELS, ids=lambda model: type(model).__name__)
def test_what_is_masked_counts_as_missing(model):
    X, y = np.random.default_rng(0).normal(size=(2, 12, 2))
    hidden = np.ma.masked_array(X, mask=False)
    hidden.data[5, 1] = 1e6  # what lies under a mask is not a reading
    hidden.mask[5, 1] = True
    with pytest.raises(DataError, match="Input X contains NaN: row 5, column 1; 1 values"):
        model.fit(hidden, y)
    if model in MODELS[4:]:
        with pytest.raises(DataError, match="Input y contains NaN: row 5, column 1; 1 values"):
            model.fit(y, hidden)


@pytest.mark.parametrize("model", [MODELS[4], MODELS[6], MODELS[7]], ids=lambda model: type(model).__name__)
def test_a_weight_that_is_masked_counts_as_missing(model):
    X, y = np.random.default_rng(0).normal(size=(2, 12, 2))
    with pytest.raises(ValueError, match="NaN"):
        model.fit(X, y, sample_weight=np.ma.masked_array(np.ones(12), mask=np.arange(12) == 3))
