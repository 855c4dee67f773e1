"""Where the gap lies, as tables: by output, location and frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import welch
from scipy.special import softmax

from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.kernels.record import Record, bridged

#: Bands of frequency; longest and shortest piece of a run whose spectrum is taken.
BANDS, LONGEST_PIECE, SHORTEST_PIECE = 6, 256, 16


def by_output(shrink: Shrink) -> Table:
    """Gap of every output above its noise, in its units, and its share of the whole."""
    gaps = [np.sqrt(max(row["before"] ** 2 - row["floor"] ** 2, 0.0)) for row in shrink.by_output]
    relative = [gap**2 / max(row["floor"], 1e-300) ** 2 for gap, row in zip(gaps, shrink.by_output)]
    total = sum(relative)
    shares = [float(part / total) if total > 0 else 0.0 for part in relative]
    rows = [
        {"output": row["output"], "gap": float(gap), "noise": row["floor"], "share": share}
        for row, gap, share in zip(shrink.by_output, gaps, shares)
    ]
    return Table(tuple(rows))


def named_places(effects: Sequence[EffectEstimate], kinds: Mapping[tuple, str]) -> list[tuple[str, str, float]]:
    """Location, kind and share of the gap of every named effect; parameters where ``kinds`` (by key) knows none."""
    keys = [(effect.name, effect.location, effect.variable) for effect in effects]
    return [(effect.location, kinds.get(key, "parameter"), effect.share) for effect, key in zip(effects, keys)]


def by_location(found: Sequence[Place], named: Sequence[tuple[str, str, float]] = ()) -> Table:
    """Places with their share, and the evidence of a free signal there over the least of them (nats).

    Where effects are named, the share of the gap that they hold at their places; else how probable a free signal at one
    place alone makes it.

    ``named``: of the named effects.
    """
    if not found:
        return EMPTY
    value = np.array([place.log_likelihood for place in found])
    evidence = {(p.location, p.kind): float(v - value.min()) for p, v in zip(found, value)}
    share = dict(zip(evidence, softmax(value).tolist()))
    if named:
        share = dict.fromkeys(evidence, 0.0)
        for location, kind, part in named:
            share[location, kind] = share.get((location, kind), 0.0) + float(np.nan_to_num(part))
    rows = [
        {"location": place[0], "kind": place[1], "share": share[place], "evidence": evidence.get(place, float("nan"))}
        for place in sorted(share, key=lambda place: -share[place])
    ]
    return Table(tuple(rows))


def by_frequency(record: Record, before: np.ndarray, floor: np.ndarray) -> Table:
    """Power of the free-run error in bands of frequency, beside that of the sensor noise."""
    spread = record.spread
    error = record.residual(before) / spread[:, None]
    if record.known is not None:
        error = bridged(error, record.known, record.starts)
    longest = int(min(LONGEST_PIECE, record.lengths.min()))
    if longest < SHORTEST_PIECE:
        return EMPTY
    total, frequency = 0.0, np.zeros(0)
    for a, n in zip(record.starts, record.lengths):
        frequency, density = welch(error[:, a : a + n], fs=1.0 / record.dt, nperseg=longest, detrend=False, axis=1)
        total = total + density.sum(axis=0) * n / record.n_samples
    width = frequency[1]
    noise = 2.0 * record.dt * float(np.sum((floor / spread) ** 2))
    edges = np.unique(np.r_[0.0, np.geomspace(1.5 * width, frequency[-1] + width, BANDS)])
    rows = []
    for a, z in zip(edges[:-1], edges[1:]):
        inside = (frequency >= a) & (frequency < z)
        if inside.any():
            band = {"low": float(a), "high": float(min(z, frequency[-1]))}
            power = float(np.sum(np.asarray(total)[inside]) * width)
            rows.append({**band, "gap": power, "noise": noise * float(inside.sum()) * width})
    beyond = [max(row["gap"] - row["noise"], 0.0) for row in rows]
    whole = sum(beyond)
    return Table(tuple({**row, "share": part / whole if whole > 0 else 0.0} for row, part in zip(rows, beyond)))
