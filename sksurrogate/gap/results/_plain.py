"""Results as plain Python objects and as strict JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from sksurrogate.gap.results._law import Law
from sksurrogate.gap.results._table import Table

__all__ = ["json_text", "plain"]


def plain(value: Any) -> Any:
    """Dicts, lists, strings, numbers, booleans and None alone; floats that are nan or infinite stay floats.

    Examples
    --------
    >>> plain({"low": np.float64(1.0), "runs": (1, 2), "rows": Table(({"a": np.True_},))})
    {'low': 1.0, 'runs': [1, 2], 'rows': [{'a': True}]}
    """
    if value is None or isinstance(value, (bool, int, float, str)):
        return float(value) if isinstance(value, np.floating) else value
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, np.ndarray):
        return [plain(one) for one in value.tolist()]
    if isinstance(value, Table):
        return [plain(row) for row in value.rows]
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, (Sequence, set, frozenset)):
        return [plain(one) for one in value]
    if is_dataclass(value) and not isinstance(value, type):
        formula = {"formula": str(value), "latex": value.latex} if isinstance(value, Law) else {}
        return {**formula, **{part.name: plain(getattr(value, part.name)) for part in fields(value)}}
    return str(value)


def json_text(value: Any, indent: int | None = 2) -> str:
    """Strict JSON (RFC 8259): nan is null, the infinities are the strings "Infinity" and "-Infinity".

    Examples
    --------
    >>> json_text({"share": float("nan"), "interval": [0.5, float("inf")]}, indent=None)
    '{"share": null, "interval": [0.5, "Infinity"]}'
    """
    return json.dumps(_finite(value), indent=indent, ensure_ascii=False, allow_nan=False)


def _finite(value: Any) -> Any:
    """Without floats that JSON does not have."""
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None if np.isnan(value) else ("Infinity" if value > 0 else "-Infinity")
    return value
