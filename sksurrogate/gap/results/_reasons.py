"""Why a verdict was given: the rule that decided, and the numbers it was given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Reasons:
    """The rule that decided, and the numbers it was given.

    Attributes
    ----------
    rule : str
        Name of the first rule of the table that applies; ``"interrupted"`` where nothing was decided.
    sentence : str
        What the rule means.
    features : mapping of str to number or bool
        All that the rules see, by name.

    Examples
    --------
    >>> print(Reasons("none", "What is left is noise and disturbance.", {"left": 1.0}))
    none: What is left is noise and disturbance.
    """

    rule: str
    sentence: str
    features: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.rule}: {self.sentence}"


#: Of a diagnosis that was interrupted before its verdict.
UNDECIDED = Reasons("interrupted", "The diagnosis was interrupted before anything was decided.")
