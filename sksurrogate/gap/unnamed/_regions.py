"""Regions of states and inputs in which a force is large: a few rules that hold on the other half of the runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from sklearn.tree import DecisionTreeRegressor

from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.kernels.record import Record

#: Share of the size of the force that a tree must explain on the other half of the runs before regions are named, and
#: what a further split must add.
LEAST_GAIN, FURTHER_GAIN = 0.10, 0.03
#: Numbers of regions that are tried: more are no sentence any longer.
LEAVES = (2, 3, 4)
#: Samples of the smallest region, and what share of all it must hold, as one over a number.
FEWEST_IN_REGION, MOST_REGIONS = 20, 25


def regions(record: Record, signals: Mapping[str, np.ndarray], w: np.ndarray) -> Table:
    """A few rules over states and inputs with the share of a signal's power there; an honest tree.

    Grown on half of the runs, judged on the other half: a split stays only where it tells there how strong the force is.

    ``signals`` (n_samples,): states and inputs.
    ``w`` (n_samples,): the signal.
    """
    Z, size = np.stack(list(signals.values()), axis=1), np.abs(w)
    if not np.any(size > 0):
        return EMPTY
    grow = _half(record)
    best, gain = None, LEAST_GAIN
    for leaves in LEAVES:
        tree = DecisionTreeRegressor(
            max_leaf_nodes=leaves, min_samples_leaf=max(FEWEST_IN_REGION, len(w) // MOST_REGIONS), random_state=0
        ).fit(Z[grow], size[grow])
        total = float(np.sum((size[~grow] - size[grow].mean()) ** 2))
        explained = 1.0 - float(np.sum((size[~grow] - tree.predict(Z[~grow])) ** 2)) / max(total, 1e-300)
        if explained > gain + (FURTHER_GAIN if best is not None else 0.0):
            best, gain = tree, explained
    if best is None:
        return Table(({"rule": "everywhere", "share": 1.0, "samples": 1.0},))
    power, leaf = w**2 / np.sum(w**2), best.apply(Z)
    rows: list[dict[str, Any]] = [
        {"rule": rule, "share": float(power[leaf == node].sum()), "samples": float(np.mean(leaf == node))}
        for node, rule in _rules(best, list(signals)).items()
    ]
    rows.sort(key=lambda row: -row["share"] / max(row["samples"], 1e-9))
    return Table(tuple(rows))


def _half(record: Record) -> np.ndarray:
    """Every other run (n_samples,), every other quarter of a single one."""
    if len(record.starts) > 1:
        return record.run_of_row % 2 == 0
    return (np.arange(record.n_samples) * 4 // record.n_samples) % 2 == 0


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
