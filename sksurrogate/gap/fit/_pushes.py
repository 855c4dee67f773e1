"""What changes the next states, where it arrives."""

from __future__ import annotations

import numpy as np

__all__ = ["PUSH_OF_INPUT", "PUSH_OF_STATE", "a_sample_later", "pushed_input"]

#: Differences are taken by this share of the range of an input, or of the size of a state: inputs may act in jumps.
PUSH_OF_INPUT, PUSH_OF_STATE = 1e-3, 1e-4


def a_sample_later(change: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Changes of the next states (..., n_samples) at the sample in which these are, never from one run into the next.

    Examples
    --------
    >>> a_sample_later(np.array([1.0, 2.0, 3.0, 4.0]), np.array([0, 2]))
    array([0., 1., 0., 3.])
    """
    out = np.zeros_like(change)
    out[..., 1:] = change[..., :-1]
    out[..., starts] = 0.0
    return out


def pushed_input(u: np.ndarray, i: int) -> tuple[np.ndarray, float]:
    """The inputs (n_inputs, n_samples) with a share of its range added to one of them, and what was added.

    Examples
    --------
    >>> pushed_input(np.array([[0.0, 2.0]]), 0)
    (array([[0.002, 2.002]]), 0.002)
    """
    push = PUSH_OF_INPUT * (float(np.ptp(u[i])) or 1.0)
    out = u.copy()
    out[i] += push
    return out, push
