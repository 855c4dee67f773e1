"""The probability of a name among its candidates, none, and a law without a name."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects._balance import ConstantBias, LinearLoss
from sksurrogate.gap.decide._equivalence import probabilities
from sksurrogate.gap.search._ode_search import EQUAL


def candidate(*effects, value):
    keys = tuple(effect.key for effect in effects)
    return SimpleNamespace(effects=effects, keys=keys, n_parameters=len(effects), value=value)


def chance(twins=(), rejected=(), null=-500.0, posterior=1.0):
    final = candidate(ConstantBias("speed"), value=0.0)
    fitted = {frozenset(one.keys): one for one in (final, *twins, *rejected)}
    null = SimpleNamespace(candidate=candidate(value=null))
    search = SimpleNamespace(score=lambda one: one.value, own=lambda one: one, null=null, fitted=fitted, n_values=100)
    (found,) = probabilities(search, final, [SimpleNamespace(index=0, twins=list(twins))], [posterior])
    return found


def test_alone_it_is_certain_and_a_twin_counts_for_its_class():
    assert chance() == pytest.approx(1.0)
    assert chance([candidate(LinearLoss("speed", "speed"), value=np.log(0.25))]) == pytest.approx(1.0)


def test_none_and_a_law_without_a_name_count_against_it():
    assert chance(posterior=0.25) == pytest.approx(0.25)
    other = candidate(LinearLoss("speed", "speed"), value=100.0)
    assert chance(rejected=[other], posterior=0.6) == pytest.approx(0.6 / (1.0 + np.exp(-EQUAL)))


def test_a_rejected_candidate_counts_as_little_as_its_finer_fit_said():
    other = candidate(LinearLoss("speed", "speed"), value=100.0)
    assert chance(rejected=[other]) == pytest.approx(1.0 / (1.0 + np.exp(-EQUAL)))
    two = candidate(LinearLoss("speed", "speed"), LinearLoss("speed", "load"), value=100.0)
    assert chance(rejected=[two]) == pytest.approx(1.0)
