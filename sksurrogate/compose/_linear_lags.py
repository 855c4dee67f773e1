"""Linear regressors of lagged columns, fitted without the lag matrix."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.linear_model import LinearRegression, Ridge

from sksurrogate.kernels.gram import CONDITION_LIMIT, solve_normal
from sksurrogate.kernels.lag_moments import lag_moments

#: Smaller lag matrices are made: their fit takes milliseconds and is the estimator's own.
FEW_NUMBERS = 2_000_000


class _Joined:
    """Outputs and inputs side by side, only where they are looked at."""

    def __init__(self, y: np.ndarray, X: np.ndarray):
        self.parts, self.shape = (y, X), (len(y), y.shape[1] + X.shape[1])

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, rows: slice) -> np.ndarray:
        return np.concatenate([part[rows] for part in self.parts], axis=1)


def fit_linear_lags(
    estimator: Any, runs: Any, output_lags: Sequence[int], input_terms: Sequence[tuple[int, int]], n_first: int
) -> tuple[Any, float] | None:
    """The fitted clone of a ``LinearRegression`` or ``Ridge`` and its sum of squared one-step errors.

    None where the estimator is something else, the data are few, or the columns are too nearly dependent for a Gram.
    """
    kind = type(estimator)
    if kind not in (LinearRegression, Ridge) or estimator.positive:
        return None
    alpha = estimator.alpha if kind is Ridge else 0.0
    if not isinstance(alpha, Real) or (kind is Ridge and estimator.solver != "auto"):
        return None
    o = runs[0].y.shape[1]
    terms = [(i, k) for k in output_lags for i in range(o)] + [(o + j, k) for j, k in input_terms]
    if sum(map(len, runs)) * len(terms) < FEW_NUMBERS:
        return None
    moments = lag_moments([_Joined(run.y, run.X) for run in runs], n_first)  # type: ignore[misc]
    width = o + runs[0].X.shape[1]
    columns = [k * width + c for c, k in terms] + list(range(o))  # lag 0 of the outputs are the targets
    mean, gram = moments.mean[columns], moments.scatter[np.ix_(columns, columns)]
    if not estimator.fit_intercept:
        gram, mean = gram + moments.n_rows * np.outer(mean, mean), np.zeros(len(mean))
    p = len(terms)
    coef, condition, _ = solve_normal(gram[:p, :p] + float(alpha) * np.eye(p), gram[:p, p:])
    if condition > CONDITION_LIMIT:
        return None
    both = np.concatenate([-coef, np.eye(o)])
    squares = float(max(np.einsum("ij,ik,kj->", both, gram, both), 0.0))
    fitted = clone(estimator)
    fitted.n_features_in_ = p
    offset = mean[p:] - mean[:p] @ coef
    fitted.coef_ = coef[:, 0] if o == 1 else coef.T.copy()
    fitted.intercept_ = (float(offset[0]) if o == 1 else offset) if estimator.fit_intercept else 0.0
    return fitted, squares
