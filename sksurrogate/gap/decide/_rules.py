"""The verdict as an ordered table: the first rule that applies decides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

from sksurrogate.gap.decide._features import DecisionFeatures
from sksurrogate.gap.fit._closeness import FAR, LEFT_BY_SEVERAL
from sksurrogate.gap.fit._problem import LARGEST_DISTURBANCE
from sksurrogate.gap.results._reasons import Reasons
from sksurrogate.gap.search._search import MOST_EFFECTS
from sksurrogate.gap.search._stopping import STACK
from sksurrogate.gap.unnamed._curve_shapes import CERTAIN

__all__ = ["RULES", "Rule", "decide", "first_rule"]

#: A reading's grid counts from this share of the output's deviation on.
ROUNDING = 0.01
#: Free-run error over the noise: below WITHIN the free run is at the noise.
WITHIN, BEYOND_NOISE, LEFT_LAWFUL, LEFT_FOR_MOST = 1.15, 1.05, 1.1, 1.5
#: R2 of a law of states and inputs in what is left: a law, a clear one, one beside two names; FEW over the samples is chance.
LAW, CLEAR_LAW, LAW_BY_TWO, FEW = 0.10, 0.3, 0.03, 20.0
#: Latent force over the RMS of dx/dt: what any model of a real plant leaves, and the largest that is called a disturbance.
CLEAR_FORCE, FORCE = 0.008, 0.06
#: Share of the gap (amplitude) that is left.
SHARE, SHARE_LAWFUL, SMALL_SHARE, LAWFUL_SHARE, NUMERICS_SHARE, SHARE_BY_TWO = 0.20, 0.05, 0.12, 0.12, 0.01, 0.08
#: Share that one name, several names and a name that leaves nothing lawful may leave.
MOST_LEFT, MOST_LEFT_BY_SEVERAL, MOST_LEFT_LAWLESS = 0.4, 0.3, 0.5
#: What a latent force, and a free curve (twice: beyond the noise, at the noise), must move an output by, over its deviation.
MOVED, CURVE_MOVED, CURVE_MOVED_WITHIN = 0.03, 0.005, 0.001
#: Share of the gap that a free curve must make up, beyond the noise and at it.
CURVE_SHARE, CURVE_SHARE_WITHIN = 0.01, 0.003
#: Gain of a law in the place of several names that makes it likelier.
ONE_FOR_SEVERAL = 3.0
#: Share of the folds that must choose the same names.
SAME_NAMES = 0.5
#: A gap below these shares of the outputs' deviation is of no practical size, the second only where no law is in it.
PRACTICAL, PRACTICAL_LAWLESS = 0.005, 0.02
#: A free run beyond both (error over the deviation, over the noise) is wrong by more than a disturbance.
LARGE_ERROR, LEFT_OF_LARGE = LARGEST_DISTURBANCE, 2.0


@dataclass(frozen=True)
class Rule:
    """One line of the table.

    Attributes
    ----------
    name : str
    applies : callable
        ``applies(features) -> bool``.
    verdict : {"none", "explained", "unknown"}
    sentence : str
        What it means.
    """

    name: str
    applies: Callable[[DecisionFeatures], bool]
    verdict: str
    sentence: str


# ---- conditions -----------------------------------------------------------------------------------------------------
def closed(f: DecisionFeatures) -> bool:
    """Effects passed, or re-tuning did."""
    return bool(f.accepted or f.retuned)


def far(f: DecisionFeatures) -> bool:
    """The free run is far from the data."""
    return bool(f.left > FAR)


def lawful(f: DecisionFeatures) -> bool:
    """States and inputs repeat what is left on runs left out, more than chance does."""
    return bool(f.law > max(LAW, FEW / f.n_samples))


def forceful(f: DecisionFeatures) -> bool:
    """The latent force is larger than a disturbance."""
    return bool(f.force > FORCE)


def certain_curve(f: DecisionFeatures, moved: float) -> bool:
    """A free curve of one signal is certain, and moves an output."""
    return bool(f.curve > CERTAIN and f.curve_moved > moved)


def hidden_curve(f: DecisionFeatures) -> bool:
    """A certain free curve beside what is named; less of it counts where the free run is at the noise."""
    moved, share = (CURVE_MOVED_WITHIN, CURVE_SHARE_WITHIN) if f.left < WITHIN else (CURVE_MOVED, CURVE_SHARE)
    return certain_curve(f, moved) and bool(f.curve_share > share)


def most_share(f: DecisionFeatures) -> float:
    """Share of the gap that names may leave."""
    if f.needless:
        return SHARE
    if f.names > 1:
        return MOST_LEFT_BY_SEVERAL
    lawless = f.law <= 0.0 and f.curve < 0.0 and f.force < FORCE
    return MOST_LEFT_LAWLESS if lawless else MOST_LEFT


def much_left(f: DecisionFeatures) -> bool:
    """More of the gap is left than a lawful rest may be, beyond the noise."""
    return bool(f.share_left > SHARE and f.left > BEYOND_NOISE)


def doubted(f: DecisionFeatures) -> bool:
    """Several names leave more than the noise and their numerics."""
    return bool(f.left > max(LEFT_BY_SEVERAL, 1.0 + f.n_samples**-0.5) and f.share_left > NUMERICS_SHARE)


def when_far(condition: Callable[[DecisionFeatures], bool]) -> Callable[[DecisionFeatures], bool]:
    """The gap was closed by names or re-tuning, but the free run is far from the data; and the condition."""
    return lambda f: closed(f) and far(f) and condition(f)


def when_near(condition: Callable[[DecisionFeatures], bool]) -> Callable[[DecisionFeatures], bool]:
    """The gap was closed by names or re-tuning, the free run is near the data; and the condition."""
    return lambda f: closed(f) and not far(f) and condition(f)


# ---- the table ------------------------------------------------------------------------------------------------------
RULES: tuple[Rule, ...] = (
    Rule("rounding", lambda f: f.rounding > ROUNDING, "unknown", "The readings lie on a grid that no effect names."),
    Rule(
        "input_curve", lambda f: f.input_curve, "unknown", "Two static laws of one input stand for its unknown curve."
    ),
    Rule("opposed", lambda f: f.opposed, "unknown", "Two static laws of one variable in one balance nearly cancel."),
    Rule(
        "names_leave_most",
        lambda f: closed(f) and f.accepted and f.share_left > most_share(f) and f.left > LEFT_FOR_MOST,
        "unknown",
        "The effects leave more of the gap than effects may leave.",
    ),
    Rule(
        "far_full_stack",
        when_far(lambda f: f.names >= MOST_EFFECTS and f.law > CLEAR_LAW and f.share_left > SHARE_LAWFUL),
        "unknown",
        "As many effects as are looked for leave a clear law, far from the data.",
    ),
    Rule(
        "far_stack",
        when_far(lambda f: f.names >= STACK and f.share_left > SHARE),
        "unknown",
        "Three or more effects leave a large share of the gap, far from the data.",
    ),
    Rule(
        "far_law",
        when_far(lambda f: lawful(f) and f.share_left > SMALL_SHARE),
        "unknown",
        "Far from the data, what is left follows a law of states and inputs.",
    ),
    Rule(
        "far_force",
        when_far(lambda f: forceful(f) and f.share_left > SMALL_SHARE),
        "unknown",
        "Far from the data, what is left is larger than a disturbance.",
    ),
    Rule(
        "far_curve",
        when_far(lambda f: hidden_curve(f) and f.share_left > SMALL_SHARE),
        "unknown",
        "Far from the data, what is left is a certain curve of one signal.",
    ),
    Rule("far_explained", when_far(lambda f: True), "explained", "Nearly all of a gap far above the noise is closed."),
    Rule(
        "clear_law",
        when_near(
            lambda f: (
                f.law > CLEAR_LAW and f.share_left > SHARE_LAWFUL and f.left > LEFT_LAWFUL and f.force > CLEAR_FORCE
            )
        ),
        "unknown",
        "What is left follows a clear law of states and inputs.",
    ),
    Rule(
        "lasting_law",
        when_near(lambda f: lawful(f) and f.share_left * f.law**0.5 > LAWFUL_SHARE and much_left(f)),
        "unknown",
        "A law of states and inputs makes up a lasting share of the gap.",
    ),
    Rule(
        "large_force",
        when_near(lambda f: forceful(f) and f.moved > MOVED and much_left(f)),
        "unknown",
        "A force larger than a disturbance is left and moves an output.",
    ),
    Rule(
        "hidden_curve", when_near(hidden_curve), "unknown", "A certain curve of one signal is left beside the effects."
    ),
    Rule(
        "imitated",
        when_near(lambda f: f.accepted and f.rival > (CERTAIN if f.names == 1 else ONE_FOR_SEVERAL)),
        "unknown",
        "One law without a name fits better in the place of all effects.",
    ),
    Rule(
        "unstable_names",
        when_near(lambda f: f.accepted and f.same_names < SAME_NAMES),
        "unknown",
        "Other runs choose other effects.",
    ),
    Rule(
        "stack",
        when_near(lambda f: doubted(f) and f.names >= STACK),
        "unknown",
        "Three or more effects leave more than the noise: they stand in for one that is missing.",
    ),
    Rule(
        "two_beside_law",
        when_near(lambda f: doubted(f) and f.names == 2 and f.share_left > SHARE_BY_TWO and f.law > LAW_BY_TWO),
        "unknown",
        "Two effects leave a law: they stand in for one that is missing.",
    ),
    Rule(
        "two_of_one_curve",
        when_near(lambda f: doubted(f) and f.names == 2 and f.share_left > SHARE_BY_TWO and f.one_curve),
        "unknown",
        "Two effects that are parts of one curve leave more than the noise.",
    ),
    Rule(
        "explained",
        closed,
        "explained",
        "The effects, or re-tuning, close the gap to what noise and disturbance leave.",
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
        lambda f: certain_curve(f, PRACTICAL),
        "unknown",
        "A curve of one signal is certain, and no effect has its form.",
    ),
    Rule(
        "unnamed_law",
        lambda f: lawful(f) and f.left > WITHIN,
        "unknown",
        "The gap follows a law of states and inputs, and no effect has its form.",
    ),
    Rule("unnamed_and_far", far, "unknown", "The free run is far from the data, and no effect explains it."),
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
