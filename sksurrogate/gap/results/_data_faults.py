"""What is wrong with the record itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sksurrogate.gap.results._table import Table

#: Rows and runs that a sentence lists before it says "and so many more".
FAULTS_LISTED = 6


@dataclass(frozen=True)
class DataFault:
    """One fault of the record.

    Attributes
    ----------
    kind : {"spikes", "dropouts", "stuck", "shift", "offset", "gain", "hum", "input_noise", "hold"}
        Single wrong readings; readings that fall to one value; a sensor that repeats one value; a run whose outputs are
        earlier or later than its inputs; an offset or a scale of a sensor that differs from run to run; a tone on a sensor;
        noise in the measurement of an input; inputs that move between the rows where the simulator holds them.
    location : str or None
        The output or input; None where all outputs, or all inputs, are concerned.
    side : {"output", "input"}
    runs : tuple
        Labels of the runs that have the fault.
    rows : tuple of int
        Rows of X and y that are wrong, counted from 0; empty if whole runs are wrong.
    size : float
        Largest deviation in the unit of the signal; a shift in samples, a gain as a relative error; nan where there is none.
    share : float
        Share of the power of the gap between the simulator and the unchanged record.
    values : mapping
        Label of the run -> offset, gain (relative error) or shift (samples, positive where outputs come late).
    effect : str or None
        Name of the effect of the catalogue that has this form, acting in these runs only.
    remedy : str
        What to do.
    taken_out : bool
        Whether effects were compared on a record without it.

    Examples
    --------
    >>> fault = DataFault("spikes", "speed", "output", ("a",), (17, 40), 2.5, 0.8, remedy="Use OutlierFilter.")
    >>> print(fault)
    speed: 2 spikes of up to 2.5 in run 'a' (rows 17, 40); 80 % of the gap. Use OutlierFilter.
    """

    kind: str
    location: str | None
    side: str
    runs: tuple[Any, ...]
    rows: tuple[int, ...]
    size: float
    share: float = float("nan")
    values: Mapping[Any, float] = field(default_factory=dict)
    effect: str | None = None
    remedy: str = ""
    taken_out: bool = True

    def __str__(self) -> str:
        return f"{self.found} {self.remedy}".rstrip()

    @property
    def found(self) -> str:
        """Place, fault and share of the gap."""
        share = "" if np.isnan(self.share) else f"; {100 * self.share:.0f} % of the gap"
        return f"{self.place}: {self.what}{share}."

    @property
    def place(self) -> str:
        """The output or input in words."""
        return self.location or f"all {self.side}s"

    @property
    def what(self) -> str:
        """The fault in words, without its place."""
        n, size = len(self.rows), f"{self.size:.3g}"
        where = "the record" if self.runs == (None,) else runs_text(self.runs)  # one run without a label
        rows = f" ({'row' if n == 1 else 'rows'} {listed([str(row) for row in self.rows])})" if self.rows else ""
        given = set(self.values.values())
        single = f"{size}" if len(given) <= 1 else f"up to {size}"
        side = "after" if min(given, default=1.0) > 0 else "before" if max(given) < 0 else "apart from"
        return {
            "spikes": f"{n} spike{'s' if n != 1 else ''} of up to {size} in {where}{rows}",
            "dropouts": f"{n} readings dropped out by up to {size} in {where}{rows}",
            "stuck": f"the sensor repeated one value for {n} readings in {where}{rows}",
            "shift": f"outputs come {single} {'sample' if single == '1' else 'samples'} {side} their inputs in {where}",
            "offset": f"an offset of {single} in {where}",
            "gain": f"a gain error of {100 * self.size:.3g} % in {where}",
            "hum": f"a tone of amplitude {size} in {where}",
            "hold": f"they move between the rows, and the simulator holds them, in {where}",
            "input_noise": f"the measurement of this input is noisy (standard deviation {size}) in {where}",
        }[self.kind]


@dataclass(frozen=True)
class DataFaults:
    """Faults of the record; empty if there are none.

    Attributes
    ----------
    entries : tuple of DataFault

    Examples
    --------
    >>> bool(DataFaults()), len(DataFaults())
    (False, 0)
    """

    entries: tuple[DataFault, ...] = ()

    def __len__(self) -> int:
        return len(self.entries)

    def __getitem__(self, index: Any) -> Any:
        return DataFaults(self.entries[index]) if isinstance(index, slice) else self.entries[index]

    def __iter__(self) -> Iterator[DataFault]:
        return iter(self.entries)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the entries."""
        return tuple(dict.fromkeys(fault.kind for fault in self.entries))

    @property
    def sentence(self) -> str:
        """All faults in words; empty where there are none."""
        out, left = (
            "; ".join(
                f"{one.place}: {one.what}"
                + ("" if taken or np.isnan(one.share) else f", {100 * one.share:.0f} % of the gap")
                for one in self.entries
                if one.taken_out is taken
            )
            for taken in (True, False)
        )
        text = f"The record has faults. They were removed before effects were compared: {out}." if out else ""
        return (
            f"{text} These faults stay in the record and explain a part of the gap: {left}.".strip() if left else text
        )

    def table(self) -> Table:
        """One row a fault."""
        return Table(
            tuple(
                {
                    "kind": fault.kind,
                    "location": fault.location,
                    "side": fault.side,
                    "runs": fault.runs,
                    "readings": len(fault.rows),
                    "size": fault.size,
                    "share": fault.share,
                }
                for fault in self.entries
            )
        )

    def __str__(self) -> str:
        return "\n".join(str(fault) for fault in self.entries) or "(nothing is wrong with the record)"


def listed(texts: Sequence[str]) -> str:
    """Some texts, and how many more there are.

    >>> listed(["1", "2", "3"])
    '1, 2, 3'
    """
    more = len(texts) - FAULTS_LISTED
    return ", ".join(texts) if more <= 1 else ", ".join(texts[:FAULTS_LISTED]) + f" and {more} more"


def runs_text(labels: Sequence[Any]) -> str:
    """Some runs by their labels.

    >>> runs_text(["a"]), runs_text([1, 2])
    ("run 'a'", 'runs 1, 2')
    """
    return f"{'run' if len(labels) == 1 else 'runs'} {listed([repr(label) for label in labels])}"


#: Nothing is wrong with the record.
NO_FAULTS = DataFaults()
