"""Normal equations: solved in the scale of their own diagonal; what columns explain with initial states and nuisance projected out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeAlias

import numpy as np

from sksurrogate.kernels.linear_fit import linear_least_squares
from sksurrogate.kernels.run_columns import UNSEEN


def scaled(H: np.ndarray, least: float = 1e-300) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations over the square roots of their diagonal, and these; ``least`` the smallest square that counts."""
    scale = np.sqrt(np.maximum(np.diag(H), least))
    return H / np.outer(scale, scale), scale


def _check_finite(*parts: np.ndarray) -> None:
    if not all(np.isfinite(part).all() for part in parts):
        raise np.linalg.LinAlgError("the normal equations are not finite")


def solve(H: np.ndarray, g: np.ndarray, damping: float = 0.0) -> np.ndarray:
    """The smallest ``x`` of ``H x = g``, unseen directions left at 0; ``damping`` in the scale of the diagonal.

    LinAlgError where a trajectory left the finite numbers.

    >>> solve(np.diag([4.0, 1e-40]), np.array([2.0, 1e-40]))
    array([0.5, 1. ])
    """
    _check_finite(H, g)
    normal, scale = scaled(H)
    if damping:
        normal = normal + damping * np.eye(len(H))
    return linear_least_squares(normal, g / scale, rcond=UNSEEN) / scale


def unexplained(columns: np.ndarray, y: np.ndarray) -> np.ndarray:
    """What columns (n_values, n_columns) leave of y (n_values, ...) by least squares.

    >>> unexplained(np.ones((3, 1)), np.array([1.0, 2.0, 3.0])).round(12)
    array([-1.,  0.,  1.])
    """
    return np.asarray(y - columns @ linear_least_squares(columns, y, rcond=UNSEEN))


def inverse(H: np.ndarray) -> np.ndarray:
    """Pseudo-inverse; LinAlgError where a trajectory left the finite numbers."""
    _check_finite(H)
    normal, scale = scaled(H)
    return np.linalg.pinv(normal, rcond=UNSEEN, hermitian=True) / np.outer(scale, scale)


def seen_inverse(H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pseudo-inverse, and which parameters take part in an unseen direction."""
    normal, scale = scaled(H)
    values, vectors = np.linalg.eigh(normal)
    seen = values > UNSEEN * values[-1]
    blind = np.sum(vectors[:, ~seen] ** 2, axis=1) > 1e-6
    return (vectors[:, seen] / values[seen]) @ vectors[:, seen].T / np.outer(scale, scale), blind


#: Orthonormal columns that the initial states of a run can move: its first row, its end, (n_outputs * length, rank).
StartBasis: TypeAlias = tuple[int, int, np.ndarray]


def start_bases(J_x: np.ndarray, starts: np.ndarray, n_samples: int) -> Iterator[StartBasis]:
    """What the initial states of each run can move, by their sensitivities J_x (n_outputs, n_states, n_samples)."""
    bounds = np.r_[starts, n_samples]
    for a, b in zip(bounds[:-1], bounds[1:]):
        basis = J_x[:, :, a:b].transpose(1, 0, 2).reshape(J_x.shape[1], -1)
        size = np.linalg.norm(basis, axis=1)
        basis = basis[size > 1e-9 * max(size.max(), 1e-300)]
        if not len(basis):
            continue
        q, r = np.linalg.qr((basis / np.linalg.norm(basis, axis=1)[:, None]).T)
        yield a, b, q[:, np.abs(np.diag(r)) > 1e-8]


def start_coordinates(columns: np.ndarray, J_x: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """What the initial states of every run can make of columns (n_columns, n_outputs, n_samples): (n_columns, n_bases).

    Their Gram is what the Gram of the columns loses with the initial states projected out.
    """
    parts = [
        columns[:, :, a:b].reshape(len(columns), -1) @ q for a, b, q in start_bases(J_x, starts, columns.shape[-1])
    ]
    return np.concatenate([np.zeros((len(columns), 0)), *parts], axis=1)


def project_starts(columns: np.ndarray, J_x: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Columns (n_columns, n_outputs, n_samples) with the initial states of every run taken out."""
    out = columns.copy()
    project_in_place(out, start_bases(J_x, starts, columns.shape[-1]))
    return out


def project_in_place(columns: np.ndarray, bases: Iterable[StartBasis]) -> None:
    """The same with the bases known, written into the columns."""
    for a, b, q in bases:
        part = columns[:, :, a:b].reshape(len(columns), -1)
        columns[:, :, a:b] = (part - (part @ q) @ q.T).reshape(len(columns), columns.shape[1], b - a)


def eliminate(G: np.ndarray, n_nuisance: int, precision: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Gram of [r, nuisance, candidates] -> Gram of [r, candidates] with the nuisance fitted under its prior."""
    if n_nuisance == 0:
        return G
    k = slice(1, 1 + n_nuisance)
    keep = np.r_[0, np.arange(1 + n_nuisance, len(G))]
    H = G[k, k] + np.diag(precision)
    cross = G[k][:, keep].copy()
    cross[:, 0] += pull
    return G[np.ix_(keep, keep)] - cross.T @ inverse(H) @ cross


def eliminate_rows(
    rows: np.ndarray, diagonal: np.ndarray, precision: np.ndarray, pull: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of the Gram of [r, nuisance, candidates], as rows of the first two: r' v and v' v with the nuisance fitted."""
    k = len(rows)
    if k == 1:
        return rows[0, 1:], diagonal[1:]
    H = rows[1:, 1:k] + np.diag(precision)
    cross, mine = rows[1:, k:], rows[1:, 0] + pull
    known = inverse(H)
    return rows[0, k:] - mine @ known @ cross, diagonal[k:] - np.einsum("pk,pk->k", cross, known @ cross)


def scores(
    g: np.ndarray, h: np.ndarray, low: np.ndarray | float, high: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Drop and amplitude of every column alone."""
    h = np.maximum(h, 1e-300)
    amplitude = np.clip(g / h, low, high)
    return 2 * amplitude * g - amplitude**2 * h, amplitude
