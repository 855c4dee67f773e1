"""Forces at its ports with which a simulator goes along a path: what it lacks acts on it there too."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._families import BalanceEffect

#: Share of the largest singular value below which ports move no state of their own.
SAME_PUSH = 1e-9


class HeldForce(BalanceEffect):
    """A known force at a port, held over every sample.

    ``values`` (n_samples,): of the record that the model is asked for.
    """

    name, equation = "held_force", "known"
    drivers, parameters = (), ()

    def __init__(self, port: str, values: np.ndarray):
        super().__init__(port)
        self.values = values

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """The force at each sample."""
        return self.values + np.zeros_like(x)


def following(pushes: np.ndarray, missed: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Forces (n_ports, n_samples) that make up best for what a model misses at every sample.

    ``pushes`` (n_ports, n_states, n_samples): what a unit force at each port changes in the next states.
    ``missed`` (n_states, n_samples): next states of the path less those of the model.
    ``scale`` (n_states,): size of the states.

    >>> pushes = np.array([[[2.0], [1.0]], [[0.0], [1.0]]])  # two ports, two states, one sample
    >>> following(pushes, np.array([[4.0], [5.0]]), np.ones(2)).ravel().round(9).tolist()
    [2.0, 3.0]
    """
    moved = (pushes / scale[:, None]).transpose(2, 1, 0)
    return np.asarray(np.einsum("tpi,it->pt", np.linalg.pinv(moved, rcond=SAME_PUSH), missed / scale[:, None]))
