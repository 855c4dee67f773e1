"""Headers of a recording: which column is which signal, and the units that they name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from sksurrogate.exceptions import DataError

_UNIT = re.compile(r"^(?P<name>.*\S)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\)|\s/\s(?P<slash>\S.*))$")


def split_unit(header: str) -> tuple[str, str]:
    """Name and unit of ``speed [rad/s]``, ``speed (rad/s)`` or ``speed / (rad/s)``.

    >>> split_unit("speed [rad/s]"), split_unit("speed (rad/s)"), split_unit("speed / rad/s"), split_unit("speed")
    (('speed', 'rad/s'), ('speed', 'rad/s'), ('speed', 'rad/s'), ('speed', ''))
    """
    match = _UNIT.match(header.strip())
    if match is None:
        return header.strip(), ""
    unit = next(part for part in match.groups()[1:] if part is not None)
    return match["name"].removesuffix("/").strip(), unit.strip()


def assigned(texts: Sequence[str], known: Sequence[str]) -> dict[str, str]:
    """Signal -> column, of ``--columns SIGNAL=COLUMN``.

    Raises DataError where an entry is not of this form, names no signal, or a signal twice.

    >>> assigned(["speed=w [rad/s]"], ["speed"])
    {'speed': 'w [rad/s]'}
    """
    found: dict[str, str] = {}
    for text in texts:
        name = next((one for one in sorted(known, key=len, reverse=True) if text.startswith(f"{one}=")), None)
        if name is None:
            raise DataError(f"--columns {text}: expected SIGNAL=COLUMN with a signal out of {list(known)}.")
        if name in found:
            raise DataError(f"--columns: {name!r} is listed twice; give each signal one column.")
        found[name] = text[len(name) + 1 :]
    return found


def columns_of(signals: Sequence[str], header: Sequence[str], given: Mapping[str, str]) -> dict[str, str]:
    """Signal -> column: as given, else of the same name, else of the same name with a unit behind it.

    A signal without any stays as it is: reading says what is missing. A given column may have a unit that the header lacks.

    Raises DataError where a given column is not there, or several may be meant.

    >>> columns_of(["flow", "level"], ["time [s]", "level [cm]", "flow"], {})
    {'flow': 'flow', 'level': 'level [cm]'}
    >>> columns_of(["flow"], ["q"], {"flow": "q [m3/h]"})
    {'flow': 'q'}
    """
    given = {name: column if column in header else split_unit(column)[0] for name, column in given.items()}
    for name, column in given.items():
        if header and column not in header:
            raise DataError(
                f"--columns {name}={column}: the file has no column {column!r}; its columns are {list(header)}."
            )
    bare: dict[str, list[str]] = {}
    for column in header:
        bare.setdefault(split_unit(column)[0], []).append(column)
    found = {}
    for name in signals:
        near = bare.get(name, [])
        if len(near) > 1 and name not in header and name not in given:
            raise DataError(
                f"{len(near)} columns of the file may be {name!r}: {near}. Rename all but one, or choose: --columns {name}=COLUMN."
            )
        found[name] = given.get(name) or (name if name in header or len(near) != 1 else near[0])
    return found
