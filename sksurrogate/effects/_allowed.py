"""Effects and places that a user rules out, or to which a user restricts the diagnosis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

from sksurrogate._close_names import did_you_mean
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.effects._variable import signals_in
from sksurrogate.exceptions import DataError
from sksurrogate.physics._simulator import Plant

HOW = (
    "expected names of effects, tuples (name, location) or (name, location, variable), or places of the simulator, for example "
    "{option}=['drift', ('*friction', 'speed'), 'level']."
)


class Pattern(NamedTuple):
    """An entry: what an effect must be; None for any. The name may hold the wildcards ``*`` and ``?``."""

    name: str | None
    location: str | None = None
    variable: str | None = None

    def fits(self, effect: BaseEffect) -> bool:
        """Whether an effect is one of these."""
        places = (self.location, effect.location), (self.variable, effect.variable)
        return self.names(effect) and all(wanted is None or wanted == own for wanted, own in places)

    def names(self, effect: BaseEffect) -> bool:
        """Whether an effect has this name."""
        return self.name is None or fnmatchcase(effect.name, self.name)

    @property
    def is_name(self) -> bool:
        """Whether it says nothing of a place."""
        return self.location is None and self.variable is None


def allowed_effects(effects: Sequence[BaseEffect], exclude: Any, plausible: Any, plant: Plant) -> list[BaseEffect]:
    """The effects that a user does not rule out.

    ``exclude``: a name of an effect (everywhere), a place (a state, input, output or parameter: every effect there), or
        ``(name, location)`` or ``(name, location, variable)``; None in a tuple stands for any, and a name may hold
        wildcards. A word that is both a name of an effect and a place is the name; write ``(None, place)``.
    ``plausible``: the same words. Of effects that entries with a name and a place name, those that fit one of these
        entries; of the others, those of the names and at the places that stand alone, as far as there are such entries.
    Raises DataError where an entry names no effect and no place, or nothing is left.

    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.effects import build_effects
    >>> from sksurrogate.physics._simulator import describe
    >>> plant = describe(make_reactor())
    >>> effects = build_effects(plant, ["y"], ["sensor_bias", "sensor_gain", "input_lag"])
    >>> [effect.name for effect in allowed_effects(effects, ["sensor_gain", "u"], None, plant)]
    ['sensor_bias']
    >>> [effect.name for effect in allowed_effects(effects, (), [("sensor_*", "u")], plant)]
    ['input_lag']
    """
    out = _patterns("exclude", exclude, effects, plant)
    kept = [effect for effect in effects if not any(one.fits(effect) for one in out)]
    if effects and not kept:
        raise DataError(f"exclude={exclude!r} leaves none of the {len(effects)} effects: exclude fewer of them.")
    known = _patterns("plausible", plausible, effects, plant)
    found = [effect for effect in kept if _is_plausible(effect, known)]
    if kept and not found:
        raise DataError(
            f"plausible={plausible!r} leaves none of the {len(kept)} effects: give more names or places, or leave it out for all."
        )
    return found


def _is_plausible(effect: BaseEffect, known: Sequence[Pattern]) -> bool:
    """Whether an effect is what a user expects: by the entries that name it with a place, else by names and places alone."""
    own = [one for one in known if one.name is not None and not one.is_name and one.names(effect)]
    if own:
        return any(one.fits(effect) for one in own)
    names = [one for one in known if one.is_name]
    places = [one for one in known if one.name is None]
    return all(not some or any(one.fits(effect) for one in some) for some in (names, places))


def closed_places(exclude: Any, plausible: Any, plant: Plant) -> set[str]:
    """Places at which no effect is allowed, and so no law without a name.

    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.physics._simulator import describe
    >>> plant = describe(make_reactor())
    >>> closed_places(["drift", (None, "u"), ("sensor_bias", "y")], None, plant)
    {'u'}
    >>> closed_places((), ["u", "drift", ("drift", "y")], plant), closed_places((), [("drift", "y")], plant)
    (set(), set())
    >>> closed_places((), ["u", "drift"], plant)
    {'y'}
    """
    out = {str(one.location) for one in _read(exclude) if one.name is None and one.variable is None}
    known = _read(plausible)
    if any(one.name is None for one in known):
        out |= {*plant.states, *plant.inputs, *plant.outputs}.difference(str(one.location) for one in known)
    return out


def _read(entries: Any) -> list[Pattern]:
    """Entries that were checked."""
    return [_pattern(entry, CATALOGUE) for entry in _listed(entries)]


def _listed(entries: Any) -> list[Any]:
    """One or several entries."""
    if entries is None:
        return []
    return [entries] if isinstance(entries, str) or not isinstance(entries, Iterable) else list(entries)


def _pattern(entry: Any, names: Iterable[str]) -> Pattern:
    """An entry; a word that is no name is a place."""
    if isinstance(entry, tuple):
        return Pattern(*entry)
    return Pattern(entry) if _is_among(entry, names) else Pattern(None, entry)


def _is_among(name: str, names: Iterable[str]) -> bool:
    """Whether a name, perhaps with wildcards, is one of these."""
    return any(fnmatchcase(one, name) for one in names)


def _patterns(option: str, entries: Any, effects: Sequence[BaseEffect], plant: Plant) -> list[Pattern]:
    """The entries of ``exclude=`` or ``plausible=``, checked."""
    names = {*CATALOGUE, *(effect.name for effect in effects)}
    places = {*plant.params, *plant.states, *plant.inputs, *plant.outputs, *(str(e.location) for e in effects)}
    how = HOW.format(option=option)
    found = []
    for entry in _listed(entries):
        if not isinstance(entry, str) and not _is_tuple(entry):
            held = f"{option}={entry!r}" if entry is entries else f"{option} holds {entry!r}"
            raise DataError(f"{held}: {how}")
        for word, known, what in _words(entry, names, places):
            if not _is_among(word, known):
                hint = did_you_mean(word, sorted(known))
                hint = f" ({hint.strip()})" if hint else ""
                raise DataError(f"{option} holds {entry!r}: {word!r} is {what}{hint}; {how}")
        found.append(_pattern(entry, names))
    return found


def _is_tuple(entry: Any) -> bool:
    """Whether an entry is (name, location) or (name, location, variable), not all of them None."""
    is_one = isinstance(entry, tuple) and 2 <= len(entry) <= 3 and all(v is None or type(v) is str for v in entry)
    return is_one and any(v is not None for v in entry)


def _words(entry: Any, names: set[str], places: set[str]) -> list[tuple[str, set[str], str]]:
    """The words of an entry, what each may be, and what it is if it is none of these."""
    if isinstance(entry, str):
        return [(entry, names | places, "neither an effect nor a place of the simulator")]
    name, location = entry[:2]
    variables = signals_in(entry[2]) if len(entry) == 3 else ()
    return [
        *([(name, names, "not an effect")] if name is not None else []),
        *([(location, places, "not a place of the simulator")] if location is not None else []),
        *((signal, places, "not a signal of the simulator") for signal in variables),
    ]
