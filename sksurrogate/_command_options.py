"""What a user knows, as options of the command line: bounds, priors, what is ruled out, how much time there is."""

from __future__ import annotations

import argparse
import math
from typing import Any

from sksurrogate.exceptions import DataError


def add_knowledge(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--exclude", metavar="WHAT", nargs="+", action="extend", default=[],
        help="effects, places, effect@place or effect@place@variable that are known not to be there",
    )  # fmt: skip
    parser.add_argument(
        "--plausible", metavar="WHAT", nargs="+", action="extend", default=[],
        help="effect@place: that effect acts there only; an effect or a place alone: no effects but these",
    )  # fmt: skip
    parser.add_argument(
        "--bounds", metavar="NAME=LOW:HIGH", nargs="+", action="extend", default=[],
        help="bounds of parameters; an empty side is open",
    )  # fmt: skip
    parser.add_argument(
        "--prior", metavar="NAME=SD", nargs="+", action="extend", default=[],
        help="relative standard deviation of a parameter, or NAME=MEAN:SD in its unit",
    )  # fmt: skip
    parser.add_argument(
        "--clock-offset", metavar="TIME", type=float, default=0.0,
        help="time by which the clocks of two sensors may be apart: sensor_delay may be negative",
    )  # fmt: skip
    parser.add_argument(
        "--time-limit", metavar="SECONDS", type=float, default=None,
        help="end after this time with what is known by then",
    )  # fmt: skip


def knowledge_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Settings of the diagnosis.

    Raises DataError where an option is not of its form.
    """
    limit = arguments.time_limit
    if limit is not None and not 0.0 < limit < math.inf:
        raise DataError(f"--time-limit {limit:g}: expected a number of seconds above 0.")
    offset = arguments.clock_offset
    if not 0.0 <= offset < math.inf:
        raise DataError(
            f"--clock-offset {offset:g}: expected a time from 0 on, the most by which two clocks are apart."
        )
    return {
        "time_limit": limit,
        "clock_offset": offset,
        "exclude": [_effect_or_place("--exclude", text) for text in arguments.exclude] or (),
        "plausible": [_effect_or_place("--plausible", text) for text in arguments.plausible] or None,
        "bounds": {
            name: _bounds(text, value) for text in arguments.bounds for name, value in [_split("--bounds", text)]
        }
        or None,
        "priors": {name: _prior(text, value) for text in arguments.prior for name, value in [_split("--prior", text)]}
        or None,
    }


def _effect_or_place(option: str, text: str) -> Any:
    """``effect``, ``place``, ``effect@place``, ``@place`` or ``effect@place@variable``."""
    parts = tuple(part or None for part in text.split("@"))
    if len(parts) > 3:
        raise DataError(f"{option} {text}: expected effect, place, effect@place or effect@place@variable.")
    return parts[0] if len(parts) == 1 else parts


def _split(option: str, text: str) -> tuple[str, str]:
    """Name and value of ``NAME=VALUE``; a name may hold an equals sign, a value not."""
    name, _, value = text.rpartition("=")
    if not name or not value:
        raise DataError(
            f"{option} {text}: expected {'NAME=LOW:HIGH' if option == '--bounds' else 'NAME=SD or NAME=MEAN:SD'}."
        )
    return name, value


def _bounds(text: str, value: str) -> tuple[float | None, float | None]:
    """``LOW:HIGH``, one side perhaps empty."""
    low, colon, high = value.partition(":")
    try:
        ends = tuple(float(end) if end else None for end in (low, high))
    except ValueError:
        colon = ""
    if not colon:
        raise DataError(f"--bounds {text}: expected NAME=LOW:HIGH, two numbers; an empty side is open, as in k=0.1:.")
    return ends[0], ends[1]


def _prior(text: str, value: str) -> float | tuple[float, float]:
    """``SD``, or ``MEAN:SD``."""
    try:
        numbers = [float(part) for part in value.split(":")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 2:
        raise DataError(f"--prior {text}: expected NAME=SD (relative, as 0.05) or NAME=MEAN:SD, numbers.")
    return numbers[0] if len(numbers) == 1 else (numbers[0], numbers[1])
