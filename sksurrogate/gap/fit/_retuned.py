"""Free parameters as they are reported: the model holds the logarithm of what they are over nominal, or the value where that is 0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sksurrogate.gap.results._table import Table

__all__ = ["retuned_table", "value_of"]

#: A fit that ends this near to a bound is at it: steps are cut there.
AT_BOUND = 1e-9


def value_of(nominal: float, phi: float) -> float:
    """Value of a free parameter.

    Examples
    --------
    >>> value_of(2.0, 0.0), value_of(0.0, 0.3)
    (2.0, 0.3)
    """
    return float(phi if nominal == 0 else nominal * np.exp(phi))


def retuned_table(
    params: Mapping[str, float],
    free: Sequence[str],
    phi: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray] | None = None,
) -> Table:
    """One row a free parameter: nominal, value, 90 % interval, moved or not, at a bound or not.

    Examples
    --------
    >>> rows = retuned_table({"k": -2.0}, ["k"], np.array([0.1]), np.array([0.05]), np.array([0.15]))
    >>> rows[0]["low"] < rows[0]["value"] < rows[0]["high"] < rows[0]["nominal"], rows[0]["moved"]
    (True, True)
    """
    rows = []
    least, most = bounds or (np.full(len(phi), -np.inf), np.full(len(phi), np.inf))
    held = (phi <= least + AT_BOUND) | (phi >= most - AT_BOUND)
    for name, at_bound, *own in zip(free, held, phi, low, high):
        nominal = float(params[name])
        value, *ends = (value_of(nominal, one) for one in own)
        first, last = sorted(ends)
        rows.append(
            {
                "parameter": name,
                "nominal": nominal,
                "value": value,
                "low": first,
                "high": last,
                "moved": not first <= nominal <= last,
                "at_bound": bool(at_bound),
            }
        )
    return Table(tuple(rows))
