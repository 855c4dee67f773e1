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
    by its signals.
    """
    best = None if search.leading is None else search.leading[0]
    if best is None or search.judged[best].left < NEARLY_WHITE:
        return None
    null = search.fitted_null
    law = judged_law(search, null, null.candidate, along=True)
    if law is None or law.left.variable == "time" or law.left.left > NEARLY_WHITE:
        return None
    return law.left if 2.0 * (law.total - search.score(best)) > CERTAIN else None
