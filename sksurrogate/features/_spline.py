"""Splines as features."""

from __future__ import annotations

from numbers import Integral
from typing import Any

import numpy as np
from sklearn.utils._param_validation import Interval, StrOptions

from sksurrogate.exceptions import DataError
from sksurrogate.features._base import INTERACTION, TRANSFORM_ROWS, BaseFeatures, column_of, rising
from sksurrogate.kernels.bases import Spline, spline_at_data, spline_csr, spline_on
from sksurrogate.kernels.gram import Moments
from sksurrogate.kernels.spline_moments import add_spline_moments


class SplineFeatures(BaseFeatures):
    """Splines of any order as features: pulses (0), saw teeth (1), smooth ones (3).

    On the range of the knots the splines of an input are positive and sum to one; at any x only ``degree + 1`` of them
    differ from zero. Orders above 0 follow by recursion from the order below.

    Parameters
    ----------
    n_knots : int, default=5
        Knots of each input, ends included, where ``knots`` is "uniform" or "quantile".
    degree : int, default=3
        Order of the splines.
    knots : {"uniform", "quantile", "data"} or array-like (n_knots,) or (n_knots, n_inputs), default="uniform"
        "uniform": equidistant between the least and the largest value (the fast form). "quantile": equally many rows
        between two knots; knots that coincide count once. "data": one spline centred at each distinct value, as in
        Figure 1 of the paper: least squares on these features (without an intercept) passes through the data.
    extrapolation : {"constant", "linear", "continue", "periodic", "zero", "error"}, default="constant"
        Outside the knots: the value at the end, the tangent there, the last polynomial, the range repeated, nothing, or an error.
    interaction : bool or {"additive", "tensor"}, default=False
        With several inputs: the splines of each input side by side (False, "additive"), or all products of one spline of
        each input (True, "tensor").
    sparse_output : bool, default=False
        Whether ``transform`` gives compressed rows (``scipy.sparse.csr_array``).

    Attributes
    ----------
    bases_ : list of Spline
        Knots of each input.
    n_features_out_ : int
    n_features_in_ : int
    feature_names_in_ : ndarray of str
        Where X is a frame.

    See Also
    --------
    HeavisideFeatures : Unit steps; splines of order 0 are their differences.
    sklearn.preprocessing.PolynomialFeatures : Polynomials.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), sections 2.1 and 2.2.
    de Boor, *A Practical Guide to Splines*, Springer (1978).

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.features import SplineFeatures
    >>> saw = SplineFeatures(n_knots=3, degree=1).fit([[0.0], [2.0]])
    >>> saw.transform([[0.5], [2.0]])
    array([[0.5, 0.5, 0. ],
           [0. , 0. , 1. ]])
    >>> saw.get_feature_names_out(["u"])
    array(['spline0(u)', 'spline1(u)', 'spline2(u)'], dtype=object)

    As many splines as data interpolate:

    >>> from sklearn.linear_model import LinearRegression
    >>> from sklearn.pipeline import make_pipeline
    >>> x, y = np.array([[0.0], [1.0], [3.0]]), np.array([1.0, -1.0, 2.0])
    >>> model = make_pipeline(SplineFeatures(degree=1, knots="data"), LinearRegression(fit_intercept=False)).fit(x, y)
    >>> model.predict([[0.0], [1.0], [2.0]])
    array([ 1. , -1. ,  0.5])
    """

    _parameter_constraints: dict = {
        "n_knots": [Interval(Integral, 2, None, closed="left")],
        "degree": [Interval(Integral, 0, None, closed="left")],
        "knots": [StrOptions({"uniform", "quantile", "data"}), "array-like"],
        "extrapolation": [StrOptions({"constant", "linear", "continue", "periodic", "zero", "error"})],
        "interaction": INTERACTION,
        "sparse_output": ["boolean"],
    }

    def __init__(
        self,
        n_knots: int = 5,
        degree: int = 3,
        *,
        knots: Any = "uniform",
        extrapolation: str = "constant",
        interaction: bool | str = False,
        sparse_output: bool = False,
    ):
        self.n_knots = n_knots
        self.degree = degree
        self.knots = knots
        self.extrapolation = extrapolation
        self.interaction = interaction
        self.sparse_output = sparse_output

    def _learn(self, x: np.ndarray, j: int) -> Spline:
        if not isinstance(self.knots, str):
            breaks = column_of(self.knots, j, self.n_features_in_, "knots")
            if len(breaks) < 2 or not np.all(np.diff(breaks) > 0):
                raise DataError(
                    f"knots of input {j} must be at least two numbers in rising order, got {breaks.tolist()}."
                )
            return spline_on(breaks, self.degree, self.extrapolation)
        if self.knots == "data":
            if self.extrapolation == "periodic":
                raise DataError(
                    'knots="data" has no period: give the knots over one period, or use another extrapolation.'
                )
            return spline_at_data(x, self.degree, self.extrapolation)
        if self.knots == "uniform":
            breaks = np.linspace(x.min(), x.max(), self.n_knots)
            if not np.all(np.diff(breaks) > 0):
                low, high = rising(x[:1])  # a column that does not move
                breaks = np.linspace(low, high, self.n_knots)
        else:
            breaks = rising(np.quantile(x, np.linspace(0.0, 1.0, self.n_knots)))
        return spline_on(breaks, self.degree, self.extrapolation)

    def add_moments(
        self, moments: Moments, X: np.ndarray, targets: np.ndarray, weights: np.ndarray | None = None
    ) -> bool:
        """Take the second moments of features and targets without making the features.

        Parameters
        ----------
        moments : Moments
            Of features and targets so far.
        X : ndarray (n_samples, n_inputs)
        targets : ndarray (n_samples, n_outputs)
        weights : ndarray (n_samples,), optional

        Returns
        -------
        bool
            False where nothing was taken in, and the features must be made.
        """
        if self._multiplied:
            return False
        return add_spline_moments(moments, self._checked(X), self.bases_, targets, weights)

    def _values(self, basis: Spline, x: np.ndarray, derivative: int) -> np.ndarray:
        return spline_csr(x[:, None], [basis], derivatives=[derivative]).toarray()

    def _labels(self, basis: Spline, name: str) -> list[str]:
        return [f"spline{i}({name})" for i in range(basis.n_splines)]

    def _checked(self, X: Any) -> np.ndarray:
        X = super()._checked(X)
        if self.extrapolation == "error":
            for j, basis in enumerate(self.bases_):
                outside = (X[:, j] < basis.low) | (X[:, j] > basis.high)
                if outside.any():
                    row = int(np.flatnonzero(outside)[0])
                    raise DataError(
                        f'extrapolation="error": row {row} has {X[row, j]:g} in input {j}, outside the knots '
                        f"{basis.low:g}..{basis.high:g} ({int(outside.sum())} rows in all); "
                        'fit on a wider range or choose extrapolation="constant" or "linear".'
                    )
        return X

    def _evaluate(self, X: np.ndarray) -> Any:
        if self.sparse_output:
            return spline_csr(X, self.bases_, self._multiplied)
        out = np.empty((len(X), self.n_features_out_))
        for a in range(0, len(X), TRANSFORM_ROWS):
            spline_csr(X[a : a + TRANSFORM_ROWS], self.bases_, self._multiplied).toarray(
                out=out[a : a + TRANSFORM_ROWS]
            )
        return out
