"""What takes the place of a name beside its law is simplified first, as what the search lets stand is."""

from types import SimpleNamespace

import pytest

from sksurrogate.gap.decide import _posterior
from sksurrogate.gap.decide._contenders import Contender
from sksurrogate.gap.decide._posterior import Posterior


@pytest.mark.parametrize(("rings", "stands"), [(True, "mode"), (False, "relaxation")])
def test_a_mode_that_does_not_ring_does_not_take_the_place_of_the_relaxation_that_it_is(monkeypatch, rings, stands):
    """A floor slab with natural convection: beside laws of their own the overdamped mode is 7 nats likelier than the relaxation."""
    relaxation, mode = (
        SimpleNamespace(keys=(name,), effects=(name,), fit=SimpleNamespace(cost=cost))
        for name, cost in (("relaxation", 2063.0), ("mode", 2091.0))
    )
    law = SimpleNamespace(name="law")
    as_contenders = {id(relaxation): Contender(0.0, -5.0, relaxation, law), id(mode): Contender(7.0, -5.0, mode, law)}
    evidence = {
        id(one): SimpleNamespace(candidate=one, effects=one.effects, left=1.02, fit=one.fit)
        for one in (relaxation, mode)
    }
    stood = []
    search = SimpleNamespace(
        tolerated_cost=0.0, gap_cost=1e6, polish=lambda one: one, plausible=lambda one: True, stand=lambda one: stood.append(one) or evidence[id(one)]
    )  # fmt: skip
    patched = {
        "needed_only": lambda search, final: final,
        "closes_by_size": lambda *given: False,
        "leaves_most": lambda *given: False,
        "weigh": lambda search, final: Posterior((0.95,), law),
        "contenders": lambda search, final, law, fallen: (
            as_contenders[id(final.candidate)], [as_contenders[id(mode)]] if final.candidate is relaxation else []
        ),
        "elsewhere": lambda *given: [],
        "simplify": lambda search, one: one if rings else relaxation,
        "judged_contender": lambda search, final, one, seeds: [as_contenders[id(one)]],
    }  # fmt: skip
    for name, instead in patched.items():
        monkeypatch.setattr(_posterior, name, instead)
    final, _ = _posterior.let_stand(SimpleNamespace(stood={}, **vars(search)), evidence[id(relaxation)])
    assert final.candidate.keys == (stands,)
