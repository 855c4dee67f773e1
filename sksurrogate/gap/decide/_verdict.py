"""The verdict: none, explained or unknown, by size and evidence; intervals and probabilities of what is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.effects._effect import BalanceEffect, BaseEffect, HiddenEffect
from sksurrogate.gap.fit._closeness import FAR
from sksurrogate.gap.fit._evidence import left
from sksurrogate.gap.fit._problem import LARGEST_DISTURBANCE, Problem, Rival
from sksurrogate.gap.fit._project import project_starts
from sksurrogate.gap.fit._rounding import Rounding
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.search._merged_pair import opposed
from sksurrogate.gap.search._search import MOST_EFFECTS
from sksurrogate.gap.search._stopping import LEFT_BY_SEVERAL, STACK
from sksurrogate.gap.unnamed._curve_shapes import CERTAIN
from sksurrogate.gap.unnamed._free_curve import FreeCurve
from sksurrogate.gap.unnamed._latent_force import LatentForce, moved_by
from sksurrogate.gap.unnamed._law_rival import LawRival

__all__ = ["Facts", "certified", "decide", "intervals", "parameter_errors"]

#: `explained` when the named effects leave less than this share of the gap (amplitude).
SHARE = 0.20
#: With a clear law in what is left, or as many names as are looked for (a stack of stand-ins), this share is too much
#: already where the error is over this many times the noise.
SHARE_LAWFUL, LEFT_LAWFUL, CLEAR_LAW = 0.05, 1.1, 0.3
#: A clear law in a force below this share of the RMS of dx/dt is what any model of a real plant leaves.
CLEAR_FORCE = 0.008
#: A stack of names that leaves more of the gap than this, than the numerics of true ones, stands in for one missing effect.
NUMERICS_SHARE = 0.01
#: So are two where a law of even this R2 is left or both are static laws of one variable in one balance; two that leave less
#: of the gap than this share are a good model of a real plant.
LAW_BY_TWO, SHARE_BY_TWO = 0.03, 0.08
#: Names that leave more than this share of the gap (amplitude), where the error is over this many times the noise, explain
#: less of it than they leave. Several names could have closed more; a disturbance, in which nothing is lawful, may leave more.
MOST_LEFT, LEFT_FOR_MOST = 0.4, 1.5
MOST_LEFT_BY_SEVERAL, MOST_LEFT_LAWLESS = 0.3, 0.5
#: A gap closed to this share (amplitude) is explained however precise the sensors are: no real plant's model is exact.
SMALL_SHARE = 0.12
#: Share of the latent force that states and inputs explain on runs left out, above which it is a law.
LAW = 0.10
#: A law that explains less than this over the number of samples may be chance.
FEW = 20.0
#: A latent force beyond this share of the RMS of dx/dt is no disturbance.
FORCE = 0.06
#: Near the noise, what is left is no disturbance when laws make up this share of the gap (amplitude), or when it moves an
#: output by this share of its deviation.
LAWFUL_SHARE, MOVED = 0.12, 0.03
#: Beside names a certain free curve must make up the first share of the gap, and move an output by the second share of its
#: deviation. Within so many times the noise, where no other flaw of the model hides it, less of both.
CURVE_SHARE, CURVE_MOVED = 0.01, 0.005
WITHIN, CURVE_SHARE_WITHIN, CURVE_MOVED_WITHIN = 1.15, 0.003, 0.001
#: Names that fewer than this share of the folds' other runs choose again are stand-ins, for what no name holds.
SAME_NAMES = 0.5
#: What is said of parameters that close the gap, and where they would hide effects as large.
RETUNED = "Re-tuning alone closes the gap."
HIDES = " It would hide these effects: they part from it where parameters are measured or fewer are free (free_params)."
#: One law that beats several names by this much (twice nats, parameters paid) is what is missing: it lay below -10 beside 31 true
#: pairs of the blind check, at 6 and 9 beside two stand-ins.
ONE_FOR_SEVERAL = 3.0
#: A grid of readings is a quantizer that is missing when its rounding is this share of the output's deviation.
ROUNDING = 0.01
#: A gap of which no effect explains anything is below the practical bar when its free-run error is below the first share
#: of the output's deviation, or below the second and no repeatable law of states and inputs.
PRACTICAL, PRACTICAL_LAWLESS = 0.005, 0.02

#: Free runs beyond both (error over the output's deviation, over the noise) are wrong by more than a disturbance is called.
LARGE_ERROR, LEFT_OF_LARGE = LARGEST_DISTURBANCE, 2.0

#: Share of the gap (amplitude) that named effects must close on runs left out.
CERTIFICATE = 0.15
#: Share of a parameter that integrators and the smoothing of kinks may always move.
NUMERICS = 5e-4


@dataclass(frozen=True)
class Facts:
    """What the verdict is decided on.

    Attributes
    ----------
    accepted : bool
        Whether effects passed.
    share_left : float
        Share of the gap that is left, in amplitude, held out; of the outputs' deviation where the gap is larger.
    left : float
        Free-run error that is left, in units of the noise.
    law : float
        R2 of the latent force on runs left out, the largest of all balances.
    force : float
        Largest latent force over the RMS of its dx/dt.
    retuned : bool
        Whether re-tuning alone passed its bar.
    names : int
        Effects that passed; as many as are looked for are a stack of stand-ins.
    error : float
        Free-run error before, held out, each output divided by its deviation.
    n_samples : int
    moved : float
        What the latent force moves an output by, over its deviation.
    one_curve : bool
        Whether two names are static laws of one variable in one balance: parts of one curve.
    curve : float
        Gain of the likeliest free curve on top of what is named.
    curve_share, curve_moved : float
        What it moves an output by: over the gap, and over the output's deviation.
    rounding : float
        Error of a rounding that nothing names, over the deviation of the output.
    input_curve : bool
        Whether that variable is an input: a curve of an input, which no pair of laws in a balance is.
    rival : float
        Gain of the likeliest law of one signal, of no name, in the place of all names.
    same_names : float
        Share of the folds whose other runs choose the same names.
    opposed : bool
        Whether two static laws of one variable in one balance nearly cancel.
    needless : bool
        Whether what needs no name closes as much of the gap, held out (`needless`).
    """

    accepted: bool
    share_left: float
    left: float
    law: float
    force: float
    retuned: bool
    names: int = 1
    error: float = np.inf
    n_samples: int = 1000
    moved: float = np.inf
    one_curve: bool = False
    curve: float = -np.inf
    curve_share: float = 0.0
    curve_moved: float = 0.0
    rounding: float = 0.0
    input_curve: bool = False
    rival: float = -np.inf
    same_names: float = 1.0
    opposed: bool = False
    needless: bool = False


def decide(facts: Facts) -> str:
    """None, explained or unknown."""
    law = facts.law > max(LAW, FEW / facts.n_samples)
    lawful = law or facts.force > FORCE
    if facts.rounding > ROUNDING or facts.input_curve or facts.opposed:
        return "unknown"
    if facts.accepted or facts.retuned:
        within = facts.left < WITHIN
        hidden = unnamed_curve(facts, CURVE_MOVED_WITHIN if within else CURVE_MOVED)
        hidden = hidden and facts.curve_share > (CURVE_SHARE_WITHIN if within else CURVE_SHARE)
        leaves = facts.share_left > (SHARE if facts.needless else most_left(facts))
        most = facts.accepted and leaves and facts.left > LEFT_FOR_MOST
        if facts.left > FAR:
            lawful_stack = facts.names >= MOST_EFFECTS and facts.law > CLEAR_LAW and facts.share_left > SHARE_LAWFUL
            stack = lawful_stack or (facts.names >= STACK and facts.share_left > SHARE)
            too_much = stack or most or ((lawful or hidden) and facts.share_left > SMALL_SHARE)
        else:
            clear = facts.law > CLEAR_LAW and facts.share_left > SHARE_LAWFUL and facts.left > LEFT_LAWFUL
            clear = clear and facts.force > CLEAR_FORCE
            lasting = law and facts.share_left * facts.law**0.5 > LAWFUL_SHARE
            large = facts.force > FORCE and facts.moved > MOVED
            much = (lasting or large) and facts.share_left > SHARE and facts.left > 1.05
            imitated = facts.accepted and facts.rival > (CERTAIN if facts.names == 1 else ONE_FOR_SEVERAL)
            unstable = facts.accepted and facts.same_names < SAME_NAMES
            too_much = clear or much or hidden or most or imitated or unstable or stand_ins(facts)
        return "unknown" if too_much else "explained"
    if facts.error < PRACTICAL or (facts.error < PRACTICAL_LAWLESS and not law):
        return "none"
    if unnamed_curve(facts, PRACTICAL):
        return "unknown"
    large = facts.error > LARGE_ERROR and facts.left > LEFT_OF_LARGE
    return "unknown" if (law and facts.left > 1.15) or facts.left > FAR or large else "none"


def certified(shrink: Shrink, left: float) -> bool:
    """Whether the effects close a practical share of the gap on runs left out: any of a gap within the noise, most of a small one beyond."""
    small = shrink.before < PRACTICAL_LAWLESS and left > LEFT_FOR_MOST
    least = 1.0 - MOST_LEFT if small else CERTIFICATE
    return shrink.fraction > least if np.isfinite(shrink.fraction) else not shrink.after > shrink.before


def most_left(facts: Facts) -> float:
    """Share of the gap (amplitude) that names may leave."""
    if facts.names > 1:
        return MOST_LEFT_BY_SEVERAL
    lawless = facts.law <= 0.0 and facts.curve < 0.0 and facts.force < FORCE
    return MOST_LEFT_LAWLESS if lawless else MOST_LEFT


def needless(shrink: Shrink, names: int) -> bool:
    """Whether a learned correction closes as much on runs left out as the names; beside one name, also re-tuning.

    Of several names one may be an error of a parameter, which re-tuning finds as well.
    """
    without = [shrink.fraction_correction, *([shrink.fraction_retuning] if names == 1 else [])]
    return any(fraction >= shrink.fraction for fraction in without)


def unnamed_curve(facts: Facts, moved: float) -> bool:
    """Whether a free curve of one signal is certain, and moves an output by a share of its deviation."""
    return facts.curve > CERTAIN and facts.curve_moved > moved


def stand_ins(facts: Facts) -> bool:
    """Whether several names, near the noise, only stand in for one effect that is missing."""
    beyond = facts.left > max(LEFT_BY_SEVERAL, 1.0 + facts.n_samples**-0.5) and facts.share_left > NUMERICS_SHARE
    lawful = facts.share_left > SHARE_BY_TWO and (facts.law > LAW_BY_TWO or facts.one_curve)
    return beyond and (facts.names >= STACK or (facts.names == 2 and lawful))


def facts_of(
    problem: Problem,
    final: Rival,
    shrink: Shrink,
    latent: LatentForce,
    law: np.ndarray,
    curve: FreeCurve | None,
    rival: LawRival | None,
    rounding: Rounding | None,
    retuned: bool,
    gap: float,
    beyond: float,
) -> Facts:
    """Collect them, with the gap over the noise and the error ``beyond`` it that is left (`left_over`)."""
    parts = curves_in_parts(final.effects)
    return Facts(
        bool(final.effects),
        share_left(shrink),
        beyond,
        float(np.max(law, initial=0.0)),
        float(np.max(latent.size, initial=0.0)),
        retuned,
        len(final.effects),
        float(shrink.before) if np.isfinite(shrink.before) else np.inf,
        final.model.record.n_samples,
        _moved(problem, final, latent),
        bool(parts),
        *((curve.gain, curve.moved / max(gap, 1e-300), curve.deviation) if curve is not None else (-np.inf, 0.0, 0.0)),
        rounding.share if rounding is not None else 0.0,
        any(variable in problem.plant.inputs for _, variable in parts),
        rival.gain if rival is not None else -np.inf,
        shrink.same_names if np.isfinite(shrink.same_names) else 1.0,
        opposed(problem, final),
        needless(shrink, len(final.effects)),
    )


def share_left(shrink: Shrink) -> float:
    """Share of the gap that is left, in amplitude; no gap counts as larger than what the outputs do.

    A simulator that runs away is further off than one that says nothing: of its error any name leaves a vanishing share.
    """
    if not np.isfinite(shrink.fraction):
        return 0.0
    return float((1.0 - shrink.fraction) * (max(shrink.before, 1.0) if np.isfinite(shrink.before) else 1.0))


def left_over(final: Rival, latent: LatentForce, most_noise: np.ndarray, retuned: bool) -> float:
    """Free-run error that is left, in units of the noise (the worst output).

    Sensors are at least as noisy as the latent force finds them: a noise fit may call white noise coloured. Where nothing
    is named, noise beyond ``most_noise`` is a gap that the noise fit has swallowed.
    """
    most = np.inf if final.effects or retuned else most_noise
    return left(final, most, np.minimum(latent.noise.sigma, most_noise))


def curves_in_parts(effects: Sequence[BaseEffect]) -> set[tuple[str, str]]:
    """Balances and variables of which more than one of the effects is a static law: parts of one curve."""
    static = [e for e in effects if isinstance(e, BalanceEffect) and not isinstance(e, HiddenEffect)]
    places = [(str(e.location), e.variable) for e in static if e.variable is not None]
    return {place for place in places if places.count(place) > 1}


def _moved(problem: Problem, final: Rival, latent: LatentForce) -> float:
    """What the latent forces move an output by, over its deviation (the worst output)."""
    moved = np.sqrt(np.mean(np.sum(moved_by(problem, final, latent), axis=0) ** 2, axis=1)) * problem.sd
    return float(np.max(moved / np.maximum(np.std(problem.record.y, axis=1), 1e-300)))


def covariance(problem: Problem, rival: Rival) -> np.ndarray:
    """Covariance of the output-error parameters when the residual has the rival's own noise.

    The sandwich ``H^-1 J' W S W J H^-1`` with W the white weights of the fit and S the covariance of white noise, forces
    and coloured sensor noise; initial states are projected out.
    """
    assert rival.noise is not None
    lin, record = problem.linearised(rival), problem.record
    k = lin.J_theta.shape[1]
    if k == 0:
        return np.zeros((0, 0))
    white = 1.0 / problem.sd[:, None, None]
    J = project_starts(
        (lin.J_theta * white).transpose(1, 0, 2), lin.J_x[:, rival.model.free_states] * white, record.starts
    )
    flat = J.reshape(k, -1)
    H = flat @ flat.T + np.diag(1.0 / problem.prior(rival.effects, rival.fit.theta) ** 2)
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
    seen = values > 1e-10 * values[-1]
    inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T / np.outer(scale, scale)
    pull = problem.disturbance(rival).spread((J * white.transpose(1, 0, 2)).transpose(1, 0, 2), rival.noise)
    out = inverse @ pull @ inverse
    blind = np.sum(vectors[:, ~seen] ** 2, axis=1) > 1e-6
    out[blind, blind] = np.inf
    return out


def numerical_change(problem: Problem, rival: Rival) -> np.ndarray:
    """How far the parameters move when the steps are halved and kinks made sharper."""
    finer = replace(problem, n_sub=2 * rival.model.n_sub, sharpness=2 * rival.model.sharpness)
    fit = finer.fit(rival.effects, rival.fit.theta, rival.fit.x, open_steps=0, settled=True, max_steps=6)
    coarse = problem.fit(rival.effects, rival.fit.theta, rival.fit.x, open_steps=0, settled=True, max_steps=6)
    if fit is None or coarse is None:
        return np.zeros(len(rival.fit.theta))
    return np.abs(fit.fit.theta - coarse.fit.theta)


def intervals(problem: Problem, rival: Rival) -> tuple[np.ndarray, np.ndarray]:
    """90 % intervals of all parameters: noise and disturbance, and what steps and kinks may have moved."""
    theta = rival.fit.theta
    spread = np.sqrt(np.maximum(np.diag(covariance(problem, rival)), 0.0))
    numerical = numerical_change(problem, rival)
    half = np.sqrt((1.645 * spread) ** 2 + numerical**2 + (NUMERICS * theta) ** 2)
    low, high = problem.bounds(rival.effects)
    return np.maximum(theta - half, low), np.minimum(theta + half, high)


def parameter_errors(
    retuned: Table, share: float, hidden: Sequence[tuple[str, str, str | None]] = ()
) -> list[EffectEstimate]:
    """Re-tuning alone closes the gap: one parameter_error for each parameter that moved, with equal parts of the share.

    The effects ``hidden`` by the re-tuning are equivalents of all of them together.
    """
    rows = [row for row in retuned if row["moved"]]
    out = []
    for row in rows:
        p0 = row["nominal"]
        value, *ends = [(row[k] / p0 - 1.0) if p0 != 0 else row[k] for k in ("value", "low", "high")]
        out.append(
            EffectEstimate(
                "parameter_error",
                row["parameter"],
                None,
                share / len(rows),
                {"relative_error": value},
                {"relative_error": (min(ends), max(ends))},
                1.0,
                list(hidden),
                RETUNED + HIDES if hidden else RETUNED,
            )
        )
    return out
