"""What a diagnosis says: frozen results of every question, each with a readable text form."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from sksurrogate.gap._display import GapDisplay

__all__ = [
    "Curve",
    "EffectEstimate",
    "GapReport",
    "MissingTerm",
    "NextExperiment",
    "Shrink",
    "Table",
    "Trace",
    "Where",
    "values_of",
    "weight_of",
]


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

    def to_pandas(self) -> Any:
        """The table as a pandas frame (extra ``frames``)."""
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


@dataclass(frozen=True)
class EffectEstimate:
    """One named effect.

    Attributes
    ----------
    name, location : str
    variable : str or None
    share : float
        Share of the gap's power on held-out runs that this effect removes.
    params : dict of float
        Magnitude first.
    intervals : dict of (float, float)
        90 % intervals, same keys as ``params``; inf where unbounded.
    probability : float
        Among the rivals fitted in its place, none, and the likeliest law without a name; half of that where the verdict is unknown.
    equivalents : list of (name, location, variable)
        Other effects that these data cannot tell from this one.
    why : str
        When they part.

    Examples
    --------
    >>> from sksurrogate.gap import EffectEstimate
    >>> effect = EffectEstimate("sensor_bias", "y", None, 0.98, {"value": 0.5}, {"value": (0.4, 0.6)}, 0.99, [], "")
    >>> effect.location, effect.params["value"]
    ('y', 0.5)
    """

    name: str
    location: str
    variable: str | None
    share: float
    params: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    probability: float
    equivalents: list[tuple[str, str, str | None]] = field(default_factory=list)
    why: str = ""

    def __str__(self) -> str:
        driver = f" in {self.variable}" if self.variable else ""
        return f"{self.name} at {self.location}{driver}: {values_of(self)}; {weight_of(self)}"


def values_of(effect: EffectEstimate) -> str:
    """Parameters with their 90 % intervals; after an early interrupt without."""
    parts = []
    for name, value in effect.params.items():
        low, high = effect.intervals[name]
        parts.append(f"{name} = {value:.4g}" + ("" if np.isnan(low) else f" [{low:.4g}, {high:.4g}]"))
    return ", ".join(parts)


def weight_of(effect: EffectEstimate) -> str:
    """Share and probability in words."""
    if np.isnan(effect.share):
        return "its share of the gap is not known yet"
    return f"{100 * effect.share:.1f} % of the gap, probability {effect.probability:.3f}"


@dataclass(frozen=True)
class Where:
    """Where the gap lies.

    Attributes
    ----------
    location : str or None
        The state, input, output or parameter most accused; None where there is no gap.
    kind : {"state", "input", "output", "parameter"} or None
    by_output : Table
        output, gap (units of the output), noise, share.
    by_location : Table
        States, inputs and outputs that were compared, a parameter only where an effect is named there: location, kind, share
        (of the gap, held by the named effects there; where nothing is named, how probable a free signal there alone is),
        evidence (of a free signal there alone, in nats over the least).
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
    by_output: Table = Table()
    by_location: Table = Table()
    by_region: Table = Table()
    by_time: Table = Table()
    by_frequency: Table = Table()


@dataclass(frozen=True)
class Shrink:
    """How far the gap shrinks, free run on runs left out of the choice of the names and of the fit of their parameters.

    One fold of runs after another is left out (six at most; blocks where there are fewer than three runs). The other runs
    choose among the sets of as many effects that were fitted to all runs, by their own share of the likelihood, and keep the
    names unless another set gains over them what an effect must gain over none; parameters are refitted to them, and the fold is simulated, with initial states fitted there.
    Which sets were fitted, the noise and the number of effects come from all runs: to certify these too keep runs back from
    ``fit`` and simulate them with ``diagnoser.augmented_``.

    Attributes
    ----------
    before, after, floor : float
        RMSE of the free run, each output divided by its standard deviation.
    fraction : float
        ``1 - gap_after / gap_before`` with ``gap = sqrt(max(rmse^2 - floor^2, 0))``; nan without a gap.
    interval : (float, float)
        90 %.
    by_output : Table
        output, before, after, floor in units of the output, and fraction.
    after_retuning, fraction_retuning : float
        The same when the simulator's parameters are re-tuned and nothing else.
    after_correction, fraction_correction : float
        The same with the generic learned correction.
    fraction_power : float
        The same as ``fraction`` in energy, ``1 - gap_after^2 / gap_before^2``.
    measurable : bool
        False where the gap is not clearly above the floor.
    same_names : float
        Share of the folds whose other runs choose the same effects, up to those that no data here tell apart; nan where
        nothing is named.
    """

    before: float
    after: float
    floor: float
    fraction: float
    interval: tuple[float, float]
    by_output: Table = Table()
    after_retuning: float = float("nan")
    fraction_retuning: float = float("nan")
    after_correction: float = float("nan")
    fraction_correction: float = float("nan")
    fraction_power: float = float("nan")
    measurable: bool = True
    same_names: float = float("nan")


@dataclass(frozen=True, eq=False)
class Curve:
    """The missing term against one variable.

    Attributes
    ----------
    variable : str
    at, value, low, high : ndarray (n_points,)
        Points on the variable, mean of the term there and its 90 % band, in units of the derivative (or of the input or
        output where it sits there).
    explained : float
        Share of the term's variance that a curve in this variable alone explains on runs left out.
    """

    variable: str
    at: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    explained: float


@dataclass(frozen=True)
class MissingTerm:
    """The shape of what is missing.

    Attributes
    ----------
    location : str
    kind : str
    curves : tuple of Curve
        Best variable first.
    candidates : tuple of str
        Symbolic candidates, best first: sums of few simple shapes, with the share of the term that each explains on runs
        left out.
    effects : tuple of LawEffect
        The same as effects, ready for ``GapDiagnoser(effects=[...])``; empty where the term sits in an input or sensor.
    """

    location: str
    kind: str
    curves: tuple[Curve, ...]
    candidates: tuple[str, ...] = ()
    effects: tuple[Any, ...] = ()


@dataclass(frozen=True)
class NextExperiment:
    """What to measure or excite next.

    Attributes
    ----------
    sentence : str
    options : Table
        experiment, gain (expected separation of the tied rivals in nats), between, within (whether its inputs stay where
        inputs were recorded).
    named : str
        The effect whose rivals it is about.
    parted : tuple of str
        Rivals from which the first option parts it.
    """

    sentence: str
    options: Table = Table()
    named: str = ""
    parted: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Trace:
    """One run for the eye: measured, simulated, simulated with the effects; held out from the fit that drew it.

    Attributes
    ----------
    label : object
    t : ndarray (n_samples,)
    measured, before, after : ndarray (n_samples, n_outputs)
    """

    label: Any
    t: np.ndarray
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray


@dataclass(frozen=True, eq=False)
class GapReport:
    """The answer of a diagnosis.

    Attributes
    ----------
    verdict : {"none", "explained", "unknown"}
    sentence : str
        The verdict in plain words, with what to do next.
    effects : list of EffectEstimate
        In order of share; never None.
    ranking : Table
        All rivals with their evidence.
    retuned : Table
        One row a free parameter: parameter, nominal, value, low, high, moved.
    where : Where
    shrink : Shrink
    missing_term : MissingTerm or None
    next_experiment : NextExperiment or None
    complete : bool
        False after an interrupt.
    notes : tuple of str
        What a careful reader should know (closed loop, gap below the bar, what could not be tested).
    untestable : tuple of str
        Effects that were asked for and that this simulator does not allow to test.
    outputs, states, inputs : tuple of str
    traces : tuple of Trace
    seconds : float

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor, make_reactor_runs
    >>> from sksurrogate.gap import GapDiagnoser
    >>> X, y, runs = make_reactor_runs(3, 60, noise=0.02, random_state=0)
    >>> diagnoser = GapDiagnoser(make_reactor(), effects=["sensor_bias", "input_bias"], random_state=0)
    >>> report = diagnoser.fit(X, y + 0.5, groups=runs).report_
    >>> report.verdict, report.where.kind, report.where.location
    ('explained', 'output', 'y')
    >>> bool(report.shrink.after < 0.1 * report.shrink.before)
    True
    >>> page = report.to_html()   # or to_html("gap.html"), plot(), print(report)
    """

    verdict: str
    sentence: str
    effects: list[EffectEstimate]
    ranking: Table
    retuned: Table
    where: Where
    shrink: Shrink
    missing_term: MissingTerm | None = None
    next_experiment: NextExperiment | None = None
    complete: bool = True
    notes: tuple[str, ...] = ()
    untestable: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    traces: tuple[Trace, ...] = ()
    seconds: float = float("nan")

    def plot(self) -> GapDisplay:
        """Draw the report: a :class:`~sksurrogate.gap.GapDisplay` (extra ``plot``)."""
        from sksurrogate.gap._display import GapDisplay

        return GapDisplay(self).plot()

    def to_html(self, path: Any = None) -> str:
        """One self-contained page; written to ``path`` where given, returned as text."""
        from sksurrogate.gap._page import html_page

        page = html_page(self)
        if path is not None:
            with open(path, "w", encoding="utf-8") as file:
                file.write(page)
        return page

    def _repr_html_(self) -> str:
        from sksurrogate.gap._page import html_fragment

        return html_fragment(self)

    def __str__(self) -> str:
        from sksurrogate.gap._page import terminal_page

        return terminal_page(self)

    def __repr__(self) -> str:
        named = ", ".join(effect.name for effect in self.effects) or "no effect"
        return f"GapReport(verdict={self.verdict!r}, {named}, where={self.where.location!r})"
