"""Where a search stops: sets that grow in vain, sets that remember enough, stacks of surrogates."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._formula import Term
from sksurrogate.gap import _law_stage
from sksurrogate.gap._law_stage import LawStage
from sksurrogate.gap.decide._held_out import HeldOut
from sksurrogate.gap.decide._law_certificate import CertifiedLaw, takes_the_place
from sksurrogate.gap.decide._posterior import Posterior
from sksurrogate.gap.decide._rules import DecisionFeatures, first_rule
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.search import _set_search
from sksurrogate.gap.search._stopping import grows_in_vain, is_stack
from sksurrogate.kernels.record import Record


def record_of(rows):
    return Record.from_runs([np.zeros((rows, 0))], [np.zeros((rows, 1))], [0.1 * np.arange(rows)], 0.1)


def of_cost(cost):
    return SimpleNamespace(fit=SimpleNamespace(cost=cost))


@pytest.mark.parametrize(
    ("cost", "before", "null", "vain"),
    [
        (90.0, 114.0, 500.0, True),  # a fifth less, 0.4 of the gap left: a missing law of a reactor
        (60.0, 114.0, 500.0, False),  # half of what was left is gone
        (90.0, 114.0, 2000.0, False),  # less than 0.3 of the gap is left
    ],
)
def test_a_set_grows_in_vain_that_leaves_much_after_an_effect_that_took_little(cost, before, null, vain):
    assert grows_in_vain(of_cost(cost), of_cost(before), of_cost(null)) == vain


def leaving(error, names, sigma=0.1):
    """A candidate of so many names whose residual is a constant."""
    candidate = SimpleNamespace(
        effects=[CATALOGUE["constant_bias"](f"x{i}") for i in range(names)],
        residual=np.full((1, 50), error),
        problem=SimpleNamespace(record=record_of(50)),
    )
    return Evidence(candidate, SimpleNamespace(sigma=np.array([sigma])), 0.0)


def test_three_names_that_leave_more_than_the_noise_are_a_stack():
    assert is_stack(leaving(0.11, 3))
    assert not is_stack(leaving(0.101, 3))
    assert not is_stack(leaving(0.11, 2))


@pytest.mark.parametrize(
    ("worth", "rest", "instead"),
    [(110.0, None, True), (105.0, None, False), (110.0, 105.0, True), (110.0, 120.0, False)],
)
def test_one_formula_takes_the_place_of_several_names_only_where_it_is_clearly_likelier(worth, rest, instead):
    """Three names of a library of 100 cost 3 log(100) nats, the formula its price of 20, and a law beside the names 15."""
    worths = {"law": worth, "names": 90.0, "names and a law": rest}

    def found(candidate, price):
        return SimpleNamespace(
            curve=False,
            price=price,
            location="v",
            kind="state",
            found=SimpleNamespace(candidate=candidate),
            effect=SimpleNamespace(terms=[Term((("drag", "v", 0.0, 0.0),)), Term((("sine", "q", 0.0, 0.0),))]),
        )

    search = SimpleNamespace(library=[None] * 100, order=lambda candidates: worths.__getitem__)
    law, beside = found("law", 20.0), None if rest is None else found("names and a law", 15.0)
    names = [SimpleNamespace(name=name, location="v") for name in ("constant_bias", "linear_loss", "bilinear")]
    final = SimpleNamespace(candidate="names", effects=names)
    assert takes_the_place(search, law, final, beside) is instead
    two = SimpleNamespace(
        candidate="names", effects=names[:2]
    )  # as many as the parts of the law, which share no signal
    assert takes_the_place(search, law, two, beside) is (instead and rest is not None)
    law.effect.terms.append(Term(()))  # a constant, which is the first name: one part more
    assert not takes_the_place(search, law, two, beside)
    law.curve = True
    assert not takes_the_place(search, law, final, beside)


@pytest.mark.parametrize(
    ("places", "left", "share_left", "rule", "bases"),
    [("aab", 3.0, 0.3, "imitations", ["null"]), ("ab", 3.0, 0.3, "law_left", ["null", "final"]), ("aaa", 3.0, 0.05, "closed", ["null"]),
     ("aa", 3.0, 0.05, "closed", []), ("ab", 3.0, 0.05, "closed", ["null"]), ("ab", 1.0, 0.05, "closed", []),
     ("a", 3.0, 0.3, "law_left", ["null", "final"]), ("a", 3.0, 0.15, "law_left", ["final"]), ("a", 3.0, 0.05, "closed", [])],
)  # fmt: skip
def test_three_names_that_leave_a_law_are_withdrawn_and_of_fewer_one_law_may_take_the_place(
    places, left, share_left, rule, bases
):
    said, asked = [], []
    named = [(f"effect_{i}", place, "v") for i, place in enumerate(places)]
    names = [SimpleNamespace(name=key[0], location=key[1], variable=key[2], key=key) for key in named]
    stage = LawStage.__new__(LawStage)
    stage.posterior = Posterior((), None)
    null, final = SimpleNamespace(effects=[]), SimpleNamespace(effects=names, left=left)
    stage.search = SimpleNamespace(standing=final, fitted_null=null, tolerance=0.1)
    stage.found = SimpleNamespace(held=object(), shrink=SimpleNamespace(measurable=True))
    features = DecisionFeatures(
        names=len(names), share_left=share_left, left=left, lawful=share_left, error=0.5, after=0.2
    )
    stage.features = lambda: features
    stage.share_the_gap = lambda: None
    stage.withdraw = lambda why: said.append(why) or setattr(stage.search, "standing", null)
    stage.access = SimpleNamespace(law_beside=lambda base, final, held: asked.append(base))
    stage.look_for_a_law()
    assert first_rule(features).name == rule
    assert bool(said) is (rule == "imitations")
    told = "Effect 0 at a, driven by v; effect 1 at a, driven by v; effect 2 at b, driven by v passed"
    assert not said or told in said[0]
    assert asked == [null if base == "null" else final for base in bases]


@pytest.mark.parametrize(("verdict", "sought"), [("partial", ["null", "names"]), ("explained", ["null"])])
def test_the_law_that_standing_names_leave_is_sought_where_they_leave_one(verdict, sought, monkeypatch):
    monkeypatch.setattr(_law_stage, "takes_the_place", lambda *given: False)
    asked, left = [], SimpleNamespace(law=object())
    stage = LawStage.__new__(LawStage)
    stage.search = SimpleNamespace(standing="names", fitted_null="null")
    stage.access = SimpleNamespace(law_beside=lambda base, final, held: asked.append(base) or left)
    assert stage.law_in_place_of_names(None, verdict) == (None, left if verdict == "partial" else None)
    assert asked == sought


@pytest.mark.parametrize(("n_names", "closed", "instead"), [(1, 0.80, False), (1, 0.84, True), (2, 0.80, True)])
def test_a_law_of_as_many_parts_as_there_are_names_must_close_more_on_runs_left_out(
    n_names, closed, instead, monkeypatch
):
    """Of what one name leaves, 0.2 of the gap, a practical share is 0.03; two names for one law are reason enough."""
    monkeypatch.setattr(_law_stage, "takes_the_place", lambda *given: True)
    law = SimpleNamespace(kind="state", location="v", effect=SimpleNamespace(terms=[Term((("drag", "v", 0.0, 0.0),))]))
    beside = CertifiedLaw(law, HeldOut(None, None, None, None, None), None, 0.0)
    stage = LawStage.__new__(LawStage)
    names = [SimpleNamespace(name=f"effect_{i}", location="v", variable="v") for i in range(n_names)]
    stage.search = SimpleNamespace(standing=SimpleNamespace(effects=names), fitted_null="null")
    stage.access = SimpleNamespace(law_beside=lambda base, final, held: beside)
    stage.measured = lambda held: SimpleNamespace(fraction=0.8, fraction_law=closed)
    stage.withdraw_names = lambda why: HeldOut(None, None, None, None, None)
    found, rest = stage.law_in_place_of_names(None, "partial")
    assert (found is not None) is instead
    assert (rest is beside) is not instead


@pytest.mark.parametrize(
    ("leads", "grown"), [("rich", "rich"), ("simple", "simple"), ("lean", "lean"), ("poor", None), (None, None)]
)
def test_a_set_grows_on_from_the_form_that_leads_to_the_noise(leads, grown):
    """A loss in place of a friction has fewer parameters, and does not show the lag that is missing beside the friction.

    A set with fewer parameters leads on too, as long as it closes the gap up to the tolerance.
    """

    class Named:
        effects = (1, 2)

        def __init__(self, name, n_parameters, cost=9.0):
            self.name, self.keys, self.n_parameters, self.fit = name, (name,), n_parameters, SimpleNamespace(cost=cost)

    rich, simple, lean, poor = Named("rich", 5), Named("simple", 3), Named("lean", 2, 9.5), Named("poor", 2, 12.0)
    stood, asked = [], []
    search = SimpleNamespace(
        is_far=lambda one: True,
        judged={rich: SimpleNamespace(left=20.0, fit=rich.fit)},
        fitted={frozenset((one.name, "other")): one for one in (rich, simple, lean, poor)},
        plausible=lambda one: True,
        gap_cost=100.0,
        tolerated_cost=10.0,
        polish=lambda one: one,
        leads_on=lambda one, n: one.name == leads,
        richer_form=lambda one: None,
        stand=lambda one: stood.append(one.name) or SimpleNamespace(candidate=one),
        may_be_extended=lambda one: True,
        one_more=lambda one, passed: asked.append(one.name),
    )
    search.leanest_that_leads_on = partial(_set_search.SetSearch.leanest_that_leads_on, search)
    _set_search.SetSearch.grow(search, rich, True, None)
    assert stood == [grown or "simple"]
    assert asked == ([grown] if grown else [])


@pytest.mark.parametrize(("names", "goes_on"), [(2, True), (3, False)])
def test_a_search_gives_up_where_a_further_name_takes_little_not_where_a_richer_form_does(names, goes_on, monkeypatch):
    """A richer form in the place of one name leaves 0.77 of what the set left: no name was added, so none was added in vain.

    A reactor whose state saturates, with a rate that depends on its temperature: the search stopped at two wrong names.
    """

    class Found:
        def __init__(self, cost, names):
            self.keys, self.effects, self.fit = (cost,), tuple(range(names)), SimpleNamespace(cost=cost)

    before, larger = Found(53.2, 2), Found(40.9, names)
    asked = []
    search = SimpleNamespace(
        is_far=lambda one: True,
        judged={before: None, larger: None},
        may_be_extended=lambda one: True,
        richer_form=lambda one: None,
        stand=lambda one: SimpleNamespace(candidate=one),
        tolerated_cost=10.0,
        one_more=lambda one, passed: asked.append(one) or (larger if one is before else None),
    )
    monkeypatch.setattr(_set_search, "closes_by_size", lambda *given: False)
    _set_search.SetSearch.grow(search, before, True, Found(367.6, 0))
    assert asked == ([before, larger] if goes_on else [before])
