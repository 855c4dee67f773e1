"""Terms of a law in a balance that have the form of an effect of the catalogue."""

from __future__ import annotations

from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.effects._formula import Term

#: Effects by the shapes of their one term, each of a signal of its own.
FORMS: dict[tuple[str, ...], str] = {
    (): "constant_bias",
    ("v",): "linear_loss",
    ("square",): "quadratic_loss",
    ("drag",): "quadratic_drag",
    ("cube",): "cubic_stiffness",
    ("power",): "power_law",
    ("flow",): "sqrt_leak",
    ("sign",): "coulomb_friction",
    ("sine",): "gravity_tilt",
    ("v", "v"): "bilinear",
}


def form_of(term: Term, coefficient: float) -> str | None:
    """Name of the effect whose form a term has; None where no effect has it, or the effect has the other sign.

    >>> drag, squared = Term((("drag", "speed", 0.0, 0.0),)), Term((("square", "t", 0.0, 0.0),))
    >>> form_of(drag, -0.2), form_of(drag, 0.2), form_of(squared, -1.0)
    ('quadratic_drag', None, None)
    """
    name = FORMS.get(tuple(factor[0] for factor in term.factors))
    of_plain_signals = all(factor[1].isidentifier() and factor[1] != "t" for factor in term.factors)
    if name is None or not of_plain_signals or len(term.variables) < len(term.factors):
        return None
    lossy = CATALOGUE[name].parameters[0].low >= 0.0  # written as -c f(v) with c >= 0
    return None if lossy and coefficient > 0.0 else name
