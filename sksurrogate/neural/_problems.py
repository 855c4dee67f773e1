"""Networks as least-squares problems: standardised rows in blocks, smoothness, projected and full normal equations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.kernels.least_squares import Evaluate
from sksurrogate.kernels.rows import RowSource
from sksurrogate.kernels.separable import Separable
from sksurrogate.neural._network import ACTIVATIONS, Layers
from sksurrogate.neural._shallow import Shallow

#: Rows that are worked on at once, so that a block of the Jacobian stays in cache.
JACOBIAN_ROWS = 2048
#: Distance over which slopes and curvatures are taken, in standard deviations of the input.
CURVATURE_STEP = 1e-2


@dataclass(frozen=True)
class Smoothness:
    """Mean squared slopes and curvatures of the prediction at the rows, as further residuals (paper, section 2.3).

    They are taken by central differences over 0.01 standard deviations, so that they need values of the network only.
    """

    #: slope, curvature: weights beside the mean squared error, in standardised units
    slope: float
    curvature: float

    def inputs(self, x: np.ndarray) -> np.ndarray:
        """Inputs (n_inputs, n_rows), then moved up and down along each axis: (n_inputs, n_rows * (1 + 2 n_inputs))."""
        moves = CURVATURE_STEP * np.eye(len(x))
        return np.hstack([x, *(x + sign * move[:, None] for move in moves for sign in (1.0, -1.0))])

    def mix(self, values: np.ndarray, n_rows: int) -> np.ndarray:
        """Values at those inputs -> values, weighted slopes, weighted curvatures, side by side."""
        here, *moved = np.split(values, values.shape[1] // n_rows, axis=1)
        out = [here]
        for up, down in zip(moved[::2], moved[1::2]):
            if self.slope:
                out.append((up - down) * (np.sqrt(self.slope) / (2 * CURVATURE_STEP)))
            if self.curvature:
                out.append((up - 2 * here + down) * (np.sqrt(self.curvature) / CURVATURE_STEP**2))
        return np.hstack(out)

    def unmix(self, delta: np.ndarray, n_rows: int) -> np.ndarray:
        """The transpose of ``mix``: slopes by the mixed values -> slopes by the values."""
        here, *rest = np.split(delta, delta.shape[1] // n_rows, axis=1)
        here, parts, per_input = here.copy(), [], bool(self.slope) + bool(self.curvature)
        for k in range(0, len(rest), per_input):
            up, down = np.zeros_like(here), np.zeros_like(here)
            if self.slope:
                push = rest[k] * (np.sqrt(self.slope) / (2 * CURVATURE_STEP))
                up, down = up + push, down - push
            if self.curvature:
                push = rest[k + per_input - 1] * (np.sqrt(self.curvature) / CURVATURE_STEP**2)
                up, down, here = up + push, down + push, here - 2 * push
            parts += [up, down]
        return np.hstack([here, *parts])

    def copies(self, n_inputs: int) -> int:
        """Residuals for each row."""
        return 1 + n_inputs * (bool(self.slope) + bool(self.curvature))


def projected(
    layers: Layers,
    X: np.ndarray,
    Y: np.ndarray,
    weights: np.ndarray | None,
    alpha: float,
    smooth: Smoothness | None = None,
) -> Separable | Shallow:
    """Least squares over the hidden layers, the linear output layer eliminated (variable projection).

    ``weights`` (n_rows,) multiply the squares; ``alpha`` multiplies the sum of the squared weights (not of biases).
    """
    hidden = layers.below(len(layers.weights) - 1)
    x = np.ascontiguousarray(X.T)
    n_basis, n_rows = len(hidden.biases[-1]) + 1, len(X)
    if smooth is not None:
        x = smooth.inputs(x)
        copies = smooth.copies(len(x))
        Y = np.vstack([Y, np.zeros(((copies - 1) * n_rows, Y.shape[1]))])
        weights = None if weights is None else np.tile(weights, copies)

    def basis(omega: np.ndarray) -> tuple[np.ndarray, tuple]:
        net = hidden.at(omega)
        runs = net.run(x)
        phi = np.empty((n_basis, x.shape[1]))
        phi[:-1], phi[-1] = runs[-1][1], 1.0
        return phi if smooth is None else smooth.mix(phi, n_rows), (net, runs)

    def tangent(kept: tuple, theta: np.ndarray) -> list[np.ndarray]:
        net, runs = kept
        found = []
        for column in theta.T:
            out = np.empty((n_omega, x.shape[1]))
            net.back(x, runs, column[:-1, None], out)
            found.append(out if smooth is None else smooth.mix(out, n_rows))
        return found

    n_omega = sum(w.size + b.size for w, b in zip(hidden.weights, hidden.biases))
    ridge = np.append(np.full(n_basis - 1, alpha), 0.0) if alpha else None
    exact = Separable(
        basis,
        tangent,
        Y,
        root_weights=None if weights is None else np.sqrt(weights),
        ridge=ridge,
        ridge_omega=alpha * hidden.is_weight if alpha else None,
    )
    return Shallow(hidden, x, exact) if len(hidden.weights) == 1 and smooth is None else exact


@dataclass(frozen=True)
class Rows:
    """Data that are standardised block by block, so that no second copy of a large set is made.

    Attributes
    ----------
    X, Y : ndarray or RowSource (n_rows, n_inputs), ndarray (n_rows, n_outputs)
        In the units of the user.
    weights : ndarray (n_rows,) or None
    mean, scale : ndarray (n_inputs,)
    shift, gain : ndarray (n_outputs,)
    smooth : Smoothness or None
    """

    X: np.ndarray | RowSource
    Y: np.ndarray
    weights: np.ndarray | None
    mean: np.ndarray
    scale: np.ndarray
    shift: np.ndarray
    gain: np.ndarray
    smooth: Smoothness | None = None

    def __len__(self) -> int:
        return len(self.X)

    @property
    def total(self) -> float:
        """Sum of the weights."""
        return float(len(self.X)) if self.weights is None else float(self.weights.sum())

    def part(self, which: slice | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Standardised inputs, outputs and weights of some rows."""
        x = (self.X[which] - self.mean) / self.scale
        y = (self.Y[which] - self.shift) / self.gain
        return x, y, None if self.weights is None else self.weights[which]

    def block(self, first: int) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Inputs (n_inputs, n), targets (n_outputs, m) and weights (m,) of a block; with smoothness n and m count copies."""
        X, Y, weights = self.part(slice(first, first + JACOBIAN_ROWS))
        x, y = np.ascontiguousarray(X.T), Y.T
        if self.smooth is None:
            return x, y, weights
        copies = self.smooth.copies(len(x))
        y = np.hstack([y, np.zeros((len(y), (copies - 1) * len(X)))])
        return self.smooth.inputs(x), y, None if weights is None else np.tile(weights, copies)

    def take(self, which: np.ndarray) -> Rows:
        """Some rows as data of their own."""
        return replace(
            self, X=self.X[which], Y=self.Y[which], weights=None if self.weights is None else self.weights[which]
        )

    def through(self, layers: Layers) -> Rows:
        """The same outputs, inputs replaced by what the layers make of the standardised ones."""
        x = layers((self.X[:] - self.mean) / self.scale)
        return replace(self, X=x, mean=np.zeros(x.shape[1]), scale=np.ones(x.shape[1]))


def normal_equations(layers: Layers, rows: Rows, alpha: float = 0.0) -> Evaluate:
    """``theta -> (r'r, J'r, J'J)`` over all layers, added up over blocks of rows."""
    penalty = alpha * layers.is_weight
    n_theta, n_rows = len(penalty), len(rows)
    smooth = rows.smooth
    scratch = np.empty((n_theta, min(JACOBIAN_ROWS, n_rows) * (1 if smooth is None else 1 + 2 * rows.X.shape[1])))

    def evaluate(theta: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        net = layers.at(theta)
        cost, gradient, gram = float(penalty @ theta**2), penalty * theta, np.diag(penalty)
        for first in range(0, n_rows, JACOBIAN_ROWS):
            x, y, weights = rows.block(first)
            n_block = min(JACOBIAN_ROWS, n_rows - first)
            runs = net.run(x)
            residual = (runs[-1][1] if smooth is None else smooth.mix(runs[-1][1], n_block)) - y
            root = None if weights is None else np.sqrt(weights)
            if root is not None:
                residual *= root
            cost += float(np.vdot(residual, residual))
            if not np.isfinite(cost):
                return np.inf, gradient, gram
            whole = scratch if x.shape[1] == scratch.shape[1] else np.empty((n_theta, x.shape[1]))
            for k, r in enumerate(residual):
                delta = np.zeros((len(residual), x.shape[1]))
                delta[k] = 1.0
                net.back(x, runs, delta, whole)
                jacobian = whole if smooth is None else smooth.mix(whole, n_block)
                if root is not None:
                    jacobian *= root
                gradient += jacobian @ r
                gram += jacobian @ jacobian.T
        return cost, gradient, gram

    return evaluate


def squares(
    layers: Layers, rows: Rows, alpha: float, prior: np.ndarray | None = None
) -> Callable[[np.ndarray], tuple[float, np.ndarray]]:
    """``theta -> (r'r, its gradient)`` by back-propagation, added up over blocks of rows.

    ``alpha`` weighs the squared weights, or with ``prior`` the squared distance of weights and biases from it.
    """
    penalty = alpha * (layers.is_weight if prior is None else np.ones(len(prior)))

    def evaluate(theta: np.ndarray) -> tuple[float, np.ndarray]:
        net = layers.at(theta)
        away = theta if prior is None else theta - prior
        cost, gradient = float(penalty @ away**2), 2.0 * penalty * away
        for first in range(0, len(rows), JACOBIAN_ROWS):
            x, y, weights = rows.block(first)
            n_block = min(JACOBIAN_ROWS, len(rows) - first)
            runs = net.run(x)
            residual = (runs[-1][1] if rows.smooth is None else rows.smooth.mix(runs[-1][1], n_block)) - y
            delta = 2.0 * residual if weights is None else 2.0 * weights * residual
            cost += 0.5 * float(np.vdot(delta, residual))
            if rows.smooth is not None:
                delta = rows.smooth.unmix(delta, n_block)
            end = len(gradient)
            for layer in range(len(net.weights) - 1, -1, -1):
                delta = delta * ACTIVATIONS[net.activations[layer]].slope(*runs[layer])
                below, w = (runs[layer - 1][1] if layer else x), net.weights[layer]
                gradient[end - len(delta) : end] += delta.sum(axis=1)
                end -= len(delta) + w.size
                gradient[end : end + w.size] += (below @ delta.T).ravel()
                delta = w @ delta
        return cost, gradient

    return evaluate
