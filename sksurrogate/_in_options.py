"""Messages about parameters of Python in the words of the command: the option that was typed, and its value as it is typed."""

from __future__ import annotations

import ast
import re
from typing import Any

#: Parameters of ``GapDiagnoser`` and of the check on withheld effects, and the options that set them.
OPTION_OF = {
    "free_params": "--free",
    "bounds": "--bounds",
    "priors": "--prior",
    "exclude": "--exclude",
    "plausible": "--plausible",
    "effects": "--effects",
    "clock_offset": "--clock-offset",
    "time_limit": "--time-limit",
    "n_jobs": "--jobs",
    "random_state": "--seed",
    "cases": "--cases",
    "arms": "--arms",
    "resume": "--resume",
    "record": "--record",
    "follow_up": "--follow-up",
}
#: How Python writes what is expected, and how an option does.
IN_THE_COMMAND = (
    (r"\(low, high\) with low < high; None leaves a side", "NAME=LOW:HIGH with LOW below HIGH; an empty side is"),
    (r"\(mean, standard deviation\)", "MEAN:SD"),
    (r"for instance \(([^(),]+), ([^(),]+)\)", r"for instance \1:\2"),
    (r"tuples \(name, location\) or \(name, location, variable\)", "effect@place or effect@place@variable"),
    (r" An effect of your own goes in as a class or an instance\.", ""),
)
_ANY_PARAMETER = "|".join(OPTION_OF)
_NO_WORD = "|".join(name for name in OPTION_OF if "_" in name)
#: With a value anywhere; as the subject of a message at its beginning; where it can be no word of the language, anywhere.
_MENTIONED = re.compile(
    rf"(?<![\w.'\"-])(?P<set>{_ANY_PARAMETER})(\[(?P<key>'[^']*')\])?=|^(?P<held>{_ANY_PARAMETER}) holds |^(?P<first>{_ANY_PARAMETER})(?=:| names )"
    rf"|(?<![\w.'\"-])(?P<bare>{_NO_WORD})\b"
)


def in_options(said: str) -> str:
    """A message with options in the place of parameters.

    >>> in_options("free_params=['K', 'K']: 'K' is listed twice.")
    "--free K K: 'K' is listed twice."
    >>> in_options("bounds['K']=(2.0, 1.0): expected (low, high) with low < high; None leaves a side open.")
    '--bounds K=2:1: expected NAME=LOW:HIGH with LOW below HIGH; an empty side is open.'
    >>> in_options("exclude holds ('drift', 'nowhere'): 'nowhere' is not a place, for example exclude=['drift', 'level'].")
    "--exclude drift@nowhere: 'nowhere' is not a place, for example --exclude drift level."
    """
    for python, option in IN_THE_COMMAND:
        said = re.sub(python, option, said)
    out, done = "", 0
    for found in _MENTIONED.finditer(said):
        if found.start() < done:
            continue  # within a value
        name = found["set"] or found["held"] or found["first"] or found["bare"]
        out += said[done : found.start()] + OPTION_OF[name]
        done = found.end()
        if found["set"] or found["held"]:
            text, length = _value(said[done:])
            out += f" {ast.literal_eval(found['key'])}={text}" if found["key"] else f" {text}".rstrip()
            done += length
    return out + said[done:]


def _value(rest: str) -> tuple[str, int]:
    """The value with which a text begins, as typed, and its length in the text; nothing of a text that begins with none."""
    for end in re.finditer(r"(?=[:;,.]?(?:\s|$))", rest):
        try:
            return as_typed(ast.literal_eval(rest[: end.start()])), end.start()
        except (ValueError, SyntaxError):
            continue
    return "", 0


def as_typed(value: Any) -> str:
    """A value of Python as the words of an option.

    >>> as_typed(["drift", ("lag", "valve"), (None, "level")]), as_typed((0.5, None)), as_typed(2)
    ('drift lag@valve @level', '0.5:', '2')
    """
    if isinstance(value, list):
        return " ".join(map(as_typed, value))
    if isinstance(value, tuple):
        joint = ":" if any(isinstance(part, (int, float)) for part in value) else "@"
        return joint.join("" if part is None else as_typed(part) for part in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
