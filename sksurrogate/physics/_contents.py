"""Whether an object is still what it was: `fit` and `set_params` change it in place."""

from __future__ import annotations

from operator import is_
from typing import Any

from sklearn.base import BaseEstimator


def contents(*things: Any) -> list[Any]:
    """The objects that these are made of: parameters and learned attributes, those of estimators among them too.

    Private attributes do not count: what is looked up again lies there, and a fit sets public ones.
    """
    found = list(things)
    for thing in things:
        for name, value in getattr(thing, "__dict__", {}).items():
            if name.startswith("_"):
                continue
            if isinstance(value, BaseEstimator):
                found += contents(value)
            elif isinstance(value, dict):
                found += value.values()
            found.append(value)
    return found


def same(one: list[Any], other: list[Any]) -> bool:
    """Whether two contents are the same objects."""
    return len(one) == len(other) and all(map(is_, one, other))
