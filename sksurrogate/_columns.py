"""Columns of a frame by the names of a simulator's signals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sksurrogate.exceptions import DataError

__all__ = ["by_name"]


def by_name(data: Any, names: Sequence[str] | str | None, run: Any = None) -> Any:
    """Columns of a frame in the order of a simulator's signals; arrays pass as they are.

    Parameters
    ----------
    data : array-like or frame
    names : sequence of str, optional
        Signals of the simulator.
    run : None, column name, int or "index"
        The run column, which is kept; a position leaves the frame as it is.

    Returns
    -------
    array-like or frame

    Raises
    ------
    DataError
        Some columns carry the simulator's names and one that is needed does not.

    Notes
    -----
    A frame none of whose columns is named as a signal, and with as many columns, is taken in its own order.
    """
    if names is None or not hasattr(data, "columns") or (run is not None and not isinstance(run, str)):
        return data
    wanted = [names] if isinstance(names, str) else [str(name) for name in names]
    kept = [run] if run is not None and run != "index" else []
    there = [str(column) for column in data.columns]
    missing = [name for name in wanted if name not in there]
    if missing and len(there) == len(wanted) + len(kept) and not set(there) & set(wanted):
        return data
    if missing:
        raise DataError(
            f"column {missing[0]!r} of the simulator is not in the data; columns are {there}. "
            "Rename it, or name the signals of the simulator so."
        )
    return data[[*wanted, *(name for name in kept if name in there)]]
