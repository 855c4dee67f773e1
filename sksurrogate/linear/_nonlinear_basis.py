"""Basis functions whose places and widths are fitted together with their coefficients (paper, section 2.5)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import comb
from numbers import Integral, Real
from typing import Any, Self

import numpy as np
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin, _fit_context
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.parallel import _get_threadpool_controller
from sklearn.utils.validation import _check_sample_weight, check_is_fitted

from sksurrogate._checks import checked
from sksurrogate._tables import unmasked
from sksurrogate.kernels.least_squares import levenberg_marquardt, merge_rows, several_starts
from sksurrogate.kernels.separable import Separable

#: Rows up to which rows that repeat are merged.
BASIS_MERGE_ROWS = 5_000
#: Rows beyond which the starts are tried on a subsample, rows of that, and evaluations on all rows then.
BASIS_WHOLE_ROWS, BASIS_SUBSAMPLE, POLISH = 20_000, 5_000, 15
#: Shares of the variance at which a start counts as solved, and at which a search ends.
BASIS_SOLVED, BASIS_FLOOR = 1e-14, 1e-22
#: Largest log of a width, up or down, in standard deviations of the input.
WIDEST = 9.0


class BaseBasis(ABC):
    """Basis functions of standardised inputs, one column of parameters omega; arrays lie functions first."""

    def __init__(self, n_basis: int, n_inputs: int, degree: int):
        self.n_basis, self.n_inputs, self.degree = n_basis, n_inputs, degree

    @abstractmethod
    def start(self, X: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Random parameters (n_omega,) that suit the data."""

    @abstractmethod
    def values(self, omega: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(n_functions, n_rows); the last is the constant."""

    @abstractmethod
    def tangent(self, omega: np.ndarray, X: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Slopes (n_omega, n_rows) of ``theta @ values`` by omega, for one column theta (n_functions,)."""

    @abstractmethod
    def by_input(self, omega: np.ndarray, X: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Slopes (n_inputs, n_rows) of ``theta @ values`` by the inputs."""


class Bumps(BaseBasis):
    """``prod_i B((x_i - c_i) / w_i)``: Gaussians (degree < 0), or cardinal splines of height 1; omega is (c, log w)."""

    def bump(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """B(z) and its slope."""
        if self.degree < 0:
            value = np.exp(-0.5 * z * z)
            return value, -z * value
        p, half = self.degree, 0.5 * (self.degree + 1)
        height = sum((-1) ** k * comb(p + 1, k) * (half - k) ** p for k in range(p + 2) if k < half)  # 1 at its top
        value, slope = np.zeros_like(z), np.zeros_like(z)
        for k in range(p + 2):
            ramp = np.maximum(z + half - k, 0.0)
            sign = (-1) ** k * comb(p + 1, k)
            value += sign / height * ramp**p
            slope += sign * p / height * (ramp ** (p - 1) if p > 1 else (ramp > 0))
        inside = np.abs(z) < half
        return value * inside, slope * inside

    def parts(self, omega: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """z (n_basis, n_inputs, n_rows), widths (n_basis, n_inputs, 1), and products and slopes for each input."""
        centre, log_width = omega.reshape(2, self.n_basis, self.n_inputs, 1)
        width = np.exp(log_width)
        z = (X.T - centre) / width
        return z, width, np.stack(self.bump(z))

    def start(self, X: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        shares = (np.arange(self.n_basis) + rng.uniform(0, 1, self.n_basis)) / self.n_basis
        if self.n_inputs == 1:
            centre = np.quantile(X, shares, axis=0)
        else:
            centre = X[rng.choice(len(X), self.n_basis, replace=len(X) < self.n_basis)]
        width = (
            2.0 * np.sqrt(self.n_inputs) * self.n_basis ** (-1 / self.n_inputs) * rng.uniform(0.5, 1.5, centre.shape)
        )
        return np.concatenate([centre.ravel(), np.log(width).ravel()])

    def values(self, omega: np.ndarray, X: np.ndarray) -> np.ndarray:
        if np.abs(omega[len(omega) // 2 :]).max() > WIDEST:  # not admissible
            return np.full((self.n_basis + 1, len(X)), np.nan)
        value = self.parts(omega, X)[2][0].prod(axis=1)
        return np.vstack([value, np.ones(len(X))])

    def _one_sloped(self, omega: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Products in which one factor is its slope, (n_basis, n_inputs, n_rows), with z and widths."""
        z, width, (value, slope) = self.parts(omega, X)
        found = slope
        for i in range(self.n_inputs):
            found[:, i] *= np.delete(value, i, axis=1).prod(axis=1)
        return found, z, width

    def tangent(self, omega: np.ndarray, X: np.ndarray, theta: np.ndarray) -> np.ndarray:
        sloped, z, width = self._one_sloped(omega, X)
        sloped *= theta[:-1, None, None]
        return np.concatenate([-sloped / width, -sloped * z]).reshape(len(omega), len(X))

    def by_input(self, omega: np.ndarray, X: np.ndarray, theta: np.ndarray) -> np.ndarray:
        sloped, _, width = self._one_sloped(omega, X)
        return np.tensordot(theta[:-1], sloped / width, axes=1)


class Knots(BaseBasis):
    """Splines with free knots, a sum over inputs: ``x^1 .. x^p``, ``(x - t_j)_+^p``, 1; omega is t (n_inputs, n_basis)."""

    def start(self, X: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        shares = (np.arange(self.n_basis) + rng.uniform(0, 1, (self.n_inputs, self.n_basis))) / self.n_basis
        return np.concatenate([np.quantile(x, share) for x, share in zip(X.T, shares)])

    def ramps(self, omega: np.ndarray, X: np.ndarray) -> np.ndarray:
        """(x - t)_+ as (n_inputs * n_basis, n_rows)."""
        knots = omega.reshape(self.n_inputs, self.n_basis, 1)
        return np.maximum(X.T[:, None] - knots, 0.0).reshape(len(omega), len(X))

    def values(self, omega: np.ndarray, X: np.ndarray) -> np.ndarray:
        powers = [X.T**k for k in range(1, self.degree + 1)]
        return np.vstack([*powers, self.ramps(omega, X) ** self.degree, np.ones(len(X))])

    def _sloped(self, omega: np.ndarray, X: np.ndarray, theta: np.ndarray) -> np.ndarray:
        ramps, p = self.ramps(omega, X), self.degree
        slope = p * ramps ** (p - 1) if p > 1 else (ramps > 0).astype(float)
        return slope * theta[self.degree * self.n_inputs : -1, None]

    def tangent(self, omega: np.ndarray, X: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return -self._sloped(omega, X, theta)

    def by_input(self, omega: np.ndarray, X: np.ndarray, theta: np.ndarray) -> np.ndarray:
        slopes = self._sloped(omega, X, theta).reshape(self.n_inputs, self.n_basis, -1).sum(axis=1)
        for k in range(1, self.degree + 1):
            slopes += k * theta[(k - 1) * self.n_inputs : k * self.n_inputs, None] * X.T ** (k - 1)
        return slopes


class NonlinearBasisRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):
    r"""Basis functions with free places and widths, :math:`\hat y = \theta\,\Phi(x; \omega)`.

    The linear :math:`\theta` is eliminated (variable projection); :math:`\omega` is found by Levenberg-Marquardt from
    several starts, since there are local minima. Of more than 20000 rows the starts see 5000; from the best one all rows
    are used.

    Parameters
    ----------
    basis : {"gaussian", "spline", "knots"}, default="gaussian"
        "gaussian": Gaussians with free centres and widths. "spline": bell-shaped splines of ``degree`` with free places
        and widths. Both are products over the inputs. "knots": splines of ``degree`` with free knots; a sum over inputs.
    n_basis : int, default=5
        Functions, or knots for each input. Fewer are taken where there are too few rows.
    degree : int, default=3
        Of the splines, at least 1 (a step has no slope by its place).
    alpha : float, default=0.0
        Ridge: weight of the sum of squares of theta beside the mean squared error, in standardised units.
    n_starts : int, default=5
    max_iter : int, default=200
        Iterations from the best start.
    random_state : int, RandomState instance or None, default=None

    Attributes
    ----------
    coef_ : ndarray (n_functions,) or (n_outputs, n_functions)
        theta, in units of y.
    intercept_ : float or ndarray (n_outputs,)
    centers_, widths_ : ndarray (n_basis, n_features)
        In units of X ("gaussian": standard deviations; "spline": distance of knots). Not for "knots".
    knots_ : ndarray (n_features, n_basis)
        For "knots": rising, in units of X.
    loss_curve_ : list of float
        Mean squared error of standardised outputs after each step of the best start.
    start_losses_ : list of float
        The same after the first steps from every start tried: a wide spread says that there are local minima.
    n_iter_ : int
    converged_ : bool
        False where ``max_iter`` ended the search.
    n_features_in_ : int
    feature_names_in_ : ndarray of str

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.5.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import NonlinearBasisRegressor
    >>> X = np.linspace(0, 10, 80)[:, None]
    >>> y = 2 * np.exp(-0.5 * ((X[:, 0] - 3) / 0.5) ** 2) - np.exp(-0.5 * ((X[:, 0] - 7) / 1.5) ** 2)
    >>> model = NonlinearBasisRegressor(n_basis=2, random_state=0).fit(X, y)
    >>> np.sort(model.centers_, axis=0).round(3).ravel(), np.sort(model.widths_, axis=0).round(3).ravel()
    (array([3., 7.]), array([0.5, 1.5]))
    """

    _parameter_constraints: dict = {
        "basis": [StrOptions({"gaussian", "spline", "knots"})],
        "n_basis": [Interval(Integral, 1, None, closed="left")],
        "degree": [Interval(Integral, 1, None, closed="left")],
        "alpha": [Interval(Real, 0, None, closed="left")],
        "n_starts": [Interval(Integral, 1, None, closed="left")],
        "max_iter": [Interval(Integral, 1, None, closed="left")],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        basis: str = "gaussian",
        n_basis: int = 5,
        *,
        degree: int = 3,
        alpha: float = 0.0,
        n_starts: int = 5,
        max_iter: int = 200,
        random_state: Any = None,
    ):
        self.basis = basis
        self.n_basis = n_basis
        self.degree = degree
        self.alpha = alpha
        self.n_starts = n_starts
        self.max_iter = max_iter
        self.random_state = random_state

    @_fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> Self:
        """Fit coefficients, places and widths.

        Parameters
        ----------
        X : array-like (n_samples, n_features)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        sample_weight : array-like (n_samples,), optional
            A weight of 2 counts as the row twice.

        Returns
        -------
        self
        """
        X, y = checked(self, X, y, dtype=np.float64, multi_output=True, y_numeric=True)
        Y, weights = np.asarray(y, dtype=float).reshape(len(X), -1), None
        if sample_weight is not None:
            weights = _check_sample_weight(unmasked(sample_weight), X, dtype=np.float64, ensure_non_negative=True)
            X, Y, weights = X[weights > 0], Y[weights > 0], weights[weights > 0]
        if len(X) <= BASIS_MERGE_ROWS:
            X, Y, weights = merge_rows(X, Y, weights)
        self._mean, self._scale = _standard(X, weights)
        shift, gain = _standard(Y, weights)
        x = (X - self._mean) / self._scale
        self._one_column = y.ndim == 1
        self._basis = self._make(x)
        with _get_threadpool_controller().limit(limits=1, user_api="blas"):
            theta = self._search(x, (Y - shift) / gain, weights)
        self._theta = theta * gain
        self._theta[-1] += shift
        self._name_parts()
        return self

    def _make(self, x: np.ndarray) -> BaseBasis:
        """The basis, with no more functions than the rows can bear."""
        n_inputs = x.shape[1]
        if self.basis == "knots":
            most = (len(x) - 1 - self.degree * n_inputs) // n_inputs
            return Knots(max(1, min(self.n_basis, most)), n_inputs, self.degree)
        n_basis = max(1, min(self.n_basis, len(x) - 1))
        return Bumps(n_basis, n_inputs, -1 if self.basis == "gaussian" else self.degree)

    def _search(self, x: np.ndarray, y: np.ndarray, weights: np.ndarray | None) -> np.ndarray:
        """Find omega; returns theta (n_functions, n_outputs)."""
        basis = self._basis
        rng = np.random.default_rng(check_random_state(self.random_state).randint(2**31 - 1))
        starts = [basis.start(x, rng) for _ in range(self.n_starts)]
        whole = len(x) <= BASIS_WHOLE_ROWS
        rows = slice(None) if whole else np.sort(rng.choice(len(x), BASIS_SUBSAMPLE, replace=False))
        problem, total = self._problem(x[rows], y[rows], None if weights is None else weights[rows])
        unit = total * y.shape[1]
        fit, costs = several_starts(
            problem, starts, max_iter=self.max_iter, solved=BASIS_SOLVED * unit, floor=BASIS_FLOOR * unit
        )
        curve = [cost / total for cost in fit.history]
        self.start_losses_ = [cost / total for cost in costs]
        spent = 0
        if not whole:
            spent = fit.n_iter
            problem, total = self._problem(x, y, weights)
            floor = BASIS_FLOOR * total * y.shape[1]
            fit = levenberg_marquardt(problem, fit.theta, max_iter=POLISH, floor=floor, window=4, least_gain=0.01)
            curve += [cost / total for cost in fit.history]
        self._omega, self.loss_curve_ = fit.theta, curve
        self.n_iter_, self.converged_ = fit.n_iter + spent, fit.done
        return problem.solve(fit.theta)

    def _problem(self, x: np.ndarray, y: np.ndarray, weights: np.ndarray | None) -> tuple[Separable, float]:
        """Least squares over omega on these rows, and the sum of their weights."""
        basis = self._basis
        total = float(len(x)) if weights is None else float(weights.sum())
        ridge = None
        if self.alpha:
            ridge = np.full(len(basis.values(basis.start(x, np.random.default_rng(0)), x[:1])), self.alpha * total)
            ridge[-1] = 0.0
        problem = Separable(
            lambda omega: (basis.values(omega, x), omega),
            lambda omega, theta: [basis.tangent(omega, x, column) for column in theta.T],
            y,
            root_weights=None if weights is None else np.sqrt(weights),
            ridge=ridge,
        )
        return problem, total

    def _name_parts(self) -> None:
        """The parts of the model in units of X and y."""
        coef, self.intercept_ = self._theta[:-1].T.copy(), self._theta[-1].copy()
        if isinstance(self._basis, Knots):
            knots = self._omega.reshape(self._basis.n_inputs, -1)
            self.knots_ = np.sort(knots * self._scale[:, None] + self._mean[:, None], axis=1)
        else:
            centre, log_width = self._omega.reshape(2, self._basis.n_basis, self._basis.n_inputs)
            self.centers_ = centre * self._scale + self._mean
            self.widths_ = np.exp(log_width) * self._scale
        self.coef_ = coef[0] if self._one_column else coef
        if self._one_column:
            self.intercept_ = float(self.intercept_[0])

    def predict(self, X: Any) -> np.ndarray:
        """theta Phi(x; omega).

        Parameters
        ----------
        X : array-like (n_samples, n_features)

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)
        """
        check_is_fitted(self)
        x = (checked(self, X, reset=False, dtype=np.float64) - self._mean) / self._scale
        out = self._basis.values(self._omega, x).T @ self._theta
        return out[:, 0] if self._one_column else out

    def jacobian(self, X: Any) -> np.ndarray:
        """Exact slopes of the prediction by the inputs.

        Parameters
        ----------
        X : array-like (n_samples, n_features)

        Returns
        -------
        ndarray (n_samples, n_features) or (n_samples, n_outputs, n_features)
            The first for a y of one axis.
        """
        check_is_fitted(self)
        x = (checked(self, X, reset=False, dtype=np.float64) - self._mean) / self._scale
        slopes = [self._basis.by_input(self._omega, x, column).T / self._scale for column in self._theta.T]
        return slopes[0] if self._one_column else np.stack(slopes, axis=1)


def _standard(values: np.ndarray, weights: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Weighted means and standard deviations (1 for constant columns)."""
    mean = np.average(values, axis=0, weights=weights)
    scale = np.sqrt(np.average((values - mean) ** 2, axis=0, weights=weights))
    scale[~(scale > 1e-13 * np.abs(mean))] = 1.0
    return mean, scale
