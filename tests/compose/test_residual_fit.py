"""What a residual is fitted on: pieces of runs, rows that choose its form."""

import numpy as np
import pytest
from sklearn.model_selection import PredefinedSplit, cross_val_score

from sksurrogate.compose._hybrid_output import OutputCorrection, _defaults
from sksurrogate.compose._residual_fit import cut


@pytest.mark.parametrize(("most_rows", "n_pieces"), [(1000, 8), (80, 8), (40, 4), (20, 2)])
def test_pieces_begin_with_measured_rows_and_have_as_many_others_in_all_as_are_asked_for(most_rows, n_pieces):
    y = np.arange(90.0)[:, None]
    pieces = cut([np.hstack([y, -y])], [y], n_lags=10, longest=10, most_rows=most_rows)
    assert pieces.target.shape == (20, n_pieces, 1) and pieces.known.shape == (20, n_pieces, 2)
    begins = np.arange(n_pieces) * 80 // n_pieces
    np.testing.assert_array_equal(pieces.target[:, :, 0], begins + np.arange(20)[:, None])
    np.testing.assert_array_equal(pieces.known[..., 1:], -pieces.target)


@pytest.mark.parametrize("n_runs", [1, 5])
@pytest.mark.parametrize("seed", range(4))
def test_the_default_residual_is_that_of_a_search_on_every_fourth_run_or_row(seed, n_runs):
    rng, n_lags, n = np.random.default_rng(seed), 2, 40 // n_runs
    deviation = [np.zeros((n + n_lags, 1)) for _ in range(n_runs)]
    phi = rng.normal(size=(n * n_runs, 2))
    wanted = phi[:, 0] + 0.4 * phi[:, 1] ** 2 + rng.normal(size=n * n_runs)
    number = np.arange(n * n_runs) // n if n_runs > 1 else np.arange(n)
    split = PredefinedSplit(np.where(number % 4 == 1, 0, -1))
    scores = [
        cross_val_score(candidate, phi, wanted, cv=split, scoring="neg_mean_squared_error")[0]
        for candidate in _defaults(2)
    ]
    correction = OutputCorrection(None, None, "output", "one_step", n_lags, 0.5, 0.0, None)
    chosen = correction._chosen(deviation, phi, wanted)
    assert repr(chosen) == repr(_defaults(2)[int(np.argmax(scores))])
