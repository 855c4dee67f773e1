"""The terms of the grammar as columns: what each moves the outputs by, those that differ."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sksurrogate.effects._formula import Term
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
    def of(cls, drivers: Drivers) -> Library:
        """All terms of the grammar, and sines read off the smoothed signal, that are finite and distinct along the path."""
        channel, terms = drivers.channel, [*terms_of(drivers), *waves_of(drivers)]
        kept, unit = _distinct(len(terms), channel.record.n_samples, lambda some: drivers.values(terms[some]))
        most = MOST_NUMBERS // channel.r.size
        if len(kept) > most:
            follows = _correlation(unit, channel.force())
            chosen = np.sort(np.argsort(-follows, kind="stable")[:most])
            kept, unit = kept[chosen], unit[chosen]
        columns = channel.respond(unit).transpose(1, 0, 2).reshape(len(kept), -1)
        finite = np.isfinite(columns).all(axis=1)
        if not finite.all():
            kept, columns = kept[finite], columns[finite]
        return cls([terms[k] for k in kept], columns)


def _distinct(n_terms: int, n_samples: int, values_of: Callable[[slice], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Places of the terms that are finite and do not repeat an earlier one, up to the sign; their values, of unit RMS.

    ``values_of``: values (n_some, n_samples) of some of the terms. They are made block by block: what is not kept takes no memory, nor do
        rows that nothing is written into.
    """
    some_rows = slice(None, None, max(n_samples // 400, 1))
    values = np.empty((n_terms, n_samples))
    sample = np.empty((n_terms, len(range(n_samples)[some_rows])))
    kept, n = np.empty(0, dtype=int), 0
    for a in range(0, n_terms, COMPARED_AT_ONCE):
        block = values_of(slice(a, a + COMPARED_AT_ONCE))
        sizes = np.sqrt(np.mean(block**2, axis=1))
        good = np.flatnonzero(np.isfinite(sizes) & (sizes > 1e-12))
        unit = block[good] / sizes[good, None]
        own, end = unit[:, some_rows], n + len(good)
        sample[n:end] = own / np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-300)
        alike = sample[n:end] @ sample[:end].T
        first = np.argmax(np.abs(alike, out=alike) > SAME, axis=1) == np.arange(n, end)
        values[len(kept) : len(kept) + np.sum(first)] = unit[first]
        kept, n = np.r_[kept, a + good[first]], end
    return kept, values[: len(kept)]


def _correlation(unit: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Of columns with a signal."""
    w, out = force - force.mean(), np.empty(len(unit))
    for a in range(0, len(unit), COMPARED_AT_ONCE):
        some = unit[a : a + COMPARED_AT_ONCE]
        z = some - some.mean(axis=1, keepdims=True)
        out[a : a + len(z)] = np.abs(z @ w) / np.maximum(np.linalg.norm(z, axis=1), 1e-300)
    return out
