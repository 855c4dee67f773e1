"""The step of a quantizer, seen in its readings alone: they crowd at the multiples of one number."""

from __future__ import annotations

from typing import Any

import numpy as np

#: Bins over the range of the readings, at least, and most bins with the empty ones.
BINS, MOST_BINS = 2000, 1 << 19
#: Least ``mean cos(2 pi y / step)`` of a lattice; share of the best from which a coarser step wins.
LEAST, AS_CLEAR = 0.35, 0.97
#: Lattices that are looked at closely, and what a peak between two frequencies of the transform shows of its height at least.
MOST_ALIKE, BETWEEN = 8, 0.9

#: Least coherence at which every reading shows its level: white noise of a sixth of a step leaves as much.
SHOWN = 0.58
#: How much clearer than by chance a lattice must be.
CLEARER_THAN_CHANCE = 1.2
#: Steps that the readings must span: fewer are seen in many a smooth signal.
LATTICE_STEPS_SPANNED = 1.7

#: Parts of the runs in which readings that crowd in a part only are looked for.
PARTS = 4
#: Share of these readings that may be at one level.
MOST_AT_ONE_LEVEL = 0.5

#: Steps up to the largest value between which likely ones are sought, bins to the finest one, and bins per cycle at the largest.
COARSE, FINE, FINEST_BINS, TURN = 20.0, 2000.0, 10, 8
#: Harmonics of the saw tooth, and steps that are kept in every octave.
HARMONICS, PER_OCTAVE = 3, 3


def coherence(readings: np.ndarray, step: np.ndarray) -> np.ndarray:
    """``mean cos(2 pi y / step)``: 1 on the multiples of a step, about 0 for a smooth signal of a range beyond it, 0 without readings."""
    return np.asarray(np.sum(np.cos(2 * np.pi * readings[:, None] / step), axis=0) / max(len(readings), 1))


def shows_steps(readings: np.ndarray, step: Any) -> np.ndarray:
    """Whether nearly every reading (n_samples,) is nearest to its own multiple of a step: (n_columns, 1) or (1,).

    >>> import numpy as np
    >>> y = np.linspace(0.0, 9.0, 500)
    >>> [bool(shows_steps(np.round(y), np.array([step]))[0]) for step in (1.0, 0.7)]
    [True, False]
    """
    step = np.atleast_1d(np.asarray(step, dtype=float))
    return coherence(readings, step.ravel()).reshape(step.shape) > np.maximum(SHOWN, by_chance(readings, step))


def by_chance(readings: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Coherence that a smooth signal of few readings reaches with one of all the steps down to this one.

    While a step shrinks a reading y passes from one multiple to the next y / step times.
    """
    rounded = np.sum(np.abs(readings)) / np.maximum(np.abs(step), 1e-300)
    return CLEARER_THAN_CHANCE * np.sqrt(np.log(np.maximum(rounded, 1.0)) / max(len(readings), 1))


def lattice_steps(readings: np.ndarray) -> list[float]:
    """Steps whose multiples the readings crowd at, clearest first; none for readings that do not.

    White noise of deviation s after the rounding leaves a coherence of ``exp(-2 pi^2 s^2 / step^2)``.

    ``readings`` (n_samples,).
    Returns list of float: at most one step: the clearest about the coarsest of those that are about as clear as the
        clearest.

    >>> import numpy as np
    >>> y = 20.0 + np.cumsum(np.random.default_rng(0).normal(size=2000)) / 30
    >>> steps = lattice_steps(0.25 * np.round(y / 0.25))
    >>> bool(abs(steps[0] - 0.25) < 1e-4)
    True
    >>> lattice_steps(y)
    []
    """
    readings = np.asarray(readings, dtype=float)
    low, spread = float(readings.min()), float(np.ptp(readings))
    if spread <= 1e-12 * max(abs(low), 1e-300) or len(readings) < 20:
        return []
    # Frequencies 1/step by one transform of the histogram, whose span is padded to resolve the phase at the largest reading.
    largest = float(np.max(np.abs(readings)))
    span = max(8.0 * largest, 2.0 * spread)
    bins = min(1 << int(np.ceil(np.log2(BINS * span / spread))), MOST_BINS)
    width = span / bins
    counts = np.bincount(((readings - low) / width).astype(int), minlength=bins)[:bins]
    frequency = np.fft.rfftfreq(bins, width)
    first = low + width / 2
    score = np.real(np.fft.rfft(counts) * np.exp(-2j * np.pi * frequency * first)) / len(readings)
    usable = (frequency > LATTICE_STEPS_SPANNED / spread) & (frequency < 0.1 / width)  # ten bins to a step
    if not usable.any() or score[usable].max() < LEAST:
        return []
    clear = np.flatnonzero(usable & (score > AS_CLEAR * score[usable].max()))
    # Far from 0 a lattice of one step more or fewer up to there is nearly as clear; at half the step it is another one.
    family = np.abs(np.log(np.maximum(frequency, frequency[1]) / frequency[clear[0]])) < 0.4
    alike = np.flatnonzero(usable & family & (score > BETWEEN * score[clear[0]]))
    likely = alike[np.argsort(-score[alike])[:MOST_ALIKE]]
    steps = np.array([top_of(readings, 1.0 / frequency[k], span) for k in likely])
    clearness = coherence(readings, steps)
    best = int(np.argmax(clearness))
    return [float(steps[best])] if clearness[best] > max(LEAST, by_chance(readings, steps[best])) else []


def lattice_window(readings: np.ndarray, ages: np.ndarray) -> tuple[float, int, int] | None:
    """The step that readings crowd at in a part of their runs only, and that part.

    ``readings`` (n_samples,): of all runs, not nan.
    ``ages`` int (n_samples,): samples since the first row of the run.
    Returns (step, first, last) or None: from the age ``first`` until before the age ``last`` readings crowd at multiples of the
        step, before and after it they do no more than by chance; None where they do nowhere, or everywhere.

    >>> import numpy as np
    >>> ages = np.tile(np.arange(500), 4)
    >>> y = 20.0 + np.cumsum(np.random.default_rng(0).normal(size=2000)) / 30
    >>> step, first, last = lattice_window(np.where(ages < 300, y, 0.25 * np.round(y / 0.25)), ages)
    >>> bool(abs(step - 0.25) < 1e-4), abs(first - 300) <= 1, last
    (True, True, 500)
    >>> lattice_window(0.25 * np.round(y / 0.25), ages)
    """
    longest = int(ages.max(initial=0)) + 1
    edges = np.linspace(0, longest, PARTS + 1).astype(int)
    found: list[tuple[float, float]] = []
    for a, b in zip(edges[:-1], edges[1:]):
        own = readings[(ages >= a) & (ages < b)]
        found.extend((float(coherence(own, np.array([step]))[0]), step) for step in lattice_steps(own))
    if not found:
        return None
    clearest, step = max(found)
    turn = np.cos(2 * np.pi * readings / step)
    first, last = _fullest(np.bincount(ages, turn - clearest / 2, minlength=longest))
    inside = (ages >= first) & (ages < last)
    outside = readings[~inside]
    everywhere = len(outside) < 2 or np.mean(turn[~inside]) > max(LEAST, float(by_chance(outside, np.array(step))))
    _, at_level = np.unique(np.round(readings[inside] / step), return_counts=True)
    still = at_level.max(initial=0) > MOST_AT_ONE_LEVEL * np.sum(at_level)  # a sensor that stands still has no steps
    shown = not everywhere and not still and bool(shows_steps(readings[inside], step)[0])
    return (float(step), first, last) if shown else None


def _fullest(values: np.ndarray) -> tuple[int, int]:
    """First and last place, the last not within it, between which values have the largest sum.

    >>> _fullest(np.array([-1.0, 2.0, -0.5, 3.0, -4.0, 1.0]))
    (1, 4)
    """
    total = np.r_[0.0, np.cumsum(values)]
    least = np.minimum.accumulate(total)
    last = int(np.argmax(total - least))
    return int(np.argmin(total[: last + 1])), last


def top_of(readings: np.ndarray, step: float, span: float) -> float:
    """The step at the top of the peak of coherence that a step lies on, its frequency known to ``1 / span``."""
    for narrow in (1.0, 0.1, 0.01):
        near = 1.0 / (1.0 / step + narrow * np.linspace(-1.0, 1.0, 21) / span)
        step = float(near[np.argmax(coherence(readings, near))])
    return step


def likely_steps(signal: np.ndarray, slope: np.ndarray) -> list[float]:
    """Steps whose rounding of a signal goes with a slope, likeliest first in every octave of steps.

    The error of rounding is a saw tooth, ``c round(u/c) - u = c/pi sum_k (-1)^k sin(2 pi k u/c) / k``, so that one Fourier
    transform of the slope over the values of the signal, ``S(f) = sum slope sin(2 pi f u)``, gives its product with every
    step at once: ``c/pi sum_k (-1)^k S(k/c) / k``.

    ``signal, slope`` (n_samples,): what is rounded, and what a unit change of it at every sample does.

    >>> import numpy as np
    >>> u = np.random.default_rng(0).normal(size=1000)
    >>> slope = 0.031 * np.round(u / 0.031) - u
    >>> steps = np.array(likely_steps(u, slope))
    >>> bool(np.min(np.abs(steps / 0.031 - 1)) < 1e-3)
    True
    """
    largest = float(np.max(np.abs(signal), initial=0.0))
    if largest <= 0 or not np.all(np.isfinite(slope)):
        return []
    low, span, width = float(np.min(signal)), TURN * largest, largest / FINE / FINEST_BINS
    bins = round(span / width)
    weights = np.bincount(((signal - low) / width).astype(int), weights=slope, minlength=bins)
    turned = np.exp(-2j * np.pi * np.arange(bins // 2 + 1) / bins * (low / width + 0.5))
    sines = -np.imag(np.fft.rfft(weights[:bins]) * turned)
    last = int(FINE * TURN)
    product = np.zeros(last)
    for k in range(1, HARMONICS + 1):
        product += (-1) ** k / k * sines[: k * last : k]
    peaks = 1 + np.flatnonzero((product[1:-1] >= product[:-2]) & (product[1:-1] > product[2:]) & (product[1:-1] > 0))
    found: list[float] = []
    first = COARSE * TURN
    while first < last:
        octave = peaks[(peaks >= first) & (peaks < 2 * first)]
        found.extend(float(span / k) for k in octave[np.argsort(-product[octave])[:PER_OCTAVE]])
        first *= 2
    return found
