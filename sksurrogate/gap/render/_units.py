"""Units of the numbers of a report: of signals as the simulator names them, of the parameters of effects by their form."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

from sksurrogate._units import over, times, to_power
from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.effects._variable import is_difference, signals_in
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._table import Table

#: Key of ``units`` under which the unit of time stands.
TIME = "time"
#: Units that are not written: not known, or none.
NO_UNIT = ("", "1", "-")


def axis(name: str, units: Mapping[str, str]) -> str:
    """Label of an axis for a signal."""
    return labelled(name, units.get(name, ""))


def labelled(quantity: str, unit: str) -> str:
    """Quantity, slash, unit; the quantity alone where no unit is known or it has none.

    >>> labelled("speed", "rad/s"), labelled("gain", "1"), labelled("speed", "")
    ('speed / (rad/s)', 'gain', 'speed')
    """
    if unit in NO_UNIT:
        return quantity
    return f"{quantity} / ({unit})" if any(sign in unit for sign in "/ *") else f"{quantity} / {unit}"


def with_unit(number: str, unit: str) -> str:
    """A number and its unit.

    >>> with_unit("2.5", "m/s"), with_unit("2.5", "1"), with_unit("2.5", "")
    ('2.5 m/s', '2.5', '2.5')
    """
    return number if unit in NO_UNIT else f"{number} {unit}"


def variable_unit(variable: str | None, units: Mapping[str, str]) -> str:
    """Of a signal, a product or a difference.

    >>> variable_unit("v*w", {"v": "m", "w": "N"}), variable_unit("abs(T - Ta)", {"T": "K", "Ta": "K"})
    ('m N', 'K')
    """
    signals = [units.get(name, "") for name in signals_in(variable)]
    if is_difference(variable):
        return signals[0] if str(variable).startswith("abs") else to_power(signals[0], 2)
    return reduce(times, signals or [""])


def derivative_unit(name: str, units: Mapping[str, str]) -> str:
    """Unit of the derivative of a signal; empty where its unit, or that of time, is not known."""
    return over(units.get(name, ""), units.get(TIME, ""))


def range_text(rule: str, units: Mapping[str, str]) -> str:
    """A rule of the operating range with the units of its signals.

    >>> range_text("speed <= 0.3 and force > 2", {"speed": "m/s"})
    'speed <= 0.3 m/s and force > 2'
    >>> range_text("speed of the motor <= 0.3", {"speed of the motor": "m/s"})
    'speed of the motor <= 0.3 m/s'
    """
    parts = rule.split(" and ")
    return " and ".join(with_unit(part, units.get(part.rsplit(" ", 2)[0], "")) for part in parts)


def unit_column(table: Table, column: str, units: Mapping[str, str]) -> Table:
    """A table with a column of units, where one is known of the signals of a column."""
    found = [units.get(str(row.get(column)), "") for row in table]
    if not any(found):
        return table
    return Table(tuple({**row, "unit": unit or "-"} for row, unit in zip(table, found)))


def parameter_unit(effect: EffectEstimate, parameter: str, units: Mapping[str, str]) -> str:
    """Unit of a parameter of an effect of the catalogue; empty where it does not follow.

    >>> drag = EffectEstimate("quadratic_drag", "speed", "speed", 1.0, {"coefficient": 0.1}, {}, 1.0)
    >>> parameter_unit(drag, "coefficient", {"speed": "m/s", "time": "s"})
    '1/m'
    >>> decay = EffectEstimate("linear_loss", "biomass", "biomass", 1.0, {"coefficient": 0.1}, {}, 1.0)
    >>> parameter_unit(decay, "coefficient", {"time": "h"})
    '1/h'
    """
    known = {p.name: p.unit for p in CATALOGUE[effect.name].parameters} if effect.name in CATALOGUE else {}
    form = known.get(parameter, "")
    v = variable_unit(effect.variable, units)
    own = units.get(effect.location, "")
    force = own if effect.at_port else over(own, units.get(TIME, ""))
    if form == "dx/dt over v" and effect.variable == effect.location and not effect.at_port:
        return over("1", units.get(TIME, ""))  # whatever the unit of the state
    letters = {
        "x": own, "u": own, "y": own, "v": v, "dx/dt": force, "time": units.get(TIME, ""),
        "radian": "rad", "1": "1", "v w": v, "v^2": to_power(v, 2), "v^3": to_power(v, 3),
    }  # fmt: skip
    above, _, below = form.partition(" over ")
    if above not in letters:
        return ""
    if not below:
        return letters[above]
    parts = below.split(" and ")
    if not all(part in letters for part in parts):
        return ""
    return over(letters[above], reduce(times, (letters[part] for part in parts)))
