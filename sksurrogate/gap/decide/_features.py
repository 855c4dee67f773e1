"""What the verdict is decided on: plain numbers of everything that was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sksurrogate.effects._effect import BalanceEffect, BaseEffect, HiddenEffect
from sksurrogate.gap.fit._closeness import NEARLY_WHITE
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._problem import Candidate
from sksurrogate.gap.fit._rounding import Rounding
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.search._merged_pair import opposed
from sksurrogate.gap.unnamed._free_curve import FreeCurve
from sksurrogate.gap.unnamed._latent_force import LatentForce, moved_by
from sksurrogate.gap.unnamed._law_rival import LawRival

__all__ = ["DecisionFeatures", "certified", "curves_in_parts", "features_of", "left_over", "needless", "share_left"]

#: Share of the gap (amplitude) that named effects must close on runs left out; of a small gap (error over the deviation of the
#: outputs) beyond what may be white noise most of it.
CERTIFICATE, CERTIFICATE_OF_SMALL = 0.15, 0.6
SMALL_GAP = 0.02


@dataclass(frozen=True)
class DecisionFeatures:
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


def features_of(
    *,
    final: Evidence,
    shrink: Shrink,
    latent: LatentForce,
    law: np.ndarray,
    curve: FreeCurve | None,
    rival: LawRival | None,
    rounding: Rounding | None,
    retuned: bool,
    gap: float,
    beyond: float,
) -> DecisionFeatures:
    """Collect them, with the gap over the noise and the error ``beyond`` it that is left (`left_over`)."""
    problem, parts = final.candidate.problem, curves_in_parts(final.effects)
    return DecisionFeatures(
        bool(final.effects),
        share_left(shrink),
        beyond,
        float(np.max(law, initial=0.0)),
        float(np.max(latent.size, initial=0.0)),
        retuned,
        len(final.effects),
        float(shrink.before) if np.isfinite(shrink.before) else np.inf,
        problem.record.n_samples,
        _moved(final.candidate, latent),
        bool(parts),
        *((curve.gain, curve.moved / max(gap, 1e-300), curve.deviation) if curve is not None else (-np.inf, 0.0, 0.0)),
        rounding.share if rounding is not None else 0.0,
        any(variable in problem.plant.inputs for _, variable in parts),
        rival.gain if rival is not None else -np.inf,
        shrink.same_names if np.isfinite(shrink.same_names) else 1.0,
        opposed(final.candidate),
        needless(shrink, len(final.effects)),
    )


def certified(shrink: Shrink, left: float) -> bool:
    """Whether the effects close a practical share of the gap on runs left out: any of a gap within the noise, most of a small one beyond."""
    small = shrink.before < SMALL_GAP and left > NEARLY_WHITE
    least = CERTIFICATE_OF_SMALL if small else CERTIFICATE
    return shrink.fraction > least if np.isfinite(shrink.fraction) else not shrink.after > shrink.before


def needless(shrink: Shrink, names: int) -> bool:
    """Whether a learned correction closes as much on runs left out as the names; beside one name, also re-tuning.

    Of several names one may be an error of a parameter, which re-tuning finds as well.
    """
    without = [shrink.fraction_correction, *([shrink.fraction_retuning] if names == 1 else [])]
    return any(fraction >= shrink.fraction for fraction in without)


def share_left(shrink: Shrink) -> float:
    """Share of the gap that is left, in amplitude; no gap counts as larger than what the outputs do.

    A simulator that runs away is further off than one that says nothing: of its error any name leaves a vanishing share.
    """
    if not np.isfinite(shrink.fraction):
        return 0.0
    return float((1.0 - shrink.fraction) * (max(shrink.before, 1.0) if np.isfinite(shrink.before) else 1.0))


def left_over(final: Evidence, latent: LatentForce, most_noise: np.ndarray, retuned: bool) -> float:
    """Free-run error that is left, in units of the noise (the worst output).

    Sensors are at least as noisy as the latent force finds them: a noise fit may call white noise coloured. Where nothing
    is named, noise beyond ``most_noise`` is a gap that the noise fit has swallowed.
    """
    most = np.inf if final.effects or retuned else most_noise
    return final.left_within(most, np.minimum(latent.noise.sigma, most_noise))


def curves_in_parts(effects: Sequence[BaseEffect]) -> set[tuple[str, str]]:
    """Balances and variables of which more than one of the effects is a static law: parts of one curve."""
    static = [e for e in effects if isinstance(e, BalanceEffect) and not isinstance(e, HiddenEffect)]
    places = [(str(e.location), e.variable) for e in static if e.variable is not None]
    return {place for place in places if places.count(place) > 1}


def _moved(final: Candidate, latent: LatentForce) -> float:
    """What the latent forces move an output by, over its deviation (the worst output)."""
    problem = final.problem
    moved = np.sqrt(np.mean(np.sum(moved_by(final, latent), axis=0) ** 2, axis=1)) * problem.sd
    return float(np.max(moved / np.maximum(np.std(problem.record.y, axis=1), 1e-300)))
