"""Formulae of a few simple shapes: products and sums of functions of signals, as values, as text, as LaTeX and for sympy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.effects._smooth import TINY, after, magnitude, sign

#: Shape; signal; first constant; width over which its kink is rounded; further constants.
Factor = tuple[Any, ...]
#: Exponents that are fitted, and arguments of exponentials: beyond them nothing finite is left.
EXPONENT_RANGE, LARGEST_ARGUMENT = (0.1, 8.0), 50.0


def _above(v: Any, c: Any, w: float) -> Any:
    """max(v - c, 0), rounded over w."""
    z = v - c
    return 0.5 * (z + np.sqrt(z**2 + w**2))


def _root(v: Any, w: float) -> Any:
    """sign(v) sqrt(|v|), with a finite slope at 0."""
    return v / np.sqrt(np.sqrt(v**2 + w**2) + TINY)


def _power(v: Any, c: Any) -> Any:
    """sign(v) |v|^c."""
    return np.sign(v) * np.maximum(np.abs(v), TINY) ** c


def _exp(z: Any) -> Any:
    """exp(z), finite."""
    return np.exp(np.clip(z, -LARGEST_ARGUMENT, LARGEST_ARGUMENT))


def _hill(v: Any, c: Any, d: Any) -> Any:
    """v^d / (c^d + v^d) of what is positive."""
    return 1.0 / (1.0 + (c / np.maximum(v, TINY)) ** d)


def _spline(z: Any) -> Any:
    """The cubic B-spline of unit knots about 0."""
    a = np.abs(z)
    b = np.maximum(2.0 - a, 0.0)
    square = a * a  # products: a power of three takes many times as long
    return np.where(a < 1.0, 2.0 / 3.0 - square + square * a / 2.0, b * b * b / 6.0)


class Shape(NamedTuple):
    """A function of one signal."""

    #: (v, c, w, *more) -> value: of the signal with the constant c, the width w of kinks and further constants
    value: Callable[..., Any]
    #: text, latex: with {v}, {c} and {d}
    text: str
    latex: str
    symbolic: Callable[..., Any]  #: (sympy, v, c, d) -> expression
    #: tuple of (float, float): of every constant that a fit may move; none for what stays
    bounds: tuple[tuple[float, float], ...] = ()
    power: int | None = 0  #: Power of the signal's unit that its own is; None: no whole one
    constant_powers: tuple[int, ...] = (1, 1)  #: The same of its constants


_ANY, _POSITIVE = (-np.inf, np.inf), (1e-9, np.inf)

#: By name.
SHAPES: dict[str, Shape] = {
    "v": Shape(lambda v, c, w: v, "{v}", "{v}", lambda s, v, c, d: v, power=1),
    "square": Shape(lambda v, c, w: v**2, "{v}^2", "{v}^2", lambda s, v, c, d: v**2, power=2),
    "cube": Shape(lambda v, c, w: v**3, "{v}^3", "{v}^3", lambda s, v, c, d: v**3, power=3),
    "fourth": Shape(lambda v, c, w: v**4, "{v}^4", "{v}^4", lambda s, v, c, d: v**4, power=4),
    "drag": Shape(
        lambda v, c, w: v * np.abs(v), "{v}*abs({v})", r"{v}\,|{v}|", lambda s, v, c, d: v * s.Abs(v), power=2,
    ),
    "size": Shape(lambda v, c, w: magnitude(v, w), "abs({v})", "|{v}|", lambda s, v, c, d: s.Abs(v), power=1),
    "sign": Shape(lambda v, c, w: sign(v, w), "sign({v})", r"\operatorname{{sign}}({v})", lambda s, v, c, d: s.sign(v)),
    "root": Shape(
        lambda v, c, w: _root(v, w), "sign({v})*sqrt(abs({v}))", r"\operatorname{{sign}}({v})\sqrt{{|{v}|}}",
        lambda s, v, c, d: s.sign(v) * s.sqrt(s.Abs(v)), power=None,
    ),
    "flow": Shape(
        lambda v, c, w: _root(np.maximum(v, 0.0), w), "sqrt({v})", r"\sqrt{{{v}}}", lambda s, v, c, d: s.sqrt(v), power=None,
    ),
    "power": Shape(
        lambda v, c, w: _power(v, c), "sign({v})*abs({v})^{c}", r"\operatorname{{sign}}({v})\,|{v}|^{{{c}}}",
        lambda s, v, c, d: s.sign(v) * s.Abs(v) ** c, (EXPONENT_RANGE,), power=None, constant_powers=(0,),
    ),
    "sine": Shape(lambda v, c, w: np.sin(v), "sin({v})", r"\sin({v})", lambda s, v, c, d: s.sin(v)),
    "cosine": Shape(lambda v, c, w: np.cos(v), "cos({v})", r"\cos({v})", lambda s, v, c, d: s.cos(v)),
    "wave": Shape(
        lambda v, c, w: np.sin(c * v), "sin({c}*{v})", r"\sin({c}\,{v})", lambda s, v, c, d: s.sin(c * v), (_POSITIVE,),
        constant_powers=(-1,),
    ),
    "swing": Shape(
        lambda v, c, w, d: np.sin(c * v + d), "sin({c}*{v} + {d})", r"\sin({c}\,{v} + {d})",
        lambda s, v, c, d: s.sin(c * v + d), (_POSITIVE, _ANY), constant_powers=(-1, 0),
    ),
    "above": Shape(
        lambda v, c, w: _above(v, c, w), "max({v} - {c}, 0)", r"\max({v} - {c}, 0)",
        lambda s, v, c, d: s.Max(v - c, 0), (_ANY,), power=1,
    ),
    "below": Shape(
        lambda v, c, w: _above(-v, -c, w), "max({c} - {v}, 0)", r"\max({c} - {v}, 0)",
        lambda s, v, c, d: s.Max(c - v, 0), (_ANY,), power=1,
    ),
    "beyond": Shape(
        lambda v, c, w: 0.5 * (1.0 + sign(v - c, w)), "({v} > {c})", r"[{v} > {c}]",
        lambda s, v, c, d: s.Heaviside(v - c), (_ANY,),
    ),
    "dead_zone": Shape(
        lambda v, c, w: _above(v, c, w) - _above(-v, c, w), "(max({v} - {c}, 0) - max(-{v} - {c}, 0))",
        r"\operatorname{{dead}}_{{{c}}}({v})", lambda s, v, c, d: s.Max(v - c, 0) - s.Max(-v - c, 0), (_POSITIVE,), power=1,
    ),
    "clip": Shape(
        lambda v, c, w: v - _above(v, c, w) + _above(-v, c, w), "max(min({v}, {c}), -{c})",
        r"\operatorname{{clip}}_{{\pm {c}}}({v})", lambda s, v, c, d: s.Max(s.Min(v, c), -c), (_POSITIVE,), power=1,
    ),
    "tanh": Shape(
        lambda v, c, w: np.tanh(v / c), "tanh({v}/{c})", r"\tanh({v}/{c})", lambda s, v, c, d: s.tanh(v / c),
        (_POSITIVE,),
    ),
    "switch": Shape(
        lambda v, c, w, d: 0.5 * (1.0 + np.tanh((v - c) / d)), "(1 + tanh(({v} - {c})/{d}))/2",
        r"\tfrac12 (1 + \tanh(({v} - {c})/{d}))", lambda s, v, c, d: (1 + s.tanh((v - c) / d)) / 2, (_ANY, _POSITIVE),
    ),
    "exp": Shape(
        lambda v, c, w: _exp(v / c), "exp({v}/{c})", r"\exp({v}/{c})", lambda s, v, c, d: s.exp(v / c), (_ANY,)
    ),
    "bell": Shape(
        lambda v, c, w, d: _exp(-(((v - c) / d) ** 2)), "exp(-(({v} - {c})/{d})^2)",
        r"\exp(-(({v} - {c})/{d})^2)", lambda s, v, c, d: s.exp(-(((v - c) / d) ** 2)), (_ANY, _POSITIVE),
    ),
    "saturating": Shape(
        lambda v, c, w: v / (c + v), "{v}/({c} + {v})", r"\frac{{{v}}}{{{c} + {v}}}", lambda s, v, c, d: v / (c + v),
        (_POSITIVE,),
    ),
    "bending": Shape(
        lambda v, c, w: v / (c + np.abs(v)), "{v}/({c} + abs({v}))", r"\frac{{{v}}}{{{c} + |{v}|}}",
        lambda s, v, c, d: v / (c + s.Abs(v)), (_POSITIVE,),
    ),
    "hill": Shape(
        lambda v, c, w, d: _hill(v, c, d), "{v}^{d}/({c}^{d} + {v}^{d})",
        r"\frac{{{v}^{{{d}}}}}{{{c}^{{{d}}} + {v}^{{{d}}}}}", lambda s, v, c, d: v**d / (c**d + v**d),
        (_POSITIVE, EXPONENT_RANGE), constant_powers=(1, 0),
    ),
    "fading": Shape(
        lambda v, c, w: v / (1.0 + (v / c) ** 2), "{v}/(1 + ({v}/{c})^2)", r"\frac{{{v}}}{{1 + ({v}/{c})^2}}",
        lambda s, v, c, d: v / (1 + (v / c) ** 2), (_POSITIVE,), power=1,
    ),
    "resonant": Shape(
        lambda v, c, w: 1.0 / (1.0 + (v / c) ** 2), "1/(1 + ({v}/{c})^2)", r"\frac{{1}}{{1 + ({v}/{c})^2}}",
        lambda s, v, c, d: 1 / (1 + (v / c) ** 2), (_POSITIVE,),
    ),
    "inverse": Shape(lambda v, c, w: 1.0 / v, "1/{v}", r"\frac{{1}}{{{v}}}", lambda s, v, c, d: 1 / v, power=-1),
    "inverse_square": Shape(
        lambda v, c, w: 1.0 / v**2, "1/{v}^2", r"\frac{{1}}{{{v}^2}}", lambda s, v, c, d: 1 / v**2, power=-2,
    ),
    "inhibited": Shape(
        lambda v, c, w: 1.0 / (1.0 + v / c), "1/(1 + {v}/{c})", r"\frac{{1}}{{1 + {v}/{c}}}",
        lambda s, v, c, d: 1 / (1 + v / c), (_POSITIVE,),
    ),
    "logarithm": Shape(
        lambda v, c, w: sign(v, 0.0) * np.log1p(np.abs(v) / c), "sign({v})*log(1 + abs({v})/{c})",
        r"\operatorname{{sign}}({v})\ln(1 + |{v}|/{c})", lambda s, v, c, d: s.sign(v) * s.log(1 + s.Abs(v) / c),
        (_POSITIVE,),
    ),
    "activated": Shape(
        lambda v, c, w: _exp(-c / v), "exp(-{c}/{v})", r"\exp(-{c}/{v})", lambda s, v, c, d: s.exp(-c / v),
        (_POSITIVE,),
    ),
    "after": Shape(
        lambda v, c, w: after(v, c, w), "(t > {c})", r"[t > {c}]", lambda s, v, c, d: s.Heaviside(s.Symbol("t") - c)
    ),
    "spline": Shape(
        lambda v, c, w, d: _spline((v - c) / d), "spline(({v} - {c})/{d})", r"B_3(({v} - {c})/{d})",
        lambda s, v, c, d: s.Function("spline")((v - c) / d),
    ),
}  # fmt: skip


def signal_of(name: str, signals: Mapping[str, Any]) -> Any:
    """A signal by name, or the difference "a - b" of two.

    >>> signal_of("a - b", {"a": 3.0, "b": 1.0})
    2.0
    """
    if name in signals:
        return signals[name]
    first, _, second = name.partition(" - ")
    return signals[first] - signals[second]


def signal_names(name: str) -> tuple[str, ...]:
    """The signals in a name; that behind "lag(v)" is v.

    >>> signal_names("a - b"), signal_names("lag(v)")
    (('a', 'b'), ('v',))
    """
    plain = name[4:-1] if name.startswith("lag(") else name
    return tuple(plain.split(" - ")) if " - " in plain else (plain,)


@dataclass(frozen=True)
class Term:
    """A product of shapes."""

    #: tuple of (shape, variable, constant, width, further constants...): shape of :data:`SHAPES`; name of a state or
    #: input ("t" for the time since the start, "a - b" for a difference, "lag(v)" for the recent past); constant of
    #: the shape; width over which its kink is rounded; a second constant of shapes that have one
    factors: tuple[Factor, ...] = ()

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of its signals, sorted; without time."""
        return tuple(sorted({name for factor in self.factors for name in signal_names(factor[1]) if name != "t"}))

    @property
    def constants(self) -> tuple[float, ...]:
        """Constants that a fit may move."""
        return tuple(c for f in self.factors for c, _ in zip((f[2], *f[4:]), SHAPES[f[0]].bounds))

    @property
    def bounds(self) -> tuple[tuple[float, float], ...]:
        """Their bounds."""
        return tuple(bound for f in self.factors for bound in SHAPES[f[0]].bounds)

    def at(self, constants: Sequence[Any]) -> Term:
        """The same with other constants."""
        left, factors = list(constants), []
        for f in self.factors:
            own = [left.pop(0) for _ in SHAPES[f[0]].bounds]
            factors.append((f[0], f[1], own[0], f[3], *own[1:]) if own else f)
        return Term(tuple(factors))

    @property
    def text(self) -> str:
        """As one writes it; "1" for the constant."""
        return "*".join(_written(SHAPES[f[0]].text, f, _plain) for f in self.factors) or "1"

    @property
    def latex(self) -> str:
        """As one typesets it."""
        return r"\,".join(_written(SHAPES[f[0]].latex, f, _typeset) for f in self.factors) or "1"

    def symbolic(self, sympy: Any) -> Any:
        """As an expression of sympy; signals are symbols."""
        out = sympy.Integer(1)
        for f in self.factors:
            symbols = {name: sympy.Symbol(name, real=True) for name in (f[1], *f[1].split(" - "))}
            v = symbols[f[1]] if " - " not in f[1] else signal_of(f[1], {k: v for k, v in symbols.items() if k != f[1]})
            out = out * SHAPES[f[0]].symbolic(sympy, v, *((float(f[2]), *map(float, f[4:]), None)[:2]))
        return out

    def value(self, signals: Mapping[str, Any], t: Any = 0.0) -> Any:
        """Of arrays by name.

        >>> drag = Term((("drag", "speed", 0.0, 0.0),))
        >>> drag.text, float(drag.value({"speed": -2.0}))
        ('speed*abs(speed)', -4.0)
        """
        out: Any = None
        for shape, name, constant, width, *more in self.factors:
            v = t if name == "t" else signal_of(name, signals)
            value = SHAPES[shape].value(v, constant, width, *more)
            out = value if out is None else out * value
        return 1.0 if out is None else out


def _plain(name: str) -> str:
    """A signal in a text."""
    return f"({name})" if " - " in name else name


def _typeset(name: str) -> str:
    """A signal in LaTeX."""
    names = name.split(" - ")
    return " - ".join(r"\mathrm{" + n.replace("_", r"\_") + "}" for n in names).join(
        ("(", ")") if len(names) > 1 else ("", "")
    )


def _written(template: str, factor: Factor, named: Callable[[str], str]) -> str:
    """A factor by its template.

    >>> Term((("swing", "q", 2.6, 0.0, -0.35),)).text
    'sin(2.6*q - 0.35)'
    """
    more = [f"{c:.4g}" for c in factor[4:]]
    text = template.format(v=named(factor[1]), c=f"{factor[2]:.4g}", d=more[0] if more else "")
    return text.replace("+ -", "- ")


def equation_of(terms: Sequence[Term], coefficients: Sequence[float], latex: bool = False) -> str:
    """A sum of terms with their coefficients.

    >>> equation_of([Term(), Term((("square", "v", 0.0, 0.0),))], [0.5, -0.3])
    '0.5 - 0.3*v^2'
    """
    out = ""
    for term, c in zip(terms, coefficients):
        shape = term.latex if latex else term.text
        number = f"{abs(c):.4g}" + ("" if shape == "1" else (r"\," if latex else "*") + shape)
        out += (f"-{number}" if c < 0 else number) if not out else f" {'-' if c < 0 else '+'} {number}"
    return out or "0"


def separate_parts(terms: Sequence[Term]) -> int:
    """Groups of terms that share no signal with another group; constants belong to none.

    >>> drag, sine = Term((("drag", "w", 0.0, 0.0),)), Term((("sine", "q", 0.0, 0.0),))
    >>> separate_parts([drag, sine, Term()]), separate_parts([drag, sine, Term((*drag.factors, *sine.factors))])
    (2, 1)
    """
    groups: list[set[str]] = []
    for names in (set(term.variables) for term in terms):
        shared = [group for group in groups if group & names]
        groups = [group for group in groups if not group & names]
        groups += [names.union(*shared)] if names else []
    return len(groups)
