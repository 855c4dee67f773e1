"""Shares of the gap: they add up to one, their intervals hold them, and what one may gain another may lose."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from sksurrogate.gap.decide._budget import budget_of, remainder_of
from sksurrogate.gap.decide._partial_results import Parts
from sksurrogate.gap.results._effect_estimate import BAND
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.unnamed._law_left import LawLeft

#: 80 % of the amplitude, 96 % of the power; 91 to 99 % with 90 % of certainty.
SHRINK = Shrink(0.5, 0.1, 0.02, 0.8, (0.7, 0.9), fraction_power=0.96)
LAW = LawLeft("speed", "state", "speed")
shares = st.floats(0, 1.5)


def rows(*given):
    return {row["part"]: (row["share"], row["low"], row["high"]) for row in budget_of(*given)}


def test_what_two_effects_close_is_uncertain_in_proportion_and_the_disturbance_is_the_rest():
    found = rows(["friction", "lag"], [0.72, 0.18], 0.06, SHRINK, None)
    assert found["friction"] == pytest.approx((0.72, 0.72 - 0.75 * 0.05, 0.72 + 0.75 * 0.03))
    assert found["lag"] == pytest.approx((0.18, 0.18 - 0.1875 * 0.05, 0.18 + 0.1875 * 0.03))
    assert found["re-tuning"] == pytest.approx((0.06, 0.06 - 0.0625 * 0.05, 0.06 + 0.0625 * 0.03))
    assert found["disturbance"] == pytest.approx((0.04, 0.01, 0.09)) and found["unnamed law"] == (0, 0, 0)


def test_a_law_takes_its_power_of_the_rest_and_all_of_it_where_it_is_larger():
    found = rows(["friction"], [0.96], 0.0, SHRINK, replace(LAW, size=0.1, spread=0.02))
    low, high = (0.1 - 1.645 * 0.02) ** 2, (0.1 + 1.645 * 0.02) ** 2
    assert found["unnamed law"] == pytest.approx((0.01, low, high))
    assert found["disturbance"] == pytest.approx((0.03, 0.0, 0.03 + 0.05 + 0.01 - low))
    found = rows(["friction"], [0.96], 0.0, SHRINK, replace(LAW, size=0.5, spread=0.02))
    assert found["unnamed law"] == pytest.approx((0.04, 0.04, 0.09))  # what the effect may lose the law may be
    assert found["disturbance"] == pytest.approx((0.0, 0.0, 0.05))


def test_a_certified_formula_has_a_row_of_its_own_within_the_law():
    formula = SimpleNamespace(certified=True, share=0.03)
    found = budget_of(["friction"], [0.96], 0.0, SHRINK, replace(LAW, size=0.5), formula)
    own, left, noise = list(found)[2:]
    assert own["kind"] == left["kind"] == "unnamed law" and own["part"].startswith("law: ")
    assert [own["share"], left["share"], noise["share"]] == pytest.approx([0.03, 0.01, 0.0])
    assert (own["low"], own["high"], left["high"]) == pytest.approx((0.0, 0.06, 0.06))
    for not_one in (SimpleNamespace(certified=False, share=0.03), SimpleNamespace(certified=True, share=np.nan)):
        assert len(budget_of(["friction"], [0.96], 0.0, SHRINK, None, not_one)) == 4


@given(st.lists(shares, max_size=3), shares, st.floats(0, 0.9), st.floats(0, 1), shares, st.floats(0, 1), shares)
def test_shares_add_up_to_one_and_lie_in_their_intervals(parts, retuning, fraction, width, size, spread, certified):
    shrink = replace(SHRINK, fraction=fraction, interval=(fraction - width, fraction + width / 10))
    formula = SimpleNamespace(certified=True, share=certified) if certified < 0.5 else None
    names = [f"effect {k}" for k in range(len(parts))]
    found = list(budget_of(names, parts, retuning, shrink, replace(LAW, size=size, spread=spread), formula))
    assert sum(row["share"] for row in found) == pytest.approx(1.0, abs=1e-9)
    for row in found:
        assert 0.0 <= row["low"] <= row["share"] + 1e-12 and row["share"] <= row["high"] + 1e-12 <= 1.0 + 2e-12


def test_where_there_is_no_gap_there_are_no_shares():
    assert len(budget_of([], [], 0.0, replace(SHRINK, fraction_power=np.nan), None)) == 0
    bare = rows([], [], 0.0, replace(SHRINK, interval=(np.nan, np.nan)), None)
    assert bare["disturbance"] == (1.0, 1.0, 1.0)


def test_what_no_stage_has_said_closes_nothing():
    assert (Parts().shares, Parts().retuning, Parts().probabilities) == ((), 0.0, ())
    assert pytest.approx(norm.ppf(0.95), abs=1e-3) == BAND


@pytest.mark.parametrize(("share", "lawful"), [(0.2, 0.1), (0.04, 0.04), (-0.002, 0.0)])
def test_a_law_is_no_more_than_what_is_left(share, lawful):
    """Where the gap is below the noise, a law in it may be any number of its size."""
    left = remainder_of(SHRINK, share, 1.0, replace(LAW, size=0.1, spread=0.02))
    assert (left.share, left.lawful) == (share, lawful) and left.lawful_spread <= left.lawful
