"""Where the gap lies, as tables: by output, location, region, time and frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import welch
from sklearn.tree import DecisionTreeRegressor

from sksurrogate.gap.fit._record_parts import row_folds
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.kernels.record import Record, bridged

#: Share of the size of the force that a tree must explain on the other half of the runs before regions are named, and
#: what a further split must add.
LEAST_GAIN, FURTHER_GAIN = 0.10, 0.03
#: Blocks of time in which changes are looked for.
N_BLOCKS = 12


def by_output(shrink: Shrink) -> Table:
    """Gap of every output above its noise, in its units, and its share of the whole."""
    gaps = [np.sqrt(max(row["before"] ** 2 - row["floor"] ** 2, 0.0)) for row in shrink.by_output]
    relative = [gap**2 / max(row["floor"], 1e-300) ** 2 for gap, row in zip(gaps, shrink.by_output)]
    total = sum(relative)
    return Table(
        tuple(
            {
                "output": row["output"],
                "gap": float(gap),
                "noise": row["floor"],
                "share": float(part / total) if total > 0 else 0.0,
            }
            for row, gap, part in zip(shrink.by_output, gaps, relative)
        )
    )


def named_places(effects: Sequence[EffectEstimate], kinds: Mapping[tuple, str]) -> list[tuple[str, str, float]]:
    """Location, kind and share of the gap of every named effect; parameters where ``kinds`` (by key) knows none."""
    keys = [(effect.name, effect.location, effect.variable) for effect in effects]
    return [(effect.location, kinds.get(key, "parameter"), effect.share) for effect, key in zip(effects, keys)]


def by_location(found: Sequence[Place], named: Sequence[tuple[str, str, float]] = ()) -> Table:
    """Places with their share, and the evidence of a free signal there over the least of them (nats).

    Where effects are named, the share of the gap that they hold at their places; else how probable a free signal at one
    place alone makes it.

    Parameters
    ----------
    named : sequence of (location, kind, share)
        Of the named effects.
    """
    if not found:
        return Table()
    value = np.array([place.log_likelihood for place in found])
    weight = np.exp(np.clip(value - value.max(), -700, 0))
    evidence = {(p.location, p.kind): float(v - value.min()) for p, v in zip(found, value)}
    share = dict(zip(evidence, (float(w) for w in weight / weight.sum())))
    if named:
        share = dict.fromkeys(evidence, 0.0)
        for location, kind, part in named:
            share[location, kind] = share.get((location, kind), 0.0) + float(np.nan_to_num(part))
    rows = [
        {"location": place[0], "kind": place[1], "share": share[place], "evidence": evidence.get(place, float("nan"))}
        for place in sorted(share, key=lambda place: -share[place])
    ]
    return Table(tuple(rows))


def regions(record: Record, Z: np.ndarray, names: Sequence[str], w: np.ndarray) -> Table:
    """A few rules over states and inputs with the share of the latent force's power there; an honest tree.

    Grown on half of the runs, judged on the other half: a split stays only where it tells there how strong the force is.

    Parameters
    ----------
    Z : ndarray (n_samples, n_variables)
        States and inputs, named by ``names``.
    w : ndarray (n_samples,)
        Latent force.
    """
    size = np.abs(w)
    if not np.any(size > 0):
        return Table()
    grow = row_folds(record, 2) == 0
    if grow.all() or not grow.any():
        grow = np.arange(len(w)) % 2 == 0
    best: tuple[float, DecisionTreeRegressor | None] = (LEAST_GAIN, None)
    for leaves in (2, 3, 4):
        tree = DecisionTreeRegressor(max_leaf_nodes=leaves, min_samples_leaf=max(20, len(w) // 25), random_state=0).fit(
            Z[grow], size[grow]
        )
        total = float(np.sum((size[~grow] - size[grow].mean()) ** 2))
        explained = 1.0 - float(np.sum((size[~grow] - tree.predict(Z[~grow])) ** 2)) / max(total, 1e-300)
        if explained > best[0] + (FURTHER_GAIN if best[1] is not None else 0.0):
            best = (explained, tree)
    power = w**2 / np.sum(w**2)
    if best[1] is None:
        return Table(({"rule": "everywhere", "share": 1.0, "samples": 1.0},))
    leaf = best[1].apply(Z)
    rows = [
        {"rule": rule, "share": float(power[leaf == node].sum()), "samples": float(np.mean(leaf == node))}
        for node, rule in _rules(best[1], names).items()
    ]
    rows.sort(key=lambda row: -float(str(row["share"])) / max(float(str(row["samples"])), 1e-9))
    return Table(tuple(rows))


def _rules(tree: DecisionTreeRegressor, names: Sequence[str]) -> dict[int, str]:
    """Readable rule of every leaf: one condition below and one above for each variable."""
    t, out = tree.tree_, {}

    def walk(node: int, below: dict[str, float], above: dict[str, float]) -> None:
        if t.children_left[node] < 0:
            both = [
                part
                for name in dict.fromkeys([*above, *below])
                for part in (
                    *([f"{name} > {above[name]:.4g}"] if name in above else []),
                    *([f"{name} <= {below[name]:.4g}"] if name in below else []),
                )
            ]
            out[node] = " and ".join(both) or "everywhere"
            return
        name, cut = names[t.feature[node]], float(t.threshold[node])
        walk(t.children_left[node], {**below, name: min(cut, below.get(name, cut))}, above)
        walk(t.children_right[node], below, {**above, name: max(cut, above.get(name, cut))})

    walk(0, {}, {})
    return out


def times(record: Record, w: np.ndarray) -> Table:
    """Level of the latent force over the time since the start of the run: constant, one change, or a drift.

    Where the force changes from run to run instead, a line a run.
    """
    age = record.t - record.t[record.starts][record.run_of_row]
    order = np.argsort(age, kind="stable")
    edges = np.linspace(0.0, float(age.max()) + record.dt, N_BLOCKS + 1)
    block = np.clip(np.searchsorted(edges, age, side="right") - 1, 0, N_BLOCKS - 1)
    n = np.maximum(np.bincount(block, minlength=N_BLOCKS), 1)
    mean = np.bincount(block, w, N_BLOCKS) / n
    level = np.sqrt(np.bincount(block, w**2, N_BLOCKS) / n)
    kind, cut, signed = _change(mean, level)
    runs = _by_run(record, w) if kind == "constant" else None
    if runs is not None:
        return runs
    if kind == "change":
        instant = _instant(age[order], w[order] if signed else np.abs(w[order]), edges[cut], edges[1] - edges[0])
        spans = [(0.0, instant), (instant, float(edges[-1]))]
    elif kind == "constant":
        spans = [(0.0, float(edges[-1]))]
    else:
        spans = list(zip(edges[:-1].tolist(), edges[1:].tolist()))
    rows = []
    for a, z in spans:
        inside = (age >= a) & (age < z)
        if inside.any():
            rows.append(
                {"start": a, "stop": z, "level": float(np.sqrt(np.mean(w[inside] ** 2))), "kind": kind, "runs": "all"}
            )
    return Table(tuple(rows))


def _by_run(record: Record, w: np.ndarray) -> Table | None:
    """The runs before and after a change between runs, counted from 1 (a record has no labels); None where all are alike."""
    n_runs = len(record.starts)
    if n_runs < 4:
        return None
    mean = np.add.reduceat(w, record.starts) / record.lengths
    level = np.sqrt(np.add.reduceat(w**2, record.starts) / record.lengths)
    best: tuple[float, int] = (0.1, 0)
    for series in (mean, np.log(np.maximum(level, 1e-300))):
        flat = float(np.sum((series - series.mean()) ** 2)) + 1e-300
        for cut in range(1, n_runs):
            rest = sum(float(np.sum((part - part.mean()) ** 2)) for part in (series[:cut], series[cut:]))
            if rest / flat < best[0]:
                best = (rest / flat, cut)
    cut = best[1]
    power = [float(np.mean(level[:cut] ** 2)), float(np.mean(level[cut:] ** 2))] if cut else [1.0, 1.0]
    if not cut or max(power) < 9.0 * min(power):
        return None
    stop = float(np.max(record.lengths)) * record.dt
    return Table(
        tuple(
            {
                "start": 0.0,
                "stop": stop,
                "level": float(np.sqrt(value)),
                "kind": "change between runs",
                "runs": f"{first} to {last}" if first < last else str(first),
            }
            for value, (first, last) in zip(power, ((1, cut), (cut + 1, n_runs)))
        )
    )


def _instant(age: np.ndarray, z: np.ndarray, guess: float, width: float) -> float:
    """The moment within two blocks of a guess that parts a series best into two levels."""
    moments, place = np.unique(age, return_index=True)
    total, count = np.cumsum(z), np.arange(1, len(z) + 1)
    square = np.cumsum(z**2)
    best = (np.inf, guess)
    for moment, k in zip(moments, place):
        if abs(moment - guess) > 2.0 * width or not 0 < k < len(z):
            continue
        before = square[k - 1] - total[k - 1] ** 2 / count[k - 1]
        n = len(z) - k
        after = square[-1] - square[k - 1] - (total[-1] - total[k - 1]) ** 2 / n
        best = min(best, (float(before + after), float(moment)))
    return best[1]


def _change(mean: np.ndarray, level: np.ndarray) -> tuple[str, int, bool]:
    """One jump, one slope, or neither, by residual sums of squares over blocks; whether the mean (not the size) says so."""
    best: tuple[float, str, int, bool] = (0.2, "constant", 0, True)
    n = len(mean)
    for series, signed in ((mean, True), (np.log(np.maximum(level, 1e-300)), False)):
        flat = float(np.sum((series - series.mean()) ** 2)) + 1e-300
        if signed and flat < 0.25 * float(np.sum(level**2)):
            continue
        if not signed and np.max(level) < 2.0 * np.min(level):
            continue
        line = np.polyval(np.polyfit(np.arange(n), series, 1), np.arange(n))
        trials = [(float(np.sum((series - line) ** 2)), "drift", 0)]
        for cut in range(1, n):
            parts = (series[:cut], series[cut:])
            trials.append((sum(float(np.sum((p - p.mean()) ** 2)) for p in parts), "change", cut))
        for rss, kind, cut in trials:
            if rss / flat < best[0]:
                best = (rss / flat, kind, cut, signed)
    return best[1], best[2], best[3]


def by_frequency(record: Record, before: np.ndarray, floor: np.ndarray, n_bands: int = 6) -> Table:
    """Power of the free-run error in bands of frequency, beside that of the sensor noise."""
    spread = record.spread
    error = record.residual(before) / spread[:, None]
    if record.known is not None:
        error = bridged(error, record.known, record.starts)
    longest = int(min(256, record.lengths.min()))
    if longest < 16:
        return Table()
    total, frequency = 0.0, np.zeros(0)
    for a, n in zip(record.starts, record.lengths):
        frequency, density = welch(error[:, a : a + n], fs=1.0 / record.dt, nperseg=longest, detrend=False, axis=1)
        total = total + density.sum(axis=0) * n / record.n_samples
    width = frequency[1]
    noise = 2.0 * record.dt * float(np.sum((floor / spread) ** 2))
    edges = np.unique(np.r_[0.0, np.geomspace(1.5 * width, frequency[-1] + width, n_bands)])
    rows = []
    for a, z in zip(edges[:-1], edges[1:]):
        inside = (frequency >= a) & (frequency < z)
        if inside.any():
            power = float(np.sum(np.asarray(total)[inside]) * width)
            rows.append(
                {
                    "low": float(a),
                    "high": float(min(z, frequency[-1])),
                    "gap": power,
                    "noise": noise * float(inside.sum()) * width,
                }
            )
    whole = sum(max(row["gap"] - row["noise"], 0.0) for row in rows)
    return Table(
        tuple({**row, "share": max(row["gap"] - row["noise"], 0.0) / whole if whole > 0 else 0.0} for row in rows)
    )
