"""Effects that begin or end: windows of time are tried where what is missing is confined to a part of the runs."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._onset import EDGE_SHARES, WINDOW_SHARES, Starting, can_start, starting
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, HALF_THE_POWER
from sksurrogate.gap.fit._evidence import CERTAIN
from sksurrogate.gap.fit._normal_equations import project_starts
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.screen._pairs import COLLINEAR
from sksurrogate.gap.screen._screen import Screen, grown, grows
from sksurrogate.gap.search._base import Wanted
from sksurrogate.gap.search._expander import Expander
from sksurrogate.gap.search._nested import richer
from sksurrogate.gap.search._related_forms import PlainForm, as_good, in_plainer_form
from sksurrogate.gap.search._stopping import grows_in_vain, in_vain_from
from sksurrogate.kernels.record import ages_of

#: Effects that are tried in a window, and columns of the screen that are looked at for them.
MOST_WINDOWED, MOST_ONSET_COLUMNS = 6, 200
#: A window is worth a fit where it explains this much more of the squared residual than the same effect always does, or leaves less
#: than this share of what that leaves.
LENGTHENED, MOST_REMAINING = 1.05, 0.5
#: What a window may have.
SPANS = (("onset",), ("end",), ("onset", "end"))

#: Drop of the squared residual by every effect, (n_effects,), by what the window has.
Drops: TypeAlias = dict[tuple[str, ...], np.ndarray]


class Confined(NamedTuple):
    """An effect that explains more within a window."""

    effect: BaseEffect
    span: tuple[str, ...]  #: One of :data:`SPANS`
    drop: float  #: Drop of the squared residual over the noise, initial states free on both sides of the edge


def confined(screen: Screen, lengths: np.ndarray, least: float) -> list[Confined]:
    """Effects that explain more of the residual within a window than always, the best first.

    Windows of a coarse grid, then finer ones about the best: on the grid a short window looks alike to all effects.

    ``screen``: of the null.
    ``lengths`` (n_runs,): samples of the runs.
    ``least``: drop that a window must reach.
    """
    if screen.columns is None or not len(screen.starts):
        return []
    gain = np.array([start.white for start in screen.starts])
    able = np.flatnonzero([can_start(start.effect) for start in screen.starts])
    order = able[np.argsort(-gain[able])][:MOST_ONSET_COLUMNS]
    if not len(order):
        return []
    about = _Within(screen, order, lengths)
    always, longest = about.drop_of(about.whole), int(lengths.max())
    best, kind = np.zeros(len(order)), np.zeros(len(order), int)
    for found in about.on_a_grid(longest):
        for span, drop in found.items():
            better = _worth_more(drop, best, about.total) if len(span) > 1 else drop > best
            best, kind = np.where(better, drop, best), np.where(better, SPANS.index(span), kind)
    for found in about.nearer(longest):
        for span, drop in found.items():
            better = (drop > best) & ((kind == SPANS.index(span)) | _worth_more(drop, best, about.total))
            best, kind = np.where(better, drop, best), np.where(better, SPANS.index(span), kind)
    worth = (best > least) & _worth_more(best, always, about.total)
    out: dict = {}
    for k in np.argsort(-best):
        effect = screen.starts[order[k]].effect
        if worth[k] and effect.key not in out:
            out[effect.key] = Confined(effect, SPANS[kind[k]], float(best[k]))
    return list(out.values())


@dataclass(frozen=True, eq=False)
class _Within:
    """What the columns of some effects explain of a residual within windows.

    A state that remembers goes on from where it was at the edge: the columns of the initial states, free on both sides of it,
    stand for that, so that the column of the effect always there tells its answer within the window.
    """

    screen: Screen
    order: np.ndarray  #: Places of the effects among the columns of the screen
    lengths: np.ndarray  #: (n_runs,): samples of the runs
    known: dict[tuple[int, ...], Drops] = field(default_factory=dict)  #: By edges

    @cached_property
    def stack(self) -> np.ndarray:
        """The residual and the columns, (1 + n_effects, n_outputs, n_samples)."""
        assert self.screen.columns is not None
        return np.concatenate([self.screen.known[:1], self.screen.columns[self.order]]).astype(np.float32)

    @cached_property
    def J_x(self) -> np.ndarray:
        """What initial states move the outputs by."""
        return self.screen.J_x.astype(np.float32)

    @cached_property
    def ages(self) -> np.ndarray:
        """Samples since the start of the run, (n_samples,)."""
        return ages_of(self.screen.record_starts, self.stack.shape[-1])

    @cached_property
    def total(self) -> float:
        """Squared residual, initial states free."""
        r = self.whole[0]
        return float(np.sum(r * r))

    @cached_property
    def whole(self) -> np.ndarray:
        """Residual and columns without what initial states of the runs explain."""
        return project_starts(self.stack, self.J_x, self.screen.record_starts)

    def drop_of(self, parts: np.ndarray) -> np.ndarray:
        """Drop of the squared residual by every column alone, of one sign where the effect has one."""
        r, columns = parts[0].ravel(), parts[1:].reshape(len(parts) - 1, -1)
        g, h = columns @ r, np.einsum("kn,kn->k", columns, columns)
        g = np.where(self.screen.low[self.order] < 0.0, g, np.maximum(g, 0.0))
        return np.asarray(g**2 / np.maximum(h, 1e-12), dtype=float)

    def drops(self, edges: tuple[int, ...]) -> Drops:
        """Drop by every effect within the windows that one edge or two make (samples), what is free at the edges paid."""
        starts, later = self.screen.record_starts, self.ages >= edges[0]
        inner = [(starts + edge)[self.lengths > edge + len(self.J_x[0])] for edge in edges]
        parts = project_starts(self.stack, self.J_x, np.sort(np.concatenate([starts, *inner])))
        r = parts[0]
        restarted = self.total - float(np.sum(r * r)) - self.J_x.shape[1] * np.log(r.size) * sum(map(len, inner))
        one, both = {("onset",): later, ("end",): ~later}, {("onset", "end"): later & (self.ages < edges[-1])}
        windows = one if len(edges) == 1 else both
        return {span: restarted + self.drop_of(parts[:, :, rows]) for span, rows in windows.items()}

    def on_a_grid(self, longest: int) -> Iterator[Drops]:
        """Drops within the windows of the grid: of one edge, then of two."""
        yield from (self.within(max(int(share * longest), 1)) for share in EDGE_SHARES)
        both = ([max(int(share * longest), 1) for share in pair] for pair in WINDOW_SHARES)
        yield from (self.within(*edges) for edges in both if edges[0] < edges[1])

    def nearer(self, longest: int) -> Iterator[Drops]:
        """Drops within windows about the best of the grid: edges moved by shorter and shorter steps to where the best effect explains most."""
        step, best = int(longest * (EDGE_SHARES[1] - EDGE_SHARES[0])), max(self.known, key=self.most)
        while step >= 1:
            ways = itertools.product((-step, 0, step), repeat=len(best))
            moved = [tuple(edge + by for edge, by in zip(best, way)) for way in ways]
            able = [one for one in moved if one[0] > 0 and one[-1] < longest and one[0] < one[-1] + (len(one) < 2)]
            yield from [self.within(*one) for one in able if one not in self.known]
            other = max((best, *able), key=self.most)
            step, best = (step // 2 if other == best else step), other

    def within(self, *edges: int) -> Drops:
        """Drops within the windows that one edge or two make (samples), computed once."""
        if edges not in self.known:
            self.known[edges] = self.drops(edges)
        return self.known[edges]

    def most(self, edges: tuple[int, ...]) -> float:
        """Of the drops within these windows the largest."""
        return max(float(drop.max()) for drop in self.known[edges].values())


def twins_with_onset(screen: Screen, effect: BaseEffect, theta: np.ndarray) -> list[tuple[BaseEffect, np.ndarray]]:
    """Effects within a window that move the outputs as one does that jumps or has this window: a loss that sets in, for a friction
    that jumps, a quadratic drag for a quadratic loss of what stays positive.

    What it is always (a wrong parameter, a constant load; the effect without the window) has a column in the screen of the null, which
    tells the other effects that move the outputs as it does; none where it was not a candidate. Each comes with the values at which it
    does what the effect does.

    ``theta`` (n_params,): of the effect: its size, and the time of the jump or the window.
    """
    jumps = [parameter.name for parameter in effect.parameters[1:]] == ["time"]
    windowed = isinstance(effect, Starting) and len(effect.parameters) == 1 + len(effect.span)
    if screen.columns is None or not (jumps or windowed):
        return []
    span = effect.span if isinstance(effect, Starting) else ("onset",)
    always = [
        k
        for k, start in enumerate(screen.starts)
        if (richer(effect, start.effect) if jumps else start.effect.key == effect.key[:3])
    ]
    # a constant load that begins is the jump by another name
    others = [k for k in range(len(screen.starts)) if k not in always]
    able = [k for k in others if can_start(screen.starts[k].effect) and grows(screen.starts[k].effect)]
    if not always or not able:
        return []
    flat = screen.columns[[always[0], *able]].reshape(1 + len(able), -1)  # initial states hide what was always there
    moved, columns = flat[0] * (theta[0] / screen.starts[always[0]].raw[0]), flat[1:]
    product, size = columns @ moved, np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
    cosine = np.abs(product) / (size * max(float(np.linalg.norm(moved)), 1e-300))
    found = {}
    for j in np.flatnonzero(cosine > COLLINEAR):
        one, raw = screen.starts[able[j]].effect, screen.starts[able[j]].raw
        values = grown(one, raw, product[j] / size[j] ** 2)
        found[one.key] = starting(one, span), np.r_[values, theta[1:]]
    return list(found.values())


def _worth_more(drop: np.ndarray, other: np.ndarray, total: float) -> np.ndarray:
    """Whether something explains enough more of a squared residual than something simpler does.

    >>> _worth_more(np.array([60.0, 97.5, 95.0]), np.array([50.0, 94.0, 94.0]), 100.0)
    array([ True,  True, False])
    """
    return np.asarray((drop > LENGTHENED * other) | (total - drop < MOST_REMAINING * (total - other)))


def fewer_with_a_time(one: OdeCandidate, other: OdeCandidate) -> bool:
    """Whether a set takes the place of a larger one whose time was looked for as its own was: an error that ends, for an error that a
    jump takes back."""
    timed = any(parameter.jumps for effect in other.effects for parameter in effect.parameters)
    return timed and len(one.effects) < len(other.effects)


def _bases(search: Expander) -> list[tuple[OdeCandidate, Screen]]:
    """The simulator alone with its screen, re-tuned and as it is given: a re-tuning to the whole record spreads over it what began within."""
    null = search.fitted_null.candidate
    if search.first_screen is None:  # what is asked has changed since
        search.base_and_screen(null)
    assert search.first_screen is not None
    given = null.at_nominal() if search.problem.free else None
    return [(null, search.first_screen), *([search.base_and_screen(given, search.asked)] if given is not None else [])]


def _promising(base: OdeCandidate, about: Screen, search: Expander, most: float) -> dict[Any, Starting]:
    """The best effects within a window that are expected to leave at most so much; what seems to end may go on to where the runs end."""
    found = confined(about, search.problem.record.lengths, search.needed_gain(2))[:MOST_WINDOWED]
    near = [one for one in found if base.fit.cost - one.drop < most]
    windows = [starting(one.effect, span) for one in near for span in dict.fromkeys((one.span, one.span[:1]))]
    return {one.key: one for one in windows}


def always_there(search: Expander, candidate: OdeCandidate) -> OdeCandidate:
    """A set without the windows that it does not need, fitted from where it stands: in a window an effect may have found its values."""

    def without_window(effect: BaseEffect, theta: np.ndarray) -> PlainForm | None:
        forms = [e for e in search.library if isinstance(effect, Starting) and e.key == effect.key[:-1]]
        return (forms[0], np.asarray(effect.own(theta))) if forms else None  # type: ignore[attr-defined]

    return in_plainer_form(search, candidate, without_window, lambda one, other: as_good(search, one, other))


def look_for_onsets(search: Expander) -> None:
    """Where what stands leaves something, or takes several names: the best effects in windows of time in its place.

    One effect that is always there and leaves the noise is not asked, nor where one law explains the gap that is always there: no window
    could earn its price. Nor are windows that would leave most of what the simulator alone leaves and hardly less than what stands.
    """
    null, final = search.fitted_null, search.standing
    explained = final.left < AT_THE_NOISE
    if null.left < AT_THE_NOISE or (explained and len(final.effects) == 1) or search.of_signals is not None:
        return
    # edges lie apart here, and the screen is linear: up to half of what the null leaves (power) may be theirs
    most = max(in_vain_from(final.candidate, null.candidate), HALF_THE_POWER**2 * null.fit.cost)
    if len(final.effects) == 1 and final.candidate.fit.cost < search.tolerated_cost:
        # an edge just before that of an effect which always being there nearly tells leaves no more than that
        most = min(most, final.candidate.fit.cost)
    windowed: dict[Any, Starting] = {}
    trial: list[OdeCandidate] = []
    for base, about in _bases(search):
        promising = _promising(base, about, search, most)
        if promising:
            search.report("effects that begin or end within the runs")
            least = about.left_by[0] - most
            trial += search.expand(base, Wanted(len(promising), 2, list(promising.values()), least=least))
            windowed |= promising
    trial = search.ranked(trial, null.candidate)
    if not trial:
        return
    n_windows = sum(len(WINDOW_SHARES if len(one.span) > 1 else EDGE_SHARES) for one in windowed.values())
    top = always_there(search, search.best_polished(trial))
    stands = final.candidate
    worth = search.order([top, stands])
    price = 0.0 if fewer_with_a_time(top, stands) else CERTAIN + 2.0 * np.log(n_windows)
    if 2.0 * (worth(top) - worth(stands)) < price or grows_in_vain(top, stands, null.candidate):
        return
    search.library.extend(windowed.values())
    search.stand(top)
    if search.judged[top].left > AT_THE_NOISE:
        better = search.one_more(top, True)
        if better is not None:
            search.stand(better)
