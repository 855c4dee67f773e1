"""Sets that say in more names what stands: no rivals of it, but said beside it."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.decide._contenders import elsewhere, in_more_names, in_other_names, nats_apart
from sksurrogate.gap.decide._ode_access import notes_in_other_words

SIGMA, ROWS = 0.1, 200
GAIN = CATALOGUE["input_gain"]("valve")
DEPENDS = CATALOGUE["parameter_dependence"]("feed", "level")
LOSS, BIAS = CATALOGUE["linear_loss"]("level", "level"), CATALOGUE["constant_bias"]("level")


class Fitted(SimpleNamespace):
    """A set whose prediction is a constant away from that of the named one."""

    __hash__ = object.__hash__


def fitted(*effects, away=0.0, cost=200.0):
    return Fitted(
        effects=effects,
        keys=tuple(effect.key for effect in effects),
        residual=np.full((1, ROWS), away * SIGMA),
        fit=SimpleNamespace(cost=cost),
        n_parameters=3,
    )


NAMED = fitted(GAIN, DEPENDS)


def search_with(*others, worth=0.0):
    """A search that has fitted these sets, each as likely as what stands but for ``worth`` nats."""
    return SimpleNamespace(
        fitted={frozenset(one.keys): one for one in (NAMED, *others)},
        judged={},
        plausible=lambda one: True,
        evidence=lambda one: 0.0 if one is NAMED else worth,
        own=lambda one: one,
        tolerated_cost=100.0,
        library=[GAIN, DEPENDS, LOSS, BIAS],
        positions=(),
        n_values=ROWS,
    )


FINAL = SimpleNamespace(
    candidate=NAMED, effects=NAMED.effects, fit=NAMED.fit, noise=SimpleNamespace(sigma=np.array([SIGMA])), left=1.0
)


@pytest.mark.parametrize("away", [0.0, 0.1, 0.5])
def test_what_the_data_tell_apart_is_half_the_square_of_the_difference_over_the_noise(away):
    """The expected log likelihood ratio of two means under white noise (Kullback and Leibler)."""
    assert nats_apart(fitted(GAIN, away=away), FINAL.candidate, FINAL.noise) == pytest.approx(0.5 * ROWS * away**2)


@pytest.mark.parametrize(
    ("other", "same"),
    [
        (fitted(GAIN, LOSS, BIAS, away=0.05), True),  # 0.25 nats
        (fitted(GAIN, LOSS, BIAS, away=0.3), False),  # 9 nats
        (fitted(GAIN, DEPENDS, LOSS, away=0.05), False),  # holds what stands
        (fitted(GAIN, BIAS, away=0.05), False),  # in as many names: a twin
        (fitted(GAIN, LOSS, BIAS, away=0.05, cost=400.0), False),  # leaves more than the tolerance
    ],
)
def test_two_names_in_the_place_of_one_that_predict_the_same_are_no_rivals(other, same):
    search = search_with(other)
    assert in_more_names(search, FINAL) == ([other] if same else [])


def test_rivals_count_against_a_name_and_other_words_for_it_do_not(monkeypatch):
    monkeypatch.setattr("sksurrogate.gap.decide._contenders.judged_contender", lambda *given: [])
    alike, apart = fitted(GAIN, LOSS, BIAS, away=0.05), fitted(GAIN, BIAS, LOSS, CATALOGUE["drift"]("level"), away=0.3)
    own = SimpleNamespace(net=0.0, before=-10.0, law=SimpleNamespace(name=None))
    held = [keys for keys, _ in elsewhere(search_with(alike, apart), FINAL, own)]
    assert held == [frozenset(apart.keys)]


def test_the_report_says_in_which_other_words():
    four = fitted(GAIN, LOSS, BIAS, CATALOGUE["drift"]("level"))
    (note,) = notes_in_other_words(NAMED, [four, fitted(GAIN, LOSS, BIAS)])
    assert note == (
        "These data cannot tell linear loss at level and constant bias at level together from parameter dependence at feed, driven by "
        "level; the fewest names stand."
    )
    assert notes_in_other_words(NAMED, []) == []


@pytest.mark.parametrize(("away", "same"), [(0.05, True), (0.3, False)])
def test_names_that_predict_the_same_one_by_one_are_no_rivals(away, same, monkeypatch):
    """A bias and a loss in the place of a gain and a dependence: alone, the bias does what the gain does, the loss what the dependence does."""
    monkeypatch.setattr("sksurrogate.gap.decide._contenders.judged_contender", lambda *given: [])
    alone = [fitted(GAIN, away=5.0), fitted(BIAS, away=5.0 + away), fitted(DEPENDS, away=3.0), fitted(LOSS, away=3.0)]
    search = search_with(*alone, other := fitted(BIAS, LOSS))
    assert in_other_names(search, FINAL) == ([other] if same else [])
    own = SimpleNamespace(net=0.0, before=-10.0, law=SimpleNamespace(name=None))
    assert (frozenset(other.keys) in [keys for keys, _ in elsewhere(search, FINAL, own)]) != same
    (note,) = notes_in_other_words(NAMED, [other])
    assert note.startswith(
        "These data cannot tell constant bias at level and linear loss at level from input gain at valve and parameter"
    )
