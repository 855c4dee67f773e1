"""A law is certified where it closes a practical share of what the names leave."""

from dataclasses import replace

import pytest

from sksurrogate.gap.decide._law_certificate import CERTIFICATE, certified_law
from sksurrogate.gap.results._shrink import NOT_KNOWN


@pytest.mark.parametrize("named", [0.0, 0.5, float("nan")])
def test_a_law_must_close_a_share_of_what_is_left(named):
    closed = 0.0 if named != named else named
    bar = closed + CERTIFICATE * (1.0 - closed)
    shrink = replace(NOT_KNOWN, fraction=named)
    assert certified_law(replace(shrink, fraction_law=bar + 1e-9))
    assert not certified_law(replace(shrink, fraction_law=bar - 1e-9))
    assert not certified_law(shrink)
