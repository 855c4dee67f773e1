"""What a user means by ``lags``: columns and their lags, in order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.exceptions import DataError


def lag_list(lags: int | Sequence[int], first: int, name: str) -> list[int]:
    """The lags that an int (``first..lags``) or a list stands for, sorted."""
    whole = isinstance(lags, (int, np.integer)) and not isinstance(lags, bool)
    given: Any = lags
    if whole and (lags == 0 or lags >= first):  # type: ignore[operator]
        given = range(first, int(lags) + 1)  # type: ignore[arg-type]
    elif whole:
        given = [lags]
    listed = not isinstance(given, (str, Mapping)) and np.iterable(given)
    if not listed or any(not isinstance(k, (int, np.integer)) or k < first for k in given):
        raise DataError(f"{name}={lags!r}: every lag must be at least {first}; give an int or a list of ints.")
    return sorted({int(k) for k in given})


def lag_terms(lags: Any, names: Sequence[str], argument: str = "lags") -> list[tuple[int, int]]:
    """Column and lag of every feature; ``lags`` is for all columns, or a dict by name or position of some of them."""
    if not isinstance(lags, Mapping):
        return [(j, k) for j in range(len(names)) for k in lag_list(lags, 0, argument)]
    wanted = [(_position(key, names, argument), lag_list(k, 0, f"{argument}[{key!r}]")) for key, k in lags.items()]
    return [(j, k) for j, listed in wanted for k in listed]


def _position(key: Any, names: Sequence[str], argument: str) -> int:
    """Column that a key of a dict of lags means."""
    if isinstance(key, str) and key in names:
        return list(names).index(key)
    if isinstance(key, (int, np.integer)) and 0 <= key < len(names):
        return int(key)
    raise DataError(f"{argument} names the column {key!r}, but the inputs are {list(names)}.")
