"""What the headline says of a certified law: beside names that stand, in the place of names that do not."""

from types import SimpleNamespace

import pytest

from sksurrogate.gap.render._headline import _with_law


@pytest.mark.parametrize(
    "verdict, names, words",
    [
        ("partial", 1, "in the balance of T beside it closes 99.0 %"),
        ("partial", 2, "in the balance of T beside them closes 99.0 %"),
        ("unknown", 1, "in the balance of T in its place closes 99.0 %"),
        ("unknown", 2, "in the balance of T in their place closes 99.0 %"),
        ("unknown", 0, "in the balance of T closes 99.0 %"),
    ],
)
def test_where_a_law_stands(verdict, names, words):
    class Law:
        is_curve, place = False, "the balance of T"

        def __str__(self):
            return "-2*T^3"

    report = SimpleNamespace(
        traces=(),
        provenance=SimpleNamespace(n_runs=3, command=""),
        certified_law=Law(),
        shrink=SimpleNamespace(fraction_law=0.99),
        effects=[None] * names,
        verdict=verdict,
    )
    assert f"The law -2*T^3 {words} of the gap on held-out runs." in _with_law(report)
