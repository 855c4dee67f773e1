"""Constructor arguments of an effect as plain JSON, and back: numbers, text, lists, tuples, dicts and terms of laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._formula import SHAPES, Factor, Term
from sksurrogate.exceptions import DataError

#: What stands apart from the arguments in a file.
PLACE = ("location", "variable")


def as_text(effect: BaseEffect) -> dict[str, Any]:
    """Constructor arguments beside the place, as JSON has them.

    Raises DataError where an argument is nothing that can be written.
    """
    own = effect.get_params(deep=False)
    return {name: _written(effect, name, value) for name, value in own.items() if name not in PLACE}


def _written(effect: BaseEffect, name: str, value: Any) -> Any:
    """One value; what JSON would confuse with a list carries a tag."""

    def each(values: Sequence[Any]) -> list[Any]:
        return [_written(effect, name, one) for one in values]

    if isinstance(value, np.generic):
        value = value.item()
    if value is None or type(value) in (bool, int, float, str):
        return value
    if type(value) is list:
        return each(value)
    if type(value) is tuple:
        return {"tuple": each(value)}
    if type(value) is dict and all(type(key) is str for key in value):
        return {"dict": {key: _written(effect, name, one) for key, one in value.items()}}
    if type(value) is Term:
        return {"term": [each(factor) for factor in value.factors]}
    raise DataError(
        f"effects: {name}={value!r} of {type(effect).__name__} at {effect.location!r} is a {type(value).__name__} and cannot be "
        "written as text: expected numbers, text, None, or lists, tuples and dicts (names as keys) of those. Let the effect take "
        "such arguments and make the rest of them, or keep the simulator with skops or joblib."
    )


def as_arguments(text: Mapping[str, Any]) -> dict[str, Any]:
    """Constructor arguments from what :func:`as_text` wrote.

    Raises ValueError, TypeError where it is not such a text.
    """
    return {str(name): _read(value) for name, value in text.items()}


def _read(value: Any) -> Any:
    """One value."""
    if isinstance(value, list):
        return [_read(one) for one in value]
    if value != value:
        raise ValueError("an argument is nan, expected a number")
    if isinstance(value, int) and value.bit_length() > 1023:
        raise ValueError("an argument is a whole number beyond 1e308")
    if not isinstance(value, dict):
        return value
    ((tag, inside),) = value.items()
    if tag == "tuple":
        return tuple(_read(one) for one in listed(inside))
    if tag == "dict":
        return {str(key): _read(one) for key, one in inside.items()}
    if tag == "term":
        return Term(tuple(_factor(*factor) for factor in listed(inside)))
    raise ValueError(f"an argument has the tag {tag!r}, expected tuple, dict or term")


def _factor(shape: Any, name: Any, constant: Any, width: Any, *more: Any) -> Factor:
    """A factor of a term."""
    if shape not in SHAPES:
        raise ValueError(f"a term has the shape {shape!r}, expected one of {list(SHAPES)}")
    numbers = (constant, width, *more)
    if not isinstance(name, str) or any(isinstance(n, bool) or not np.isfinite(float(n)) for n in numbers):
        raise ValueError(f"a term has the factor {(shape, name, *numbers)!r}, expected a signal and finite numbers")
    return (str(shape), name, *map(float, numbers))  # type: ignore[return-value]


def listed(value: Any) -> list[Any]:
    """A list; text and objects of JSON could be run through too."""
    if not isinstance(value, list):
        raise TypeError(f"expected a list, got {type(value).__name__}")
    return value
