"""Least squares with linear parameters among the others: variable projection."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from scipy.linalg.lapack import dgeqrf, dorgqr, dtrtrs

from sksurrogate.kernels.least_squares import Slopes
from sksurrogate.kernels.linear_fit import linear_least_squares

#: Largest ratio of the diagonal of R at which a basis still counts as of full rank.
RANK_RATIO = 1e14


class Separable:
    """Variable projection: ``y ~ Phi(omega) @ theta`` with theta eliminated by linear least squares.

    The residual is ``(I - Q Q') y`` with ``Phi = Q R``; its Jacobian is taken as Kaufman does, ``-(I - Q Q') (dPhi theta)``,
    which leaves out a term of the size of the residual. An instance is the ``evaluate`` of a search over omega.

    ``basis``: omega -> (Phi transposed (n_basis, n_rows), anything that ``tangent`` needs).
    ``tangent``: (what basis returned, theta (n_basis, n_outputs)) -> one array (n_omega, n_rows) for each output: the
        slopes of ``Phi @ theta`` with respect to omega. The arrays are overwritten.
    ``y`` (n_rows, n_outputs).
    ``root_weights`` (n_rows,): square roots of the weights of the rows.
    ``ridge`` (n_basis,): weights of the squares of theta in the cost.
    ``ridge_omega`` (n_omega,): weights of the squares of omega in the cost.

    See G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973); L. Kaufman, BIT 15 (1975).
    """

    def __init__(
        self,
        basis: Callable,
        tangent: Callable,
        y: np.ndarray,
        *,
        root_weights: np.ndarray | None = None,
        ridge: np.ndarray | None = None,
        ridge_omega: np.ndarray | None = None,
    ):
        self.basis, self.tangent = basis, tangent
        self.root_weights = root_weights
        self.ridge, self.ridge_omega = ridge, ridge_omega
        self.n_rows = len(y)
        self.targets = np.asarray(y, dtype=float).T  # (n_outputs, n_rows)
        if root_weights is not None:
            self.targets = self.targets * root_weights
        if ridge is not None:
            self.targets = np.hstack([self.targets, np.zeros((len(self.targets), len(ridge)))])
        self.targets = np.ascontiguousarray(self.targets)

    def factor(self, phi: np.ndarray) -> tuple | None:
        """Orthogonal basis Q (n_rows, n_basis), residuals (n_outputs, n_rows), theta; None without full rank.

        ``phi`` (n_basis, n_rows) is multiplied by the root weights already.
        """
        if self.ridge is not None:
            phi = np.hstack([phi, np.diag(np.sqrt(self.ridge))])
        n_basis = len(phi)
        if phi.shape[1] < n_basis:
            return None
        factors, tau, _, _ = dgeqrf(phi.T)
        upper = factors[:n_basis]
        size = np.abs(upper.diagonal()).tolist()  # a list: quicker than an array for few numbers
        if not (min(size) * RANK_RATIO > max(size) and sum(size) < np.inf):  # also nan
            return None
        q = dorgqr(factors, tau)[0]
        c = self.targets @ q
        residual = self.targets - c @ q.T
        residual -= (residual @ q) @ q.T
        return q, residual, dtrtrs(upper, c.T)[0]

    def solve(self, omega: np.ndarray) -> np.ndarray:
        """The best theta (n_basis, n_outputs) for this omega (minimum norm without full rank)."""
        phi = self._weighted(self.basis(omega)[0])
        factor = self.factor(phi)
        if factor is not None:
            return factor[2]
        return linear_least_squares(phi.T, self.targets[:, : self.n_rows].T)

    def __call__(self, omega: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Sum of squares, J'r and J'J of the projected residual."""
        cost, slopes = self.probe(omega)
        return (cost, *slopes())

    def probe(self, omega: np.ndarray) -> tuple[float, Slopes]:
        """Sum of squares, and a function that gives J'r and J'J when they are wanted."""
        phi, kept = self.basis(omega)
        return self.projected(
            omega, self._weighted(phi), lambda theta: [self._weighted(t) for t in self.tangent(kept, theta)]
        )

    def _weighted(self, rows: np.ndarray) -> np.ndarray:
        return rows if self.root_weights is None else rows * self.root_weights

    def projected(
        self, omega: np.ndarray, phi: np.ndarray, tangent: Callable[[np.ndarray], Iterable[np.ndarray]]
    ) -> tuple[float, Slopes]:
        """As ``probe``, from a basis and slopes that carry the root weights already."""
        factor = self.factor(phi)
        if factor is None:
            return np.inf, lambda: (np.zeros(len(omega)), np.eye(len(omega)))
        cost = float(np.vdot(factor[1], factor[1]))
        if self.ridge_omega is not None:
            cost += float(self.ridge_omega @ omega**2)
        return cost, lambda: self._slopes(omega, tangent(factor[2]), factor)

    def _slopes(
        self, omega: np.ndarray, tangents: Iterable[np.ndarray], factor: tuple
    ) -> tuple[np.ndarray, np.ndarray]:
        """J'r and J'J."""
        q, residual, _ = factor
        n_omega = len(omega)
        gradient, gram = np.zeros(n_omega), np.zeros((n_omega, n_omega))
        top = q[: self.n_rows]
        for r, slopes in zip(residual, tangents):
            inside = slopes @ top
            slopes -= inside @ top.T
            gradient -= slopes @ r[: self.n_rows]
            gram += slopes @ slopes.T
            if self.ridge is not None:
                below = inside @ q[self.n_rows :].T
                gradient += below @ r[self.n_rows :]
                gram += below @ below.T
        if self.ridge_omega is not None:
            gradient += self.ridge_omega * omega
            gram.flat[:: n_omega + 1] += self.ridge_omega
        return gradient, gram
