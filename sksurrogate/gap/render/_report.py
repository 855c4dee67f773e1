"""The answer of a diagnosis, for the eye and for programs."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from sksurrogate._files import write_text
from sksurrogate.gap.render._display import GapDisplay
from sksurrogate.gap.render._page import html_fragment, html_page
from sksurrogate.gap.render._summary import GapSummary, summary_of, table_of
from sksurrogate.gap.render._terminal import terminal_page
from sksurrogate.gap.results._json import SCHEMA_ID, json_text, plain, schema_of
from sksurrogate.gap.results._report_data import ReportData


@dataclass(frozen=True, eq=False)
class GapReport(ReportData):
    """The answer of a diagnosis.

    Attributes
    ----------
    verdict : {"none", "explained", "partial", "unknown"}
        ``explained``: effects of evidence 0.9 (or re-tuning), and the lawful rest is below the tolerance or within the noise.
        ``partial``: such effects, and a larger lawful rest. ``unknown``: no effect is certain.
    sentence : str
        The verdict in plain words, with what to do next.
    effects : list of EffectEstimate
        In order of share; never None.
    ranking : Table
        All candidates with their evidence.
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
        Requested effects that cannot be tested with this simulator.
    outputs, states, inputs : tuple of str
    traces : tuple of Trace
        Every run: measured, simulated, and simulated with the effects (and a certified law) of a fit without this run.
    seconds : float
        Time that the diagnosis took.
    reasons : Reasons
        The rule that decided the verdict, and the numbers that it was given.
    budget : Table
        Shares of the gap's power on held-out runs, which add up to one: part, kind ("effect", "re-tuning", "unnamed law",
        "disturbance"), share, low, high (90 %); no rows without a gap.
    remainder : Remainder
        The part of the gap that is not named: size, lawful or not, place.
    units : mapping of str to str
        Units of signals, parameters and "time", as the simulator names them.
    nominal : mapping of str to float
        Parameters of the simulator as it was given.
    ranges : mapping of str to (float, float)
        Lowest and highest value of states and inputs along the fitted trajectories.
    provenance : Provenance
        Simulator, runs, rows, sample time, seed, version, date, files, command.
    data : DataFaults
        Faults of the record: kind, output or input, runs and rows, size, share of the gap, remedy. Empty if there are none.
    scale : tuple of float
        Sizes of the states, over which ``augmented_`` smooths kinks; empty if it does not.
    sharpness : float
        Size of a variable over the width of its kinks, as it was fitted; 500 where none is.
    mistakes : tuple of str
        Errors of the simulator's own code (a TypeError, a name that is not defined), for which effects could not be tried.

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
    >>> report.to_dict()["where"]["location"]
    'y'
    """

    def plot(self, kind: str | None = None, ax: Any = None) -> GapDisplay:
        """Draw the report with matplotlib (extra ``plot``).

        Parameters
        ----------
        kind : str, optional
            One panel: "budget", "waterfall", "ranking", "trace", "residual", "runs", "regions", "time", "frequency" or
            "missing_term". Default: all that the report has.
        ax : matplotlib Axes, optional
            Where one panel is drawn; default: a new figure.

        Returns
        -------
        GapDisplay
        """
        return GapDisplay(self).plot(kind, ax)

    def summary(self) -> GapSummary:
        """Estimates, intervals and errors as a table to print, in the manner of statistics packages.

        Returns
        -------
        GapSummary
            ``print(report.summary())``; ``as_text()``, ``as_html()``, ``tables``.
        """
        return summary_of(self)

    def to_dict(self, *, traces: bool = True) -> dict[str, Any]:
        """All of the report as dicts, lists, strings, numbers, booleans and None.

        Parameters
        ----------
        traces : bool, default=True
            Whether the runs sample by sample are in it.

        Returns
        -------
        dict
            "schema" (name and version of the format), then the attributes by name; tables as lists of rows.
        """
        skipped = () if traces else ("traces",)
        values = {part.name: getattr(self, part.name) for part in fields(self) if part.name not in skipped}
        return {"schema": SCHEMA_ID, **plain(values)}

    def to_json(self, path: Any = None, *, indent: int | None = 2, traces: bool = True) -> str:
        """:meth:`to_dict` as strict JSON: nan is null, the infinities are the strings "Infinity" and "-Infinity".

        Parameters
        ----------
        path : path, optional
            File to write to.
        indent : int or None, default=2
        traces : bool, default=True

        Returns
        -------
        str
        """
        text = json_text(self.to_dict(traces=traces), indent)
        if path is not None:
            write_text(path, text + "\n")
        return text

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """JSON Schema (draft 2020-12) of :meth:`to_json`, with a description of every entry."""
        schema = schema_of(cls)
        schema["properties"] = {"schema": {"const": SCHEMA_ID}, **schema["properties"]}
        schema["required"] = ["schema", *(name for name in schema["required"] if name != "traces")]
        return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": cls.__name__, **schema}

    def to_frame(self, table: str = "effects") -> Any:
        """One table as a pandas ``DataFrame`` (extra ``frames``).

        Parameters
        ----------
        table : str, default="effects"
            "effects" (one row a parameter), "budget", "ranking", "retuned", "by_output", "by_location", "by_region",
            "by_time", "by_frequency", "shrink_by_output", "experiments", "data" (one row a fault of the record), or "traces" (one
            row a sample of every run).

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        ValueError
            There is no such table.
        """
        return table_of(self, table).to_frame()

    def to_html(self, path: Any = None) -> str:
        """One self-contained page; written to ``path`` where given, returned as text."""
        page = html_page(self)
        if path is not None:
            write_text(path, page)
        return page

    def _repr_html_(self) -> str:
        return html_fragment(self)

    def __str__(self) -> str:
        return terminal_page(self)

    def __repr__(self) -> str:
        named = ", ".join(effect.name for effect in self.effects) or "no effect"
        return f"GapReport(verdict={self.verdict!r}, {named}, where={self.where.location!r})"
