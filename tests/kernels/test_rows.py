"""Lag matrices that are made block by block, against the matrix and against fits on it."""

import subprocess
import sys

import numpy as np
import pytest

from sksurrogate.compose import RecursivePredictor
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.features import SplineFeatures
from sksurrogate.kernels.rows import LagRows
from sksurrogate.linear import PCRRegressor, PenalizedRegressor, Ridge
from sksurrogate.neural import FNNRegressor

rng = np.random.default_rng(0)
TERMS = [(0, 0, 1), (0, 1, 3), (1, 0, 0), (1, 0, 2)]


def whole(tables):
    parts = [np.stack([run[k][3 - lag : len(run[k]) - lag, c] for k, c, lag in TERMS], axis=1) for run in tables]
    return np.concatenate(parts)


@pytest.mark.parametrize("lengths", [[50], [4, 20, 5, 40], [4] * 60])
def test_any_rows_equal_those_of_the_matrix(lengths):
    tables = [(rng.normal(size=(n, 2)), rng.normal(size=(n, 1))) for n in lengths]
    rows, matrix = LagRows(tables, TERMS, 3), whole(tables)
    assert rows.shape == matrix.shape and len(rows) == len(matrix)
    for which in (
        slice(None),
        slice(2, 9),
        slice(0, 0),
        slice(5, 10_000),
        slice(None, None, 3),
        np.array([3, 1, 1, -1]),
        np.array([], dtype=int),
    ):
        np.testing.assert_array_equal(rows[which], matrix[which])


@pytest.mark.parametrize("make", [lambda: FNNRegressor((3,), random_state=0), lambda: PCRRegressor(5)])
@pytest.mark.parametrize("weights", [None, rng.uniform(0.5, 2.0, 24_985)])
def test_fits_on_a_source_are_those_on_the_matrix(make, weights):
    tables = [(rng.normal(size=(5000, 2)), rng.normal(size=(5000, 1))) for _ in range(5)]
    rows = LagRows(tables, TERMS, 3)
    matrix = whole(tables)
    y = np.tanh(matrix[:, 0] - matrix[:, 1]) + 0.3 * matrix[:, 3]
    for target in (y, np.c_[y, -y]):
        from_rows, from_matrix = (make().fit(X, target, sample_weight=weights) for X in (rows, matrix))
        np.testing.assert_allclose(from_rows.predict(matrix[:99]), from_matrix.predict(matrix[:99]), atol=1e-7)
        assert from_rows.n_features_in_ == 4


@pytest.mark.slow
def test_what_wants_all_rows_gets_them():
    tables = [(rng.normal(size=(21_000, 2)), rng.normal(size=(21_000, 1)))]
    rows, matrix = LagRows(tables, TERMS, 3), whole(tables)
    y = matrix @ [1.0, -1.0, 0.5, 2.0]
    for model in (
        FNNRegressor((4,), activation="binary_step", random_state=0),
        FNNRegressor((2,), solver="adam", max_epochs=1, random_state=0),
        FNNRegressor((2,), early_stopping=True, max_epochs=3, random_state=0),
        FNNRegressor((2,), solver="lbfgs", max_epochs=3, random_state=0),
        PenalizedRegressor([Ridge()], features=SplineFeatures(4)),
    ):
        a, b = model.fit(rows, y).predict(matrix[:9]), model.fit(matrix, y).predict(matrix[:9])
        np.testing.assert_allclose(a, b, atol=1e-6)


def test_a_large_lag_model_is_the_one_of_the_lag_matrix(monkeypatch):
    X, y, groups = make_reactor_runs(60, 400, y0_range=(4.0, 6.0), u_range=(0.1, 0.15), random_state=0)
    models = [FNNRegressor((3,), random_state=0), PenalizedRegressor([Ridge(1e-6)])]
    kept = [RecursivePredictor(model, 3, 3).fit(X, y, groups=groups) for model in models]
    monkeypatch.setattr("sksurrogate.compose._lagged.WHOLE_LAG_MATRIX", 1000)
    for model, by_matrix in zip(models, kept):
        by_rows = RecursivePredictor(model, 3, 3).fit(X, y, groups=groups)
        np.testing.assert_allclose(by_rows.one_step_rmse_, by_matrix.one_step_rmse_, rtol=1e-6)
        np.testing.assert_allclose(
            by_rows.predict(X[:400], y0=y[:3]), by_matrix.predict(X[:400], y0=y[:3]), rtol=1e-4, atol=1e-4
        )


SCRIPT = """
import resource
import numpy as np
from sksurrogate.compose import RecursivePredictor
from sksurrogate.neural import FNNRegressor
from sksurrogate.linear import PCRRegressor
X = np.zeros((600_000, 1))
X[:, 0] = np.repeat(np.random.default_rng(0).uniform(-1, 1, 30_000), 20)
y = np.empty(600_000)
y[:] = X[:, 0]
for k in range(1, 4):
    y[k:] += 0.3 * np.tanh(X[:-k, 0])
for model in (PCRRegressor(3), FNNRegressor((2,), max_epochs=2, random_state=0)):
    RecursivePredictor(model, 2, 2).fit(X[:9000], y[:9000])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for model in (PCRRegressor(20), FNNRegressor((2,), max_epochs=2, random_state=0)):
    RecursivePredictor(model, 10, 10).fit(X, y)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


@pytest.mark.slow
def test_memory_is_that_of_a_block():
    out = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert float(out.stdout) < 40.0  # MiB; the lag matrix alone has 96
