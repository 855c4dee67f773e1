"""Names that a mistyped one may stand for."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(word: str, known: Iterable[str], cutoff: float = 0.5) -> str:
    """A question that begins with a space; empty where no name is close.

    >>> did_you_mean("elbow", ["elbow.pos", "elbow.vel", "wrist.pos"])
    " did you mean 'elbow.vel' or 'elbow.pos'?"
    >>> did_you_mean("elbow", ["x"])
    ''
    """
    close = difflib.get_close_matches(word, list(known), n=3, cutoff=cutoff)
    return f" did you mean {' or '.join(map(repr, close))}?" if close else ""
