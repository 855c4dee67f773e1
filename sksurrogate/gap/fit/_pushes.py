"""What changes the next states, where it arrives."""

from __future__ import annotations

import numpy as np

__all__ = ["a_sample_later"]


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
