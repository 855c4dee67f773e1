"""What the verdict is decided on: plain numbers of everything that was found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sksurrogate.gap.fit._closeness import NEARLY_WHITE
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.unnamed._latent_force import LatentForce

__all__ = ["DecisionFeatures", "certified", "left_over", "share_left"]

#: Share of the gap (amplitude) that named effects must close on runs left out; of a small gap (error over the deviation of the
#: outputs) beyond the noise most of it.
CERTIFICATE, CERTIFICATE_OF_SMALL = 0.15, 0.6
SMALL_GAP = 0.02


@dataclass(frozen=True)
class DecisionFeatures:
    """What the verdict is decided on."""

    names: int = 0  #: Effects that passed their certificate
    probability: float = 1.0  #: That of the least probable of them, whatever else acts; 1 where nothing is named
    retuned: bool = False  #: Whether the free parameters moved by more than chance
    #: Share of the gap that is left, in amplitude, on runs left out; of the outputs' deviation where the gap is larger
    share_left: float = 1.0
    left: float = 1.0  #: Free-run error that is left, in units of the noise
    lawful: float = 0.0  #: Share of the gap (amplitude) that a law without a name makes up beside what is named
    #: after, error: Free-run error with and without what is named, on runs left out, each output divided by its
    #: deviation
    after: float = np.inf
    error: float = np.inf
    #: R2 on runs left out of the force that is left, by states and inputs; the largest of all balances
    law: float = 0.0
    #: curve, curve_moved: Gain of the likeliest law beside what is named, and what it moves an output by, over its
    #: deviation
    curve: float = -np.inf
    curve_moved: float = 0.0
    rounding: float = 0.0  #: Error of a rounding that nothing names, over the deviation of the output
    n_samples: int = 1000
    tolerance: float = 0.1  #: Share of the gap (amplitude) that a model may leave


def certified(shrink: Shrink, left: float) -> bool:
    """Whether the effects close a practical share of the gap on runs left out: any of a gap within the noise, most of a small one beyond."""
    small = shrink.before < SMALL_GAP and left > NEARLY_WHITE
    least = CERTIFICATE_OF_SMALL if small else CERTIFICATE
    return shrink.fraction > least if np.isfinite(shrink.fraction) else not shrink.after > shrink.before


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
