"""Where the gap lies: by output, location, region, time and frequency; never by slicing the accumulated free-run error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch
from sklearn.tree import DecisionTreeRegressor

from sksurrogate.gap._problem import Problem
from sksurrogate.gap._report import Shrink, Table
from sksurrogate.gap._unknown import LatentForce, Place, features, folds
from sksurrogate.kernels.record import Record

__all__ = ["by_frequency", "by_location", "by_output", "by_region", "by_time"]


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


def by_location(found: Sequence[Place]) -> Table:
    """Places with their evidence over the best of the others, as shares that sum to one."""
    if not found:
        return Table()
    value = np.array([place.log_likelihood for place in found])
    weight = np.exp(np.clip(value - value.max(), -700, 0))
    weight /= weight.sum()
    return Table(
        tuple(
            {
                "location": p.location,
                "kind": p.kind,
                "share": float(w),
                "evidence": float(p.log_likelihood - value.min()),
            }
            for p, w in zip(found, weight)
        )
    )


def by_region(problem: Problem, latent: LatentForce) -> Table:
    """A few rules over states and inputs with the share of the latent force's power there; an honest tree.

    Grown on half of the runs, measured on the other half.
    """
    Z, names = features(problem, latent.x)
    b = int(np.argmax(latent.size))
    power = latent.force[b] ** 2
    total = float(power.sum())
    if not total > 0:
        return Table()
    grow = folds(problem.record, 2) == 0
    if grow.all() or not grow.any():
        grow = np.arange(len(power)) % 2 == 0
    tree = DecisionTreeRegressor(max_depth=2, min_samples_leaf=max(20, len(power) // 25)).fit(Z[grow], power[grow])
    leaf = tree.apply(Z[~grow])
    rules = _rules(tree, names)
    judged = float(power[~grow].sum())
    rows = []
    for node, rule in rules.items():
        inside = leaf == node
        rows.append(
            {"rule": rule, "share": float(power[~grow][inside].sum() / judged), "samples": float(inside.mean())}
        )
    rows.sort(key=lambda row: -float(str(row["share"])) / max(float(str(row["samples"])), 1e-9))
    return Table(tuple(rows))


def _rules(tree: DecisionTreeRegressor, names: Sequence[str]) -> dict[int, str]:
    """Readable rule of every leaf."""
    t, out = tree.tree_, {}

    def walk(node: int, conditions: list[str]) -> None:
        if t.children_left[node] < 0:
            out[node] = " and ".join(conditions) or "everywhere"
            return
        name, cut = names[t.feature[node]], t.threshold[node]
        walk(t.children_left[node], [*conditions, f"{name} <= {cut:.4g}"])
        walk(t.children_right[node], [*conditions, f"{name} > {cut:.4g}"])

    walk(0, [])
    return out


def by_time(problem: Problem, latent: LatentForce, n_blocks: int = 12) -> Table:
    """Level of the latent force in blocks of time since the start of the run, and whether it changes or drifts."""
    record = problem.record
    b = int(np.argmax(latent.size))
    w = latent.force[b]
    age = record.t - record.t[record.starts][record.run_of_row]
    edges = np.linspace(0.0, float(age.max()) + record.dt, n_blocks + 1)
    block = np.clip(np.searchsorted(edges, age, side="right") - 1, 0, n_blocks - 1)
    n = np.maximum(np.bincount(block, minlength=n_blocks), 1)
    mean = np.bincount(block, w, n_blocks) / n
    level = np.sqrt(np.bincount(block, w**2, n_blocks) / n)
    kind, cut = _change(mean, level)
    if kind == "change":
        spans = [(0, cut), (cut, n_blocks)]
    else:
        spans = [(0, n_blocks)] if kind == "constant" else [(i, i + 1) for i in range(0, n_blocks)]
    return Table(
        tuple(
            {
                "start": float(edges[a]),
                "stop": float(edges[z]),
                "level": float(np.sqrt(np.mean(level[a:z] ** 2))),
                "kind": kind,
            }
            for a, z in spans
        )
    )


def _change(mean: np.ndarray, level: np.ndarray) -> tuple[str, int]:
    """One jump, one slope, or neither: by residual sums of squares over blocks with their price."""
    best: tuple[float, str, int] = (np.inf, "constant", 0)
    n = len(mean)
    for series in (mean, np.log(np.maximum(level, 1e-300))):
        flat = float(np.sum((series - series.mean()) ** 2)) + 1e-300
        line = np.polyval(np.polyfit(np.arange(n), series, 1), np.arange(n))
        trials = [(float(np.sum((series - line) ** 2)), "drift", 0)]
        for cut in range(2, n - 1):
            trials.append(
                (
                    float(
                        np.sum((series[:cut] - series[:cut].mean()) ** 2)
                        + np.sum((series[cut:] - series[cut:].mean()) ** 2)
                    ),
                    "change",
                    cut,
                )
            )
        for rss, kind, cut in trials:
            gain = rss / flat
            if gain < 0.2 and gain < best[0]:
                best = (gain, kind, cut)
    return best[1], best[2]


def by_frequency(record: Record, before: np.ndarray, floor: np.ndarray, n_bands: int = 6) -> Table:
    """Power of the free-run error in bands of frequency, beside that of the sensor noise."""
    spread = np.maximum(np.std(record.y, axis=1), 1e-300)
    error = (record.y - before) / spread[:, None]
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
