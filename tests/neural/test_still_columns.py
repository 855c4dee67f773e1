"""Columns that never moved in training."""

import numpy as np
import pytest

from sksurrogate.neural import FNNRegressor


@pytest.mark.parametrize("solver", ["auto", "lbfgs"])
def test_a_column_that_never_moved_has_no_say(solver):
    rng = np.random.default_rng(0)
    X = rng.uniform(-2, 2, (200, 2))
    y = np.tanh(2 * X[:, 0]) * X[:, 1] + 0.05 * rng.normal(size=200)
    with_constant = np.column_stack([X, np.full(200, 7.0)])
    fitted = FNNRegressor((5,), solver=solver, random_state=0).fit(with_constant, y)
    np.testing.assert_allclose(fitted.predict(with_constant + [0, 0, 10.0]), fitted.predict(with_constant), atol=1e-6)
    assert fitted.score(with_constant, y) > 0.9
