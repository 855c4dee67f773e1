"""An effect whose magnitude the data do not show is first asked for another one in its place; only then it is taken out."""

from types import SimpleNamespace

import pytest

from sksurrogate.gap.decide import _posterior
from sksurrogate.gap.decide._contenders import Contender
from sksurrogate.gap.decide._posterior import Posterior

LAW = SimpleNamespace(name="law")


def a_set(*names, cost):
    return SimpleNamespace(keys=names, effects=names, fit=SimpleNamespace(cost=cost))


@pytest.mark.parametrize(
    ("lag_is", "without", "not_shown", "stands"),
    [
        (5.0, 432.0, None, ("grid", "lag")),
        (-50.0, 432.0, None, ("grid",)),
        (5.0, 50.0, None, ("grid",)),
        (5.0, 432.0, "lag", ("grid",)),
        (-50.0, 432.0, "grid", ()),
    ],
)
def test_what_does_most_of_the_same_takes_its_place(monkeypatch, lag_is, without, not_shown, stands):
    """A heater's step on a sensor's grid: a mode from any start does what the lag does, and its interval holds 0.

    What only corrects a form is taken out. What a finer fit, or one without another effect, moves to where no data show it, does not
    stand (a mode beside a delay, to above the frequency of the samples)."""
    mode, lag, grid = a_set("grid", "mode", cost=14.3), a_set("grid", "lag", cost=17.9), a_set("grid", cost=without)
    unseen = {"lag": lag, "grid": grid, None: None}[not_shown]
    nets = {id(mode): 0.0, id(lag): lag_is, id(grid): -700.0}
    known = {id(one): Contender(nets[id(one)], -5.0, one, LAW) for one in (mode, lag, grid)}
    evidence = {
        id(one): SimpleNamespace(candidate=one, effects=one.effects, left=3.4, fit=one.fit) for one in (mode, lag, grid)
    }
    search = SimpleNamespace(
        stood={}, fitted_null=SimpleNamespace(candidate=a_set(cost=1e4), effects=()), tolerated_cost=100.0, gap_cost=1e4,
        stand=lambda one: evidence[id(one)], polish=lambda one: one, without=lambda one, i: grid,
        plausible=lambda one: one is not unseen,
    )  # fmt: skip
    patched = {
        "needed_only": lambda search, final: final,
        "closes_by_size": lambda *given: False,
        "leaves_most": lambda *given: False,
        "weigh": lambda search, final: Posterior((1.0,) * len(final.effects), LAW),
        "contenders": lambda search, final, law, fallen: (
            known[id(final.candidate)],
            [known[id(one)] for one in (lag, mode) if len(final.effects) == 2 and one is not final.candidate
             and frozenset(one.keys) not in fallen],
        ),
        "elsewhere": lambda *given: [],
        "simplify": lambda search, one: one,
        "judged_contender": lambda search, final, one, seeds: [known[id(one)]],
        "redundant_effect": lambda final: 1 if "mode" in final.effects else None,
        "taken": lambda search, fewer, before: evidence[id(fewer)],
    }  # fmt: skip
    for name, instead in patched.items():
        monkeypatch.setattr(_posterior, name, instead)
    final, _ = _posterior.let_stand(search, evidence[id(mode)])
    assert final.candidate.keys == stands
