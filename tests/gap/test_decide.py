"""The verdict: which rule decides on which features."""

from dataclasses import fields, replace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.decide._intervals import is_sized
from sksurrogate.gap.decide._rules import MOST_LEFT, RULES, DecisionFeatures, certified, decide, first_rule, share_left
from sksurrogate.gap.results._shrink import Shrink

#: One certain name that leaves 2 % of a gap of a tenth of the outputs.
NAMED = DecisionFeatures(names=1, probability=0.99, share_left=0.02, left=1.05, after=0.002, error=0.1)


def rule_of(features):
    return first_rule(features).name


def test_a_name_that_closes_the_gap_is_explained_whatever_small_rest_is_lawful():
    assert decide(replace(NAMED, share_left=0.05, left=3.0, lawful=0.05))[0] == "explained"


def test_the_tolerance_is_the_users():
    leaves = replace(NAMED, share_left=0.15, left=3.0, lawful=0.15, after=0.02)
    assert decide(leaves)[0] == "partial"
    assert decide(replace(leaves, tolerance=0.2))[0] == "explained"


def test_a_certain_name_beside_a_lawful_rest_is_partial_and_beside_a_disturbance_explained():
    leaves = replace(NAMED, share_left=0.3, left=3.0, lawful=0.25, after=0.03)
    assert decide(leaves)[0] == "partial"
    assert decide(replace(leaves, lawful=0.05))[0] == "explained"


def test_a_name_that_does_not_show_its_form_is_not_certain():
    assert (
        decide(replace(NAMED, shown=False))[0] == "unknown"
        and rule_of(replace(NAMED, shown=False)) == "uncertain_names"
    )


def test_what_is_larger_than_a_disturbance_is_not_called_one():
    leaves = replace(NAMED, share_left=0.3, left=3.0, lawful=0.05, error=0.5, after=0.15)
    assert decide(leaves)[0] == "partial"


def test_a_name_that_is_not_certain_is_unknown_however_much_it_closes():
    assert decide(replace(NAMED, probability=0.7)) == decide(replace(NAMED, probability=0.7))
    assert rule_of(replace(NAMED, probability=0.7)) == "uncertain_names"


def test_a_name_whose_interval_holds_no_effect_is_not_certain_however_probable_it_is():
    unsized = replace(NAMED, probability=0.9999, sized=False)
    assert (decide(unsized)[0], rule_of(unsized)) == ("unknown", "uncertain_names")
    assert decide(replace(unsized, names=0, retuned=True, share_left=0.05))[0] == "explained"  # of names alone


@pytest.mark.parametrize(
    ("low", "high", "sized"), [(0.1, 0.4, True), (0.0, 0.4, False), (-0.1, 0.4, False), (-0.4, -0.1, True)]
)
def test_an_interval_that_holds_no_effect(low, high, sized):
    """The second of two effects; the first has two parameters, of which only the magnitude counts."""
    effects = [CATALOGUE["power_law"]("v", "v"), CATALOGUE["linear_loss"]("v", "v")]
    assert is_sized(effects, np.array([1.0, -1.0, low]), np.array([2.0, 1.0, high])) is sized


def test_within_the_noise_a_certain_name_explains():
    assert rule_of(replace(NAMED, share_left=0.4, left=1.1)) == "at_the_noise"


def test_retuning_alone_is_judged_as_a_name_is():
    alone = replace(NAMED, names=0, probability=1.0, retuned=True)
    assert decide(alone)[0] == "explained"
    assert decide(replace(alone, share_left=0.3, left=3.0, lawful=0.25))[0] == "unknown"
    assert rule_of(replace(alone, share_left=0.4, left=1.1)) == "at_the_noise"
    # what it leaves is a law, or a disturbance, however large beside the gap
    assert rule_of(replace(alone, share_left=0.6, left=1.1, lawful=0.25)) == "most_left"
    assert rule_of(replace(alone, share_left=0.6, left=1.1)) == "disturbance_left"


def test_retuning_to_a_bound_explains_nothing():
    retuned = DecisionFeatures(retuned=True, share_left=0.05, error=0.3, after=0.015)
    assert decide(retuned)[0] == "explained"
    assert (decide(replace(retuned, at_bound=True))[0], rule_of(replace(retuned, at_bound=True))) == (
        "unknown",
        "at_a_bound",
    )
    assert decide(replace(NAMED, at_bound=True))[0] == "explained"  # by what is named beside it


def test_in_another_unit_nothing_is_explained():
    assert rule_of(replace(NAMED, other_unit=True)) == "other_unit"
    assert decide(replace(NAMED, other_unit=True))[0] == "unknown"


def test_a_grid_that_nothing_names_is_not_explained():
    assert decide(replace(NAMED, rounding=0.02))[0] == "partial"
    assert decide(DecisionFeatures(error=0.1, rounding=0.02))[0] == "unknown"


@pytest.mark.parametrize(
    ("features", "rule"),
    [
        (DecisionFeatures(error=0.004, left=9.0, curve=90.0, curve_moved=0.004), "below_practical"),
        (DecisionFeatures(error=0.015, left=3.0), "small_and_near"),
        (DecisionFeatures(error=0.015, left=5.1), "unnamed_and_far"),
        (DecisionFeatures(error=0.05, left=1.3, curve=40.0, curve_moved=0.02), "unnamed_law"),
        (DecisionFeatures(error=0.05, left=1.3, curve=40.0, curve_moved=0.002), "none"),
        (DecisionFeatures(error=0.05, left=5.1), "unnamed_and_far"),
        (DecisionFeatures(error=0.05, left=5.1, curve=40.0, curve_moved=0.02, noisy_input=True), "noisy_input"),
        (DecisionFeatures(error=0.05, left=5.1, noisy_input=False), "unnamed_and_far"),
        (DecisionFeatures(error=0.05, after=0.05, left=5.1, lawful=0.2), "unnamed_and_far"),
        (DecisionFeatures(error=0.05, after=0.05, left=5.1, lawful=0.05), "none"),  # a disturbance
        (DecisionFeatures(error=0.15, after=0.15, left=5.1, lawful=0.05), "unnamed_and_far"),
        (DecisionFeatures(names=1, probability=0.99, share_left=0.4, left=5.1, noisy_input=True), "law_left"),
        (DecisionFeatures(error=0.2, left=2.1), "unnamed_and_far"),
        (DecisionFeatures(error=0.05, left=1.3), "none"),
    ],
)
def test_without_a_name_the_size_and_the_law_of_the_gap_decide(features, rule):
    assert rule_of(features) == rule


def test_a_law_that_is_not_certain_may_be_chance():
    gap = DecisionFeatures(error=0.05, left=1.3, curve=9.0, curve_moved=0.02)
    assert rule_of(gap) == "none"
    assert rule_of(replace(gap, curve=11.0)) == "unnamed_law"


def test_a_law_that_closes_nothing_on_runs_left_out_does_not_repeat():
    """What wanders may look like a law of the signals of these runs. A gap that is far and no disturbance stays unknown."""
    gap = DecisionFeatures(error=0.05, after=0.05, left=1.3, curve=40.0, curve_moved=0.02, lawful=0.2, repeats=False)
    assert rule_of(gap) == rule_of(replace(gap, left=8.0)) == "none"
    assert rule_of(replace(gap, error=0.5, after=0.5, left=8.0)) == "unnamed_and_far"


def test_a_certain_law_that_makes_up_most_of_the_gap_is_none_of_what_wanders():
    """Its formula may be poor all the same: a surface of two signals has none."""
    gap = DecisionFeatures(error=0.05, after=0.05, left=5.0, curve=40.0, curve_moved=0.05, repeats=False)
    assert rule_of(replace(gap, lawful=0.9)) == "unnamed_law" and rule_of(replace(gap, lawful=0.4)) == "none"
    assert rule_of(replace(gap, lawful=4.5)) == "none"  # it cancels with initial states


def test_the_reasons_hold_the_rule_and_every_feature():
    verdict, reasons = decide(NAMED)
    assert (verdict, reasons.rule) == ("explained", "closed")
    assert set(reasons.features) == {field.name for field in fields(DecisionFeatures)}
    assert reasons.sentence == next(rule.sentence for rule in RULES if rule.name == "closed")


def test_more_left_never_makes_a_better_verdict():
    rank = {"explained": 0, "partial": 1, "unknown": 2}
    rng = np.random.default_rng(0)
    for _ in range(300):
        one = replace(
            NAMED,
            probability=float(rng.uniform(0.5, 1.0)),
            share_left=float(rng.uniform(0.0, MOST_LEFT)),
            left=float(rng.uniform(1.0, 6.0)),
            lawful=float(rng.uniform(0.0, 0.6)),
            after=float(rng.uniform(0.0, 0.3)),
        )
        worse = replace(
            one,
            share_left=min(one.share_left + 0.2, MOST_LEFT),
            left=one.left + 1.0,
            lawful=one.lawful + 0.1,
            after=one.after + 0.05,
        )
        assert rank[decide(worse)[0]] >= rank[decide(one)[0]]


def test_every_rule_can_decide_and_has_its_own_name():
    assert len({rule.name for rule in RULES}) == len(RULES)
    assert {rule.verdict for rule in RULES} == {"none", "explained", "partial", "unknown"}


def test_a_simulator_that_runs_away_leaves_no_vanishing_share():
    away = Shrink(before=50.0, after=0.5, floor=0.01, fraction=0.99, interval=(0.98, 1.0))
    assert share_left(away) == pytest.approx(0.5)


def unasked() -> bool:
    raise AssertionError("a gap that is seen is judged by its size")


@pytest.mark.parametrize("likelier", [True, False])
def test_where_no_gap_is_seen_the_likelihood_of_runs_left_out_decides(likelier):
    # Beside a noisy input errors differ by chance: a larger one says nothing.
    shrink = Shrink(before=0.10989, after=0.10993, floor=0.111, fraction=np.nan, interval=(-0.5, 1.0))
    assert certified(shrink, lambda: likelier) is likelier


def test_the_certificate_asks_for_a_share_of_the_gap_on_runs_left_out():
    shrink = Shrink(before=0.3, after=0.28, floor=0.01, fraction=0.07, interval=(0.0, 0.1))
    assert not certified(shrink, unasked)
    assert not certified(replace(shrink, fraction=0.29), unasked)  # more power is left than is closed
    assert certified(replace(shrink, fraction=0.3), unasked)


def test_names_that_pass_the_certificate_leave_no_more_than_half_of_the_power():
    rng = np.random.default_rng(0)
    for before, fraction in zip(10 ** rng.uniform(-3, 2, 300), rng.uniform(-1, 1, 300)):
        shrink = Shrink(before, before * (1 - fraction), 0.0, fraction, (0.0, 1.0))
        assert not certified(shrink, unasked) or share_left(shrink) ** 2 <= 0.5 + 1e-12


def test_what_a_generic_correction_learns_is_no_disturbance():
    left = replace(NAMED, share_left=0.15, left=5.0, after=0.06, error=0.42)
    assert decide(left)[1].rule == "disturbance_left"
    assert decide(replace(left, correction_closes_more=True))[0] == "partial"
    alone = DecisionFeatures(error=0.05, after=0.05, left=5.1, lawful=0.05)
    assert decide(alone)[0] == "none"
    assert decide(replace(alone, correction_closes_more=True))[0] == "unknown"


def test_uncertain_names_of_a_small_gap_near_the_noise_are_none():
    uncertain = replace(NAMED, probability=0.2, share_left=0.49, left=1.03, after=0.0105, error=0.0114)
    assert decide(uncertain)[0] == "none"
    assert decide(replace(uncertain, probability=0.99, share_left=0.02))[0] == "explained"
    assert decide(replace(uncertain, error=0.03))[1].rule == "uncertain_names"  # not small
    assert decide(replace(uncertain, after=0.002))[1].rule == "uncertain_names"  # not near: 5.9 times the noise
