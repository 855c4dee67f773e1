"""Pieces of runs in which the free run of an unstable plant can be followed: a whole run says nothing but that it grows."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.fit._record_parts import SHORTEST_BLOCK
from sksurrogate.kernels.record import Record

UNSTABLE_NOTE = (
    "The simulator is unstable along the data: small differences grow beyond what the noise allows to follow. Free runs therefore "
    "start again every {rows} rows, with initial states of their own, and slow effects are hard to tell apart. With its controller "
    "(ClosedLoopSimulator) the plant can be compared over whole runs."
)


def largest_growth(sd: np.ndarray, spread: np.ndarray) -> float:
    """Growth (log) of small differences over a piece of a run up to which a model that is linear about a measured path holds.

    A path of error e leaves ``e^2 / spread`` of second order in every step; grown by ``exp(g)`` that stays within the noise
    as long as ``exp(g) e^2 / spread < sd``, and e is at most the noise: ``g < log(spread / sd)``.

    ``sd, spread`` (n_outputs,): noise and deviation of every output.

    >>> round(largest_growth(np.array([0.01]), np.array([1.0])), 3)
    4.605
    """
    return max(float(-0.5 * np.log(np.mean((sd / spread) ** 2))), 0.0)


def piece_starts(A: np.ndarray, scale: np.ndarray, starts: np.ndarray, most: float) -> np.ndarray:
    """First rows of pieces over which small differences grow by at most ``most`` (log), no shorter than a block of a fold.

    The growth is that of the product of the Jacobians, RMS over all directions: what grows here and shrinks there does not count.

    ``A`` (n_states, n_states, n_samples): state Jacobians of the step from every row to the next.
    ``scale`` (n_states,): size of the states.
    ``starts`` (n_runs,): first rows of the runs.

    >>> A = np.full((1, 1, 100), np.exp(0.1))
    >>> piece_starts(A, np.ones(1), np.array([0]), 2.95)
    array([ 0, 30, 60, 90])
    >>> piece_starts(1.0 / A, np.ones(1), np.array([0]), 3.0)
    array([0])
    """
    n, n_samples = A.shape[0], A.shape[2]
    step = np.moveaxis(A * (scale[None, :] / scale[:, None])[:, :, None], 2, 0)
    lengths = np.diff(np.r_[starts, n_samples])
    product, since = np.repeat(np.eye(n)[None], len(starts), axis=0), np.zeros(len(starts), int)
    first = np.zeros(n_samples, bool)
    first[starts] = True
    with np.errstate(all="ignore"):
        for k in range(1, int(lengths.max())):
            runs = np.flatnonzero(k < lengths)
            product[runs] = step[starts[runs] + k - 1] @ product[runs]
            since[runs] += 1
            growth = 0.5 * np.log(np.sum(product[runs] ** 2, axis=(1, 2)) / n)
            cut = runs[~(growth <= most) & (since[runs] >= SHORTEST_BLOCK)]
            first[starts[cut] + k], product[cut], since[cut] = True, np.eye(n), 0
    return np.flatnonzero(first)


def followed_rows(A: np.ndarray, scale: np.ndarray, starts: np.ndarray, most: float) -> int | None:
    """Rows over which a free run can be followed anywhere in the record, arguments as above; None where whole runs can be."""
    pieces = piece_starts(A, scale, starts, most)
    ended = np.diff(pieces)[~np.isin(pieces[1:], starts)]
    return int(ended.min()) if len(ended) else None


def in_pieces(record: Record, n_rows: int) -> Record:
    """The record with its runs in equal pieces of at most ``n_rows``, each with an unknown initial state of its own.

    >>> whole = Record(np.zeros((1, 100)), np.zeros((1, 100)), np.arange(100.0), np.array([0, 40]), 1.0)
    >>> part = in_pieces(whole, 30)
    >>> part.starts, part.recorded_starts
    (array([ 0, 20, 40, 70]), array([ 0, 40]))
    """
    edges = [np.linspace(a, b, -(-(b - a) // n_rows) + 1)[:-1] for a, b in record.spans]
    return record.cut(np.round(np.concatenate(edges)).astype(int))
