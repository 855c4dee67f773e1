"""Gaussian bumps as features."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any, NamedTuple

import numpy as np
from sklearn.cluster import KMeans
from sklearn.utils._param_validation import Interval, StrOptions

from sksurrogate.exceptions import DataError
from sksurrogate.features._base import TRANSFORM_ROWS, BaseFeatures, column_of, rising
from sksurrogate.kernels.bases import gaussians, radial


class Bumps(NamedTuple):
    """Centres (n,) and width of the bumps of one input."""

    centers: np.ndarray
    width: float


class GaussianFeatures(BaseFeatures):
    """Gaussian bumps exp(-(x - c)^2 / (2 width^2)).

    Parameters
    ----------
    centers : int or array-like (n_centers,) or (n_centers, n_inputs), default=10
        An int: equidistant between the least and the largest value of each input; with ``interaction="radial"`` the
        centres of as many clusters.
    width : None, float or array-like (n_inputs,), default=None
        Standard deviation of the bumps, in units of the input. None: the mean distance of neighbouring centres.
    interaction : bool or {"additive", "tensor", "radial"}, default=False
        With several inputs: bumps of each input side by side (False, "additive"); all their products (True, "tensor"),
        which are bumps on a grid; or one bump around each row of ``centers``, by the distance over all inputs
        ("radial": scale the inputs first, one width serves all).
    random_state : int, RandomState or None, default=None
        Seed of the clustering.

    Attributes
    ----------
    bases_ : list of Bumps
        Centres and width of each input ("radial": column j of the centres and the common width).
    n_features_out_ : int
    n_features_in_ : int
    feature_names_in_ : ndarray of str
        Where X is a frame.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.5.

    Examples
    --------
    >>> from sksurrogate.features import GaussianFeatures
    >>> bumps = GaussianFeatures(centers=[0.0, 1.0], width=0.5).fit([[0.0], [1.0]])
    >>> bumps.transform([[0.0]]).round(3)
    array([[1.   , 0.135]])
    """

    _parameter_constraints: dict = {
        "centers": [Interval(Integral, 1, None, closed="left"), "array-like"],
        "width": [None, Interval(Real, 0, None, closed="neither"), "array-like"],
        "interaction": ["boolean", StrOptions({"additive", "tensor", "radial"})],
        "random_state": ["random_state"],
    }

    def __init__(
        self, centers: Any = 10, width: Any = None, *, interaction: bool | str = False, random_state: Any = None
    ):
        self.centers = centers
        self.width = width
        self.interaction = interaction
        self.random_state = random_state

    def _learn_all(self, X: np.ndarray) -> None:
        if self.interaction != "radial":
            super()._learn_all(X)
            return
        centers = self._radial_centers(X)
        width = self._width_of(0)
        if width is None:
            squares = ((centers[:, None, :] - centers) ** 2).sum(axis=2)
            np.fill_diagonal(squares, np.inf)
            nearest = np.sqrt(squares.min(axis=1))
            width = float(nearest.mean()) if len(centers) > 1 and nearest.mean() > 0 else 1.0
        self.bases_ = [Bumps(column, width) for column in centers.T]
        self.n_features_out_ = len(centers)

    def _radial_centers(self, X: np.ndarray) -> np.ndarray:
        """Rows to put a bump around."""
        if isinstance(self.centers, Integral):
            return KMeans(int(self.centers), n_init=1, random_state=self.random_state).fit(X).cluster_centers_
        centers = np.asarray(self.centers, dtype=float)
        if centers.ndim != 2 or centers.shape[1] != X.shape[1] or not np.isfinite(centers).all():
            raise DataError(
                f'interaction="radial" needs centers as (n_centers, {X.shape[1]}), finite, or an int; got shape {centers.shape}.'
            )
        return centers

    def _learn(self, x: np.ndarray, j: int) -> Bumps:
        if isinstance(self.centers, Integral):
            n = int(self.centers)
            low, high = rising(np.array([x.min(), x.max()]))[[0, -1]]
            centers = np.linspace(low, high, n) if n > 1 else np.array([(low + high) / 2])
        else:
            low, high = x.min(), x.max()
            centers = column_of(self.centers, j, self.n_features_in_, "centers")
        width = self._width_of(j)
        if width is None:
            span = np.ptp(centers) / (len(centers) - 1) if len(centers) > 1 else (high - low) / 2
            width = float(span) or 1.0
        return Bumps(centers, width)

    def _width_of(self, j: int) -> float | None:
        """Width given for input j."""
        if self.width is None or isinstance(self.width, Real):
            return None if self.width is None else float(self.width)
        widths = np.asarray(self.width, dtype=float)
        wanted = () if self.interaction == "radial" else (self.n_features_in_,)
        if widths.shape != wanted or not (np.isfinite(widths) & (widths > 0)).all():
            many = "" if self.interaction == "radial" else f", or one for each of the {self.n_features_in_} inputs"
            raise DataError(f"width={self.width!r} must be a positive number{many}.")
        return float(widths[j])

    def _values(self, basis: Bumps, x: np.ndarray, derivative: int) -> np.ndarray:
        return gaussians(x, basis.centers, basis.width, derivative)

    def _labels(self, basis: Bumps, name: str) -> list[str]:
        return [f"gauss{i}({name})" for i in range(len(basis.centers))]

    def _evaluate(self, X: np.ndarray) -> np.ndarray:
        if self.interaction != "radial":
            return super()._evaluate(X)
        centers = np.stack([basis.centers for basis in self.bases_], axis=1)
        width = self.bases_[0].width
        return np.vstack([radial(X[a : a + TRANSFORM_ROWS], centers, width) for a in range(0, len(X), TRANSFORM_ROWS)])

    def _slope(self, X: np.ndarray, j: int, out: np.ndarray) -> None:
        if self.interaction != "radial":
            super()._slope(X, j, out)
            return
        basis = self.bases_[j]
        out[:] = -(X[:, j, None] - basis.centers) / basis.width**2 * self._evaluate(X)

    def _names(self, inputs: Sequence[str]) -> list[str]:
        if self.interaction != "radial":
            return super()._names(inputs)
        return [f"gauss{i}({','.join(map(str, inputs))})" for i in range(self.n_features_out_)]
