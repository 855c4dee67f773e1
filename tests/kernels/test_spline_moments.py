"""Second moments of splines cell by cell against those of the features written out."""

import numpy as np
import pytest

from sksurrogate.features import SplineFeatures
from sksurrogate.kernels.bases import spline_csr, spline_on
from sksurrogate.kernels.gram import Moments
from sksurrogate.kernels.spline_moments import add_spline_moments
from sksurrogate.linear import PCRRegressor, PenalizedRegressor, Ridge


def both(X, splines, Y, w=None):
    p = sum(spline.n_splines for spline in splines) + Y.shape[1]
    cells, rows = Moments.zeros(p), Moments.zeros(p)
    taken = add_spline_moments(cells, X, splines, Y, w)
    rows.add(spline_csr(X, splines).toarray(), Y, w)
    return taken, cells, rows


def same(cells, rows):
    assert (cells.n_rows, cells.weight) == (rows.n_rows, pytest.approx(rows.weight, rel=1e-13))
    np.testing.assert_allclose(cells.mean, rows.mean, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(cells.scatter, rows.scatter, atol=1e-11 * np.abs(rows.scatter).max())


@pytest.mark.parametrize("extrapolation", ["constant", "linear", "continue", "zero"])
@pytest.mark.parametrize("degree", [0, 1, 3, 4])
def test_any_number_of_inputs_and_knots(degree, extrapolation):
    rng = np.random.default_rng(degree)
    for n_inputs in (1, 2, 3, 5):
        X = rng.normal(size=(9000, n_inputs))
        Y = np.c_[X.sum(axis=1) + 1e4, X[:, 0] ** 2]
        breaks = [np.linspace(-1, 2, 4 + j) if j % 2 else np.array([-1.0, 0.2, 0.5, 1.7]) for j in range(n_inputs)]
        splines = [spline_on(b, degree, extrapolation) for b in breaks]
        taken, cells, rows = both(X, splines, Y, rng.integers(0, 3, len(X)).astype(float))
        assert taken
        same(cells, rows)


def test_many_rows_and_uneven_cells():
    rng = np.random.default_rng(0)
    X = rng.beta(0.3, 3.0, size=(150_000, 3))  # most rows in few cells, some cells empty
    splines = [spline_on(np.linspace(0, 1, 20), 3) for _ in range(3)]
    taken, cells, rows = both(X, splines, X[:, :1])
    assert taken
    same(cells, rows)


def test_what_is_left_to_the_features():
    x = np.linspace(0, 1, 5000)[:, None]
    few = both(x[:20], [spline_on(np.linspace(0, 1, 9), 3)], x[:20])
    periodic = both(x, [spline_on(np.linspace(0, 1, 9), 3, "periodic")], x)
    constant = both(x, [spline_on(np.array([0.0, 1.0]), 0)], x)
    for taken, cells, _ in (few, periodic, constant):
        assert not taken
        assert cells.n_rows == 0 and not cells.scatter.any()


def test_fits_are_those_of_the_features():
    rng = np.random.default_rng(1)
    X = rng.uniform(size=(6000, 3))
    y = np.sin(5 * X[:, 0]) + X[:, 1] * 2 + np.abs(X[:, 2] - 0.4) + 0.1 * rng.normal(size=6000)
    w = rng.uniform(0.5, 2, 6000)
    splines = SplineFeatures(12)
    Phi = splines.fit_transform(X)
    for make in (
        lambda f: PenalizedRegressor([Ridge()], features=f),
        lambda f: PenalizedRegressor([Ridge()], features=f, fit_intercept=False),
        lambda f: PCRRegressor(10, scale=True, features=f),
    ):
        ours, plain = make(splines).fit(X, y, sample_weight=w), make(None).fit(Phi, y, sample_weight=w)
        np.testing.assert_allclose(ours.predict(X), plain.predict(Phi), atol=1e-8)
    streamed = PenalizedRegressor([Ridge()], features=splines)
    streamed.fit(X, y)
    parts = PenalizedRegressor([Ridge()], features=SplineFeatures(knots=np.linspace(0, 1, 12)))
    for a in range(0, 6000, 1500):
        parts.partial_fit(X[a : a + 1500], y[a : a + 1500])
    whole = PenalizedRegressor([Ridge()], features=SplineFeatures(knots=np.linspace(0, 1, 12))).fit(X, y)
    np.testing.assert_allclose(parts.predict(X), whole.predict(X), atol=1e-9)


def test_rows_outside_are_refused_where_asked():
    model = PenalizedRegressor([Ridge()], features=SplineFeatures(5, extrapolation="error"))
    X = np.linspace(0, 1, 500)[:, None]
    model.partial_fit(X, X[:, 0])
    with pytest.raises(ValueError, match="outside the knots"):
        model.partial_fit(X + 0.5, X[:, 0])
