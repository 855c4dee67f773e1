"""Scalers and projections of scikit-learn as plain numbers, with their options as they are set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

#: Transformers that :func:`scaling_of` knows.
SCALERS = ("StandardScaler", "MinMaxScaler", "MaxAbsScaler", "RobustScaler")


@dataclass(frozen=True, eq=False)
class Scaling:
    """``z = (x - center) / scale``, then held within ``bounds``."""

    #: center, scale: (n_features,)
    center: np.ndarray
    scale: np.ndarray
    bounds: tuple[float, float] | None = None

    @property
    def affine(self) -> tuple[np.ndarray, np.ndarray]:
        """(A, c) of ``x * A + c``, each (n_features,)."""
        return 1.0 / self.scale, -self.center / self.scale

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """dz/dx at rows (n_rows, n_features), (n_rows, n_features): 0 where z is held."""
        slope = np.broadcast_to(1.0 / self.scale, x.shape)
        if self.bounds is None:
            return slope
        z = (x - self.center) / self.scale
        return np.where((z >= self.bounds[0]) & (z <= self.bounds[1]), slope, 0.0)


def scaling_of(step: Any) -> Scaling | None:
    """What a fitted scaler of scikit-learn does; None for all else.

    A scaler keeps ``mean_`` without ``with_mean``, and its options decide in ``transform``: the attributes do not say which are used.
    """
    kind = type(step).__name__
    if kind not in SCALERS or not type(step).__module__.startswith("sklearn."):
        return None
    zero, one = np.zeros(step.n_features_in_), np.ones(step.n_features_in_)
    if kind == "StandardScaler":
        return Scaling(step.mean_ if step.with_mean else zero, step.scale_ if step.with_std else one)
    if kind == "RobustScaler":
        return Scaling(step.center_ if step.with_centering else zero, step.scale_ if step.with_scaling else one)
    if kind == "MaxAbsScaler":
        return Scaling(zero, step.scale_, (-1.0, 1.0) if step.clip else None)
    low, high = step.feature_range
    return Scaling(-step.min_ / step.scale_, 1.0 / step.scale_, (float(low), float(high)) if step.clip else None)


def projection_of(step: Any) -> np.ndarray | None:
    """The matrix (n_features, n_components) of a fitted ``PCA``, which multiplies ``x - mean_``; None for all else."""
    if type(step).__name__ != "PCA" or not type(step).__module__.startswith("sklearn."):
        return None
    if not step.whiten:
        return step.components_.T
    size = np.sqrt(step.explained_variance_)
    return step.components_.T / np.maximum(size, np.finfo(size.dtype).eps)  # the same floor as in its transform


def affine_map(step: Any) -> tuple[np.ndarray, np.ndarray] | None:
    """A fitted scaler without bounds, or PCA, as ``x @ A + c`` (A a matrix, or the diagonal of one); None for all else."""
    scaling, projection = scaling_of(step), projection_of(step)
    if projection is not None:
        return projection, -step.mean_ @ projection
    return None if scaling is None or scaling.bounds is not None else scaling.affine
