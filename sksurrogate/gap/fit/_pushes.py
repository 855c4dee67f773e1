"""What changes the next states, where it arrives."""

from __future__ import annotations

import numpy as np

from sksurrogate.kernels.banded import first_order_scan, solve_recursion

#: Differences are taken by the first share of the size of what may act in jumps, inputs and a simulator that is only run, and by the
#: second of anything else.
COARSE_STEP, STEP_OF_SLOPES = 1e-3, 1e-4
#: Samples after which a disturbance has forgotten, where nothing better is known.
REMEMBERED = 10.0


def a_sample_later(change: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Changes of the next states (..., n_samples) at the sample in which these are, never from one run into the next.

    >>> a_sample_later(np.array([1.0, 2.0, 3.0, 4.0]), np.array([0, 2]))
    array([0., 1., 0., 3.])
    """
    out = np.zeros_like(change)
    out[..., 1:] = change[..., :-1]
    out[..., starts] = 0.0
    return out


def gain_of_forces(
    band: np.ndarray, push: np.ndarray, C: np.ndarray, starts: np.ndarray, spread: np.ndarray
) -> np.ndarray:
    """Deviation that a random force of unit size causes, of the output that it moves most, (n_forces,).

    ``band``: of the recursion of the states.
    ``push`` (n_states, n_forces): what a unit of each force changes in the next states.
    ``C`` (n_outputs, n_states, n_samples).
    ``starts`` (n_runs,).
    ``spread`` (n_outputs,): deviation of the outputs, the unit of the answer.
    """
    rng, a = np.random.default_rng(0), np.exp(-1 / REMEMBERED)
    gain = np.empty(push.shape[1])
    for k, unit in enumerate(push.T):
        w = first_order_scan(a, np.sqrt(1 - a * a) * rng.normal(size=C.shape[-1]), starts)
        b = a_sample_later(unit[:, None, None] * w, starts)
        moved = np.einsum("oit,it->ot", C, solve_recursion(band, b)[:, 0])
        gain[k] = np.max(np.std(moved, axis=1) / spread)
    return gain
