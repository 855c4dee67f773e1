"""The missing term as a formula at a place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sksurrogate.effects._forms import form_of
from sksurrogate.effects._formula import equation_of
from sksurrogate.exceptions import require
from sksurrogate.gap.results._where import place_in_words


@dataclass(frozen=True, eq=False)
class Law:
    """The missing term as a formula at a place, or as a free curve where no formula is good enough.

    Attributes
    ----------
    location, kind : str
        State in whose balance it stands ("state"), input, output or parameter to which it is added.
    variables : tuple of str
        Signals that drive it.
    effect : LawEffect
        The law with the parameters found; :meth:`to_effect` gives a copy.
    params, standard_errors : dict of float
        Coefficients ``c0, c1, ...``, constants ``k0, k1, ...`` in the order of the formula, ``time_constant`` of a recent past;
        nan where the data do not show one.
    units : dict of str
        Of the parameters, in words; made of the simulator's units where it has any.
    share : float
        Share of the gap's power that it closes on runs left out of the choice among the formulae and of the fit.
    domain : dict of (float, float)
        Range of every variable in which it was fitted. A formula goes on beyond it, a curve fades to nothing.
    is_curve : bool
        Whether it is a free curve.
    certified : bool
        Whether it closes a practical share of the gap on runs left out: then ``augmented_`` carries it.
    evidence : float
        Log-likelihood difference to no law, its price paid.
    """

    location: str
    kind: str
    variables: tuple[str, ...]
    effect: Any
    params: dict[str, float]
    standard_errors: dict[str, float]
    units: dict[str, str] = field(default_factory=dict)
    share: float = float("nan")
    domain: dict[str, tuple[float, float]] = field(default_factory=dict)
    is_curve: bool = False
    certified: bool = False
    evidence: float = float("nan")

    def __str__(self) -> str:
        """The formula with its numbers; the driver and the range of a curve."""
        if self.is_curve:
            names = (f"{v} from {self.domain[v][0]:.4g} to {self.domain[v][1]:.4g}" for v in self.variables)
            return f"curve of {' and '.join(names)}"
        return str(self.effect.text())

    @property
    def tells_the_place(self) -> bool:
        """Whether its place is more than a guess: a formula that is certified."""
        return self.certified and not self.is_curve

    @property
    def is_constant(self) -> bool:
        """Whether no signal drives it."""
        return not self.is_curve and not any(term.factors for term in self.effect.terms)

    @property
    def _theta(self) -> list[float]:
        """Its parameters in the order of the effect."""
        return [self.params[p.name] for p in self.effect.parameters]

    @property
    def forms(self) -> dict[str, str]:
        """Terms of a law in a balance that have the form of an effect of the catalogue, as they are written, and its name."""
        if self.is_curve or self.kind != "state":
            return {}
        filled = self.effect.filled(self._theta)
        named = ((equation_of([term], [float(c)]), form_of(term, float(c))) for c, term in filled)
        return {text: name for text, name in named if name is not None}

    @property
    def latex(self) -> str:
        """The formula for LaTeX, without dollar signs."""
        return str(self.effect.text(latex=True))

    @property
    def equation(self) -> str:
        """Its form, without coefficients."""
        return str(self.effect.equation)

    @property
    def place(self) -> str:
        """Where it acts, in words."""
        return place_in_words(self.kind, self.location)

    def sympy(self) -> Any:
        """The formula as an expression of sympy (extra ``sympy``); signals are real symbols of their names.

        Raises
        ------
        MissingExtraError
            sympy is not installed.
        """
        sympy = require("sympy", "sympy")
        return sum((float(c) * term.symbolic(sympy) for c, term in self.effect.filled(self._theta)), sympy.Integer(0))

    def to_effect(self) -> Any:
        """An effect for ``GapDiagnoser(effects=[...])`` and ``AugmentedSimulator``; saved as text like any of the catalogue."""
        e = self.effect
        return type(e)(e.location, e.variable, e.terms, e.values, e.free)

    def value(self, signals: Mapping[str, Any], t: Any = 0.0) -> np.ndarray:
        """What the law adds at its place.

        Parameters
        ----------
        signals : dict of array-like
            Every variable by name; of a recent past "lag(v)".
        t : array-like, default=0
            Time since the start of the run.
        """
        arrays = {name: np.asarray(z, dtype=float) for name, z in signals.items()}
        return np.asarray(self.effect.added(arrays, t, self._theta))
