"""A gap that one law explains: before further names are looked for, which signals they may have."""

from __future__ import annotations

from sksurrogate.gap.decide._contenders import judged_law
from sksurrogate.gap.fit._closeness import NEARLY_WHITE
from sksurrogate.gap.fit._evidence import CERTAIN
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.unnamed._law_left import LawLeft


def law_of_the_gap(search: OdeSearch) -> LawLeft | None:
    """The law that explains the gap up to white noise, where it is likelier than the best single effect, which leaves more; None where none
    does, or one of time.

    What is missing is one function then, at one place: names of other functions would only imitate it. Names whose sum it is are driven
    by its signals. A law that is likelier points at the effects left for later that its signals drive, also where it leaves more: to first
    order nothing tells of a parameter that changes by much.
    """
    if not _leaves_more(search):
        return None
    null = search.fitted_null
    law = judged_law(search, null, null.candidate, along=True)
    if law is None or law.left.variable == "time" or not _is_likelier(search, law.total):
        return None
    if search.ask_late_of(law.left.signals, law.total) and not (
        _leaves_more(search) and _is_likelier(search, law.total)
    ):
        return None
    return law.left if law.left.left <= NEARLY_WHITE else None


def _leaves_more(search: OdeSearch) -> bool:
    """Whether the best single effect leaves more than white noise."""
    return search.leading is not None and search.judged[search.leading[0]].left >= NEARLY_WHITE


def _is_likelier(search: OdeSearch, total: float) -> bool:
    """Than the best single effect."""
    return search.leading is not None and 2.0 * (total - search.score(search.leading[0])) > CERTAIN
