"""Runs of a MuJoCo model: what enters at every step, and a loop over its steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from sksurrogate.physics._mujoco_engine import Engine
from sksurrogate.physics._mujoco_layout import Layout


def held_inputs(layout: Layout, names: Sequence[str], U: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """What enters at every step (n_runs, n_steps + 1, n_controls + n_ports) of inputs held for some steps, the last for one."""
    entries = (*layout.controls, *layout.ports)
    out = np.zeros((len(U), int(counts.sum()) + 1, len(entries)))
    out[:, :, [entries.index(name) for name in names]] = np.repeat(U, np.append(counts, 1), axis=1)
    return out


def run_in_steps(
    engine: Engine,
    names: Sequence[str],
    X0: np.ndarray,
    n_samples: int,
    ratio: int,
    p: Mapping[str, float],
    entering: Callable[[int, float, np.ndarray], np.ndarray],
) -> np.ndarray:
    """States (n_states, n_runs, n_samples), where what enters follows from them; nan from where a run is not finite.

    ``names``: what the rows of ``entering`` belong to, inputs and ports.
    ``X0`` (n_states, n_runs).
    ``ratio``: steps of the model in a sample.
    ``entering(k, after, x)``: what enters (n_some, n_runs) in the step that begins a time ``after`` sample k, at states x.
    """
    entries, h = (*engine.layout.controls, *engine.layout.ports), engine.timestep
    places = [entries.index(name) for name in names]
    step, control, x = engine.stepper(p), np.zeros((len(entries), X0.shape[1])), X0
    out = np.full((*X0.shape, n_samples), np.nan)
    out[..., 0] = X0
    for k in range(n_samples - 1):
        for part in range(ratio):
            enters = entering(k, part * h, x)
            control[places[: len(enters)]] = enters
            x = step((k * ratio + part) * h, x, control)
        if not np.isfinite(x).all():
            break
        out[..., k + 1] = x
    return out
