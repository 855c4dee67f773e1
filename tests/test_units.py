"""Units as text: the algebra of exponents."""

import pytest

from sksurrogate._units import over, powers_of, times, to_power, unit_text


@pytest.mark.parametrize("unit", ["m", "m/s", "kg m/s^2", "1/s", "N/(m s)", "rad/s", "m^3/h", "%", "°C"])
def test_one_short_form_is_its_own(unit):
    assert unit_text(powers_of(unit)) == unit


@pytest.mark.parametrize(
    ("written", "read"),
    [("m s-1", "m/s"), ("m·s⁻¹", "m/s"), ("m*m", "m^2"), ("m/m", "1"), ("V/(A)", "V/A"), ("m/s/s", "m/s^2")],
)
def test_other_forms_are_read(written, read):
    assert unit_text(powers_of(written)) == read


def test_quotients_undo_products():
    for a in ("m", "kg m/s^2", "1"):
        for b in ("s", "rad/s", "N/(m s)"):
            assert powers_of(over(times(a, b), b)) == powers_of(a)
            assert powers_of(over(to_power(b, 3), to_power(b, 2))) == powers_of(b)


@pytest.mark.parametrize("unit", ["m(", ")", "m/(s", "deg C (outside)", "5 m"])
def test_what_is_no_product_of_units_stays_as_it_is_written(unit):
    assert powers_of(unit) is None
    assert unit in times(unit, "s")


def test_an_unknown_unit_gives_none():
    assert over("", "s") == times("m", "") == to_power("", 2) == ""
