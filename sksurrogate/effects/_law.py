"""Laws found in data: sums of simple physical shapes of states and inputs, as effects that can be fitted and added."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.effects._effect import BalanceEffect, Parameter
from sksurrogate.effects._smooth import TINY, after, magnitude, sign

__all__ = ["SHAPES", "LawEffect", "Term"]


def _above(v: Any, c: float, w: float) -> Any:
    """max(v - c, 0), rounded over w."""
    z = v - c
    return 0.5 * (z + np.sqrt(z**2 + w**2))


def _root(v: Any, w: float) -> Any:
    """sign(v) sqrt(|v|), with a finite slope at 0."""
    return v / np.sqrt(np.sqrt(v**2 + w**2) + TINY)


#: Shape -> (value of v with its constant c and the width w of kinks, text with {v} and {c}).
SHAPES: dict[str, tuple[Callable[[Any, float, float], Any], str]] = {
    "v": (lambda v, c, w: v, "{v}"),
    "square": (lambda v, c, w: v**2, "{v}^2"),
    "cube": (lambda v, c, w: v**3, "{v}^3"),
    "drag": (lambda v, c, w: v * np.abs(v), "{v}*abs({v})"),
    "size": (lambda v, c, w: magnitude(v, w), "abs({v})"),
    "sign": (lambda v, c, w: sign(v, w), "sign({v})"),
    "root": (lambda v, c, w: _root(v, w), "sign({v})*sqrt(abs({v}))"),
    "flow": (lambda v, c, w: _root(np.maximum(v, 0.0), w), "sqrt({v})"),
    "fourth": (lambda v, c, w: v**4, "{v}^4"),
    "sine": (lambda v, c, w: np.sin(v), "sin({v})"),
    "cosine": (lambda v, c, w: np.cos(v), "cos({v})"),
    "wave": (lambda v, c, w: np.sin(c * v), "sin({c}*{v})"),
    "above": (lambda v, c, w: _above(v, c, w), "max({v} - {c}, 0)"),
    "below": (lambda v, c, w: _above(-v, -c, w), "max({c} - {v}, 0)"),
    "beyond": (lambda v, c, w: 0.5 * (1.0 + sign(v - c, w)), "({v} > {c})"),
    "saturating": (lambda v, c, w: v / (c + v), "{v}/({c} + {v})"),
    "fading": (lambda v, c, w: v / (1.0 + (v / c) ** 2), "{v}/(1 + ({v}/{c})^2)"),
    "inverse": (lambda v, c, w: 1.0 / v, "1/{v}"),
    "activated": (lambda v, c, w: np.exp(-c / v), "exp(-{c}/{v})"),
    "after": (lambda v, c, w: after(v, c, w), "(t > {c})"),
}


@dataclass(frozen=True)
class Term:
    """A product of shapes.

    Attributes
    ----------
    factors : tuple of (shape, variable, constant, width)
        Shape of :data:`SHAPES`; name of a state or input ("t" for the time since the start); constant of the shape;
        width over which its kink is rounded.
    """

    factors: tuple[tuple[str, str, float, float], ...] = ()

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of its signals, sorted; without time."""
        return tuple(sorted({name for _, name, _, _ in self.factors if name != "t"}))

    @property
    def text(self) -> str:
        """As one writes it; "1" for the constant."""
        return "*".join(SHAPES[s][1].format(v=v, c=f"{c:.4g}") for s, v, c, _ in self.factors) or "1"

    def value(self, signals: Mapping[str, Any], t: Any = 0.0) -> Any:
        """Of arrays by name.

        Examples
        --------
        >>> drag = Term((("drag", "speed", 0.0, 0.0),))
        >>> drag.text, float(drag.value({"speed": -2.0}))
        ('speed*abs(speed)', -4.0)
        """
        out: Any = 1.0
        for shape, name, constant, width in self.factors:
            out = out * SHAPES[shape][0](t if name == "t" else signals[name], constant, width)
        return out


class LawEffect(BalanceEffect):
    """A sum of simple shapes is missing in a balance or at a port; made by ``report.missing_term.effects``.

    Parameters
    ----------
    location : str
        State in whose balance the law stands, or the input (or further port) to which it adds.
    variable : str, optional
        Its signals joined by ``*``, names sorted.
    terms : tuple of Term
    values : tuple of float, optional
        Coefficients found; where a fit starts.

    Examples
    --------
    >>> law = LawEffect("v", "v", (Term((("drag", "v", 0.0, 0.0),)),), (-0.3,))
    >>> law.name, law.starts(None)
    ('law: v*abs(v)', [(-0.3,)])
    """

    equation = "c0 f0(v, w) + c1 f1(v, w) + ..."
    signature = "whatever no named effect explains"
    drivers = ("state", "input")
    at_port = ()

    def __init__(
        self,
        location: str | None = None,
        variable: str | None = None,
        terms: Sequence[Term] = (),
        values: Sequence[float] | None = None,
    ):
        super().__init__(location, variable)
        self.terms = terms
        self.values = values

    @property
    def name(self) -> str:  # type: ignore[override]
        """The form, without its coefficients."""
        return "law: " + " + ".join(term.text for term in self.terms)

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """A coefficient for every term."""
        return tuple(Parameter(f"c{k}", unit=f"dx/dt over {term.text}") for k, term in enumerate(self.terms))

    @property
    def linear(self) -> bool:  # type: ignore[override]
        """One coefficient scales the whole."""
        return len(self.terms) == 1

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """``sum of c f(v, w)``."""
        names = self.variable.split("*") if self.variable else []
        signals = dict(zip(names, v if len(names) > 1 else (v,)))
        out: Any = np.zeros_like(x)
        for coefficient, term in zip(theta, self.terms):
            out = out + coefficient * term.value(signals, t)
        return out

    def starts(self, probe: Any) -> list[tuple[float, ...]]:
        """The coefficients that were found."""
        return [tuple(self.values) if self.values is not None else (1.0,) * len(self.terms)]
