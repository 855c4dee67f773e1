"""The terms of the grammar as columns: what each moves the outputs by, those that differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sksurrogate.effects._formula import Term
from sksurrogate.gap.unnamed._channel import Channel
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._grammar import terms_of
from sksurrogate.gap.unnamed._waves import waves_of

#: Numbers that all columns together may take (8 bytes each): more terms are thinned to those that follow the smoothed signal.
MOST_NUMBERS = 12_000_000
#: Two columns with a correlation above this on a sample of rows are one: the first, which is the simpler, stays.
SAME = 1.0 - 1e-7
#: Columns that are compared with all before them at once: the square of all would take more memory than all else.
COMPARED_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class Library:
    """Terms, and what they move the outputs by: (n_terms, n_outputs * n_samples), each for a signal of unit RMS."""

    terms: list[Term]
    columns: np.ndarray

    @classmethod
    def of(cls, channel: Channel, drivers: Drivers) -> Library:
        """All terms of the grammar, and sines read off the smoothed signal, that are finite and distinct along the path."""
        terms = [*terms_of(drivers), *waves_of(channel, drivers)]
        values = drivers.values(terms, channel.record)
        sizes = np.sqrt(np.mean(values**2, axis=1))
        good = np.isfinite(sizes) & (sizes > 1e-12)
        kept = np.flatnonzero(good)
        unit = values[kept] / sizes[kept, None]
        kept, unit = _distinct(kept, unit)
        most = MOST_NUMBERS // channel.r.size
        if len(kept) > most:
            follows = _correlation(unit, channel.force())
            chosen = np.sort(np.argsort(-follows, kind="stable")[:most])
            kept, unit = kept[chosen], unit[chosen]
        columns = channel.respond(unit).transpose(1, 0, 2).reshape(len(kept), -1)
        finite = np.isfinite(columns).all(axis=1)
        kept, columns = kept[finite], columns[finite]
        return cls([terms[k] for k in kept], columns)


def _distinct(kept: np.ndarray, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Without columns that repeat an earlier one, up to the sign."""
    sample = unit[:, :: max(unit.shape[1] // 400, 1)]
    sample = sample / np.maximum(np.linalg.norm(sample, axis=1, keepdims=True), 1e-300)
    first = np.zeros(len(kept), bool)
    for a in range(0, len(kept), COMPARED_AT_ONCE):
        some = np.arange(a, min(a + COMPARED_AT_ONCE, len(kept)))
        first[some] = np.argmax(np.abs(sample[some] @ sample[: some[-1] + 1].T) > SAME, axis=1) == some
    return kept[first], unit[first]


def _correlation(unit: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Of columns with a signal."""
    z = unit - unit.mean(axis=1, keepdims=True)
    w = force - force.mean()
    return np.asarray(np.abs(z @ w) / np.maximum(np.linalg.norm(z, axis=1), 1e-300))
