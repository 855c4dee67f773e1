"""One hidden layer under a linear output: variable projection from one matrix of inner products."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg.lapack import dposv, dpotrs

from sksurrogate.kernels.least_squares import Slopes
from sksurrogate.kernels.separable import Separable
from sksurrogate.neural._network import ACTIVATIONS, Layers

#: Least ratio of the pivots of the Cholesky factor (about 1 / condition of the basis) at which inner products will do.
PIVOTS = 1e-4
#: How many times the rounding of the residual must lie below the residual.
CLEAR = 1e9 * float(np.finfo(float).eps)


class Shallow:
    r"""Squares of :func:`~sksurrogate.neural._problems.projected` for one hidden layer, in a third of its time.

    With the basis :math:`\Phi` (values of the units and 1, units first), the slopes :math:`T` of the units by their own
    weights and :math:`A = \Phi \Phi^\top + R`, the projected residual has :math:`J^\top J = (t t^\top) \circ (T T^\top - T
    \Phi^\top A^{-1} \Phi T^\top)`, t the output weight of each row's unit: small matrices only, no orthogonal basis of
    the length of the data. Where the condition of the basis or a small residual would lose digits that way, the
    orthogonal route ``exact`` is taken.

    ``hidden``: the one hidden layer.
    ``x`` (n_inputs, n_rows).
    ``exact``: the same problem by orthogonal factors; it holds targets, root weights and ridge.
    """

    def __init__(self, hidden: Layers, x: np.ndarray, exact: Separable):
        self.exact = exact
        n_inputs, n_units = hidden.weights[0].shape
        n_rows = x.shape[1]
        self.shape = (n_inputs + 1, n_units)
        self.activation = ACTIVATIONS[hidden.activations[0]]
        self.inputs = np.vstack([x, np.ones(n_rows)])
        self.unit = np.arange((n_inputs + 1) * n_units) % n_units
        self.root = exact.root_weights
        self.y = np.ascontiguousarray(exact.targets[:, :n_rows])
        # slopes, values of the units, 1, residuals: one array, so that one product gives all inner products
        n_slopes, n_out = self.unit.size, len(self.y)
        self.rows = np.empty((n_slopes + n_units + 1 + n_out, n_rows))
        self.slopes, self.value = self.rows[:n_slopes], self.rows[n_slopes : n_slopes + n_units]
        self.phi, self.residual = self.rows[n_slopes:-n_out], self.rows[-n_out:]
        self.below, self.slopes_by_unit = self.inputs[:, None], self.slopes.reshape(*self.shape, n_rows)
        self.lower = self.rows[n_slopes:].T
        self.phi[-1] = 1.0 if self.root is None else self.root
        self.size = float(np.vdot(self.y, self.y))

    def solve(self, omega: np.ndarray) -> np.ndarray:
        """The best theta (n_basis, n_outputs) for this omega."""
        return self.exact.solve(omega)

    def __call__(self, omega: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Sum of squares, J'r and J'J of the projected residual."""
        cost, slopes = self.probe(omega)
        return (cost, *slopes())

    def probe(self, omega: np.ndarray) -> tuple[float, Slopes]:
        """Sum of squares, and a function that gives J'r and J'J when they are wanted (before the next probe)."""
        sums = np.dot(omega.reshape(self.shape).T, self.inputs)
        if self.root is None:
            value = self.value
            value[:] = self.activation.value(sums)
        else:
            value = self.activation.value(sums)
            np.multiply(value, self.root, out=self.value)
        np.copyto(self.residual, self.y)
        products = np.dot(self.phi, self.lower)
        gram, n_basis = products[:, : len(products)], len(products)
        ridge = self.exact.ridge
        if ridge is not None:
            gram.flat[:: n_basis + 1] += ridge
        factor, theta, info = dposv(gram, products[:, n_basis:], lower=1)
        pivots = factor.diagonal().tolist()
        worst = min(pivots) / max(pivots) if info == 0 else 0.0
        if not worst > PIVOTS:  # also nan
            return self._orthogonal(omega, sums, value)
        self.residual -= np.dot(theta.T, self.phi)
        cost = float(np.vdot(self.residual, self.residual))
        if cost * worst * worst < CLEAR * CLEAR * self.size:
            return self._orthogonal(omega, sums, value)
        if ridge is not None:
            cost += float(ridge @ np.sum(theta * theta, axis=1))
        ridge_omega = self.exact.ridge_omega
        if ridge_omega is not None:
            cost += float(ridge_omega @ (omega * omega))

        def slopes() -> tuple[np.ndarray, np.ndarray]:
            self._write_slopes(sums, value)
            products = np.dot(self.slopes, self.rows.T)
            n = len(products)
            cross = products[:, n : n + n_basis]
            inner = products[:, :n]
            inner -= np.dot(cross, dpotrs(factor, cross.T, lower=1)[0])
            top = theta.take(self.unit, axis=0)
            inner *= np.dot(top, top.T)
            top *= products[:, n + n_basis :]
            gradient = -np.add.reduce(top, axis=1)
            if ridge_omega is not None:
                gradient += ridge_omega * omega
                inner.flat[:: n + 1] += ridge_omega
            return gradient, inner

        return cost, slopes

    def _write_slopes(self, sums: np.ndarray, value: np.ndarray) -> None:
        """Slopes of every unit by its own weights."""
        slope = self.activation.slope(sums, value)
        if self.root is not None:
            slope *= self.root
        np.multiply(self.below, slope, out=self.slopes_by_unit)

    def _orthogonal(self, omega: np.ndarray, sums: np.ndarray, value: np.ndarray) -> tuple[float, Slopes]:
        """The same with an orthogonal basis."""

        def tangent(theta: np.ndarray) -> Iterator[np.ndarray]:
            self._write_slopes(sums, value)
            for column in theta.take(self.unit, axis=0).T:
                yield self.slopes * column[:, None]

        return self.exact.projected(omega, self.phi, tangent)
