"""Single steps of the search and of the choice by fold, with candidates that are only named."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.decide import _choice_by_fold
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.search import _fit_from_starts
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.search._set_moves import acts
from sksurrogate.gap.search._set_search import SetSearch
from sksurrogate.gap.search._trajectory_search import TrajectorySearch, _fit
from sksurrogate.kernels.record import Record


@pytest.mark.parametrize("runs", [2, 3, 5])
def test_each_fold_of_few_runs_elects_what_the_others_choose(monkeypatch, runs):
    record = Record.from_runs([np.zeros((8, 1))] * runs, [np.zeros((8, 1))] * runs, [0.1 * np.arange(8)] * runs, 0.1)
    search = SimpleNamespace(
        problem=SimpleNamespace(record=record), is_far=lambda one: False, prior_cost=lambda one: 0.0, library=[None] * 4
    )
    picks = [None, *[0] * (runs - 1)]
    monkeypatch.setattr(_choice_by_fold, "by_run", lambda candidate, *rest: candidate)
    monkeypatch.setattr(_choice_by_fold, "chosen_without", lambda first, others, *rest: picks)
    found = _choice_by_fold.choices_by_fold(search, [("first", [], 0.0), ("other", [], 0.0)])
    assert found == ["first", *["other"] * (runs - 1)]
    assert _choice_by_fold.choices_by_fold(search, [("first", [], 0.0)]) == ["first"] * runs


def test_an_effect_that_breaks_the_arithmetic_from_every_start_is_no_candidate(monkeypatch):
    def broken(*given):
        raise FloatingPointError("overflow")

    monkeypatch.setattr(_fit_from_starts, "fit_last", broken)
    monkeypatch.setattr(_fit_from_starts, "sticks_in", lambda *given: False)
    base = SimpleNamespace(problem=None, effects=(), theta_with=lambda own: own, fit=None)
    starts = [SimpleNamespace(effect=CATALOGUE["linear_loss"]("v", "v"), theta=np.ones(1), x=None)]
    assert _fit_from_starts.fit_added(base, starts, np.inf) is None


def test_in_place_of_a_single_name_stand_those_that_were_compared_with_it():
    calls = []
    search = SimpleNamespace(first_round=["a", "b"], without=lambda candidate, i: calls.append(i))
    one, two = (SimpleNamespace(effects=("x",) * n, candidate=None) for n in (1, 2))
    assert TrajectorySearch.in_place_of(search, one, 0) == ["a", "b"] and not calls
    assert TrajectorySearch.in_place_of(search, two, 1) == [] and calls == [1]


def test_an_effect_that_does_nothing_is_no_candidate():
    effects = [CATALOGUE[name]("y") for name in ("sensor_lag", "sensor_delay", "sensor_rectification")]

    def candidate(*values):
        return SimpleNamespace(effects=effects, theta_of=lambda i: np.array(values[i]))

    assert acts(candidate([11.0], [0.1], []))
    assert not acts(candidate([11.0], [0.0], []))


def test_the_slope_of_a_linear_effect_is_what_its_start_changes_over_its_size():
    given = []
    problem = SimpleNamespace(fit_added=lambda base, effect, theta, slopes: given.append((theta, slopes)))
    change = np.arange(5.0)[None]
    _fit(problem, None, CATALOGUE["sensor_bias"]("y"), np.array([0.25]), change)
    ((theta, slopes),) = given
    assert theta.tolist() == [0.25]
    np.testing.assert_array_equal(slopes, 4.0 * change[None])


def of_cost(cost):
    """A candidate of which only the cost is known."""
    return SimpleNamespace(fit=SimpleNamespace(cost=cost))


@pytest.mark.parametrize(("top", "nearest", "both"), [(9e4, 4e3, True), (9e4, 8e4, False), (4e3, 3e3, False)])
def test_a_set_near_the_data_is_chosen_again_beside_a_likelier_one_that_is_far(top, nearest, both):
    search = SimpleNamespace(is_far=lambda one: one.fit.cost > 1e4, polish=lambda one: one)
    trial = [of_cost(top), of_cost(nearest), of_cost(2e5)]
    assert SetSearch.near_beside_far(search, trial, trial[0]) == ([trial[1]] if both else [])


def test_a_quick_look_under_the_noise_of_others_takes_nothing_from_a_candidate():
    class Candidate(SimpleNamespace):
        __hash__ = object.__hash__

    one, search = Candidate(), OdeSearch(None, [], np.zeros((1, 2)))
    search.judge(Evidence(one, "own", 40.0))
    for noise, value, kept in [
        ("rough", 30.0, ("own", 40.0)),
        ("better", 45.0, ("better", 45.0)),
        ("rough", 30.0, ("better", 45.0)),
    ]:
        found = search.judge(Evidence(one, noise, value, quick=True))
        assert (found.noise, found.log_likelihood) == kept
        assert search.noise_of(one) == kept[0]
