"""The answer of a diagnosis, for the eye and for programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sksurrogate._files import write_text
from sksurrogate.gap.render._display import GapDisplay
from sksurrogate.gap.render._page import html_fragment, html_page, terminal_page
from sksurrogate.gap.results._report_data import ReportData

__all__ = ["GapReport"]


@dataclass(frozen=True, eq=False)
class GapReport(ReportData):
    """The answer of a diagnosis.

    Attributes
    ----------
    verdict : {"none", "explained", "partial", "unknown"}
        ``explained``: effects (or re-tuning) of probability 0.9, and what remains lawful is below the tolerance or within the
        noise. ``partial``: such effects, but more than that remains lawful. ``unknown``: no effect is certain.
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
    reasons : Reasons
        The rule that decided the verdict, and the numbers that it was given.
    budget : Table
        Shares of the gap's power on runs left out, which add up to one: part, kind ("effect", "re-tuning", "unnamed law",
        "disturbance"), share, low, high (90 %); no rows without a gap.
    remainder : Remainder
        What is left beside everything that is named: size, lawful or not, place.

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

    def plot(self) -> GapDisplay:
        """Draw the report: a :class:`~sksurrogate.gap.GapDisplay` (extra ``plot``)."""
        return GapDisplay(self).plot()

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
