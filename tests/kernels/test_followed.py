"""An input with a limited rate is the same followed number by number, for few columns, and sample by sample."""

import numpy as np
import pytest

from sksurrogate.kernels import signals


@pytest.mark.parametrize("n_columns", [1, 3])
def test_both_ways_to_follow_agree_to_the_last_digit(monkeypatch, n_columns):
    rng = np.random.default_rng(n_columns)
    bounds = np.array([0, 7, 40, 60])
    target, first = rng.normal(size=(n_columns, 60)), rng.normal(size=(n_columns, 3))
    down, up = rng.uniform(0.05, 1.0, size=(2, n_columns, 1))
    target[0, 50] = np.nan
    found = []
    for most in (0, signals.FOLLOWED_ONE_BY_ONE):
        monkeypatch.setattr(signals, "FOLLOWED_ONE_BY_ONE", most)
        found.append(signals._followed(target, first, down, up, bounds))
    np.testing.assert_array_equal(*found)
    assert np.isnan(found[0][0, 51:]).all() and not np.isnan(found[0][0, :51]).any()
