"""Results as plain Python objects, as strict JSON, and the JSON Schema of a report."""

from __future__ import annotations

import inspect
import json
import re
import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from sksurrogate.gap.results._law import Law
from sksurrogate.gap.results._table import Table


def plain(value: Any) -> Any:
    """Dicts, lists, strings, numbers, booleans and None alone; floats that are nan or infinite stay floats.

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


def json_text(value: Any, indent: int | None) -> str:
    """Strict JSON (RFC 8259): nan is null, the infinities are the strings "Infinity" and "-Infinity".

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


#: Name and version of the format; the number grows when a field is renamed or removed, not when one is added.
SCHEMA_ID = "sksurrogate.gap-report/1"

#: Floats: nan is null, infinite ones are strings.
NUMBER: dict[str, Any] = {"type": ["number", "null", "string"]}
_PLAIN: dict[Any, dict[str, Any]] = {
    str: {"type": "string"},
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: NUMBER,
    type(None): {"type": "null"},
    np.ndarray: {"type": "array"},
    Table: {"type": "array", "items": {"type": "object"}},
}


def schema_of(kind: Any) -> dict[str, Any]:
    """Schema of a type: of a dataclass field by field, with the sentences of its docstring.

    >>> schema_of(tuple[str, ...])
    {'type': 'array', 'items': {'type': 'string'}}
    >>> schema_of(Table)["type"]
    'array'
    """
    if kind in _PLAIN:
        return dict(_PLAIN[kind])
    if is_dataclass(kind) and isinstance(kind, type):
        return _object(kind)
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return {"anyOf": [schema_of(one) for one in inner]}
    if origin is not None and isinstance(origin, type) and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": schema_of(inner[1])}
    if origin is not None and isinstance(origin, type) and issubclass(origin, Sequence):
        items = [one for one in inner if one is not ...]
        alike = len(set(map(str, items))) == 1
        return {"type": "array", "items": schema_of(items[0])} if alike else {"type": "array"}
    return {}


def _object(kind: type) -> dict[str, Any]:
    """Schema of a dataclass."""
    hints, said = get_type_hints(kind), described_attributes(kind)
    properties = {}
    for part in fields(kind):
        properties[part.name] = schema_of(hints[part.name])
        if part.name in said:
            properties[part.name]["description"] = said[part.name]
    return {"type": "object", "properties": properties, "required": list(properties)}


def described_attributes(kind: type) -> dict[str, str]:
    """Attribute -> its description in the numpydoc section of the class.

    >>> class Point:
    ...     '''A point.
    ...
    ...     Attributes
    ...     ----------
    ...     x, y : float
    ...         Place.
    ...     '''
    >>> described_attributes(Point)
    {'x': 'Place.', 'y': 'Place.'}
    """
    found: dict[str, str] = {}
    text = inspect.cleandoc(kind.__doc__ or "")
    section = re.search(r"^Attributes\n-+\n(.*?)(?=^\w[^\n]*\n-{3,}\n|\Z)", text, re.S | re.M)
    names: list[str] = []
    for line in section.group(1).splitlines() if section else ():
        if line.strip() and not line.startswith(" "):
            names = [name.strip() for name in line.partition(" : ")[0].split(",")]
        elif line.strip():
            for name in names:
                found[name] = f"{found.get(name, '')} {line.strip()}".strip()
    return found
