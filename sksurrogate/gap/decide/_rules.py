"""The verdict as an ordered table: the first rule that applies decides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

from sksurrogate.gap.decide._features import DecisionFeatures
from sksurrogate.gap.fit._closeness import FAR, SETTLED
from sksurrogate.gap.fit._ode import LARGEST_DISTURBANCE
from sksurrogate.gap.results._reasons import Reasons
from sksurrogate.gap.unnamed._curve_shapes import CERTAIN

__all__ = ["RULES", "decide", "first_rule"]

#: Probability from which a name is given.
CERTAIN_NAME = 0.9
#: Names that leave more than this share of the gap (amplitude) explain less of it than they leave.
MOST_LEFT = 0.5
#: A reading's grid counts from this share of the output's deviation on.
GRID_SHARE = 0.01
#: R2 of a law of states and inputs in what is left, and its least value over the number of samples: less may be chance.
LAW, LEAST_LAW_PER_SAMPLE = 0.10, 20.0
#: A gap below these shares of the outputs' deviation is of no practical size, the second only where no law is in it.
PRACTICAL, PRACTICAL_LAWLESS = 0.005, 0.02
#: A free run beyond both (error over the deviation, over the noise) is wrong by more than a disturbance.
LARGE_ERROR, LEFT_OF_LARGE = LARGEST_DISTURBANCE, 2.0


@dataclass(frozen=True)
class Rule:
    """One line of the table."""

    name: str
    applies: Callable[[DecisionFeatures], bool]  #: ``applies(features) -> bool``
    verdict: str  #: {"none", "explained", "partial", "unknown"}
    sentence: str  #: What it means


def certain(f: DecisionFeatures) -> bool:
    """Every name is probable, or re-tuning alone moved the parameters."""
    return bool(f.probability >= CERTAIN_NAME if f.names else f.retuned)


def lawful(f: DecisionFeatures) -> bool:
    """States and inputs repeat what is left on runs left out, more than chance does."""
    return bool(f.law > max(LAW, LEAST_LAW_PER_SAMPLE / f.n_samples))


RULES: tuple[Rule, ...] = (
    Rule(
        "grid_beside_names",
        lambda f: f.rounding > GRID_SHARE and f.names > 0 and certain(f) and f.share_left <= MOST_LEFT,
        "partial",
        "The effects are certain; the readings also lie on a grid that no effect names.",
    ),
    Rule("grid", lambda f: f.rounding > GRID_SHARE, "unknown", "The readings lie on a grid that no effect names."),
    Rule(
        "uncertain_names",
        lambda f: f.names > 0 and not certain(f),
        "unknown",
        "An effect closes part of the gap, but a law without a name, or another effect, explains it as well.",
    ),
    Rule(
        "closed",
        lambda f: certain(f) and f.share_left <= f.tolerance,
        "explained",
        "What is named closes the gap on runs left out up to the tolerance.",
    ),
    Rule(
        "at_the_noise",
        lambda f: certain(f) and f.left < SETTLED and f.share_left <= MOST_LEFT,
        "explained",
        "What is named closes most of the gap, and leaves no more than the noise.",
    ),
    Rule(
        "disturbance_left",
        lambda f: (
            certain(f) and f.lawful <= f.tolerance and f.share_left <= MOST_LEFT and f.after < LARGEST_DISTURBANCE
        ),
        "explained",
        "What is named leaves a disturbance: it is not lawful, and small beside the outputs.",
    ),
    Rule(
        "law_left",
        lambda f: f.names > 0 and certain(f) and f.share_left <= MOST_LEFT,
        "partial",
        "The effects are certain, and more than the tolerance remains.",
    ),
    Rule(
        "most_left",
        lambda f: bool(f.names) or f.retuned,
        "unknown",
        "What is named leaves more of the gap than it explains.",
    ),
    Rule("below_practical", lambda f: f.error < PRACTICAL, "none", "The gap is too small to matter."),
    Rule(
        "small_and_lawless",
        lambda f: f.error < PRACTICAL_LAWLESS and not lawful(f),
        "none",
        "The gap is small, and no law of states and inputs is in it.",
    ),
    Rule(
        "unnamed_curve",
        lambda f: f.curve > CERTAIN and f.curve_moved > PRACTICAL,
        "unknown",
        "A curve of one signal is certain, and no effect has its form.",
    ),
    Rule(
        "unnamed_law",
        lambda f: lawful(f) and f.left > SETTLED,
        "unknown",
        "The gap follows a law of states and inputs, and no effect has its form.",
    ),
    Rule(
        "unnamed_and_far",
        lambda f: f.left > FAR,
        "unknown",
        "The free run is far from the data, and no effect explains it.",
    ),
    Rule(
        "unnamed_and_large",
        lambda f: f.error > LARGE_ERROR and f.left > LEFT_OF_LARGE,
        "unknown",
        "The free run is wrong by more than a disturbance, and no effect explains it.",
    ),
    Rule("none", lambda f: True, "none", "What is left is noise and disturbance."),
)


def first_rule(features: DecisionFeatures) -> Rule:
    """The rule that decides."""
    return next(rule for rule in RULES if rule.applies(features))


def decide(features: DecisionFeatures) -> tuple[str, Reasons]:
    """The verdict, and the rule that gave it."""
    rule = first_rule(features)
    return rule.verdict, Reasons(rule.name, rule.sentence, asdict(features))
