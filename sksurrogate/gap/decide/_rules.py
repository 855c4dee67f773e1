"""The verdict: what it is decided on, and the ordered table of rules; the first that applies decides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from sksurrogate.gap.decide._posterior import CERTAIN_NAME
from sksurrogate.gap.fit._closeness import FAR, HALF_THE_POWER, LARGEST_DISTURBANCE, MOST_LEFT, NEAR, SETTLED
from sksurrogate.gap.fit._evidence import CERTAIN
from sksurrogate.gap.results._reasons import Reasons
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.search._stopping import STACK

#: A gap below the first share of the outputs' deviation is of no practical size; one below the second where it is near the noise.
PRACTICAL, SMALL_GAP = 0.005, 0.02


@dataclass(frozen=True)
class DecisionFeatures:
    """What the verdict is decided on."""

    names: int = 0  #: Effects that passed their certificate
    probability: float = 1.0  #: Evidence of the least probable of them, whatever else acts; 1 where nothing is named
    sized: bool = True  #: Whether the interval of each one's magnitude leaves out the value at which it does nothing
    #: Whether the data show each one's form: no exponent at its bound, no parameter that changes its sign along them
    shown: bool = True
    retuned: bool = False  #: Whether the free parameters moved by more than chance
    #: Share of the gap that is left, in amplitude, on runs left out; of the outputs' deviation where the gap is larger
    share_left: float = 1.0
    left: float = 1.0  #: Free-run error that is left, in units of the noise
    lawful: float = 0.0  #: Share of the gap (amplitude) that a law without a name makes up beside what is named
    #: after, error: Free-run error with and without what is named, on runs left out, each output divided by its
    #: deviation
    after: float = np.inf
    error: float = np.inf
    #: curve, curve_moved: Gain of the likeliest law beside what is named, and what it moves an output by, over its
    #: deviation
    curve: float = -np.inf
    curve_moved: float = 0.0
    correction_closes_more: bool = False  #: Whether the generic correction closes clearly more on runs left out
    repeats: bool = True  #: Whether a law that was looked for closes a practical share on runs left out; of one run that is not known
    rounding: float = 0.0  #: Error of a coarse grid of readings that nothing names, over the deviation of the output
    noisy_input: bool = False  #: Whether the gap is no larger than the noise of a measured input makes it
    #: Whether the simulator alone explains the record with its time or columns in another unit, or with its columns in another order
    other_unit: bool = False
    at_bound: bool = False  #: Whether a re-tuned parameter ended at its bound
    tolerance: float = 0.1  #: Share of the gap (amplitude) that a model may leave


def certified(shrink: Shrink, likelier: Callable[[], bool]) -> bool:
    """Whether the effects close at least half of the gap's power on runs left out.

    ``likelier()``: whether runs left out are likelier with them; that counts where no gap is seen beyond the noise.
    """
    return share_left(shrink) <= HALF_THE_POWER if np.isfinite(shrink.fraction) else likelier()


def share_left(shrink: Shrink) -> float:
    """Share of the gap that is left, in amplitude; no gap counts as larger than what the outputs do.

    A simulator that runs away is further off than one that says nothing: of its error any name leaves a vanishing share.
    """
    if not np.isfinite(shrink.fraction):
        return 0.0
    return float((1.0 - shrink.fraction) * (max(shrink.before, 1.0) if np.isfinite(shrink.before) else 1.0))


@dataclass(frozen=True)
class Rule:
    """One line of the table."""

    name: str
    applies: Callable[[DecisionFeatures], bool]  #: ``applies(features) -> bool``
    verdict: str  #: {"none", "explained", "partial", "unknown"}
    sentence: str  #: What it means
    withdraws: bool = False  #: Whether the names do not stand
    law: bool = True  #: Whether what remains is looked for as a formula


def certain(f: DecisionFeatures) -> bool:
    """Every name is probable, of a known size and shows its form, or re-tuning alone moved the parameters."""
    return bool(f.probability >= CERTAIN_NAME and f.sized and f.shown if f.names else f.retuned)


def leaves_a_disturbance(f: DecisionFeatures) -> bool:
    """What is left follows no law that repeats, no generic correction learns it, and it is small beside the outputs."""
    return not f.correction_closes_more and (f.lawful <= f.tolerance or not f.repeats) and f.after < LARGEST_DISTURBANCE


def small_and_near(f: DecisionFeatures) -> bool:
    """The gap is small beside the outputs, and that of the simulator alone is near the noise."""
    alone = f.left * max(f.error / f.after, 1.0) if f.after > 0 else f.left  # in units of the noise
    return f.error < SMALL_GAP and alone <= FAR


def makes_up_most(f: DecisionFeatures) -> bool:
    """A law makes up most of the gap; one that is larger than the gap cancels with something else, as with initial states."""
    return MOST_LEFT < f.lawful < 1.0 + f.tolerance


RULES: tuple[Rule, ...] = (
    Rule(
        "other_unit",
        lambda f: f.other_unit,
        "unknown",
        "The simulator alone explains the record with its time or columns in another unit, or with its columns in another order. No effects explain more in its own.",
        law=False,
    ),
    Rule(
        "grid_beside_names",
        lambda f: f.rounding > 0.0 and f.names > 0 and certain(f),
        "partial",
        "Of all candidates the data choose these effects. The readings also lie on a grid, and no named effect explains it.",
    ),
    Rule("grid", lambda f: f.rounding > 0.0, "unknown", "The readings lie on a grid, and no effect explains it."),
    Rule(
        "uncertain_and_small",
        lambda f: f.names > 0 and not certain(f) and small_and_near(f),
        "none",
        "No effect is certain, and the gap is small and near the noise.",
        withdraws=True,
    ),
    Rule(
        "uncertain_names",
        lambda f: f.names > 0 and not certain(f),
        "unknown",
        "An effect closes part of the gap, but another effect or a law without a name explains it as well, the interval "
        "of its magnitude includes the value at which it does nothing, or it does not show its form (an exponent at its bound, a parameter that changes its sign).",
    ),
    Rule(
        "at_a_bound",
        lambda f: f.names == 0 and f.retuned and f.at_bound,
        "unknown",
        "A re-tuned parameter ended at its bound: re-tuning is not what explains the gap.",
    ),
    Rule(
        "closed",
        lambda f: certain(f) and f.share_left <= f.tolerance,
        "explained",
        "The correction closes the gap on held-out runs, up to the tolerance.",
    ),
    Rule(
        "at_the_noise",
        lambda f: certain(f) and f.left < SETTLED and f.share_left <= MOST_LEFT,
        "explained",
        "The correction closes most of the gap, and only noise remains.",
    ),
    Rule(
        "disturbance_left",
        lambda f: certain(f) and (f.share_left <= MOST_LEFT or not f.names) and leaves_a_disturbance(f),
        "explained",
        "The correction leaves a disturbance: it follows no law, and it is small beside the outputs.",
    ),
    Rule(
        "imitations",
        lambda f: f.names >= STACK,
        "unknown",
        "So many effects leave more than the tolerance. They imitate one that is missing, and are withdrawn.",
        withdraws=True,
    ),
    Rule(
        "law_left",
        lambda f: f.names > 0,
        "partial",
        "Of all candidates the data choose these effects, but more than the tolerance remains.",
    ),
    Rule(
        "most_left",
        lambda f: f.retuned,
        "unknown",
        "Re-tuning alone does not close the gap, and no effect explains the rest.",
    ),
    Rule("below_practical", lambda f: f.error < PRACTICAL, "none", "The gap is too small to matter."),
    Rule(
        "small_and_near",
        small_and_near,
        "none",
        "The gap is small, and it is near the noise.",
    ),
    Rule("noisy_input", lambda f: f.noisy_input, "none", "The noise of a measured input makes up the gap."),
    Rule(
        "unnamed_law",
        lambda f: f.curve > CERTAIN and f.curve_moved > PRACTICAL and (f.repeats or makes_up_most(f)),
        "unknown",
        "The gap follows a law of the signals for certain, on runs left out too or for the most part, and no effect has its form.",
    ),
    Rule(
        "unnamed_and_far",
        lambda f: f.left > NEAR and not leaves_a_disturbance(f),
        "unknown",
        "The free run is off the data, no effect explains it, and what is left is lawful, or too large to be taken for a disturbance.",
    ),
    Rule("none", lambda f: True, "none", "Only noise and disturbance remain."),
)


def first_rule(features: DecisionFeatures) -> Rule:
    """The rule that decides."""
    return next(rule for rule in RULES if rule.applies(features))


def decide(features: DecisionFeatures) -> tuple[str, Reasons]:
    """The verdict, and the rule that gave it."""
    rule = first_rule(features)
    return rule.verdict, Reasons(rule.name, rule.sentence, asdict(features))
