"""What is asked of scored cases: promises and targets as data, each judged by its figure with 90 % limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from sksurrogate.blind._limits import mean, median, share, share_between
from sksurrogate.blind._probabilities import calibration, class_stated
from sksurrogate.blind._summaries import answered, place_up_to_twins

Row = Mapping[str, Any]
Rows = Sequence[Row]

#: A right name that closes more than this share of the gap (amplitude) on unseen runs is never called unknown.
CLOSES = 0.95
#: Stated probabilities from here on are counted as certain.
CERTAIN_STATED = 0.99
#: Gaps beyond re-tuning, over the noise, from which an effect beside parameters that are off is to be seen.
SEEN = 4.0
#: Oracles that close less than this share of the gap (amplitude) are no measure.
SMALLEST_ORACLE = 0.1
#: Arms whose intervals are counted.
NAMED_ARMS = ("effect", "two", "weak", "sizes", "detuned", "effect_disturbed", "region", "time")
#: Arms in which the true effect and its twins are taken out of the catalogue; the others are asked with the whole of it.
PARTIAL_CATALOGUE_ARMS = ("outside", "outside_disturbed")


@dataclass(frozen=True)
class Criterion:
    """A question about the cases of some arms: their values, the figure made of these, and the bar that it has to clear."""

    text: str
    arms: tuple[str, ...]  #: Empty: all
    values: Callable[[Rows], Sequence[Any]]  #: Of the rows of these arms
    bar: Any
    figure: Callable[..., dict[str, Any]] = share
    at_most: bool = False  #: The bar is an upper one; of a share, values say which answers are bad


def judged(criteria: Sequence[Criterion], rows: Rows) -> list[dict[str, Any]]:
    """One line for each criterion of which there are cases.

    ``rows``: rows of a blind check; of cases that could not be drawn nothing is asked.
    Returns list of dict: question, bar, figure, cases, low, high (90 %: Wilson's for shares, order statistics for
        medians, normal for means, resampled for calibration), cleared ("yes" or "no", with ", open" where the interval
        holds the bar: more cases would tell).
    """
    drawn = [row for row in rows if row.get("right") is not None]
    found = []
    for one in criteria:
        values = one.values([row for row in drawn if not one.arms or row["arm"] in one.arms])
        found.append(one.figure(one.text, values, one.bar, one.at_most))
    return [line for line in found if line["cases"]]


# ---- values of rows -------------------------------------------------------------------------------------------------
def right(rows: Rows) -> list[bool]:
    """Right answers; no answer is a wrong one."""
    return [bool(row["right"]) for row in rows]


def right_beyond_retuning(rows: Rows) -> list[bool]:
    """Right answers where re-tuning leaves a gap, if that is known of all."""
    known = all("gap_beyond_retuning" in row for row in rows)
    return right([row for row in rows if row["gap_beyond_retuning"] >= SEEN]) if known else []


def false_names(rows: Rows) -> list[bool]:
    """A name where nothing acts; no answer counts as one."""
    return ["error" in row or row["false_names"] > 0 for row in rows]


def any_names(rows: Rows) -> list[bool]:
    """A name at all; no answer counts as one."""
    return ["error" in row or bool(row["effects"]) for row in rows]


def places(rows: Rows) -> list[bool]:
    """The likely place is that of a true effect or of an exact twin."""
    return ["error" not in row and place_up_to_twins(row) for row in rows]


def in_the_class(rows: Rows) -> list[bool]:
    """A true effect is among the names that the data do not tell apart."""
    return ["error" not in row and row["named"] > 0 for row in rows]


def class_sizes(rows: Rows) -> list[int]:
    """Names that the data do not tell apart."""
    return [size for row in answered(rows) for size in row["classes"]]


def covered(rows: Rows) -> list[bool]:
    """Intervals that hold the true parameter."""
    return [bool(value) for row in answered(rows) for value in row["covered"]]


def shrink(rows: Rows) -> list[float]:
    """Share of the gap that is closed on unseen runs."""
    return [row["shrink"] for row in answered(rows) if row["shrink"] is not None]


def shrink_over_oracle(rows: Rows) -> list[float]:
    """The same over that of the true effect refitted."""
    known = [row for row in answered(rows) if row["shrink"] is not None]
    return [row["shrink"] / row["oracle"] for row in known if (row.get("oracle") or 0) > SMALLEST_ORACLE]


def time_taken(rows: Rows, partial_catalogue: bool, key: str = "seconds") -> list[float]:
    """Seconds of cases of 6 runs; of those that had the machine alone where there are any."""
    timed = [row for row in answered(rows) if row["n_runs"] == 6 and row.get("n_states", 2) >= 2]
    timed = [
        row for row in timed if row.get("cases_at_once") == 1
    ] or timed  # one diagnosis at a time has the machine's cores
    some = [row for row in timed if (row["arm"] in PARTIAL_CATALOGUE_ARMS) == partial_catalogue]
    return [row[key] for row in some if row["seconds"] is not None and row.get(key) is not None]


def probabilities(rows: Rows) -> list[tuple[float, bool]]:
    """Probability of each name, and whether it or a member of its class acts."""
    return [pair for row in answered(rows) for pair in class_stated(row)]


def certain_names(rows: Rows) -> list[bool]:
    """Whether the names act whose stated probability counts as certain."""
    return [true for chance, true in probabilities(rows) if chance >= CERTAIN_STATED]


def budget_errors(rows: Rows) -> list[float]:
    """Distance of the share that the report says is closed from the share that is closed on unseen runs without their noise."""
    stated = [row for row in answered(rows) if row["effects"] and row.get("predicted_shrink") is not None]
    return [abs(row["predicted_shrink"] - row["shrink"]) for row in stated if row.get("shrink") is not None]


def known_where_closed(rows: Rows) -> list[bool]:
    """Whether right names that close nearly all of the gap are not called unknown."""
    named = [row for row in answered(rows) if row["named"] and not row["false_names"]]
    return [row["verdict"] != "unknown" for row in named if (row["shrink"] or 0.0) > CLOSES]


# ---- questions ------------------------------------------------------------------------------------------------------
#: What a diagnosis promises.
PROMISES: tuple[Criterion, ...] = (
    Criterion("one effect, in all runs, a region or a time: named, nothing else", ("effect", "region", "time", "onset"), right, 0.98),
    Criterion("one effect, runs of unequal lengths: named, nothing else", ("unequal",), right, 0.98),
    Criterion("one effect, parameters 20 % off: named, nothing else", ("far",), right, 0.95),
    Criterion("one effect, 6 to 12 states: named, nothing else", ("big",), right, 0.98),
    Criterion("two effects: both named, nothing else", ("two",), right, 0.94),
    Criterion("three effects: all named, nothing else", ("three",), right, 0.90),
    Criterion("a form that is not the catalogue's: its name, explained or partial, nothing else", ("inexact",), right, 0.95),
    Criterion("no effect (white, coloured, disturbed, spikes, tails, unreached): false names",
             ("none", "coloured", "disturbed", "spikes", "tails", "unexcited"), false_names, 0.01, at_most=True),
    Criterion("sensors that drift or differ from run to run: none, or the sensor's name", ("trends",), right, 0.99),
    Criterion("taken out of the catalogue: unknown, partial without a false name, or imitated",
             ("outside", "novel", "outside_disturbed"), right, 0.95),
    Criterion("stated probability: error of calibration", (), probabilities, 0.02, calibration, at_most=True),
    Criterion("stated 0.99 and more: true", (), certain_names, 0.985),
    Criterion("budget: closed share stated less closed on unseen runs", (), budget_errors, 0.05, median, at_most=True),
    Criterion("right names that close more than 95 % on unseen runs: not called unknown", (), known_where_closed, 1.0),
)  # fmt: skip

#: What single arms should reach, and in what time.
TARGETS: tuple[Criterion, ...] = (
    Criterion("one effect: named, nothing else", ("effect",), right, 0.98),
    Criterion("one effect: mean size of the class", ("effect",), class_sizes, 2.5, mean, at_most=True),
    Criterion("one effect: its place or an exact twin's", ("effect",), places, 0.98),
    Criterion("one effect in a region: named, nothing else", ("region",), right, 0.98),
    Criterion("one effect from some time on: named, nothing else", ("time",), right, 0.98),
    Criterion("two effects: both named, nothing else", ("two",), right, 0.93),
    Criterion("weak effect: in the class", ("weak",), in_the_class, 0.95),
    Criterion("weak effect: mean size of the class", ("weak",), class_sizes, 4.0, mean, at_most=True),
    Criterion("parameters off by 8 %: named, nothing else", ("detuned",), right, 0.95),
    Criterion("the same, where re-tuning leaves a gap of 4 x noise", ("detuned",), right_beyond_retuning, 0.95),
    Criterion("beside a disturbance: named, nothing else", ("effect_disturbed",), right, 0.95),
    Criterion("no effect, white noise: false names", ("none",), any_names, 0.02, at_most=True),
    Criterion("no effect, coloured disturbance: false names", ("disturbed",), any_names, 0.03, at_most=True),
    Criterion("no effect, coloured sensor noise: false names", ("coloured",), any_names, 0.05, at_most=True),
    Criterion("effect never reached: false names", ("unexcited",), any_names, 0.02, at_most=True),
    Criterion("outside the catalogue: unknown", ("outside", "novel"), right, 0.97),
    Criterion("outside the catalogue: its place or an exact twin's", ("outside", "novel"), places, 0.95),
    Criterion("outside the catalogue, beside a disturbance: unknown", ("outside_disturbed",), right, 0.95),
    Criterion("90 % intervals that hold the truth", NAMED_ARMS, covered, (0.85, 0.95), share_between),
    Criterion("shrink on runs nobody fitted (the true effect with its true parameters: 1)", ("effect",), shrink, 0.98, median),
    Criterion("shrink over that of the true effect refitted", ("effect",), shrink_over_oracle, 0.98, median),
    Criterion("seconds, 2 to 4 states, 6 x 300 samples, the whole catalogue", (), partial(time_taken, partial_catalogue=False),
             3.0, median, at_most=True),
    Criterion("processor seconds of two cores, the same", (),
             partial(time_taken, partial_catalogue=False, key="processor_seconds"), 6.0, median, at_most=True),
    Criterion("seconds where the true effect is taken out of the catalogue", (), partial(time_taken, partial_catalogue=True),
             3.0, median, at_most=True),
)  # fmt: skip
