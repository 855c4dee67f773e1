"""Effects and places that a user rules out."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Any

from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.effects._effect import BaseEffect
from sksurrogate.exceptions import DataError
from sksurrogate.physics._simulator import Plant

__all__ = ["excluded_places", "without_excluded"]

HOW = (
    "expected names of effects, tuples (name, location) or (name, location, variable), or places of the simulator, for example "
    "exclude=['drift', ('coulomb_friction', 'speed'), 'level']."
)


def without_excluded(effects: Sequence[BaseEffect], exclude: Any, plant: Plant) -> list[BaseEffect]:
    """The effects that a user does not rule out.

    Parameters
    ----------
    effects : sequence of BaseEffect
    exclude : str, tuple, or an iterable of them
        A name of an effect (everywhere), a place (a state, input, output or parameter: every effect there), or
        ``(name, location)`` or ``(name, location, variable)``; None in a tuple stands for any. A word that is both a name of
        an effect and a place is the name; write ``(None, place)``.
    plant : Plant

    Returns
    -------
    list of BaseEffect

    Raises
    ------
    DataError
        An entry names no effect and no place, or nothing is left.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.effects import build_effects
    >>> from sksurrogate.physics._simulator import describe
    >>> plant = describe(make_reactor())
    >>> effects = build_effects(plant, ["y"], ["sensor_bias", "sensor_gain", "input_lag"])
    >>> [effect.name for effect in without_excluded(effects, ["sensor_gain", "u"], plant)]
    ['sensor_bias']
    """
    ruled_out = [_pattern(entry, effects, plant) for entry in _entries(exclude)]
    kept = [effect for effect in effects if not any(_matches(effect, pattern) for pattern in ruled_out)]
    if effects and not kept:
        raise DataError(f"exclude={exclude!r} leaves none of the {len(effects)} effects: exclude fewer of them.")
    return kept


def excluded_places(exclude: Any) -> set[str]:
    """Places at which every effect is ruled out.

    Examples
    --------
    >>> sorted(excluded_places(["drift", "level", (None, "flow"), ("sensor_bias", "y")]))
    ['flow', 'level']
    """
    words = {entry for entry in _entries(exclude) if isinstance(entry, str) and entry not in CATALOGUE}
    pairs = (entry for entry in _entries(exclude) if isinstance(entry, tuple) and len(entry) == 2 and entry[0] is None)
    return words | {str(place) for _, place in pairs}


def _entries(exclude: Any) -> list[Any]:
    """The entries of ``exclude=``."""
    if exclude is None:
        return []
    if isinstance(exclude, str):
        return [exclude]
    if not isinstance(exclude, Iterable):
        raise DataError(f"exclude={exclude!r}: {HOW}")
    return list(exclude)


def _pattern(entry: Any, effects: Sequence[BaseEffect], plant: Plant) -> tuple[str | None, ...]:
    """An entry as (name, location[, variable]), None for any."""
    names = {*CATALOGUE, *(effect.name for effect in effects)}
    places = {*plant.params, *plant.states, *plant.inputs, *plant.outputs, *(str(e.location) for e in effects)}
    if isinstance(entry, str):
        if entry not in names and entry not in places:
            raise DataError(_unknown(entry, entry, names | places, "neither an effect nor a place of the simulator"))
        return (entry,) if entry in names else (None, entry)
    if not isinstance(entry, tuple) or not 2 <= len(entry) <= 3 or not all(v is None or type(v) is str for v in entry):
        raise DataError(f"exclude holds {entry!r}: {HOW}")
    name, location = entry[:2]
    if name is not None and name not in names:
        raise DataError(_unknown(entry, name, names, "not an effect"))
    if location is not None and location not in places:
        raise DataError(_unknown(entry, location, places, "not a place of the simulator"))
    if len(entry) == 3 and entry[2] is not None:
        for signal in entry[2].split("*"):
            if signal not in places:
                raise DataError(_unknown(entry, signal, places, "not a signal of the simulator"))
    return entry


def _matches(effect: BaseEffect, pattern: tuple[str | None, ...]) -> bool:
    """Whether an effect is ruled out by a pattern."""
    return all(wanted is None or wanted == own for wanted, own in zip(pattern, effect.key))


def _unknown(entry: Any, word: str, known: set[str], what: str) -> str:
    close = difflib.get_close_matches(word, sorted(known), n=3, cutoff=0.5)
    hint = f" (did you mean {' or '.join(map(repr, close))}?)" if close else ""
    return f"exclude holds {entry!r}: {word!r} is {what}{hint}; {HOW}"
