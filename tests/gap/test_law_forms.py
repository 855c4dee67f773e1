"""A law says which of its terms have a name."""

import pytest

from sksurrogate.effects import LawEffect
from sksurrogate.effects._forms import FORMS, form_of
from sksurrogate.effects._formula import Term
from sksurrogate.gap.results._law import Law


def term(*factors):
    return Term(tuple((shape, signal, constant, 0.0) for shape, signal, constant in factors))


FLOW = term(("power", "q", 1.753))
SPRING = term(("exp", "V", 0.09))


def law(kind="state", is_curve=False):
    effect = LawEffect("q", "V*q", (SPRING, FLOW), (-9.2e-5, -8.33, 0.09, 1.753), True)
    params = {p.name: v for p, v in zip(effect.parameters, effect.values)}
    return Law("q", kind, ("V", "q"), effect, params, {}, is_curve=is_curve)


def test_a_term_with_a_name_is_told():
    assert law().forms == {"-8.33*sign(q)*abs(q)^1.753": "power_law"}


@pytest.mark.parametrize("kind, is_curve", [("output", False), ("parameter", False), ("state", True)])
def test_terms_elsewhere_and_curves_have_none(kind, is_curve):
    assert law(kind, is_curve).forms == {}


def test_every_form_is_that_of_its_effect():
    """The effect with a coefficient of one adds what the term adds with its sign."""
    from sksurrogate.effects import CATALOGUE

    signals = {"a": 0.7, "b": 1.3}
    for shapes, name in FORMS.items():
        own = term(*((shape, signal, 1.6) for shape, signal in zip(shapes, signals)))
        effect = CATALOGUE[name]("x")
        v = {0: 0.0, 1: signals["a"], 2: (signals["a"], signals["b"])}[len(shapes)]
        theta = [1.0, 1.6][: len(effect.parameters)]
        added = float(effect.term(0.0, 0.0, v, theta, 1e-9))
        assert abs(added) == pytest.approx(abs(float(own.value(signals))), rel=1e-6), name
        sign = 1.0 if added * float(own.value(signals)) > 0 else -1.0
        assert form_of(own, sign) == name


def test_what_an_effect_does_not_do_has_no_name():
    assert form_of(FLOW, 8.33) is None  # a gain
    assert form_of(term(("v", "lag(q)", 0.0)), -1.0) is None
    assert form_of(term(("v", "q", 0.0), ("v", "q", 0.0)), -1.0) is None
