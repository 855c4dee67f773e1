"""Units as text: products, quotients and powers of unit names, brought to one short form."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction

_TOKEN = re.compile(
    r"\s*(?:(?P<name>[^\W\d_][^\s*·/^()\d+-]*|%|°[A-Za-z]?)(?:\^?(?P<power>[+-]?\d+))?|(?P<op>[*·/()])|(?P<one>1))"
)
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")


def powers_of(unit: str) -> dict[str, Fraction] | None:
    """Unit name -> exponent; None where the text is not a product of units.

    >>> powers_of("kg m/s^2") == {"kg": 1, "m": 1, "s": -2}
    True
    >>> powers_of("N/(m s)") == {"N": 1, "m": -1, "s": -1}
    True
    >>> powers_of("1"), powers_of("deg C (outside)")
    ({}, None)
    """
    text, at, sign, inside = unit.strip().translate(_SUPERSCRIPTS), 0, 1, False
    found: dict[str, Fraction] = {}
    after_slash = False
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            return None
        at = match.end()
        if match["op"] == "/":
            if after_slash or inside:
                return None
            after_slash = True
        elif match["op"] == "(":
            if not after_slash or inside:
                return None
            inside, sign = True, -1
            after_slash = False
        elif match["op"] == ")":
            if not inside:
                return None
            inside, sign = False, 1
        elif match["name"]:
            exponent = Fraction(match["power"] or 1) * (-1 if after_slash else sign)
            found[match["name"]] = found.get(match["name"], Fraction(0)) + exponent
            after_slash = False
        elif match["one"]:
            after_slash = False
    return None if inside or after_slash else {name: power for name, power in found.items() if power}


def unit_text(powers: Mapping[str, Fraction]) -> str:
    """One short form: positive powers, then what they are divided by.

    >>> unit_text({"m": Fraction(1), "s": Fraction(-2)})
    'm/s^2'
    >>> unit_text({"m": Fraction(-1), "s": Fraction(-1)}), unit_text({})
    ('1/(m s)', '1')
    """
    above = [_one(name, power) for name, power in powers.items() if power > 0]
    below = [_one(name, -power) for name, power in powers.items() if power < 0]
    head = " ".join(above) or "1"
    if not below:
        return head
    return f"{head}/{below[0]}" if len(below) == 1 else f"{head}/({' '.join(below)})"


def _one(name: str, power: Fraction) -> str:
    return name if power == 1 else f"{name}^{power}"


def times(first: str, second: str) -> str:
    """Product of two units.

    >>> times("m/s", "s"), times("", "s")
    ('m', '')
    """
    return _combined(first, second, 1)


def over(first: str, second: str) -> str:
    """Quotient of two units; empty where one is not known.

    >>> over("m/s", "s"), over("m", "m"), over("m", "")
    ('m/s^2', '1', '')
    >>> over("deg C (outside)", "s")
    '(deg C (outside))/(s)'
    """
    return _combined(first, second, -1)


def may_be_one(first: str, second: str) -> bool:
    """Whether two units are one, or one of them is not known: only then signals have a difference.

    >>> may_be_one("m/s", "m s^-1"), may_be_one("degC", "kW"), may_be_one("degC", "")
    (True, False, True)
    """
    return not first or not second or first == second or over(first, second) == "1"


def to_power(unit: str, power: int) -> str:
    """A unit to a whole power.

    >>> to_power("m/s", 2)
    'm^2/s^2'
    """
    found = powers_of(unit)
    if not unit or found is None:
        return f"({unit})^{power}" if unit else ""
    return unit_text({name: exponent * power for name, exponent in found.items()})


def _combined(first: str, second: str, sign: int) -> str:
    """First times second to the power of sign."""
    if not first or not second:
        return ""
    a, b = powers_of(first), powers_of(second)
    if a is None or b is None:
        return f"({first}){'/' if sign < 0 else '*'}({second})"
    total = dict(a)
    for name, power in b.items():
        total[name] = total.get(name, Fraction(0)) + sign * power
    return unit_text({name: power for name, power in total.items() if power})
