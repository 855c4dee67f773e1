"""Laws found in data: sums of products of simple shapes, as effects in a balance, on an input, a sensor or a parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect, Theta
from sksurrogate.effects._families import BalanceEffect, HiddenEffect, InputEffect, ParameterEffect, SensorEffect
from sksurrogate.effects._formula import Term, equation_of
from sksurrogate.effects._parts import Parameter
from sksurrogate.effects._smooth import TINY, follow, stable
from sksurrogate.kernels.signals import Signal, lag

#: Laws act after the effects of the catalogue on the same input or sensor.
LAST = 99
#: Shapes that turn round where their signal changes its sign, and which entry of their factor is the width of that.
OWN_WIDTH = {"sign": 3, "tanh": 2}


class _Formula(BaseEffect):
    """What laws at all places share: a formula whose coefficients, and constants where they are free, are the parameters.

    ``location``: state in whose balance the law stands.
    ``variable``: its signals joined by ``*``, names sorted.
    ``values``: parameters found; where a fit starts.
    ``free``: whether the constants inside the shapes are parameters too, behind the coefficients.
    """

    #: Unit of a coefficient's numerator.
    unit = "dx/dt"

    def __init__(
        self,
        location: str | None = None,
        variable: str | None = None,
        terms: Sequence[Term] = (),
        values: Sequence[float] | None = None,
        free: bool = False,
    ):
        super().__init__(location, variable)
        self.terms = terms
        self.values = values
        self.free = free

    @property
    def name(self) -> str:  # type: ignore[override]
        """The form, without its coefficients; the number of its pieces for a curve."""
        return "law: " + _form(self.terms)

    @property
    def equation(self) -> str:  # type: ignore[override]
        """The form."""
        return _form(self.terms)

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """A coefficient for every term, then every constant that is free."""
        return (*self._coefficients(), *self._constants())

    def _coefficients(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"c{k}", unit=f"{self.unit} over {term.text}") for k, term in enumerate(self.terms))

    def _constants(self) -> tuple[Parameter, ...]:
        if not self.free:
            return ()
        known = [(c, bounds) for term in self.terms for c, bounds in zip(term.constants, term.bounds)]
        return tuple(Parameter(f"k{k}", c, low, high) for k, (c, (low, high)) in enumerate(known))

    @property
    def linear(self) -> bool:  # type: ignore[override]
        """One coefficient scales the whole."""
        return len(self.terms) == 1 and len(self.parameters) == 1

    def filled(self, theta: Sequence[Any]) -> list[tuple[Any, Term]]:
        """Coefficients and terms at parameters theta."""
        n = len(self.terms)
        constants, out = list(theta[n:]), []
        for coefficient, term in zip(theta[:n], self.terms):
            k = len(term.constants) if self.free else 0
            out.append((coefficient, term.at(constants[:k]) if k else term))
            constants = constants[k:]
        return out

    def added(self, signals: dict[str, Any], t: Any, theta: Sequence[Any]) -> Any:
        """``sum of c f(v, w)``, what the law adds at its place."""
        return sum((coefficient * term.value(signals, t) for coefficient, term in self.filled(theta)), 0.0)

    def by_name(self, v: Any) -> dict[str, Any]:
        """Values of the variable by name: an array, or one for each signal of "v*w"."""
        return dict(zip(self.signals, v if len(self.signals) > 1 else (v,)))

    def starts(self, probe: Any) -> list[tuple[float, ...]]:
        """The parameters that were found."""
        if self.values is not None:
            return [tuple(self.values)]
        return [(*(1.0 for _ in self.terms), *(p.null for p in self.parameters[len(self.terms) :]))]

    def text(self, theta: Sequence[float] | None = None, latex: bool = False) -> str:
        """The formula with its numbers."""
        filled = self.filled(self.starts(None)[0] if theta is None else theta)
        return equation_of([term for _, term in filled], [float(c) for c, _ in filled], latex)


def _form(terms: Sequence[Term]) -> str:
    """Sum of the terms without coefficients."""
    pieces = [term for term in terms if term.factors and term.factors[0][0] == "spline"]
    if len(pieces) > 1:
        return f"curve of {' and '.join(pieces[0].variables)} ({len(pieces)} pieces)"
    return " + ".join(term.text for term in terms)


class LawEffect(_Formula, BalanceEffect):  # type: ignore[misc]
    """A sum of simple shapes is missing in a balance; made by ``report.missing_term``.

    Parameters
    ----------
    location : str
        State in whose balance the law stands.
    variable : str, optional
        Its signals joined by ``*``, names sorted.
    terms : tuple of Term
    values : tuple of float, optional
        Parameters found; where a fit starts.
    free : bool, default=False
        Whether the constants inside the shapes are parameters too, behind the coefficients.

    Examples
    --------
    >>> law = LawEffect("v", "v", (Term((("drag", "v", 0.0, 0.0),)),), (-0.3,))
    >>> law.name, law.starts(None)
    ('law: v*abs(v)', [(-0.3,)])
    >>> soft = LawEffect("v", "v", (Term((("tanh", "v", 0.5, 0.0),)),), (-0.3, 0.4), free=True)
    >>> [parameter.name for parameter in soft.parameters], soft.text()
    (['c0', 'k0'], '-0.3*tanh(v/0.4)')
    """

    signature = "whatever no named effect explains"
    drivers = ("state", "input")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: Any) -> Any:
        """``sum of c f(v, w)``; ``width``: 0, or a width and the step that has to follow its turns (:meth:`smoothed`)."""
        signals, h = self.by_name(v), width[1] if isinstance(width, tuple) else 0.0
        out = np.zeros_like(x)
        for coefficient, term in self.filled(theta):
            followed = self._followed(coefficient, term, signals, t, h) if np.ndim(h) or h > 0 else term
            out = out + coefficient * followed.value(signals, t)
        return out

    def _turns(self, term: Term) -> list[int]:
        """Factors of a term that turn round where the balance's own state changes its sign."""
        return [i for i, f in enumerate(term.factors) if f[0] in OWN_WIDTH and f[1] == self.location]

    def _followed(self, coefficient: Any, term: Term, signals: dict[str, Any], t: Any, h: Any) -> Term:
        """A term whose turn is as wide as steps ``h`` can follow it, whatever it is multiplied by."""
        for i in self._turns(term):
            f, others = term.factors[i], Term((*term.factors[:i], *term.factors[i + 1 :]))
            width = stable(TINY, np.abs(coefficient * others.value(signals, t)), h)
            wide = ("tanh", f[1], np.maximum(f[OWN_WIDTH[f[0]]], width), 0.0)
            term = Term((*term.factors[:i], wide, *term.factors[i + 1 :]))
        return term

    def jump(self, theta: Sequence[Any], load: Any = 0.0) -> Any:
        """The coefficients of its turns that nothing multiplies."""
        own = zip(theta, self.terms)
        return sum((np.abs(c) for c, term in own if self._turns(term) and len(term.factors) == 1), 0.0)

    def smoothed(self, theta: Sequence[Any], width: float, h: float) -> Any:
        """A turn is smoothed as far as steps can follow it; other kinks have widths of their own."""
        return (0.0, h) if self.free and any(map(self._turns, self.terms)) else 0.0


class MemoryLawEffect(_Formula, HiddenEffect):  # type: ignore[misc, override]
    """A law of the recent past of one signal is missing in a balance: of ``w``, ``c dw/dt + w = v``, and of v itself.

    Parameters
    ----------
    location, variable, terms, values, free
        As :class:`LawEffect`; the recent past of v is named "lag(v)". The time constant is the last parameter.

    Examples
    --------
    >>> law = MemoryLawEffect("x", "v", (Term((("square", "lag(v)", 0.0, 0.0),)),), (-0.3, 2.0))
    >>> [parameter.name for parameter in law.parameters]
    ['c0', 'time_constant']
    """

    signature = "whatever no named effect explains, later than what drives it"
    drivers = ("state", "input")

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """Coefficients, free constants, the time constant."""
        return (*self._coefficients(), *self._constants(), Parameter("time_constant", 0.0, TINY, unit="time"))

    def rest(self, v: np.ndarray, theta: Sequence[Any]) -> Sequence[Any]:
        """The filter has settled at the first value."""
        return [v]

    def rates(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float
    ) -> Sequence[Any]:
        """``(v - w) / c``."""
        return [(v - z[0]) / np.maximum(theta[-1], TINY)]

    def rates_within(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float, h: float
    ) -> Sequence[Any]:
        """:meth:`rates` that a step can follow."""
        c = np.maximum(theta[-1], TINY)
        return [follow(h / c) * (v - z[0]) / c]

    def force(self, z: np.ndarray, v: np.ndarray, theta: Sequence[Any]) -> Any:
        """``sum of c f(w, v)``."""
        signals = {f"lag({self.variable})": z[0], str(self.variable): v}
        return np.zeros_like(z[0]) + self.added(signals, 0.0, theta[:-1])


class InputLawEffect(_Formula, InputEffect):  # type: ignore[misc, override]
    """A law is added to an input: ``u + f(u, v)``, v another input; of the recent past of u where it is named "lag(u)".

    Parameters
    ----------
    location, variable, terms, values, free
        As :class:`LawEffect`; ``variable`` is another input, or None. With a "lag(u)" the time constant is the last parameter.

    Examples
    --------
    >>> law = InputLawEffect("u", None, (Term((("square", "u", 0.0, 0.0),)),), (0.1,))
    >>> law.kind, law.equation
    ('input', 'u^2')
    """

    signature = "whatever no named effect explains, along the path of an input"
    order = LAST
    unit = "u"

    @property
    def remembers(self) -> bool:
        """Whether it holds the recent past."""
        return any(f[1].startswith("lag(") for term in self.terms for f in term.factors)

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """Coefficients, free constants, the time constant where there is one."""
        late = (Parameter("time_constant", 0.0, TINY, unit="time"),) if self.remembers else ()
        return (*self._coefficients(), *self._constants(), *late)

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        """``u + f``; exact for held inputs, Simpson's rule within a substep otherwise."""
        given = {str(self.location): u, **({str(self.variable): v} if v is not None else {})}
        if self.remembers:
            given[f"lag({self.location})"] = lag(u, theta[-1], h, starts)
            theta = theta[:-1]

        def acting(part: Any) -> np.ndarray:
            signals = {name: part(signal) for name, signal in given.items()}
            found = signals[str(self.location)] + self.added(signals, 0.0, theta)
            return np.asarray(found)

        if all(signal.half is None for signal in given.values()):
            return Signal(acting(lambda s: s.mean))
        first, middle, last = (acting(part) for part in (Signal.start, lambda s: s.mean, Signal.end))
        return Signal((first + 4 * middle + last) / 6, (last - first) / 2, acting(Signal.at_samples))


class ParameterLawEffect(_Formula, ParameterEffect):  # type: ignore[misc]
    """A parameter of the simulator depends on signals: ``p + f(v, w)``, as a rate that falls with a concentration.

    Parameters
    ----------
    location : str
        The parameter.
    variable, terms, values, free
        As :class:`LawEffect`.

    Examples
    --------
    >>> law = ParameterLawEffect("stiffness", "x", (Term((("square", "x", 0.0, 0.0),)),), (0.5,))
    >>> float(law.value(4.0, 0.0, law.starts(None)[0], 0.0, 2.0))
    6.0
    """

    signature = "a parameter that would have to change along the runs, whatever it scales"
    access = "step"
    unit = "p"

    def value(self, p: Any, t: Any, theta: Sequence[Any], width: float, v: Any = None) -> Any:
        """``p + f``."""
        return p + self.added(self.by_name(v), t, theta)


class SensorLawEffect(_Formula, SensorEffect):  # type: ignore[misc]
    """A law is added to a reading: ``y + f(y, v)``, v another output or an input.

    Parameters
    ----------
    location, variable, terms, values, free
        As :class:`LawEffect`; ``variable`` is another output or an input, or None.

    Examples
    --------
    >>> law = SensorLawEffect("y", None, (Term((("square", "y", 0.0, 0.0),)),), (0.1,))
    >>> law.read(np.array([2.0]), None, np.zeros(1), (0.1,)).round(3)
    array([2.4])
    """

    signature = "whatever no named effect explains, at rest and in motion alike"
    order = LAST
    unit = "y"

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        """``y + f(y, v)``."""
        signals = {str(self.location): y, **({str(self.variable): v} if v is not None else {})}
        return np.asarray(y + self.added(signals, t, theta))


#: A law at a place.
AnyLaw = LawEffect | MemoryLawEffect | InputLawEffect | ParameterLawEffect | SensorLawEffect


def law_effect(
    kind: str, location: str, terms: Sequence[Term], values: Sequence[float] | None = None, free: bool = True
) -> AnyLaw:
    """A law at a place: in the balance of a state, on an input ("input"), a parameter, a sensor ("output").

    >>> law_effect("output", "y", (Term((("square", "y", 0.0, 0.0),)),), (0.1,)).kind
    'output'
    """
    names = sorted({name for term in terms for name in term.variables})
    late = any(f[1].startswith("lag(") for term in terms for f in term.factors)
    if kind in ("state", "parameter"):
        made = ParameterLawEffect if kind == "parameter" else MemoryLawEffect if late else LawEffect
        return made(location, "*".join(names) or None, tuple(terms), values, free)
    others = [name for name in names if name != location]
    by_place = InputLawEffect if kind == "input" else SensorLawEffect
    return by_place(location, others[0] if others else None, tuple(terms), values, free)
