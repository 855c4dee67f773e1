"""Whether a formula that was read off a fitted model is what the model predicts."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

Function = Callable[[np.ndarray], Any]

#: Relative error that counts as rounding: networks of single precision, or whose weights nearly cancel.
ROUNDING = 1e-5
#: How far the rows reach at which a formula is asked: near, and where what saturates or clips has done so.
REACHES = (1.0, 10.0, 1000.0)


def dense(rows: Any) -> np.ndarray:
    """Rows of a transformer, sparse ones filled in."""
    return np.asarray(rows.toarray() if hasattr(rows, "toarray") else rows, dtype=float)


def probes(n: int, n_rows: int = 8) -> list[np.ndarray]:
    """Rows (n_rows, n) about zero, one array per reach."""
    rng = np.random.default_rng(0)
    return [reach * rng.uniform(-1.0, 1.0, (n_rows, n)) for reach in REACHES]


def beyond(rows: np.ndarray) -> list[np.ndarray]:
    """Rows about the middle of given ones, one array per reach, which is in their ranges."""
    low, high = rows.min(axis=0), rows.max(axis=0)
    size = np.where(high > low, high - low, np.maximum(np.abs(high), 1.0))
    return [0.5 * (low + high) + part * size for part in probes(rows.shape[1])]


def agree(formula: Function, predict: Function, places: Iterable[np.ndarray], blind: bool = False) -> bool:
    """Whether a formula gives what ``predict`` gives, in every array of rows by itself.

    Places where ``predict`` refuses the rows, or is not finite, say nothing; ``blind``: the answer where all are such.
    """
    seen = False
    for rows in places:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # arrays in place of frames
            try:
                wanted = np.asarray(predict(rows), dtype=float).reshape(len(rows), -1)
            except (ValueError, TypeError):
                continue
            try:
                found = np.asarray(formula(rows), dtype=float).reshape(len(rows), -1)
            except ValueError:  # other features than those of predict
                return False
        known = np.isfinite(wanted).all(axis=1)
        if found.shape != wanted.shape or not np.array_equal(known, np.isfinite(found).all(axis=1)):
            return False
        if known.any():
            wanted, seen = wanted[known], True
            room = ROUNDING * np.abs(wanted) + 1e-7 * np.ptp(wanted, axis=0)
            if np.any(np.abs(found[known] - wanted) > room):
                return False
    return seen or blind


def is_affine(model: Any) -> bool:
    """Whether a fitted model predicts ``features @ coef_ + intercept_``: those with a link, a centre or labels do not."""
    inner = getattr(model, "features_", None)
    coef = np.atleast_2d(np.asarray(model.coef_, dtype=float))
    n = coef.shape[1] if inner is None else int(model.n_features_in_)

    def formula(rows: np.ndarray) -> np.ndarray:
        made = rows if inner is None else dense(inner.transform(rows))
        return made @ coef.T + np.ravel(model.intercept_)

    return agree(formula, model.predict, probes(n), blind=inner is not None)
