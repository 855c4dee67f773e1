"""Figures of many cases with their 90 % limits, beside the bar that they have to clear."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

#: Quantile of the normal distribution at either end of a 90 % interval.
Z_OF_90 = 1.645


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Wilson's score interval of a share, 90 %.

    >>> low, high = wilson(49, 50)
    >>> round(low, 3), round(high, 3)
    (0.915, 0.996)
    """
    if count == 0:
        return math.nan, math.nan
    share, spread = hits / count, Z_OF_90 * Z_OF_90 / count
    middle = (share + spread / 2) / (1 + spread)
    half = Z_OF_90 * math.sqrt(share * (1 - share) / count + spread / (4 * count)) / (1 + spread)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def line(question: str, bar: str, figure: float, cases: int, low: float, high: float, good: bool, sure: bool) -> dict[str, Any]:  # fmt: skip
    """A line of the table."""
    cleared = ("yes" if good else "no") if sure else ("yes, open" if good else "no, open")
    return {
        "question": question,
        "bar": bar,
        "figure": figure,
        "cases": cases,
        "low": low,
        "high": high,
        "cleared": cleared,
    }


def share(question: str, hits: Sequence[bool], bar: float, at_most: bool = False) -> dict[str, Any]:
    """A share of cases."""
    low, high = wilson(sum(hits), len(hits))
    figure = sum(hits) / len(hits) if hits else math.nan
    good = figure <= bar if at_most else figure >= bar
    return line(question, f"{'at most ' if at_most else ''}{100 * bar:g} %", figure, len(hits), low, high, good,
                 not low < bar < high)  # fmt: skip


def share_between(
    question: str, hits: Sequence[bool], bar: tuple[float, float], at_most: bool = False
) -> dict[str, Any]:
    """A share of cases that should lie between two bars."""
    least, most = bar
    low, high = wilson(sum(hits), len(hits))
    figure = sum(hits) / len(hits) if hits else math.nan
    sure = (low >= least and high <= most) or low > most or high < least
    return line(question, f"{100 * least:g} to {100 * most:g} %", figure, len(hits), low, high,
                least <= figure <= most, sure)  # fmt: skip


def mean(question: str, values: Sequence[float], bar: float, at_most: bool = True) -> dict[str, Any]:
    """A mean that should be small."""
    n = len(values)
    figure = float(np.mean(values)) if n else math.nan
    half = Z_OF_90 * float(np.std(values)) / math.sqrt(n) if n else math.nan
    sure = not figure - half < bar < figure + half
    return line(question, f"at most {bar:g}", figure, n, figure - half, figure + half, figure <= bar, sure)


def median(question: str, values: Sequence[float], bar: float, at_most: bool = False) -> dict[str, Any]:
    """A median with its interval by order statistics."""
    ordered, n = np.sort(np.asarray(values, dtype=float)), len(values)
    if not n:
        return line(question, "", math.nan, 0, math.nan, math.nan, False, False)
    half = Z_OF_90 * math.sqrt(n) / 2
    low = float(ordered[max(math.floor(n / 2 - half), 0)])
    high = float(ordered[min(math.ceil(n / 2 + half), n - 1)])
    figure = float(np.median(ordered))
    good = figure <= bar if at_most else figure >= bar
    return line(question, f"at {'most' if at_most else 'least'} {bar:g}", figure, n, low, high, good, not low < bar < high)  # fmt: skip
