"""A law is certified where it closes a practical share of what the names leave."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._formula import Term
from sksurrogate.effects._law import LawEffect
from sksurrogate.gap._law_stage import LawStage
from sksurrogate.gap.decide._law_certificate import CERTIFICATE, certified_law
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.results._shrink import NOT_KNOWN


@pytest.mark.parametrize("named", [0.0, 0.5, float("nan")])
def test_a_law_must_close_a_share_of_what_is_left(named):
    closed = 0.0 if named != named else named
    bar = closed + CERTIFICATE * (1.0 - closed)
    shrink = replace(NOT_KNOWN, fraction=named)
    assert certified_law(replace(shrink, fraction_law=bar + 1e-9))
    assert not certified_law(replace(shrink, fraction_law=bar - 1e-9))
    assert not certified_law(shrink)


@pytest.mark.parametrize(
    ("term", "asked", "again"),
    [
        (Term(), "constant_bias", True),
        (Term(), "linear_loss", False),
        (Term((("v", "x", 0.0, 0.0),)), "constant_bias", False),
    ],
)
def test_a_constant_is_no_law_where_the_effect_that_adds_one_did_not_stand(term, asked, again):
    """The mean of a sensor's walk in one run is carried to no other run."""
    law = Law("x", "state", (), LawEffect("x", "x", (term,), (0.3,)), {}, {})
    effect = CATALOGUE[asked]("x", *(("x",) if asked == "linear_loss" else ()))
    stage = SimpleNamespace(search=SimpleNamespace(library=[effect]))
    assert LawStage.did_not_stand(stage, law) == again
