"""scikit-learn's check of X and y, with messages that say where a value is missing."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.utils.validation import _check_feature_names, _check_n_features, validate_data

from sksurrogate._tables import unmasked
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.rows import RowSource

_NOT_GIVEN = "no_validation"


def is_checked_frame(estimator: Any, X: Any, reset: bool) -> bool:
    """Whether X is a frame, whose columns are then those of the fit: what it holds is read run by run."""
    if not hasattr(X, "columns"):
        return False
    _check_feature_names(estimator, X, reset=reset)
    _check_n_features(estimator, X, reset=reset)
    return True


def checked(estimator: Any, X: Any, y: Any = _NOT_GIVEN, **checks: Any) -> Any:
    """``validate_data``; where it refuses nan, infinity or text, row and column are named.

    ``X`` array-like or RowSource (n_samples, n_features): a source of rows, which some of our own estimators take, is
        only counted.
    ``**checks``: of ``sklearn.utils.validation.validate_data``.
    Returns (ndarray, ndarray).
    Raises DataError where a value is missing (nan, or masked), infinite or no number; X and y differ in length.
    Raises ValueError: as scikit-learn says.
    """
    if isinstance(X, RowSource):
        estimator.n_features_in_ = X.shape[1]
        return (X, y)
    X, y = unmasked(X), unmasked(y)
    try:
        found = validate_data(estimator, X, y, **checks)
    except ValueError as error:
        text = str(error)
        given = [("X", X)] if isinstance(y, str) else [("X", X), ("y", y)]
        message = ""
        if "inconsistent numbers of samples" in text and len(given) == 2:
            sizes = f"X has {np.shape(X)[0]} rows and y has {np.shape(y)[0]}"
            message = f"{sizes} (inconsistent numbers of samples): give one target a row."
        elif "NaN" in text or "infinity" in text:
            message = next(filter(None, (_hole(name, values) for name, values in given)), "")
        elif "convert string to float" in text or "arrays of bytes/strings" in text:
            message = next(filter(None, (_text(name, values) for name, values in given)), "")
        if not message:
            raise
        raise DataError(message) from None
    if isinstance(found, tuple) and found[1].dtype.kind in "OUS":  # several outputs are not read as numbers above
        try:
            found[1].astype(float)
        except (TypeError, ValueError):
            raise DataError(_text("y", y)) from None
    if checks.get("reset", True):
        for name, values in zip("Xy", found if isinstance(found, tuple) else (found,)):
            _refuse_huge(name, values)
    return found


def _refuse_huge(name: str, values: Any) -> None:
    """Numbers whose squares are infinite are refused: sums of squares would be, in silence."""
    if not isinstance(values, np.ndarray) or values.dtype.kind != "f":
        return
    flat = values.ravel(order="K")
    with np.errstate(over="ignore", invalid="ignore"):
        if not np.isinf(np.vdot(flat, flat)):
            return
    if np.isinf(values).any():
        return  # what was allowed is not ours to refuse
    first = np.array(np.unravel_index(int(np.nanargmax(np.abs(values))), values.shape))
    raise DataError(
        f"{name} holds {values[tuple(first)]:.3g}, whose square is beyond float64: {_place(values, first)}. Change the unit of "
        "this column."
    )


def _place(values: Any, first: np.ndarray) -> str:
    """Row and column of an entry, by the column's name where there is one."""
    columns = getattr(values, "columns", None)
    if len(first) < 2:
        return f"row {first[0]}"
    return (
        f"row {first[0]}, column {columns[first[1]]!r}" if columns is not None else f"row {first[0]}, column {first[1]}"
    )


def _text(name: str, values: Any) -> str:
    """Where the first entry stands that cannot be read as a number."""
    table = np.asarray(values, dtype=object)
    for place in np.ndindex(table.shape):
        try:
            float(table[place])
        except (TypeError, ValueError):
            return (
                f"{name} holds {table[place]!r}, which is not a number: {_place(values, np.array(place))}. Leave the column out, "
                "encode it (sklearn.preprocessing.OneHotEncoder), or name it if it labels the runs (run=)."
            )
    if any(isinstance(value, (str, bytes)) for value in table.flat):
        return f"{name} holds numbers written as text: convert them, {name}.astype(float)."
    return ""


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
    return (
        f"Input {name} contains {what}: {_place(values, first)}; {int(bad.sum())} values in all. Remove or interpolate them first "
        "(sksurrogate.features.Interpolator does so within a run)."
    )
