"""What is wrong with the record itself: for the terminal and for the page."""

from __future__ import annotations

import textwrap
from html import escape

from sksurrogate.gap.results._data_faults import DataFaults


def record_lines(faults: DataFaults, width: int) -> list[str]:
    """A title and one paragraph a fault; nothing where nothing is wrong.

    >>> from sksurrogate.gap.results._data_faults import DataFault
    >>> fault = DataFault("gain", "level", "output", (2,), (), 0.05, 0.4, {2: 0.05}, "sensor_gain")
    >>> print("\\n".join(record_lines(DataFaults((fault,)), 60)))
    The record
      - level: a gain error of 5 % in run 2; 40 % of the
        gap.
    """
    if not faults:
        return []
    lines = ["The record"]
    for fault in faults:
        lines += textwrap.wrap(f"- {fault.found}", width, initial_indent="  ", subsequent_indent="    ")
    return lines


def record_html(faults: DataFaults) -> str:
    """A section with a list of the faults; empty where nothing is wrong."""
    if not faults:
        return ""
    entries = "".join(f"<li>{escape(fault.found)}</li>" for fault in faults)
    return f"<h2>The record</h2><p>What is wrong with the data themselves:</p><ul>{entries}</ul>"
