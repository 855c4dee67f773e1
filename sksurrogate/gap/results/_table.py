"""Rows of named values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Table(Sequence):
    """Rows of named values.

    Attributes
    ----------
    rows : tuple of dict
        All with the same keys.
    """

    rows: tuple[Mapping[str, Any], ...] = ()

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return list(self.rows[0]) if self.rows else []

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: Any) -> Any:
        return Table(self.rows[index]) if isinstance(index, slice) else self.rows[index]

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        return iter(self.rows)

    def column(self, name: str) -> list[Any]:
        """Values of one column."""
        return [row[name] for row in self.rows]

    def to_frame(self) -> Any:
        """The table as a pandas ``DataFrame`` (extra ``frames``), one row a row."""
        from sksurrogate.exceptions import require

        return require("pandas", "frames").DataFrame(list(self.rows))

    def __str__(self) -> str:
        cells = [self.columns] + [[_cell(row[c]) for c in self.columns] for row in self.rows]
        if not self.rows:
            return "(empty)"
        widths = [max(len(line[j]) for line in cells) for j in range(len(cells[0]))]
        return "\n".join("  ".join(text.ljust(w) for text, w in zip(line, widths)).rstrip() for line in cells)


def _cell(value: Any) -> str:
    """Text of one value."""
    if value is None:
        return "-"
    if isinstance(value, (float, np.floating)):
        return f"{value:.4g}"
    if isinstance(value, tuple):
        return "(" + ", ".join(_cell(v) for v in value) + ")"
    return str(value)


#: A table without rows.
EMPTY = Table()
