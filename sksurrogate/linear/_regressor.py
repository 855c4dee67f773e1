"""Least squares with secondary losses and constraints."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from sklearn.utils._param_validation import Interval, StrOptions

from sksurrogate.exceptions import DataError
from sksurrogate.kernels.constrained import Infeasible, constrained_least_squares
from sksurrogate.kernels.gram import (
    CONDITION_LIMIT,
    Quadratic,
    factor_normal,
    gcv_path,
    solve_normal,
    solve_rows,
    triangle,
)
from sksurrogate.linear._base import BaseBlockedRegressor, Blocks, warn_ill_conditioned
from sksurrogate.linear._constraints import BaseConstraint
from sksurrogate.linear._penalties import BasePenalty, Situation


class PenalizedRegressor(BaseBlockedRegressor):
    """Least squares with any weighted sum of secondary losses, under any linear constraints.

    Minimises ``sum_i w_i |y_i - y_hat_i|^2 + alpha * sum_j weight_j L2_j`` (paper, Eqs. 3, 4 and 6) over
    ``y_hat = theta phi(x) + intercept``. Without penalties, or with ``alpha=0``, this is the slash operator of section
    2.1: the residual is orthogonal to the features (Eq. 5), and of several solutions the shortest is taken.

    Parameters
    ----------
    penalties : sequence of penalties, optional
        :class:`Ridge`, :class:`RidgeTo`, :class:`CloseTo`, :class:`Slope`, :class:`Curvature`, :class:`Rows`, each with
        its weight.
    constraints : sequence of constraints, optional
        :class:`Bounds`, :class:`LinearEquality`, :class:`LinearInequality`, :class:`OutputBounds`, :class:`Monotone`.
    alpha : float or "gcv", default=1.0
        The weight of all penalties together (lambda of Eq. 6). "gcv": the one of least generalised cross-validation
        error over ``alphas``, from one factorisation and without a look at the constraints.
    alphas : array-like, optional
        Candidates for "gcv"; the default spans 16 decades about the ratio of data to penalty, 10 per decade.
    fit_intercept : bool, default=True
    features : transformer, optional
        Makes the features from X, block by block as they are needed; never all in memory. Points of penalties and
        constraints are rows of X, so that slopes and bounds are those by the inputs.
    block_size : int, optional
        Rows per block; the default makes blocks of 8 MiB.
    solver : {"auto", "gram", "qr"}, default="auto"
        "gram" goes over the data once; "qr" does not square the condition number; "auto" changes from "gram" to "qr"
        where the normal equations are near-singular.

    Attributes
    ----------
    coef_ : ndarray (n_features,) or (n_outputs, n_features)
    intercept_ : float or ndarray (n_outputs,)
    alpha_ : float
        The weight used.
    gcv_alphas_, gcv_scores_, dof_ : ndarray (n_alphas,)
        With ``alpha="gcv"``: candidates, their errors and degrees of freedom.
    active_ : list of ndarray of int (n_constraints,)
        With constraints, for each output: which rows hold the solution; -1 at the lower bound, 1 at the upper, 2
        equality, 0 free.
    condition_ : float
        Condition number of the column-scaled features together with the penalties; infinite with a null space.
    solver_ : {"gram", "qr"}
    features_ : transformer or None
    moments_ : Moments
        Mean and scatter of features and outputs.
    n_features_in_ : int

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), sections 2.1 and 2.3.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import Bounds, PenalizedRegressor, Ridge
    >>> X, y = np.array([[0.0], [1.0], [2.0]]), np.array([1.0, 3.0, 5.0])
    >>> PenalizedRegressor().fit(X, y).coef_
    array([2.])
    >>> PenalizedRegressor([Ridge(weight=2.0)]).fit(X, y).coef_
    array([1.])
    >>> PenalizedRegressor(constraints=[Bounds(upper=1.5)]).fit(X, y).coef_
    array([1.5])
    """

    _parameter_constraints: dict = {
        **BaseBlockedRegressor._parameter_constraints,
        "penalties": ["array-like", None],
        "constraints": ["array-like", None],
        "alpha": [Interval(Real, 0, None, closed="left"), StrOptions({"gcv"})],
        "alphas": ["array-like", None],
        "fit_intercept": ["boolean"],
    }

    def __init__(
        self,
        penalties: Any = None,
        constraints: Any = None,
        alpha: float | str = 1.0,
        *,
        alphas: Any = None,
        fit_intercept: bool = True,
        features: Any = None,
        block_size: int | None = None,
        solver: str = "auto",
    ):
        self.penalties = penalties
        self.constraints = constraints
        self.alpha = alpha
        self.alphas = alphas
        self.fit_intercept = fit_intercept
        self.features = features
        self.block_size = block_size
        self.solver = solver

    def _solve(self, blocks: Blocks | None) -> tuple[np.ndarray, np.ndarray]:
        data = self._data_loss()
        rows, targets = self._penalty_rows()
        if self.alpha == "gcv":
            self._choose_alpha(data, rows, targets)
        else:
            self.alpha_ = float(self.alpha)
        root = np.sqrt(self.alpha_)
        total = data.plus(root * rows, root * targets)
        self.solver_ = self._route(blocks, regular=bool(np.any(root * rows)))
        if self.solver_ == "gram":
            theta, self.condition_, doubtful = solve_normal(total.H, total.g)
            if self.solver == "auto" and blocks is not None and self.condition_ > CONDITION_LIMIT:
                self.solver_ = "qr"
            elif doubtful:
                warn_ill_conditioned(blocks is not None)
        if self.solver_ == "qr":
            assert blocks is not None
            A, B = self._data_rows(triangle(blocks(), self.moments_.mean if self.fit_intercept else None))
            A, B = np.vstack([A, root * rows]), np.vstack([B, root * targets])
            rounding = np.append(self._rounding(), 0.0) if self.fit_intercept else None
            theta, self.condition_ = solve_rows(A, B, self.moments_.n_rows, rounding)
        if self.constraints is not None and len(self.constraints):
            A, B = (A, B) if self.solver_ == "qr" else factor_normal(total.H, total.g)
            theta = self._constrained(A, B)
        coef = theta[: self._n_features]
        if not self.fit_intercept:
            return coef, np.zeros(self._n_outputs)
        means = self.moments_.mean
        return coef, theta[-1] + means[self._n_features :] - means[: self._n_features] @ coef

    # The last parameter inside is the prediction at the mean of the features, less the mean of y, instead of the
    # intercept: features and constant are then orthogonal, and large offsets cost no digits.

    def _data_loss(self) -> Quadratic:
        """Squared errors as a quadratic form."""
        p, m = self._n_features, self.moments_
        if not self.fit_intercept:
            S = m.scatter + m.weight * np.outer(m.mean, m.mean)
            return Quadratic(S[:p, :p], S[:p, p:], np.diag(S)[p:].copy())
        H, g = np.zeros((p + 1, p + 1)), np.empty((p + 1, self._n_outputs))
        H[:p, :p], H[p, p] = m.scatter[:p, :p], m.weight
        g[:p], g[p] = m.scatter[:p, p:], 0.0
        constant = self._constant()
        H[:p][constant], H[:, :p][:, constant], g[:p][constant] = 0.0, 0.0, 0.0
        return Quadratic(H, g, np.diag(m.scatter)[p:].copy())

    def _data_rows(self, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squared errors as rows, from the triangular factor of [1, features, outputs]."""
        p = self._n_features
        if not self.fit_intercept:
            return R[:, 1 : 1 + p], R[:, 1 + p :]
        A = np.hstack([R[:, 1 : 1 + p], R[:, :1]])
        A[:, :p][:, self._constant()] = 0.0
        return A, R[:, 1 + p :]

    def _inner(self, rows: np.ndarray, *targets: np.ndarray) -> list[np.ndarray]:
        """Rows on coefficients and intercept and what they aim at, rewritten for the parameters inside."""
        p, mean = self._n_features, self.moments_.mean
        if not self.fit_intercept:
            return [rows[:, :p], *targets]
        last = rows[:, p:]
        return [np.hstack([rows[:, :p] - last * mean[:p], last]), *(t - last * mean[p:] for t in targets)]

    def _asks_range(self) -> bool:
        return super()._asks_range() or any(
            getattr(part, "points", None) is not None for part in ([] if self.penalties is None else self.penalties)
        )

    def _situation(self) -> Situation:
        p, blocks = self._n_features, getattr(self.features_, "blocks_", None)
        sizes = (self.n_features_in_, p, self._n_outputs)
        return Situation(self._dense_phi, self._gradient, *sizes, self._low, self._high, blocks or (p,))

    def _penalty_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """All penalties as rows and targets, weights multiplied in."""
        n_params = self._n_features + bool(self.fit_intercept)
        rows, targets, at = [np.zeros((0, n_params))], [np.zeros((0, self._n_outputs))], self._situation()
        for penalty in [] if self.penalties is None else self.penalties:
            if not isinstance(penalty, BasePenalty):
                raise DataError(f"penalties holds {penalty!r}, expected penalties such as Ridge() or Curvature().")
            if not penalty.weight >= 0:
                raise DataError(
                    f"penalties: {type(penalty).__name__}(weight={penalty.weight!r}): expected a weight of at least 0."
                )
            L, t = self._inner(*penalty.rows(at))
            rows.append(np.sqrt(penalty.weight) * L)
            targets.append(np.sqrt(penalty.weight) * t)
        return np.concatenate(rows), np.concatenate(targets)

    def _choose_alpha(self, data: Quadratic, rows: np.ndarray, targets: np.ndarray) -> None:
        """The alpha of least generalised cross-validation error."""
        if not np.any(rows):
            raise DataError('alpha="gcv" weighs penalties, but there are none: give penalties=[Ridge()], for example.')
        n = len(data.H)
        penalty = Quadratic(np.zeros((n, n)), np.zeros_like(data.g), np.zeros_like(data.c)).plus(rows, targets)
        if self.alphas is None:
            p = self._n_features
            ratio = float(np.trace(data.H[:p, :p])) / float(np.trace(penalty.H))
            alphas = (ratio if ratio > 0 else 1.0) * np.logspace(-12, 4, 161)
        else:
            alphas = np.unique(np.asarray(self.alphas, dtype=float))
            if alphas.ndim != 1 or not len(alphas) or not np.all(alphas >= 0):
                raise DataError(
                    f"alphas={self.alphas!r}: expected numbers of at least 0, such as np.logspace(-6, 2, 30)."
                )
        self.gcv_alphas_ = alphas
        self.gcv_scores_, self.dof_ = gcv_path(data, penalty, alphas, self.moments_.weight)
        self.alpha_ = float(alphas[np.argmin(self.gcv_scores_)])

    def _constrained(self, A: np.ndarray, B: np.ndarray) -> np.ndarray:
        """The same losses under the constraints, one output after the other."""
        parts, at = [], self._situation()
        for constraint in self.constraints:
            if not isinstance(constraint, BaseConstraint):
                raise DataError(f"constraints holds {constraint!r}, expected constraints such as Bounds().")
            parts.append(self._inner(*constraint.rows(at)))
        C, lower, upper = (np.concatenate([part[i] for part in parts]) for i in range(3))
        theta = np.empty((A.shape[1], self._n_outputs))
        self.active_ = []
        for k in range(self._n_outputs):
            try:
                theta[:, k], active = constrained_least_squares(A, B[:, k], C, lower[:, k], upper[:, k])
            except Infeasible:
                names = [type(c).__name__ for c in self.constraints]
                raise DataError(
                    f"no coefficients fulfil all constraints {names} of output {k}: widen or leave out one of them."
                ) from None
            self.active_.append(active)
        return theta
