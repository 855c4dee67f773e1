"""What users give as X and y, read as arrays of numbers: arrays, lists, frames; what cannot be read is said."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.exceptions import DataError

#: Rows with this label (the gaps that :func:`~sksurrogate.runs.cut_runs` leaves) belong to no run.
LEFT_OUT = -1


def unmasked(values: Any) -> Any:
    """A masked array with nan where it is masked, anything else as it is: numpy shows what lies under a mask."""
    if not isinstance(values, np.ma.MaskedArray):
        return values
    if not np.ma.is_masked(values):
        return values.data
    kind = float if values.dtype.kind in "biuf" else object
    return np.ma.filled(np.ma.asarray(values, dtype=kind), np.nan)


def as_labels(given: Any) -> np.ndarray:
    """Labels of the rows as they were written: 1 is not "1", and -1 leaves a row out where others are text, too."""
    values = unmasked(given)
    labels = values.to_numpy() if hasattr(values, "to_numpy") else np.asarray(values)
    if labels.dtype.kind in "OU" and labels.ndim == 1:
        listed = list(values) if isinstance(values, (list, tuple)) else labels.tolist()
        texts = [isinstance(label, str) for label in listed]
        left_out = [text and label.strip() in ("-1", "-1.0") for text, label in zip(texts, listed)]
        if any(left_out) or (any(texts) and not all(texts)):
            labels = np.empty(len(listed), dtype=object)
            labels[:] = [LEFT_OUT if out else label for out, label in zip(left_out, listed)]
    return labels


def no_inputs(y: Any, groups: Any) -> np.ndarray:
    """X (n_samples, 0) of a plant without inputs, as long as y or groups."""
    rows = y if y is not None else groups
    if rows is None:
        raise DataError(
            "X is None, and neither y nor groups says how many rows there are: give X of shape (n_samples, 0), "
            "for example np.zeros((100, 0))."
        )
    return np.zeros((len(rows), 0))


def as_table(X: Any) -> np.ndarray:
    """A 2-D array of whatever dtype; 1-D and sparse are refused with the way out."""
    if hasattr(X, "toarray"):
        raise DataError("X is sparse; sparse input is not supported here: pass X.toarray().")
    X = unmasked(X)
    table = X.to_numpy() if hasattr(X, "to_numpy") else np.asarray(X)
    if table.ndim == 1:
        raise DataError(
            f"X is 1-D with shape {table.shape}, expected (n_samples, n_inputs): use X.reshape(-1, 1) for one input."
        )
    if table.ndim != 2:
        raise DataError(
            f"X has shape {table.shape}, expected (n_samples, n_inputs); stack several runs with stack_runs."
        )
    if len(table) == 0:
        raise DataError("X has no rows; at least one sample is needed.")
    return table


def column_number(key: str | int, names: list[str] | None, n_columns: int, argument: str) -> int:
    """Position of a column that is given by name or position."""
    if isinstance(key, str):
        if names is None:
            raise DataError(
                f"{argument}={key!r} names a column, but X is an array without names: give its position or pass a frame."
            )
        if key not in names:
            raise DataError(f"{argument}={key!r} is not a column of X; columns are {names}.")
        return names.index(key)
    if not -n_columns <= key < n_columns:
        raise DataError(f"{argument}={key} is out of range: X has {n_columns} columns.")
    return int(key) % n_columns


def raw_column(table: np.ndarray, column: int) -> np.ndarray:
    """The column as the user wrote it (an object table would lose integer labels)."""
    values = np.asarray(table[:, column])
    if values.dtype == object:
        listed = values.tolist()
        if any(value is None or value != value for value in listed):  # text would swallow what is missing
            return values
        values = np.asarray(listed) if not any(isinstance(value, str) for value in listed) else values
    values = as_labels(values)
    if values.dtype.kind == "f" and np.all(np.isfinite(values)) and np.all(values == np.round(values)):
        values = values.astype(int)
    return values


def labels_from_index(frame: Any) -> np.ndarray:
    """First level of a pandas index."""
    if frame is None or not hasattr(frame, "index"):
        raise DataError(
            'run="index" needs a pandas frame with the run in its index; name the column instead: run="...".'
        )
    return as_labels(np.asarray(frame.index.get_level_values(0)))


def floats(values: np.ndarray, name: str, columns: list[str] | None = None) -> np.ndarray:
    """float64, or a message that shows what could not be read as a number, and where."""
    if np.iscomplexobj(values):
        raise DataError(f"Complex data not supported: {name} is complex.")
    try:
        return np.ascontiguousarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        where = _first_text(values, columns)
        raise DataError(
            f"{name} holds something that is not a number{where} ({error}): is a text column among the inputs? Leave it out, "
            "or name it if it labels the runs (run=)."
        ) from error


def _first_text(values: np.ndarray, columns: list[str] | None) -> str:
    """Row and column of the first entry that is not a number."""
    for place in np.ndindex(values.shape):
        try:
            float(values[place])
        except (TypeError, ValueError):
            column = "" if len(place) < 2 else f", column {columns[place[1]] if columns else place[1]!r}"
            return f" at row {place[0]}{column}"
    return ""


def outputs_of(y: Any, n_samples: int) -> tuple[np.ndarray | None, list[str] | None, bool]:
    """y as (n_samples, n_outputs), its names, and whether it was 1-D."""
    if y is None:
        return None, None, True
    names = [str(c) for c in y.columns] if hasattr(y, "columns") else None
    y = unmasked(y)
    values = floats(y.to_numpy() if hasattr(y, "to_numpy") else np.asarray(y), "y")
    if values.ndim not in (1, 2):
        raise DataError(f"y has shape {values.shape}, expected (n_samples,) or (n_samples, n_outputs).")
    if len(values) != n_samples:
        raise DataError(f"X has {n_samples} rows and y has {len(values)}: both need one row per sample.")
    return values.reshape(n_samples, -1), names, values.ndim == 1


def without_nan(y: Any) -> Any:
    """y as scikit-learn's checks want it: 0 in the place of what was not measured; y itself where all was."""
    values = y.to_numpy() if hasattr(y, "to_numpy") else np.asarray(y)
    if values.dtype.kind != "f" or not np.isnan(values).any():
        return y
    return np.where(np.isnan(values), 0.0, values)


def refuse_unlabelled(labels: np.ndarray | None, name: str) -> None:
    """A label that is missing is an error, not a run of its own."""
    if labels is None or labels.dtype.kind not in "fOmM":
        return
    missing = np.array([v is None or v != v for v in labels]) if labels.dtype.kind == "O" else np.isnan(labels)
    if missing.any():
        raise DataError(
            f"{name} contains NaN: row {int(np.argmax(missing))}. Every row needs the label of its run; -1 leaves a row out."
        )


def refuse_missing(values: np.ndarray, name: str, columns: Sequence[str] | None, labels: np.ndarray | None) -> None:
    """nan or inf is an error that names row, column and run."""
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(np.sum(values)):
            return
    bad = ~np.isfinite(values)
    if labels is not None and labels.dtype.kind in "iufO":
        bad[labels == LEFT_OUT] = False
    if bad.any():
        row, column = (int(i) for i in np.argwhere(bad)[0])
        what = "NaN" if np.isnan(values[row, column]) else "infinity"
        where = f"column {columns[column]!r}" if columns else f"column {column}"
        of_run = "" if labels is None else f" (run {labels[row : row + 1].tolist()[0]!r})"
        raise DataError(
            f"Input {name} contains {what}: row {row}, {where}{of_run}; {int(bad.sum())} values in all. "
            "Remove or interpolate them first (sksurrogate.features.Interpolator does so within a run)."
        )


def refuse_unseen(outputs: np.ndarray, names: Sequence[str] | None, pieces: list[tuple[Any, int, int]]) -> None:
    """An output that was never measured is an error, and a run without any measured value."""
    known = ~np.isnan(outputs)
    if known.all():
        return
    inside = np.concatenate([np.arange(a, b) for _, a, b in pieces])
    never = np.flatnonzero(~known[inside].any(axis=0))
    if len(never):
        j = int(never[0])
        where = f"column {names[j]!r}" if names else f"column {j}"
        raise DataError(
            f"y holds no measured value in {where}: NaN in every row. Leave this output out of y and of the simulator's outputs."
        )
    for label, a, b in pieces:
        if not known[a:b].any():
            of_run = "y" if label is None else f"run {label!r}"
            raise DataError(
                f"{of_run} holds no measured value: NaN in rows {a}..{b - 1}. Leave this run out; label its rows -1 in groups."
            )
