"""Evidence of weights of a given size in a linear model, from its Gram alone."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.fit._linear_set import RANK
from sksurrogate.gap.fit._normal_equations import scaled

#: Weights of the roughness of a smooth form beside its movement.
SMOOTH_BESIDE = (1.0, 30.0, 1000.0)
#: Nats to which the evidence of weights must be known.
KNOWN_TO = 0.5


def amplitude_evidence(
    H: np.ndarray, g: np.ndarray, root: np.ndarray, sizes: np.ndarray, power: float = np.inf
) -> np.ndarray:
    """Log Bayes factor of weights ``c ~ N(0, a^2 R R')`` over none, for every size a.

    ``log N(g) = sum_i [a^2 b_i^2 / (1 + a^2 l_i) - log(1 + a^2 l_i)] / 2`` in the eigenbasis of ``R' H R``; no direction
    explains more than the residual holds, ``b_i^2 <= l_i power`` (Cauchy and Schwarz), whatever rounding makes of it.

    ``H``: Gram of the law's functions under the noise, nuisance parameters projected out.
    ``g``: their products with the residual.
    ``root``: R, a root of the prior covariance at size one.
    ``sizes`` (n_sizes,).
    ``power``: squared residual under the noise, nuisance parameters projected out.
    Returns (n_sizes,).

    >>> float(amplitude_evidence(np.array([[3.0]]), np.array([2.0]), np.eye(1), np.array([1.0]))[0])  # 2^2/(2*4) - ln(4)/2
    -0.1931471805599453
    """
    values, vectors = np.linalg.eigh(root.T @ H @ root)
    values = np.maximum(values, 0.0)
    explained = (vectors.T @ (root.T @ g)) ** 2
    if np.isfinite(power):
        explained = np.minimum(explained, values * max(power, 0.0))
    square = sizes[:, None] ** 2
    return 0.5 * np.sum(square * explained / (1.0 + square * values) - np.log1p(square * values), axis=1)


def known_to_rounding(G: np.ndarray) -> bool:
    """Whether a Gram of a residual (first) and of regressors holds the power that they explain to :data:`KNOWN_TO` nats.

    A Gram has no negative eigenvalue. Where one of unit columns is ``-e``, rounding has moved the power that is explained by about
    ``e`` of the residual's: its products were differences of far larger numbers, as under a noise far below the residual.

    >>> near = np.array([[1.0, 0.9], [0.9, 1.0]])
    >>> known_to_rounding(near), known_to_rounding(near + [[0.0, 0.2], [0.2, 0.0]])
    (True, True)
    >>> known_to_rounding(100.0 * (near + [[0.0, 0.2], [0.2, 0.0]]))
    False
    """
    if not np.isfinite(G).all():
        return False
    return bool(0.5 * G[0, 0] * np.linalg.eigvalsh(scaled(G)[0])[0] > -KNOWN_TO)


def prior_roots(metric: np.ndarray, rough: np.ndarray | None) -> list[np.ndarray]:
    """Roots of the prior covariances of a form's weights: its mean square movement is one, more or less smooth.

    ``metric``: mean square movement of the outputs by the weights, as a quadratic form.
    ``rough``: roughness of the weights, as a quadratic form; None: they are as rough as they may be.

    >>> [root.round(6).tolist() for root in prior_roots(np.array([[4.0]]), None)]
    [[[0.5]]]
    """
    if not np.isfinite(metric).all() or np.max(np.diag(metric)) <= 0.0:
        return []
    unit, scale = scaled(metric, 1e-12 * max(float(np.max(np.diag(metric))), 1e-300))
    values, vectors = np.linalg.eigh(unit)
    kept = values > RANK * values[-1]
    white = vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None]  # every direction moves as much
    found = [white / np.sqrt(white.shape[1])]
    if rough is not None:
        bent = white.T @ rough @ white
        bent /= max(float(np.trace(bent)) / len(bent), 1e-300)
        for weight in SMOOTH_BESIDE:
            level, axes = np.linalg.eigh(np.eye(len(bent)) + weight * bent)
            root = white @ (axes / np.sqrt(level))
            found.append(root / np.sqrt(np.sum(1.0 / level)))
    return found


def small_and_large(sizes: np.ndarray, tolerance: float) -> np.ndarray:
    """Prior weights of sizes, a constant factor apart: half normal as a small law, log-uniform above the tolerance as a large one.

    ``sizes`` (n_sizes,).
    ``tolerance``: scale of the half normal.
    Returns (2, n_sizes): of a small and of a large law.

    >>> small_and_large(np.geomspace(1e-4, 10.0, 200), 0.1).sum(axis=1).round(3).tolist()
    [0.999, 1.0]
    """
    step = np.log(sizes[1] / sizes[0])
    half_normal = np.sqrt(2.0 / np.pi) / tolerance * np.exp(-0.5 * (sizes / tolerance) ** 2) * sizes * step
    above = tolerance < sizes
    return np.stack([half_normal, np.where(above, 1.0 / np.sum(above), 0.0)])
