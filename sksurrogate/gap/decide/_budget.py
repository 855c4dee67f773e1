"""The budget of the gap: shares of its power on runs left out, and what remains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.results._effect_estimate import BAND
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.results._remainder import Remainder
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.gap.unnamed._law_left import LawLeft


def budget_of(
    names: Sequence[str],
    shares: Sequence[float],
    retuning: float,
    shrink: Shrink,
    law: LawLeft | None,
    formula: Law | None = None,
) -> Table:
    """Shares of the gap's power on runs left out, which add up to one; no rows where there is no gap.

    What is named and re-tuned closes ``1 - gap_after^2 / gap_before^2``; of the rest the law without a name makes up its
    posterior mean square, the disturbance the remainder.

    ``names``: of the effects, readable.
    ``shares``: their shares of the gap's power.
    ``retuning``: that of the re-tuned parameters.
    ``law``: the law beside what is named.
    ``formula``: where it is certified, what it closes on runs left out is a row of its own, a part of the unnamed law.
    Returns part, kind ("effect", "re-tuning", "unnamed law" or "disturbance"), share, low, high (90 %).

    >>> shrink = Shrink(0.5, 0.1, 0.02, 0.8, (0.7, 0.9), fraction_power=0.96)
    >>> [(row["kind"], round(row["share"], 3)) for row in budget_of(["friction"], [0.96], 0.0, shrink, None)]
    [('effect', 0.96), ('re-tuning', 0.0), ('unnamed law', 0.0), ('disturbance', 0.04)]
    """
    if not np.isfinite(shrink.fraction_power):
        return EMPTY
    closed = float(np.clip(sum(shares) + retuning, 0.0, 1.0))
    ends = [1.0 - (1.0 - end) ** 2 if np.isfinite(end) else closed for end in shrink.interval]
    below, above = (max(closed - min(ends), 0.0), max(max(ends) - closed, 0.0))
    scale = closed / max(sum(shares) + retuning, 1e-300)
    rows = []
    for part, kind, share in [
        *((name, "effect", s) for name, s in zip(names, shares)),
        ("re-tuning", "re-tuning", retuning),
    ]:
        own = share * scale
        part_of = own / closed if closed > 0 else 0.0
        rows.append(_row(part, kind, own, part_of * below, part_of * above))
    rest = 1.0 - closed
    size, spread = (law.size, law.spread) if law is not None else (0.0, 0.0)
    lawful = min(size**2, rest)
    low = min(max(size - BAND * spread, 0.0) ** 2, rest)
    high = min((size + BAND * spread) ** 2, rest + below)
    if formula is not None and formula.certified and np.isfinite(formula.share):
        known = float(np.clip(formula.share, 0.0, rest))
        rows.append(_row(f"law: {formula}", "unnamed law", known, below, above))
        lawful, low, high = (max(value - known, 0.0) for value in (lawful, low, high))
        rest -= known
        lawful = min(lawful, rest)
    rows.append(_row("unnamed law", "unnamed law", lawful, lawful - low, max(high - lawful, 0.0)))
    left = rest - lawful
    rows.append(_row("disturbance", "disturbance", left, above + max(high - lawful, 0.0), below + lawful - low))
    return Table(tuple(rows))


def _row(part: str, kind: str, share: float, below: float, above: float) -> dict[str, object]:
    """One row; the interval stays within 0 and 1."""
    low, high = max(share - below, 0.0), min(share + above, 1.0)
    return {"part": part, "kind": kind, "share": float(share), "low": float(low), "high": float(high)}


def remainder_of(shrink: Shrink, share: float, over_noise: float, law: LawLeft | None) -> Remainder:
    """What is left beside everything that is named; a law is no more than that."""
    if law is None:
        return Remainder(share, shrink.after, over_noise)
    size, spread = np.clip((law.size, law.spread), 0.0, max(share, 0.0)).tolist()
    return Remainder(
        share, shrink.after, over_noise, size, spread, law.probability, law.location, law.kind, law.variable
    )
