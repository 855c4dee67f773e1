"""Whether single columns of the record are written otherwise: an input in another unit, temperatures in kelvin, two columns exchanged."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from sksurrogate._swapped import other_orders
from sksurrogate.gap.fit._confused_units import OF_READINGS, in_words, may_differ_by
from sksurrogate.gap.fit._explained import MORE_EXPLAINED, NOTHING_HELPS, OtherWriting, explained
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant, units_of

#: Kelvin and degrees Celsius.
KELVIN = 273.15
#: Units of temperatures.
OF_TEMPERATURES = re.compile(r"^(K|°?[CF]|deg ?[CFK])$")
#: Columns of a kind, inputs or outputs, of which single ones are tried: a look is a free run.
MOST_TRIED_COLUMNS = 4
#: In a unit so far off a column has no part in the motion; of time, or of all signals, the simulator stands still, is linear, or at its
#: limits: where it explains as much there, a unit is not seen.
FAR_OFF = 1e9


def of_columns(model: PlantModel, record: Record, own: float) -> OtherWriting:
    """Share of the record that the simulator alone explains after something is done to few columns, and a sentence; empty where nothing helps.

    ``own``: share that it explains of the record as it is.
    """
    first = record.rows(np.arange(record.lengths[0]), np.array([0]))
    moving = [i for i in range(min(len(record.u), MOST_TRIED_COLUMNS)) if _has_a_part(model, first, i)]
    shares = {what: explained(model, other) for what, other in _written_otherwise(model.plant, first, moving)}
    what = max(shares, key=lambda one: round(shares[one], 3), default="")  # of equals the first: the fewest columns
    if not what or shares[what] < own + MORE_EXPLAINED:
        return NOTHING_HELPS
    share = explained(model, dict(_written_otherwise(model.plant, record, moving))[what])
    if share < own + MORE_EXPLAINED:
        return NOTHING_HELPS
    return OtherWriting(
        share,
        f"With {what} the simulator alone explains {100 * share:.0f} % of every output's variance, with the record as it is "
        f"{100 * own:.0f} %: are the columns of the record those of the simulator, in its units? Mend these columns.",
    )


def _has_a_part(model: PlantModel, record: Record, i: int) -> bool:
    """Whether the simulator explains little where an input has no part in the motion."""
    far = divided(record, _one(len(record.u), i, FAR_OFF), np.ones(len(record.y)))
    return 1.0 - explained(model, far) > MORE_EXPLAINED


def _written_otherwise(plant: Plant, record: Record, moving: Sequence[int]) -> Iterator[tuple[str, Record]]:
    """What may be done to columns, in words, and the record with it.

    ``moving``: inputs whose unit is seen.
    """
    inputs, outputs = plant.inputs[:MOST_TRIED_COLUMNS], plant.outputs[:MOST_TRIED_COLUMNS]
    m, n = len(record.u), len(record.y)
    units = units_of(plant.simulator)
    for i, factor in product(moving, OF_READINGS):
        if may_differ_by(factor, units.get(inputs[i], "")):
            yield in_words(factor, [inputs[i]]), divided(record, _one(m, i, factor), np.ones(n))
    warm = [may_be_a_temperature(units.get(name, "")) for name in (*plant.inputs, *plant.outputs)]
    for offset in (KELVIN, -KELVIN):
        verb = f"{KELVIN:g} {'taken from' if offset > 0 else 'added to'}"
        for i, name in enumerate(inputs):
            if warm[i]:
                yield f"{verb} {name}", record.with_inputs(record.u - offset * (np.arange(m) == i)[:, None])
        for j, name in enumerate(outputs):
            if warm[m + j]:
                yield f"{verb} {name}", replace(record, y=record.y - offset * (np.arange(n) == j)[:, None])
        if n > 1 and all(warm[m:]):
            yield f"{verb} {', '.join(plant.outputs)}", replace(record, y=record.y - offset)
    for said, order in other_orders(outputs):
        yield said, replace(record, y=record.y[[*order, *range(len(order), n)]])
    for said, order in other_orders(inputs):
        yield said, record.with_inputs(record.u[[*order, *range(len(order), m)]])
    if m == n and record.known is None:
        yield "inputs and outputs exchanged", replace(record.with_inputs(record.y), y=record.u)


def may_be_a_temperature(unit: str) -> bool:
    """Whether a column in this unit of the simulator may be written in kelvin, or in degrees Celsius.

    >>> may_be_a_temperature("K"), may_be_a_temperature(""), may_be_a_temperature("bar")
    (True, True, False)
    """
    return not unit or bool(OF_TEMPERATURES.search(unit))


def _one(n: int, i: int, factor: float) -> np.ndarray:
    """Ones (n,), and a factor at i."""
    return np.where(np.arange(n) == i, factor, 1.0)


def divided(record: Record, inputs: np.ndarray, outputs: np.ndarray) -> Record:
    """Signals in other units."""
    return replace(record.with_inputs(record.u / inputs[:, None]), y=record.y / outputs[:, None])
