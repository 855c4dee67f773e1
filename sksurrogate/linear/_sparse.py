"""Sparse regression by thresholds or evidence, with refit: few terms of many, as an equation."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import _check_feature_names_in, check_is_fitted

from sksurrogate.exceptions import DataError
from sksurrogate.kernels.gram import factor_normal, triangle
from sksurrogate.kernels.subsets import eliminate, log_evidence, threshold_refit
from sksurrogate.linear._base import BaseBlockedRegressor, Blocks
from sksurrogate.linear._equation import equation, named_terms


class SparseRegressor(BaseBlockedRegressor):
    """Least squares with few of many terms; the terms that stay are refitted without any penalty.

    Penalties (``Lasso``, ``ElasticNet``) shrink the terms that they keep; here a term is in or out. Every output has terms of
    its own.

    Parameters
    ----------
    threshold : float, default=1e-3
        Sequentially thresholded least squares (STLSQ): terms whose contribution, ``|coef_j| * std(phi_j) / std(y)``, is
        below it are left out and the others fitted again, until none goes.
    select : {"evidence"} or None, default="evidence"
        "evidence": before the threshold, terms are removed one by one, the least important first. The number of terms is that
        of the largest evidence. The threshold then removes terms that are certain but too small to matter (the error of an
        integration rule, for example). None: the threshold alone.
    max_terms : int, optional
        With "evidence": terms of an output at most.
    fit_intercept : bool, default=True
        The intercept is not a term: it always stays.
    features : transformer, optional
        Makes the features from X, block by block as they are needed.
    block_size : int, optional
        Rows per block; the default makes blocks of 8 MiB.

    Attributes
    ----------
    coef_ : ndarray (n_features,) or (n_outputs, n_features)
        Zero where a term is out.
    intercept_ : float or ndarray (n_outputs,)
    support_ : ndarray of bool, shape of ``coef_``
    log_evidence_ : ndarray (n_outputs, n_features + 1)
        With ``select="evidence"``: of the best model found with 0, 1, ... terms, up to a constant.
    features_ : transformer or None
    moments_ : Moments
    n_features_in_ : int

    See Also
    --------
    sksurrogate.compose.DerivativeRegressor : Differential equations, in weak form where derivatives are not measured.

    Notes
    -----
    The evidence of k of p terms is ``-n/2 log(squares / n) - k/2 log n - log binom(p, k)`` (the extended BIC); n is the
    sum of the weights of rows, so two rows of weight 1/2 count as one. Validation instead of evidence:
    ``GridSearchCV`` over ``threshold`` with ``select=None``.

    References
    ----------
    Brunton, Proctor, Kutz, PNAS 113 (2016) (STLSQ). Boninsegna, Nueske, Clementi, J. Chem. Phys. 148 (2018)
    (elimination). Chen, Chen, Biometrika 95 (2008) (evidence).

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.preprocessing import PolynomialFeatures
    >>> from sksurrogate.linear import SparseRegressor
    >>> rng = np.random.default_rng(0)
    >>> X = rng.normal(size=(200, 2))
    >>> y = 1 + 2 * X[:, 0] - 0.5 * X[:, 0] * X[:, 1] + 0.01 * rng.normal(size=200)
    >>> model = SparseRegressor(features=PolynomialFeatures(3, include_bias=False)).fit(X, y)
    >>> print(model.equations(["q", "v"], digits=2)[0])
    y = 1 + 2 q - 0.5 q v
    """

    _parameter_constraints: dict = {
        **{k: v for k, v in BaseBlockedRegressor._parameter_constraints.items() if k != "solver"},
        "threshold": [Interval(Real, 0, None, closed="left")],
        "select": [StrOptions({"evidence"}), None],
        "max_terms": [Interval(Integral, 0, None, closed="left"), None],
        "fit_intercept": ["boolean"],
    }
    solver = "qr"

    def __init__(
        self,
        threshold: float = 1e-3,
        *,
        select: str | None = "evidence",
        max_terms: int | None = None,
        fit_intercept: bool = True,
        features: Any = None,
        block_size: int | None = None,
    ):
        self.threshold = threshold
        self.select = select
        self.max_terms = max_terms
        self.fit_intercept = fit_intercept
        self.features = features
        self.block_size = block_size

    def equations(
        self, input_names: Sequence[str] | None = None, output_names: Sequence[str] | None = None, digits: int = 4
    ) -> list[str]:
        """The fit as text, one equation per output.

        Parameters
        ----------
        input_names : sequence of str, optional
            Default: the columns of the frame that was fitted, else "x0", "x1", ...
        output_names : sequence of str, optional
            Left-hand sides; default "y", or "y0", "y1", ...
        digits : int, default=4
            Significant digits.

        Returns
        -------
        list of str

        Raises
        ------
        DataError
            A scaler comes before features that are not linear: their coefficients would not be those of the inputs. Behind the
            features it is folded into the coefficients.
        """
        check_is_fitted(self, "coef_")
        coef, constant, names = named_terms(self, [], _check_feature_names_in(self, input_names))
        left = output_names or (["y"] if len(coef) == 1 else [f"y{k}" for k in range(len(coef))])
        if len(left) != len(coef):
            raise DataError(f"output_names={list(left)!r} has {len(left)} entries; the model has {len(coef)} outputs.")
        return [equation(name, c, names, b, digits) for name, c, b in zip(left, coef, constant)]

    def _solve(self, blocks: Blocks | None) -> tuple[np.ndarray, np.ndarray]:
        A, B = self._rows(blocks)
        m, p = self.moments_, self._n_features
        size = np.sqrt(np.einsum("ij,ij->j", A, A) / m.weight)
        coef = np.zeros((p, self._n_outputs))
        evidence = np.full((self._n_outputs, p + 1), -np.inf)
        for k, b in enumerate(B.T):
            kept = size
            if self.select is not None:
                found, evidence[k] = self._most_evident(A, b)
                kept = np.where(found, size, 0.0)
            spread = max(float(np.sqrt(b @ b / m.weight)), np.finfo(float).tiny)
            coef[:, k] = threshold_refit(A, b, kept / spread, float(self.threshold))
        self.support_ = (coef != 0)[:, 0] if self._flat else (coef != 0).T
        if self.select is not None:
            self.log_evidence_ = evidence
        if not self.fit_intercept:
            return coef, np.zeros(self._n_outputs)
        return coef, m.mean[p:] - m.mean[:p] @ coef

    def _most_evident(self, A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which terms of one output are in, (n_features,) of bool, and the evidence of every number of terms."""
        path = eliminate(A, b)
        evidence = log_evidence(path.squares, self.moments_.weight, int(self.fit_intercept))
        if self.max_terms is not None:
            evidence[self.max_terms + 1 :] = -np.inf
        found = np.zeros(A.shape[1], bool)
        found[path.columns(int(np.argmax(evidence)))] = True
        return found, evidence

    def _rows(self, blocks: Blocks | None) -> tuple[np.ndarray, np.ndarray]:
        """Rows with the Gram matrix of the features and outputs (centred beside an intercept); constant ones are 0."""
        m, p = self.moments_, self._n_features
        if blocks is not None:
            R = triangle(blocks(), m.mean if self.fit_intercept else None)
            A, B = R[:, 1 : 1 + p].copy(), R[:, 1 + p :].copy()
            if self.fit_intercept:
                A, B = A[1:], B[1:]  # the first row is the constant's
        else:
            S = m.scatter if self.fit_intercept else m.scatter + m.weight * np.outer(m.mean, m.mean)
            A, _ = factor_normal(S, np.zeros((len(S), 1)))
            A, B = A[:, :p], A[:, p:]
        if self.fit_intercept:
            A[:, self._constant()] = 0.0
        return A, B
