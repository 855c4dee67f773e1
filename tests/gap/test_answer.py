"""Reports without a name: too small a gap, or one that no law explains."""

from dataclasses import replace

import numpy as np

from sksurrogate.gap import GapReport
from sksurrogate.gap.decide._rules import PRACTICAL
from sksurrogate.gap.render._headline import sentence_of
from sksurrogate.gap.render._notes import on_none
from sksurrogate.gap.results._shrink import NOT_KNOWN
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.results._where import Where


def shrink(before, measurable=True):
    return replace(NOT_KNOWN, before=before, measurable=measurable)


def sentence(shrink):
    return sentence_of(GapReport("none", "", [], Table(), Table(), Where(None, None), shrink))


def test_a_gap_below_the_practical_bar_says_its_size_and_the_bar():
    small = shrink(0.6 * PRACTICAL)
    assert "0.3 %" in on_none(small)[0] and f"{100 * PRACTICAL:g} %" in on_none(small)[0]
    assert "too little to matter" in sentence(small)


def test_a_larger_one_is_a_disturbance_until_it_repeats():
    assert "Repeat a run" in on_none(shrink(3 * PRACTICAL))[0]
    assert "to within noise" in sentence(shrink(3 * PRACTICAL))
    assert "to within noise" in sentence(shrink(0.5 * PRACTICAL, measurable=False))
    assert on_none(shrink(np.nan, measurable=False)) == []
