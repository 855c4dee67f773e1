"""The shape of what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.gap.results._law import Law


@dataclass(frozen=True, eq=False)
class Curve:
    """The missing term against one variable.

    Attributes
    ----------
    variable : str
    at, value, low, high : ndarray (n_points,)
        Points on the variable, mean of the term there and its 90 % band, in units of the derivative (or of the input or
        output where it sits there).
    explained : float
        Share of the term's variance that a curve in this variable alone explains on runs left out.
    """

    variable: str
    at: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    explained: float


@dataclass(frozen=True)
class MissingTerm:
    """The shape of what is missing.

    Attributes
    ----------
    location : str
    kind : str
    curves : tuple of Curve
        Best variable first.
    candidates : tuple of str
        Symbolic candidates, best first: sums of few simple shapes, with the share of the term that each explains on runs
        left out.
    effects : tuple of LawEffect
        The same as effects, ready for ``GapDiagnoser(effects=[...])``; empty where the term sits in a sensor or an element.
    law : Law or None
        The simplest formula that does as well as a free curve, fitted in the free run; None where none was found.
    """

    location: str
    kind: str
    curves: tuple[Curve, ...]
    candidates: tuple[str, ...] = ()
    effects: tuple[Any, ...] = ()
    law: Law | None = None
