"""Signals of a joint log before they share rows, and which of them are asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate._close_names import did_you_mean
from sksurrogate.exceptions import DataError

#: What a joint reads, behind the dot of a signal's name: position, velocity, effort (a torque or force).
ENDINGS = (".pos", ".vel", ".effort")
#: Names in a message; a humanoid with hands has about a hundred signals.
MOST_NAMES = 60


@dataclass(frozen=True)
class Asked:
    """What is asked of a log: the arguments of :func:`load_joint_log`."""

    inputs: Sequence[str] | Mapping[str, str] | None = None
    outputs: Sequence[str] | Mapping[str, str] | None = None
    readings: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()
    time: str | None = None
    run: str | None = None
    dt: float | None = None
    clock: str = "auto"


@dataclass(frozen=True, eq=False)
class Stream:
    """Signals that come in the same messages, or in the rows of one table."""

    source: str  #: Topic, feature, key or file
    names: tuple[str, ...]  #: One for each column of values
    t: np.ndarray  #: (n,) s, increasing
    values: np.ndarray  #: (n, n_signals); nan where a message lacks the signal
    numbered: bool = False  #: Whether the signals have no names but their places


@dataclass(frozen=True, eq=False)
class Part:
    """Readings and commands of one run, by the names asked for; label None: pauses part the runs."""

    readings: tuple[Stream, ...]
    commands: tuple[Stream, ...]
    label: Any = None
    apart: bool = False  #: Whether commands come in messages of their own, so that they are known between readings


@dataclass(frozen=True, eq=False)
class Record:
    """A log as it was read."""

    parts: tuple[Part, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    step: float | None = None  #: Time between two rows in s where the format says it
    notes: tuple[str, ...] = ()


def distinct(streams: Sequence[Stream]) -> tuple[Stream, ...]:
    """Streams whose names stand for one signal: ``source:name`` where two sources have the same name."""
    sources: dict[str, set[str]] = {}
    for stream in streams:
        for name in stream.names:
            sources.setdefault(name, set()).add(stream.source)
    return tuple(
        replace(s, names=tuple(f"{s.source}:{name}" if len(sources[name]) > 1 else name for name in s.names))
        for s in streams
    )


def renamed(streams: Sequence[Stream], pairs: Mapping[str, str]) -> tuple[Stream, ...]:
    """Streams of the signals ``pairs`` (name asked for -> name in the log) alone, by the names asked for."""
    out = []
    for stream in streams:
        places = {new: stream.names.index(old) for new, old in pairs.items() if old in stream.names}
        if places:
            out.append(replace(stream, names=tuple(places), values=stream.values[:, list(places.values())]))
    return tuple(out)


def columns_by_name(streams: Sequence[Stream], pairs: Mapping[str, str]) -> dict[str, np.ndarray]:
    """Columns (n,) of the signals ``pairs`` by the names asked for, in their order; the streams share their rows."""
    own = {name: s.values[:, j] for s in renamed(streams, pairs) for j, name in enumerate(s.names)}
    return {name: own[name] for name in pairs}


def chosen(
    argument: str, asked: Any, known: Sequence[str], default: Sequence[str], numbered: bool = False
) -> dict[str, str]:
    """Name asked for -> name in the log.

    A joint's name alone stands for its position in ``outputs``, and for the only field that the commands have of it in
    ``inputs``, and the other way round. Signals without names (``numbered``) are taken in their order.

    Raises DataError where a name is not there, or stands for several signals.

    >>> chosen("inputs", ["elbow"], ["elbow.effort", "wrist.effort"], [])
    {'elbow': 'elbow.effort'}
    >>> chosen("inputs", {"motor": "elbow.effort"}, ["elbow.effort", "wrist.effort"], [])
    {'motor': 'elbow.effort'}
    >>> chosen("outputs", ["elbow.pos", "wrist.pos"], ["q[0]", "q[1]"], [], numbered=True)
    {'elbow.pos': 'q[0]', 'wrist.pos': 'q[1]'}
    """
    if asked is None:
        return {name: name for name in default}
    if isinstance(asked, Mapping):
        pairs = {str(name): str(other) for name, other in asked.items()}
    else:
        names = [str(name) for name in ([asked] if isinstance(asked, str) else asked)]
        twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
        if twice is not None:
            raise DataError(f"{argument}: {twice!r} is listed twice; name each signal once.")
        if numbered and not set(names) & set(known):
            return _in_order(argument, names, known)
        pairs = {name: name for name in names}
    return {name: _there(argument, name, other, known) for name, other in pairs.items()}


def _in_order(argument: str, names: list[str], known: Sequence[str]) -> dict[str, str]:
    """Signals without names, as many as names."""
    if len(names) != len(known) and names:
        raise DataError(
            f"{argument}: {len(names)} names for the {len(known)} signals {shown(known)}, which have no names in the log: "
            f"name all of them in their order, or give a dict, for example {argument}={{{names[0]!r}: {known[0]!r}}}."
        )
    return dict(zip(names, known))


def _there(argument: str, name: str, other: str, known: Sequence[str]) -> str:
    """The signal of the log that a name stands for."""
    if other in known:
        return other
    joint = other.removesuffix(".pos")
    fields = [one for one in known if one in [other + ending for ending in ENDINGS]]
    if argument == "outputs":
        fields = [one for one in known if one in (f"{other}.pos", joint)]
    elif joint != other and joint in known:
        fields = [joint]
    if len(fields) == 1:
        return fields[0]
    if fields:
        raise DataError(
            f"{argument}: {other!r} may be any of {fields}: name one of them, as in {argument}={{{name!r}: {fields[0]!r}}}."
        )
    raise DataError(
        f"{argument}: the log has no signal {other!r};{did_you_mean(other, known)} Its signals here are {shown(known)}. "
        f"A dict renames: {argument}={{{name!r}: name in the log}}."
    )


def shown(names: Sequence[str]) -> str:
    """A list as it can stand in a message.

    >>> shown(["a", "b"]), shown([])
    ("['a', 'b']", 'none')
    """
    if not names:
        return "none"
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"{list(names[:MOST_NAMES])}{more}"
