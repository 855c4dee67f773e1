"""Pairs of effects that together leave least, by the Gram of one linearisation: two that hide each other are seen."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._normal_equations import eliminate_rows, inverse, project_in_place, start_bases
from sksurrogate.gap.screen._screen import Screen, Start, grown, grows

#: Pairs with one effect in common.
MOST_WITH_ONE = 3
#: Columns that are paired with one another: the work grows with their square.
MOST_PAIRED = 1500
#: Columns closer than this (cosine) are one column.
COLLINEAR = 0.9999


class Pair(NamedTuple):
    """Two effects at the starting values at which they remove most together."""

    first: Start
    second: Start
    drop: float  #: Of the squared residual over the noise

    @property
    def effects(self) -> tuple[BaseEffect, BaseEffect]:
        """Both of them."""
        return self.first.effect, self.second.effect


def best_pairs(screen: Screen, most: int) -> list[Pair]:
    """The pairs of effects whose columns together remove most of the residual, each pair at its best starting values.

    ``most``: number of pairs.
    Returns best first; no effect stands in more than :data:`MOST_WITH_ONE` of them. None about a path that left the finite numbers.
    """
    keys = list(dict.fromkeys(start.effect.key for start in screen.starts))
    if len(keys) < 2 or screen.columns is None or not np.isfinite(screen.known).all():
        return []
    screen = with_columns(
        screen, paired([start.effect.key for start in screen.starts], [start.white for start in screen.starts])
    )
    columns, place = _Columns.of(screen), {key: i for i, key in enumerate(keys)}
    owner = np.array([place[start.effect.key] for start in screen.starts])
    of_key = [np.flatnonzero(owner == i) for i in range(len(keys))]
    best = np.full((len(keys), len(keys)), -np.inf)
    for i, mine in enumerate(of_key):
        np.maximum.at(best[i], owner, columns.with_all(mine)[0].max(axis=0))
    first, second = np.triu_indices(len(keys), 1)
    order = np.argsort(-best[first, second], kind="stable")
    used = np.zeros(len(keys), int)
    out: list[Pair] = []
    for i, j in zip(first[order], second[order]):
        if len(out) == most or not np.isfinite(best[i, j]):
            break
        if max(used[i], used[j]) >= MOST_WITH_ONE:
            continue
        used[[i, j]] += 1
        mine, other = of_key[i], of_key[j]
        drop, a, b = (values[:, other] for values in columns.with_all(mine))
        p, q = np.unravel_index(np.argmax(drop), drop.shape)
        out.append(Pair(_at(screen, mine[p], a[p, q]), _at(screen, other[q], b[p, q]), float(drop[p, q])))
    return out


def beside(screen: Screen, base: Screen, taken: Collection[Any]) -> Screen:
    """A screen of the null with what a ``base`` leaves, without the effects that are ``taken``.

    Both linearisations follow the measured trajectory, so the columns of the null are near to those of the base.
    """
    if screen.columns is None:
        return screen
    kept = with_columns(screen, [k for k, start in enumerate(screen.starts) if start.effect.key not in taken])
    return replace(base, starts=kept.starts, columns=kept.columns, low=kept.low, high=kept.high)


def with_columns(screen: Screen, kept: Sequence[int]) -> Screen:
    """A screen with some of its columns."""
    assert screen.columns is not None
    if len(kept) == len(screen.starts):
        return screen
    return replace(
        screen,
        starts=[screen.starts[k] for k in kept],
        columns=screen.columns[kept],
        low=screen.low[kept],
        high=screen.high[kept],
    )


def paired(keys: Sequence[Any], drops: Sequence[float], most: int = MOST_PAIRED) -> list[int]:
    """Places of the best starting values of every effect, as many of each as leave ``most`` in all, one at least.

    >>> paired(["lag", "lag", "lag", "loss", "lag"], [1.0, 4.0, 3.0, 0.5, 2.0], most=3)
    [1, 2, 3]
    """
    rank = dict.fromkeys(keys, 0)
    ranks = np.zeros(len(keys), int)
    for k in np.argsort(-np.asarray(drops), kind="stable"):
        ranks[k] = rank[keys[k]]
        rank[keys[k]] += 1
    each = max(int(np.searchsorted(np.cumsum(np.bincount(ranks)), most, side="right")), 1)
    return [int(k) for k in np.flatnonzero(ranks < each)]


@dataclass(frozen=True, eq=False)
class _Columns:
    """Columns of a screen over the noise, initial states projected out (n_starts, n_values); fitted parameters are taken out of products.

    Products of all columns at once would be the square of their number.
    """

    flat: np.ndarray
    cross: np.ndarray
    known: np.ndarray
    g: np.ndarray
    h: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, screen: Screen) -> _Columns:
        """The columns that a screen has kept."""
        assert screen.columns is not None
        few = len(screen.known)
        # Of a fitted parameter: in single precision squares of 1e20 would be infinite. Powers of two add no rounding.
        size = np.abs(screen.known[1:]).max(axis=(1, 2))
        unit = np.exp2(np.frexp(np.where(size > 0.0, size, 1.0))[1])  # 0 of one that these data do not see
        scaled = np.concatenate([screen.known[:1], screen.known[1:] / unit[:, None, None]])
        precision, pull = screen.precision / unit**2, screen.pull / unit
        stack = np.concatenate([scaled.astype(np.float32), screen.columns])
        project_in_place(stack, start_bases(screen.J_x.astype(np.float32), screen.record_starts, stack.shape[-1]))
        flat = stack.reshape(len(stack), -1)
        rows = (flat[:few] @ flat.T).astype(float)
        diagonal = np.einsum("kn,kn->k", flat, flat, dtype=float)
        g, h = eliminate_rows(rows, diagonal, precision, pull)
        known = inverse(rows[1:, 1:few] + np.diag(precision))
        return cls(flat[few:], rows[1:, few:], known, g, np.maximum(h, 1e-300), screen.low, screen.high)

    def with_all(self, some: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Drop of some columns beside every column, and the amplitudes of both, each (n_some, n_starts)."""
        H = (self.flat[some] @ self.flat.T).astype(float) - self.cross[:, some].T @ self.known @ self.cross
        low, high = (side[:, None] for side in (self.low[some], self.high[some]))
        g, h = self.g[some][:, None], self.h[some][:, None]
        with np.errstate(all="ignore"):
            cosine = H / np.sqrt(h * self.h)
            det = h * self.h * np.maximum(1.0 - cosine**2, 1e-12)
            a = np.clip((g * self.h - H * self.g) / det, low, high)
            b = np.clip((self.g - H * a) / self.h, self.low, self.high)
            a = np.clip((g - H * b) / h, low, high)
            drop = 2 * (a * g + b * self.g) - a**2 * h - 2 * a * b * H - b**2 * self.h
        return np.where((np.abs(cosine) < COLLINEAR) & np.isfinite(drop), drop, -np.inf), a, b


def _at(screen: Screen, k: int, amplitude: float) -> Start:
    """The start of one column with the amplitude that it has in the pair."""
    start, theta = screen.starts[k], screen.starts[k].raw.copy()
    if len(theta) and (grows(start.effect) or amplitude < 0.5):
        theta = grown(start.effect, theta, amplitude)
    return replace(start, theta=theta)
