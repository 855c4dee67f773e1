"""The JSON Schema of a report, read from the dataclasses: a field that is added is in it."""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from sksurrogate.gap.results._table import Table

__all__ = ["SCHEMA_ID", "described_attributes", "schema_of"]

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

    Examples
    --------
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

    Examples
    --------
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
