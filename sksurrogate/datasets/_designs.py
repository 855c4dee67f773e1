"""Initial states and inputs of experiments: ranges, space-filling samples, and signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any

import numpy as np
from scipy.stats import qmc

from sksurrogate._tables import unmasked
from sksurrogate.exceptions import DataError
from sksurrogate.physics._simulator import Plant

#: Sines of a multisine, and rows that a level of "levels" and a bit of "prbs" are held at least and at most.
SINES = 8


def design_of(
    plant: Plant,
    x0_ranges: Any,
    input_ranges: Any,
    design: Any,
    n_runs: int,
    n_samples: int,
    hold: tuple[int, int],
    sampling: str,
    rng: np.random.RandomState,
) -> tuple[np.ndarray, np.ndarray]:
    """Initial states (n_runs, n_states) and inputs (n_runs, n_samples, n_inputs)."""
    starts = _ranges(x0_ranges, plant.states, "x0_ranges", plant.x0)
    if isinstance(design, str):
        if design not in ("levels", "multisine", "prbs"):
            raise DataError(f'design={design!r} must be "levels", "multisine", "prbs", a callable or an array.')
        whole = np.shape(hold) == (2,) and all(isinstance(rows, Integral) for rows in hold)
        if not whole or not 1 <= hold[0] <= hold[1]:
            raise DataError(
                f"hold={hold!r}: fewest and most rows of a level, at least 1 and in this order, both whole numbers."
            )
        bounds = _ranges(input_ranges, plant.inputs, "input_ranges", None)
        each = {"levels": n_samples // hold[0] + 2, "multisine": SINES, "prbs": 2}[design]
        unit = _unit(n_runs, len(starts) + each * len(bounds), sampling, rng)
        shares = unit[:, len(starts) :].reshape(n_runs, len(bounds), each)
        shape = {"levels": _levels, "multisine": _multisine, "prbs": _prbs}[design]
        U = np.empty((n_runs, n_samples, len(bounds)))
        for r in range(n_runs):
            for i, (low, high) in enumerate(bounds):
                U[r, :, i] = low + (high - low) * shape(shares[r, i], n_samples, hold, rng)
    else:
        unit = _unit(n_runs, len(starts), sampling, rng)
        given = _given(design, n_runs, n_samples, rng)
        if given.ndim <= 2:
            given = np.repeat(_column(given)[None], n_runs, axis=0)
        if given.shape != (n_runs, n_samples, len(plant.inputs) or given.shape[-1]):
            raise DataError(
                f"design has shape {given.shape}, expected (n_runs={n_runs}, n_samples={n_samples}, "
                f"{len(plant.inputs)}) or one run of it; set n_runs and n_samples to those of the array."
            )
        U = given
    if not np.all(np.isfinite(U)):
        run, row = np.argwhere(~np.isfinite(U))[0][:2]
        raise DataError(
            f"the inputs of the design are not finite in run {run}, row {row}: {U[run, row].tolist()}; correct design=, or narrow "
            "input_ranges."
        )
    low, high = starts[:, 0], starts[:, 1]
    return low + (high - low) * unit[:, : len(starts)], U


def _given(design: Any, n_runs: int, n_samples: int, rng: np.random.RandomState) -> np.ndarray:
    """Inputs of an array, or of a function that is asked for every run."""
    try:
        if not callable(design):
            return np.asarray(unmasked(design), float)
        asked = [_column(design(rng, n_samples)) for _ in range(n_runs)]
        if len({one.shape for one in asked}) == 1:
            return np.stack(asked)
    except (TypeError, ValueError) as error:
        raise DataError(
            f"design={design!r} gives no array of numbers ({error}): expected a function design(rng, n_samples), or an array, of "
            f"the inputs (n_samples={n_samples}, n_inputs)."
        ) from error
    raise DataError(
        f"design={design!r} returned arrays of {sorted({one.shape for one in asked})}, expected {n_samples} rows for every run."
    )


def _column(values: Any) -> np.ndarray:
    rows = np.asarray(unmasked(values), float)
    return rows[:, None] if rows.ndim == 1 else rows


def _ranges(given: Any, names: Sequence[str], argument: str, nominal: np.ndarray | None) -> np.ndarray:
    """(n, 2) low and high; a name without a range stays at its nominal value."""
    if isinstance(given, Mapping):
        unknown = sorted(set(given) - set(names))
        if unknown:
            raise DataError(f"{argument} names {unknown[0]!r}, but the simulator has {list(names)}.")
        pairs: list[Any] = [given.get(name) for name in names]
    elif given is None:
        pairs = [None] * len(names)
    else:
        pairs = list(given) if np.iterable(given) and all(map(np.iterable, given)) else [given]
        if names and len(pairs) != len(names):
            raise DataError(f"{argument} has {len(pairs)} pairs, expected {len(names)}: one for each of {list(names)}.")
    out = []
    for k, pair in enumerate(pairs):
        if pair is None and nominal is None:
            raise DataError(f"{argument}: give {names[k]!r} a range, e.g. {argument}={{{names[k]!r}: (0.0, 1.0)}}.")
        if pair is not None and np.shape(pair) != (2,):
            where = f" of {names[k]!r}" if names else ""
            raise DataError(
                f"{argument}{where} is {pair!r}, expected a pair (low, high); for a fixed value the same twice."
            )
        low, high = (nominal[k], nominal[k]) if pair is None and nominal is not None else pair
        try:
            low, high = float(low), float(high)
        except (TypeError, ValueError) as error:
            raise DataError(f"{argument}: ({low!r}, {high!r}), expected two numbers.") from error
        if not (np.isfinite(high - low) and low <= high):
            raise DataError(f"{argument}: ({low}, {high}) must be finite, low before high.")
        out.append((low, high))
    return np.asarray(out, float).reshape(len(out), 2)


def _unit(n: int, d: int, sampling: str, rng: np.random.RandomState) -> np.ndarray:
    """n points in the unit cube of d dimensions."""
    if sampling not in ("lhs", "sobol", "random"):
        raise DataError(f'sampling={sampling!r} must be "lhs", "sobol" or "random".')
    if d == 0 or sampling == "random":
        return rng.uniform(size=(n, d))
    generator = np.random.default_rng(rng.randint(2**31))
    if sampling == "lhs":
        return qmc.LatinHypercube(d, seed=generator).random(n)
    # a power of two keeps the balance of the sequence; what is beyond n is dropped
    return qmc.Sobol(d, seed=generator).random_base2(max(0, int(np.ceil(np.log2(n)))))[:n]


def _levels(share: np.ndarray, n: int, hold: tuple[int, int], rng: np.random.RandomState) -> np.ndarray:
    """Levels held ``hold`` rows, in [0, 1]."""
    return np.repeat(share, rng.randint(hold[0], hold[1] + 1, len(share)))[:n]


def _multisine(share: np.ndarray, n: int, hold: tuple[int, int], rng: np.random.RandomState) -> np.ndarray:
    """Sines with the given phases from one period a run to one period in ``2 hold[0]`` rows, in [0, 1]."""
    periods = np.unique(np.round(np.geomspace(1, max(2, n / (2 * hold[0])), len(share))))
    waves = np.cos(2 * np.pi * (np.arange(n)[:, None] * periods / n + share[: len(periods)]))
    total = waves.sum(axis=1)
    return (total - total.min()) / max(np.ptp(total), 1e-12)


def _prbs(share: np.ndarray, n: int, hold: tuple[int, int], rng: np.random.RandomState) -> np.ndarray:
    """Random switching between two levels, bits held ``hold[0]`` rows, in [0, 1]."""
    bits = rng.randint(2, size=n // hold[0] + 1)
    return share[np.repeat(bits, hold[0])[:n]]
