"""Runs of a MuJoCo model: what enters at every step, and a loop over its steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from sksurrogate.physics._mujoco_engine import Engine, silent
from sksurrogate.physics._mujoco_layout import Layout


def held_inputs(layout: Layout, names: Sequence[str], U: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """What enters at every step (n_runs, n_steps + 1, n_controls + n_ports) of inputs held for some steps, the last for one."""
    entries = (*layout.controls, *layout.ports)
    out = np.zeros((len(U), int(counts.sum()) + 1, len(entries)))
    out[:, :, [entries.index(name) for name in names]] = np.repeat(U, np.append(counts, 1), axis=1)
    return out


def run_by_rollout(
    engine: Engine,
    names: Sequence[str],
    X0: np.ndarray,
    U: np.ndarray,
    lengths: np.ndarray,
    ratio: int,
    p: Mapping[str, float],
) -> np.ndarray:
    """States (n_states, n_runs, n_samples) under inputs ``U`` (n_parts, n_inputs, n_runs, n_samples) held over equal parts of a sample.

    A rollout has one length: runs that differ less than twofold go together. Other arguments as below.
    """
    octave, out, parts = np.frexp(lengths)[1], np.full((*X0.shape, U.shape[-1]), np.nan), len(U)
    for runs in (np.flatnonzero(octave == one) for one in np.unique(octave)):
        n_samples = lengths[runs].max()
        rows, n_parts = ratio * np.arange(n_samples), parts * (n_samples - 1)
        inputs = U[:, :, runs, :n_samples].transpose(2, 3, 0, 1).reshape(len(runs), -1, U.shape[1])[:, : n_parts + 1]
        held = held_inputs(engine.layout, names, inputs, np.full(n_parts, ratio // parts))
        out[:, runs, : len(rows)] = engine.runs(0.0, X0[:, runs].T, held, p, rows)[0].transpose(2, 0, 1)
    return out


def run_in_steps(
    engine: Engine,
    names: Sequence[str],
    X0: np.ndarray,
    lengths: np.ndarray,
    ratio: int,
    p: Mapping[str, float],
    entering: Callable[[int, float, np.ndarray], np.ndarray],
) -> np.ndarray:
    """States (n_states, n_runs, n_samples), where what enters follows from them; nan from where a run is not finite, and behind its end.

    ``names``: what the rows of ``entering`` belong to, inputs and ports.
    ``X0`` (n_states, n_runs).
    ``lengths`` int (n_runs,): samples of every run.
    ``ratio``: steps of the model in a sample.
    ``entering(k, after, x)``: what enters (n_some, n_runs) in the step that begins a time ``after`` sample k, at states x; it is asked in the
        order of time, at the last sample too.
    """
    entries, h = (*engine.layout.controls, *engine.layout.ports), engine.timestep
    places = [entries.index(name) for name in names]
    step, control, x = engine.stepper(p), np.zeros((len(entries), X0.shape[1])), X0.copy()
    out = np.full((*X0.shape, int(lengths.max())), np.nan)
    out[..., 0] = X0
    with silent():
        for k in range(out.shape[2] - 1):
            going = np.flatnonzero(lengths > k + 1)
            for part in range(ratio):
                enters = entering(k, part * h, x)
                control[places[: len(enters)]] = enters
                x[:, going] = step((k * ratio + part) * h, x[:, going], control[:, going])
            if not np.isfinite(x).all():
                return out
            out[..., k + 1] = np.where(lengths > k + 1, x, np.nan)
        entering(out.shape[2] - 1, 0.0, x)
    return out
