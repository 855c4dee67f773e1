"""Where the gap lies."""

from __future__ import annotations

from dataclasses import dataclass

from sksurrogate.gap.results._table import EMPTY, Table


def place_in_words(kind: str | None, location: str) -> str:
    """Where something acts, for a sentence.

    >>> place_in_words("state", "speed"), place_in_words("output", "y"), place_in_words("input", "u")
    ('the balance of speed', 'the sensor y', 'the input u')
    """
    words = {
        "state": f"the balance of {location}",
        "output": f"the sensor {location}",
        "parameter": f"the term that the parameter {location} scales",
    }
    return words.get(str(kind), f"the {kind} {location}")


@dataclass(frozen=True)
class Where:
    """Where the gap lies.

    Attributes
    ----------
    location : str or None
        The state, input, output or parameter most likely; None where there is no gap.
    kind : {"state", "input", "output", "parameter"} or None
    by_output : Table
        output, gap (units of the output), noise, share.
    by_location : Table
        States, inputs and outputs that were compared, a parameter only where an effect is named there: location, kind, share
        (of the gap, held by the named effects there; where nothing is named, how probable a free signal there alone is),
        evidence (of a free signal there alone: log-likelihood difference to the least likely place).
    by_region : Table
        rule (readable), share of the gap's power there, share of the samples.
    by_time : Table
        start, stop (time since the start of a run), level, kind ("constant", "change", "drift", "change between runs"),
        runs ("all", or for a change between runs those before and those after it, counted from 1 in the order of the data;
        of a long record, its pieces).
    by_frequency : Table
        low, high (cycles per time unit), gap power, noise power, share.
    """

    location: str | None
    kind: str | None
    by_output: Table = EMPTY
    by_location: Table = EMPTY
    by_region: Table = EMPTY
    by_time: Table = EMPTY
    by_frequency: Table = EMPTY
