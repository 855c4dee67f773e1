"""What changes the next states, where it arrives."""

from __future__ import annotations

import numpy as np

from sksurrogate.kernels.banded import a_sample_later, first_order_scan, solve_recursion
from sksurrogate.kernels.record import Record

#: Differences are taken by the first share of the size of what may act in jumps, inputs and a simulator that is only run, and by the
#: second of anything else.
COARSE_STEP, STEP_OF_SLOPES = 1e-3, 1e-4
#: Samples after which a disturbance has forgotten, where nothing better is known.
REMEMBERED = 10.0


def at_end(record: Record, f: np.ndarray) -> np.ndarray:
    """Values (n_functions, n_samples) at the end of each sample; the last of a run stands."""
    out = np.roll(f, -1, axis=1)
    last = record.starts + record.lengths - 1
    out[:, last] = f[:, last]
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
