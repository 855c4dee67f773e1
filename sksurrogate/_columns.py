"""Columns of a frame by the names of a simulator's signals."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Sequence
from typing import Any

from sklearn.exceptions import DataConversionWarning

from sksurrogate._tables import unmasked
from sksurrogate.exceptions import DataError

#: Default names, which no user chose: u0, y1, x2, 3.
_MADE_UP = re.compile(r"[uxy]?\d+")


def by_name(data: Any, names: Sequence[str] | str | None, run: Any = None, *, warn: bool = True) -> Any:
    """Columns of a frame in the order of a simulator's signals; arrays pass as they are, with nan where they are masked.

    ``names``: signals of the simulator.
    ``run``: the run column (and that of the time), which is kept; a position leaves the frame as it is.
    ``warn``: whether to warn of a frame with other names; False where its names have been seen before.
    Raises DataError where some columns carry the simulator's names and one that is needed does not.
    Warns DataConversionWarning: None of the columns carries a name of the simulator: they are taken in their own
        order. Default names (u0, y1, 0, 1) on either side give no warning.
    """
    others = run if isinstance(run, list) else [] if run is None else [run]
    if names is None or not hasattr(data, "columns") or not all(isinstance(name, str) for name in others):
        return unmasked(data)
    wanted = [names] if isinstance(names, str) else [str(name) for name in names]
    kept = [name for name in others if name != "index"]
    there = [str(column) for column in data.columns]
    missing = [name for name in wanted if name not in there]
    if missing and len(there) == len(wanted) + len(kept) and not set(there) & set(wanted):
        columns = [name for name in there if name not in kept]
        if warn and _chosen(wanted) and _chosen(columns):
            warnings.warn(
                f"none of the columns {columns} is named like a signal of the simulator, {wanted}: they are taken in their "
                "own order. Rename them (frame.rename(columns={...})) or the simulator's signals; give frame.to_numpy() "
                "where the order is meant.",
                DataConversionWarning,
                stacklevel=_outside(),
            )
        return data
    if missing:
        raise DataError(
            f"column {missing[0]!r} of the simulator is not in the data; columns are {there}. "
            "Rename it, or name the signals of the simulator so."
        )
    return data[[*wanted, *(name for name in kept if name in there)]]


def _chosen(names: Sequence[str]) -> bool:
    """Whether a user has chosen the names."""
    return not all(_MADE_UP.fullmatch(name) for name in names)


def _outside() -> int:
    """Level of the nearest caller outside the package and scikit-learn, for a warning of :func:`by_name`."""
    frame, level = sys._getframe(2), 2
    while frame is not None and frame.f_globals.get("__name__", "").split(".")[0] in ("sksurrogate", "sklearn"):
        frame, level = frame.f_back, level + 1  # type: ignore[assignment]
    return level
