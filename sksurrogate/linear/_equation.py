"""A linear model as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


def equation(left: str, coef: np.ndarray, names: Sequence[Any] | np.ndarray, intercept: float, digits: int = 4) -> str:
    """``left = intercept + coef * name ...`` with the terms that are not zero.

    ``coef`` (n_terms,).
    ``names`` (n_terms,): "1" stands for a constant.
    ``digits``: significant ones.

    >>> import numpy as np
    >>> equation("dq/dt", np.array([0.0, -2.0, 1.0]), ["q", "v", "q v"], 0.5)
    'dq/dt = 0.5 - 2 v + 1 q v'
    """
    terms = [(float(intercept), "")] + [(float(c), "" if name == "1" else f" {name}") for c, name in zip(coef, names)]
    text = ""
    for value, name in terms:
        if value:
            sign = ("- " if value < 0 else "+ ") if text else ("-" if value < 0 else "")
            text += f"{' ' if text else ''}{sign}{abs(value):.{digits}g}{name}"
    return f"{left} = {text or '0'}"
