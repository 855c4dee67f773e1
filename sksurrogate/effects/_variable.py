"""What drives an effect: a signal "v", the product "v*w" of two, or the size "abs(v - w)" of their difference or its square."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

_DIFFERENCE = re.compile(r"(?:abs)?\((.+) - (.+)\)(\^2)?")


def differences(one: str, other: str) -> tuple[str, str]:
    """The variables of what acts across an element, alike in both directions.

    >>> differences("T", "Ta")
    ('abs(T - Ta)', '(T - Ta)^2')
    """
    return f"abs({one} - {other})", f"({one} - {other})^2"


def is_difference(variable: str | None) -> bool:
    """Whether it is the size of a difference or its square."""
    return _DIFFERENCE.fullmatch(variable or "") is not None


def signals_in(variable: str | None) -> tuple[str, ...]:
    """Names of the signals that a variable is made of.

    >>> signals_in("v*w"), signals_in("abs(T - Ta)"), signals_in(None)
    (('v', 'w'), ('T', 'Ta'), ())
    """
    found = _DIFFERENCE.fullmatch(variable or "")
    return found.groups()[:2] if found else tuple(variable.split("*")) if variable else ()


def driver_of(variable: str | None, signals: Sequence[Any]) -> Any:
    """What an effect is given as its variable: one array, a pair for "v*w", None where there is none.

    >>> driver_of("abs(T - Ta)", [20.0, 25.0]), driver_of("v*w", [2.0, 3.0]), driver_of("v", [2.0])
    (5.0, (2.0, 3.0), 2.0)
    """
    if is_difference(variable):
        return abs(signals[0] - signals[1]) if str(variable).startswith("abs") else (signals[0] - signals[1]) ** 2
    return signals[0] if len(signals) == 1 else tuple(signals) or None


def value_of(variable: str | None, signals: Sequence[np.ndarray]) -> np.ndarray:
    """The variable as one array, the product for "v*w".

    >>> value_of("v*w", [np.array([2.0]), np.array([3.0])])
    array([6.])
    """
    driver = driver_of(variable, signals)
    return np.prod(driver, axis=0) if isinstance(driver, tuple) else driver
