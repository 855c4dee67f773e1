"""The screen: orders the candidates by one linearisation about the smoothed trajectory; it never decides.

Every effect at every starting value gives one column: the change of the outputs that it causes along the smoothed
trajectory. Initial states and the parameters already in the model are projected out of the columns and of the residual;
what a column then explains is its score, once for white noise and once for the noise with forces.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._normal_equations import eliminate, eliminate_rows, inverse, scores, start_coordinates
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.screen._candidate_columns import CandidateColumns, Column
from sksurrogate.gap.screen._left_by_several import left_by_several
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.gap.screen._shortlist import shortlist
from sksurrogate.gap.screen._unseen_starts import score_beside
from sksurrogate.kernels.disturbance import Noise
from sksurrogate.kernels.linear_fit import linear_least_squares

#: Numbers of the null's columns that are kept (single precision).
MOST_NUMBERS_KEPT = 60_000_000
#: Numbers of columns that are held in double precision at one time, and starting values that an effect usually has.
MOST_NUMBERS_AT_ONCE, USUAL_STARTS = 16_000_000, 6
#: Least share of a column's power that counts as beyond what the initial states can make of it.
LOST_TO_ROUNDING = 1e-12
#: A parameter is not started from below this share of its value: at 0 many plants have no free run.
LEAST_FACTOR = 0.2
#: A change of the base beyond so many times the noise cannot be squared: it breaks the arithmetic, and the order.
UNSQUARED = 1e100
#: Columns that are put together to see how far several names lead.
MOST_TOGETHER = 3


@dataclass(frozen=True, eq=False)
class Start:
    """Where the fit of a candidate starts."""

    effect: BaseEffect
    theta: np.ndarray  #: Parameters of the effect
    #: white, forced: Drop of -2 log likelihood that the screen expects, for white noise and for noise with forces
    white: float
    forced: float
    left: float  #: Sum of squares, in units of the noise, that the screen expects to be left
    path: np.ndarray  #: (n_states, n_samples): smoothed trajectory of the base
    evident: bool = False  #: Whether the measurements show it whatever the model says
    hidden: np.ndarray | None = None  #: (n_hidden, n_samples): states of the effect's own along it
    raw: np.ndarray = field(default_factory=lambda: np.zeros(0))  #: Values at which its column was computed

    @property
    def promises(self) -> float:
        """The larger of the two expected drops."""
        return max(self.white, self.forced)

    @property
    def x(self) -> np.ndarray:
        """Trajectory of all states, hidden ones of the effect last."""
        return self.path if self.hidden is None else np.concatenate([self.path, self.hidden])


@dataclass(frozen=True, eq=False)
class Screen:
    """What one linearisation says about all candidates."""

    starts: list[Start]  #: One for each candidate and starting value
    #: (n_starts, n_outputs, n_samples): the columns over the noise, where they are not too large to keep
    columns: np.ndarray | None
    #: (1 + n_theta, n_outputs, n_samples): the residual and the sensitivities of the fitted parameters, over the noise
    known: np.ndarray
    J_x: np.ndarray  #: (n_outputs, n_states, n_samples): sensitivities of the initial states, over the noise
    #: precision, pull: (n_theta,): Gaussian prior on the fitted parameters
    precision: np.ndarray
    pull: np.ndarray
    record_starts: np.ndarray  #: (n_runs,)
    #: low, high: (n_starts,): range in which the amplitude of a column stands for the effect
    low: np.ndarray
    high: np.ndarray
    #: (1 + MOST_TOGETHER,): squares over the noise expected beside the best 0, 1, ... columns together
    left_by: np.ndarray


def _range(columns: Sequence[Column], inputs: Collection[str]) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes that stand for an effect: free where it is linear, within 0.5..2 of the start where not.

    The smallest start of an effect that vanishes at 0 may shrink to nothing: near 0 it is linear.
    """
    linear = np.array([grows(c.effect) for c in columns])
    one_signed = np.array([bool(c.effect.parameters) and not c.effect.either_sign(inputs) for c in columns])
    low = np.where(linear, np.where(one_signed, 0.0, -np.inf), np.where(_smallest(columns), 0.0, 0.5))
    return low, np.where(linear, np.inf, 2.0)


def screen(
    candidates: Sequence[BaseEffect],
    base: OdeCandidate,
    x: np.ndarray,
    noise: Noise | None,
    shape: tuple[float, ...] = (),
    first: Screen | None = None,
    second: WorkerProcess | None = None,
) -> Screen:
    """Score every candidate, added to a base, at all its starting values.

    ``base``: the model that they are added to.
    ``x`` (n_states, n_samples): trajectory near the measured one, to start the smoother.
    ``noise``: noise with forces for the second score.
    ``shape``: second and further parameters, where they are known, instead of those of the starting values.
    ``first``: that of the null: with its columns only the candidates are linearised again that may explain what a base
        leaves.
    ``second``: another process.
    """
    with np.errstate(all="ignore"):
        s = Responses(base, x)
        if not np.max(np.abs(s.known)) < UNSQUARED:  # a base that cannot be linearised along the measured path
            return _joined_blocks(s, [])
        chosen = None
        if first is not None and first.columns is not None:
            effects, raw = [start.effect for start in first.starts], [start.raw for start in first.starts]
            chosen = shortlist(effects, raw, first.columns, first.low, first.high, s)
        numbers = USUAL_STARTS * s.known[0].size  # of the columns of one candidate
        at_once = len(candidates) if chosen is not None else max(int(MOST_NUMBERS_AT_ONCE / numbers), 1)
        parts = [candidates[a : a + at_once] for a in range(0, len(candidates), max(at_once, 1))]
        most = max(int(MOST_NUMBERS_KEPT / len(candidates) / s.known[0].size), 1) if len(parts) > 1 else None
        asked = CandidateColumns(s, shape, chosen)
        columns = (asked.of_all(part, second) for part in parts)
        return _joined_blocks(s, [_block(s, some, noise, most) for some in columns if some])


@dataclass(frozen=True, eq=False)
class _Block:
    """Candidates scored together."""

    starts: list[Start]
    flat: np.ndarray  #: (n_columns, n_values): columns over the noise
    moved: np.ndarray  #: (n_columns, n_bases): what the initial states can make of them
    cross: np.ndarray  #: (n_theta, n_columns): products with the sensitivities of the fitted parameters
    #: (n_columns,): products with the residual, and their own, initial states and fitted parameters projected out; range of amplitudes
    g: np.ndarray
    h: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def of(self, chosen: np.ndarray) -> _Block:
        """Some of the columns, in single precision."""
        sides = self.moved[chosen], self.cross[:, chosen]
        numbers = (part[chosen] for part in (self.g, self.h, self.low, self.high))
        return _Block([self.starts[k] for k in chosen], self.flat[chosen].astype(np.float32), *sides, *numbers)


def _block(s: Responses, columns: list[Column], noise: Noise | None, most: int | None = None) -> _Block:
    """Candidates by their columns, which are taken over; of many only the ``most`` best starting values of each effect."""
    problem, known, few = s.problem, s.known, len(s.known)
    low, high = _range(columns, problem.plant.inputs)
    precision, pull = s.base.step_prior
    whole = np.empty((few + len(columns), *known.shape[1:]))
    whole[:few] = known
    for k, row in enumerate(whole[few:]):  # one copy of them: those that came are let go
        columns[k] = replace(columns[k], column=np.divide(columns[k].column, problem.sd[:, None], out=row))
    # Known columns are projected, of the others only the Gram: a difference that may round to less than nothing.
    white = s.white.reshape(few, -1)
    flat, moved = whole[few:].reshape(len(columns), -1), start_coordinates(whole[few:], s.J_x, problem.record.starts)
    size = np.einsum("kn,kn->k", flat, flat)
    rows = np.concatenate([white @ white.T, white @ flat.T], axis=1)
    power = np.maximum(size - np.einsum("kn,kn->k", moved, moved), LOST_TO_ROUNDING * size)
    diagonal = np.r_[np.einsum("kn,kn->k", white, white), power]
    g, h = eliminate_rows(rows, diagonal, precision, pull)
    drop, amplitude = scores(g, h, low, high)
    for k, c in enumerate(columns):
        if len(c.through):
            drop[k], amplitude[k] = score_beside(
                s, whole[few + k], c.through / problem.sd[None, :, None], low[k], high[k]
            )

    def among(chosen: list[int]) -> np.ndarray:
        """Gram of the residual and the chosen columns."""
        part = np.concatenate([white, flat[chosen]])
        G = part @ part.T
        G[few:, few:] -= moved[chosen] @ moved[chosen].T
        return eliminate(G, few - 1, precision, pull)

    forced = _forced(s, whole, noise, low, high)
    starts = _starts(columns, s.smoothed.x, among, low, drop, amplitude, forced)
    block = _Block(starts, flat, moved, rows[1:, few:], g, h, low, high)
    return block if most is None else block.of(_best_of_each(starts, most))


def _best_of_each(starts: Sequence[Start], most: int) -> np.ndarray:
    """Places of the best starting values of every effect, in their order, both quadratures of a sine; evident ones stay."""
    ranks: dict[int, dict[object, int]] = {}
    kept = []
    for k in sorted(range(len(starts)), key=lambda k: -starts[k].promises):
        effect, values = starts[k].effect, starts[k].theta
        sine = any(parameter.name == "phase" for parameter in effect.parameters)
        rank = ranks.setdefault(id(effect), {})
        if rank.setdefault(float(values[1]) if sine else k, len(rank)) < most or starts[k].evident:
            kept.append(k)
    return np.array(sorted(kept), dtype=int)


def _joined_blocks(s: Responses, blocks: list[_Block]) -> Screen:
    """All blocks as one screen."""
    known, base = s.known, s.base
    precision, pull = base.step_prior
    rest = known, s.J_x, precision, pull, s.problem.record.starts
    if not blocks:
        return Screen([], None, *rest, *2 * (np.zeros(0),), np.full(1 + MOST_TOGETHER, base.fit.cost))
    few = len(known)
    white = s.white.reshape(few, -1)
    G = white @ white.T
    known_inverse = inverse(G[1:, 1:] + np.diag(precision))
    g, h, low, high = (np.concatenate([getattr(one, name) for one in blocks]) for name in ("g", "h", "low", "high"))
    places = [(block, k) for block in blocks for k in range(len(block.starts))]

    def products(k: int) -> np.ndarray:
        """Products of one column and every column, fitted parameters and initial states projected out."""
        own, i = places[k]
        flat, moved, cross = own.flat[i], own.moved[i], known_inverse @ own.cross[:, i]
        return np.concatenate([one.flat @ flat - one.moved @ moved - cross @ one.cross for one in blocks])

    left_by = left_by_several(float(eliminate(G, few - 1, precision, pull)[0, 0]), g, h, products, MOST_TOGETHER)
    kept = None
    if not base.effects and len(places) * known[0].size <= MOST_NUMBERS_KEPT:
        kept = np.empty((len(places), *known.shape[1:]), np.float32)
        np.concatenate([one.flat for one in blocks], out=kept.reshape(len(places), -1), casting="same_kind")
    return Screen([start for block in blocks for start in block.starts], kept, *rest, low, high, left_by)


def _forced(s: Responses, whole: np.ndarray, noise: Noise | None, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Drop of -2 log likelihood by every column under noise with forces; ``whole``: what is known, then the columns."""
    if noise is None:
        return np.zeros(len(low))
    D = s.problem.disturbance_along(s.base.model, s.base.fit.theta, s.smoothed.x, s.lin.A, s.problem.balances)
    try:
        found = D.gram_rows(whole, noise, len(s.known), s.problem.sd)
        return scores(*eliminate_rows(*found, *s.base.step_prior), low, high)[0]
    except np.linalg.LinAlgError:  # a trajectory that no noise can be followed along: white scores only
        return np.zeros(len(low))


def _starts(
    columns: Sequence[Column],
    path: np.ndarray,
    among: Callable[[list[int]], np.ndarray],
    low: np.ndarray,
    drop: np.ndarray,
    amplitude: np.ndarray,
    forced: np.ndarray,
) -> list[Start]:
    """Where the fits start: the amplitude of the column where the effect is linear, both quadratures of a sine."""
    pairs = _quadratures([c.effect for c in columns], [c.theta for c in columns], among)
    out, total = [], float(among([])[0, 0])
    for k, c in enumerate(columns):
        theta, gained, pulled = c.theta.copy(), float(drop[k]), float(forced[k])
        if k in pairs:
            theta, gained = pairs[k]
            pulled = max(gained * float(forced[k] / max(drop[k], 1e-9)), 0.0)
        elif low[k] <= 0.0 and len(theta) and not c.evident:  # its column stands for it down to nothing
            theta = grown(c.effect, theta, amplitude[k])
        out.append(Start(c.effect, theta, gained, pulled, total - gained, path, c.evident, c.hidden, c.theta))
    return out


def grows(effect: BaseEffect) -> bool:
    """Whether the column of an effect is proportional to its magnitude, or to all the parameters that grow with it."""
    return effect.linear or any(parameter.grows for parameter in effect.parameters)


def grown(effect: BaseEffect, theta: np.ndarray, amplitude: float) -> np.ndarray:
    """A start whose effect is so many times as large: its magnitude, and the parameters that grow with it."""
    out = theta.copy()
    out[0] = scaled_magnitude(effect, theta[0], amplitude)
    ratio = out[0] / theta[0] if theta[0] else 1.0
    together = [i for i, parameter in enumerate(effect.parameters) if parameter.grows]
    out[together] *= abs(ratio)
    return out


def scaled_magnitude(effect: BaseEffect, magnitude: float, amplitude: float) -> float:
    """The magnitude of a start times the amplitude of its column, within bounds; a parameter keeps its sign."""
    value = magnitude * (amplitude or 1e-3)
    first = effect.parameters[0]
    low, high = first.low, first.high
    if first.name == "relative_error":
        low, high = max(low, LEAST_FACTOR - 1.0), min(high, 2.0)
    elif effect.name == "parameter_drift":  # of a tenth at the end of a run
        low, high = magnitude * 10.0 * (LEAST_FACTOR - 1.0), magnitude * 20.0
    return float(np.clip(value, low, high))


def _quadratures(
    taken: Sequence[BaseEffect], values: Sequence[np.ndarray], among: Callable[[list[int]], np.ndarray]
) -> dict[int, tuple[np.ndarray, float]]:
    """Sine and cosine of one frequency fitted together: amplitude and phase of a periodic effect, and the drop."""
    out: dict[int, tuple[np.ndarray, float]] = {}
    for k in range(len(taken) - 1):
        names = [p.name for p in taken[k].parameters]
        if "phase" not in names or taken[k + 1] is not taken[k]:
            continue
        phase = names.index("phase")
        a, b = values[k], values[k + 1]
        if a[phase] != 0 or b[phase] == 0 or not np.array_equal(np.delete(a, phase), np.delete(b, phase)):
            continue
        G = among([k, k + 1])
        H, g = G[1:, 1:], G[0, 1:]
        sine, cosine = linear_least_squares(H, g, rcond=1e-10)
        theta = a.copy()
        theta[0] *= np.hypot(sine, cosine)
        theta[phase] = np.arctan2(cosine, sine)
        out[k] = theta, float(np.array([sine, cosine]) @ g)
    return out


def _smallest(columns: Sequence[Column]) -> np.ndarray:
    """Whether a start is the smallest magnitude of an effect that grows from 0 without jumps, (n_columns,)."""
    least: dict[int, float] = {}
    for c in columns:
        if len(c.theta):
            least[id(c.effect)] = min(least.get(id(c.effect), np.inf), float(c.theta[0]))
    return np.array(
        [
            not c.effect.linear
            and bool(c.effect.parameters)
            and c.effect.parameters[0].null == 0
            and not c.effect.scan(tuple(c.theta))
            and float(c.theta[0]) <= least[id(c.effect)]
            for c in columns
        ],
        dtype=bool,
    )
