"""Fits that are not made: those that were made before from the same start, and those that cannot come to anything."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.fit._ode import Numerics
from sksurrogate.gap.search import _ode_search, _onsets
from sksurrogate.gap.search._base import Wanted
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.search._onsets import Confined, look_for_onsets
from sksurrogate.gap.search._set_search import gaining
from sksurrogate.gap.search._stopping import grows_in_vain, in_vain_from

LOSS, BIAS, SPRING = (CATALOGUE[name]("v", "v") for name in ("linear_loss", "quadratic_loss", "cubic_stiffness"))


class Some:
    """Named values, each its own."""

    def __init__(self, **values):
        vars(self).update(values)


def of_cost(cost, *effects):
    return Some(
        fit=Some(cost=cost, x=np.zeros((1, 4)), theta=np.zeros(0)),
        effects=effects,
        keys=tuple(e.key for e in effects),
        n_starts=1,
    )


def start(effect, white, forced=0.0, evident=False):
    return SimpleNamespace(
        effect=effect,
        white=white,
        forced=forced,
        promises=max(white, forced),
        evident=evident,
        left=100.0,
        theta=np.ones(1),
    )


@pytest.fixture
def expanded(monkeypatch):
    """``expanded(starts, least)``: a base expanded from a screen twice; the effects that were fitted each time."""

    def expanded(starts, least=0.0):
        search = OdeSearch(Some(record=Some(n_values=10), numerics=Numerics(1)), [], np.zeros((1, 4)))
        found, base, fitted = Some(starts=starts), of_cost(1e9, LOSS), []

        def fit_all(self, base, chosen, best):
            fitted.append([one[0].effect.name for one in chosen])
            return [of_cost(50.0, LOSS, one[0].effect) for one in chosen]

        monkeypatch.setattr(OdeSearch, "base_and_screen", lambda *given: (base, found))
        monkeypatch.setattr(OdeSearch, "fit_all", fit_all)
        answers = [search.expand(base, Wanted(4, 0, least=least)) for _ in range(2)]
        return fitted, answers

    return expanded


def test_far_from_the_data_too_nothing_is_fitted_again_from_the_same_screen(expanded):
    fitted, (first, again) = expanded([start(BIAS, 5.0), start(SPRING, 3.0)])
    assert fitted == [["quadratic_loss", "cubic_stiffness"], []]
    assert again == first


def test_what_is_expected_to_gain_nothing_is_not_fitted_however_evident_it_is(expanded):
    fitted, _ = expanded([start(BIAS, 5.0), start(SPRING, -300.0, -1.0, evident=True)])
    assert fitted[0] == ["quadratic_loss"]
    assert expanded([start(SPRING, -300.0, 2.0, evident=True)], 9.0)[0][0] == ["cubic_stiffness"]


@pytest.mark.parametrize(("cost", "fits", "left"), [(85.0, 2, 90.0), (40.0, 3, 35.0)])
def test_a_set_without_an_effect_is_fitted_once(monkeypatch, cost, fits, left):
    """Until another fit of the others is known: where that is nearer by a tenth it goes on."""
    asked = []

    def fit(effects, theta, x, **how):
        asked.append(how)
        return of_cost(35.0 if how else 90.0, *effects)

    monkeypatch.setattr(_ode_search, "line_searched", lambda base, j: base)
    problem = Some(fit=fit, record=Some(n_values=10), numerics=Numerics(1))
    whole = of_cost(10.0, LOSS, BIAS)
    whole.problem, whole.states, whole.without_effect = problem, np.zeros((1, 4)), lambda i: ((LOSS,), np.zeros(0))
    search = OdeSearch(problem, [], np.zeros((1, 4)))
    first = search.refitted_without(whole, 1)
    assert search.refitted_without(whole, 1) is first and len(asked) == 1
    search.fitted[frozenset([LOSS.key])] = of_cost(cost, LOSS)
    again = search.refitted_without(whole, 1)
    assert again.fit.cost == left
    assert search.refitted_without(whole, 1) is again and len(asked) == fits


def test_sets_that_leave_more_than_a_smaller_one_are_no_bases():
    null, worse, better = of_cost(100.0), of_cost(150.0, LOSS), of_cost(80.0, BIAS)
    assert gaining([worse, better], null) == [better]


@pytest.mark.parametrize("cost", [50.0, 91.0, 700.0])
def test_a_set_grows_in_vain_from_the_cost_on_that_is_said(cost):
    before, null = of_cost(cost), of_cost(1000.0)
    edge = in_vain_from(before, null)
    assert [grows_in_vain(of_cost(share * edge), before, null) for share in (0.99, 1.01)] == [False, True]


@pytest.mark.parametrize(
    ("stands", "together", "most"),
    [
        (800.0, 100.0, 560.0),  # hardly less than what stands
        (300.0, 100.0, 500.0),  # half of what nothing leaves, in power: edges lie apart
        (245.0, 100.0, 245.0),  # one name closes the gap up to the tolerance: what it leaves
    ],
)
def test_windows_that_would_grow_in_vain_are_not_fitted(monkeypatch, stands, together, most):
    asked = []
    windows = [Confined(e, ("end",), 1000.0 - left) for e, left in ((LOSS, 240.0), (BIAS, 340.0), (SPRING, 530.0))]
    monkeypatch.setattr(_onsets, "confined", lambda *given: windows)
    null, stands = Some(candidate=of_cost(1000.0), fit=Some(cost=1000.0), left=9.0), of_cost(stands, BIAS)
    search = Some(
        fitted_null=null, standing=Some(candidate=stands, left=7.0, effects=(BIAS,)), tolerated_cost=247.0,
        first_screen=Some(left_by=np.array([1000.0, 600.0, 500.0, together])), problem=Some(free=(), record=Some(lengths=np.array([4]))),
        needed_gain=lambda k: 1.0, report=lambda text: None, ranked=lambda some, base: [], expand=lambda *given: asked.append(given) or [],
        of_signals=frozenset({"v"}),
    )  # fmt: skip
    look_for_onsets(search)
    assert not asked  # one law of v explains the gap, and is always there
    search.of_signals = None
    look_for_onsets(search)
    ((_, wanted),) = asked
    assert [one.name for one in wanted.among] == [one.effect.name for one in windows if 1000.0 - one.drop < most]
    assert wanted.least == pytest.approx(1000.0 - most)


@pytest.mark.parametrize(
    ("cost", "effects", "base"), [(99.0, 2, "refit"), (1e40, 2, None), (np.nan, 2, None), (1e40, 1, "null")]
)
def test_a_set_whose_other_effects_run_away_is_no_base(monkeypatch, cost, effects, base):
    null, refit = of_cost(1.0), of_cost(cost, LOSS)
    monkeypatch.setattr(OdeSearch, "refitted_without", lambda *given: refit)
    search = OdeSearch(Some(), [], np.zeros((1, 4)), null=Some(candidate=null, fit=null.fit))
    found = search.without(of_cost(0.5, *(LOSS, BIAS)[:effects]), 0)
    assert found is {"refit": refit, "null": null, None: None}[base]
