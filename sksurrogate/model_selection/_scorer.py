"""Selection on the free run."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.metrics import mean_squared_error, r2_score
from sklearn.utils._metadata_requests import _MetadataRequester

from sksurrogate.exceptions import DataError
from sksurrogate.runs import resolve_runs


class FreeRunScorer(_MetadataRequester):
    """Score the free run from the measured first rows of every run, those rows left out.

    scikit-learn's own scorers give neither ``groups`` nor first outputs to ``predict``. This scorer gives both.

    Parameters
    ----------
    metric : {"r2", "neg_rmse"}, default="r2"
    n_initial : int, optional
        Rows of each run that start it and do not count, at least the estimator's ``n_initial_`` (its default). Give one
        number when models of different lags are compared, so that all are scored on the same rows.

    Examples
    --------
    >>> from sklearn.linear_model import LinearRegression
    >>> from sksurrogate.compose import RecursivePredictor
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> X, y, groups = make_reactor_runs(4, 100, y0_range=(4.0, 6.0), u_range=(0.1, 0.15), random_state=0)
    >>> model = RecursivePredictor(LinearRegression(), 2, 2).fit(X, y, groups=groups)
    >>> bool(FreeRunScorer("neg_rmse").score(model, X, y, groups=groups) < 0)
    True
    """

    __metadata_request__score = {"groups": True}

    def __init__(self, metric: str = "r2", *, n_initial: int | None = None):
        self.metric = metric
        self.n_initial = n_initial

    def __call__(self, estimator: Any, X: Any, y: Any, groups: Any = None) -> float:
        """Same as :meth:`score`."""
        return self.score(estimator, X, y, groups=groups)

    def score(self, estimator: Any, X: Any, y: Any, groups: Any = None) -> float:
        """Score a fitted estimator whose ``predict`` takes ``y0`` and ``groups``; larger is better.

        Parameters
        ----------
        estimator : fitted estimator
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        float
        """
        if self.metric not in ("r2", "neg_rmse"):
            raise ValueError(f'metric={self.metric!r} must be "r2" or "neg_rmse".')
        if not hasattr(estimator, "n_initial_"):
            raise DataError(
                f"FreeRunScorer needs a fitted model that runs freely, such as RecursivePredictor(...); {type(estimator).__name__} "
                "is fitted to single rows, or not fitted."
            )
        needed = estimator.n_initial_
        skip = needed if self.n_initial is None else self.n_initial
        if skip < needed:
            raise DataError(
                f"n_initial={skip}, but the estimator needs {needed} first rows of each run: raise n_initial."
            )
        runs = resolve_runs(X, y, groups=groups, run=getattr(estimator, "run", None), min_rows=skip + 1)
        # a longer initial window only starts later, so every model sees the same measured rows
        parts = []
        for run in runs:
            assert run.y is not None
            rows = slice(run.start + skip - needed, run.stop)
            part = X.iloc[rows] if hasattr(X, "iloc") else X[rows]
            labels = np.zeros(rows.stop - rows.start)  # one run, whatever a run column says
            free = estimator.predict(part, y0=run.y[skip - needed : skip], groups=labels)
            parts.append((run.y[skip:], np.asarray(free)[needed:].reshape(run.y[skip:].shape)))
        truth, found = (np.concatenate(side) for side in zip(*parts))
        if self.metric == "r2":
            return float(r2_score(truth, found))
        return -float(np.sqrt(mean_squared_error(truth, found)))
