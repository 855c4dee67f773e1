"""scikit-learn's check of X and y, with messages that say where a value is missing."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.utils.validation import validate_data

from sksurrogate.exceptions import DataError
from sksurrogate.kernels.rows import RowSource

__all__ = ["checked"]

_NOT_GIVEN = "no_validation"


def checked(estimator: Any, X: Any, y: Any = _NOT_GIVEN, **checks: Any) -> Any:
    """``validate_data``; where it refuses nan or infinity, row and column are named.

    Parameters
    ----------
    estimator : estimator
    X : array-like or RowSource (n_samples, n_features)
        A source of rows, which some of our own estimators take, is only counted.
    y : array-like, optional
    **checks
        Of ``sklearn.utils.validation.validate_data``.

    Returns
    -------
    ndarray or (ndarray, ndarray)

    Raises
    ------
    DataError
        A value is missing or infinite.
    ValueError
        As scikit-learn says.
    """
    if isinstance(X, RowSource):
        estimator.n_features_in_ = X.shape[1]
        return (X, y)
    try:
        return validate_data(estimator, X, y, **checks)
    except ValueError as error:
        if "NaN" not in str(error) and "infinity" not in str(error):
            raise
        given = [("X", X)] if isinstance(y, str) else [("X", X), ("y", y)]
        messages = [message for name, values in given if (message := _hole(name, values))]
        if not messages:
            raise
        raise DataError(messages[0]) from None


def _hole(name: str, values: Any) -> str:
    """Where the first value that is not finite stands; empty where there is none, or none can be seen."""
    try:
        table = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        return ""
    bad = ~np.isfinite(table)
    if not bad.any():
        return ""
    first = np.argwhere(bad)[0]
    what = "NaN" if np.isnan(table[tuple(first)]) else "infinity"
    columns = getattr(values, "columns", None)
    where = f"row {first[0]}"
    if table.ndim == 2:
        where += f", column {columns[first[1]]!r}" if columns is not None else f", column {first[1]}"
    return (
        f"Input {name} contains {what}: {where}; {int(bad.sum())} values in all. Remove or interpolate them first "
        "(sksurrogate.features.Interpolator does so within a run)."
    )
