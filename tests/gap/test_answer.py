"""Sentences of a report without a name: too small a gap, or one that no law explains."""

from types import SimpleNamespace

from sksurrogate.gap.decide._rules import PRACTICAL
from sksurrogate.gap.render._sentences import note_on_none, sentence_of


def shrink(before, measurable=True):
    return SimpleNamespace(before=before, measurable=measurable, fraction=float("nan"))


def test_a_gap_below_the_practical_bar_says_its_size_and_the_bar():
    small = shrink(0.6 * PRACTICAL)
    assert "0.3 %" in note_on_none(small) and f"{100 * PRACTICAL:g} %" in note_on_none(small)
    assert "too small" in sentence_of("none", [], None, small, None, None)


def test_a_larger_one_is_a_disturbance_until_it_repeats():
    assert "repeat a run" in note_on_none(shrink(3 * PRACTICAL))
    assert "to within noise" in sentence_of("none", [], None, shrink(3 * PRACTICAL), None, None)
    assert "to within noise" in sentence_of("none", [], None, shrink(0.5 * PRACTICAL, measurable=False), None, None)
