"""An effect: a small parametric change to a simulator whose null value gives the simulator back."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any, ClassVar, TypeAlias

import numpy as np
from sklearn.base import BaseEstimator

from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.effects._prior_odds import PriorOdds
from sksurrogate.effects._variable import signals_in
from sksurrogate.physics._simulator import Plant

#: Values of the parameters of an effect, magnitude first, (n_columns, 1) each.
Theta: TypeAlias = Sequence[np.ndarray]


class BaseEffect(PriorOdds, BaseEstimator):
    """Base of all effects (made to be subclassed through one of the five families).

    Parameters
    ----------
    location : str, optional
        Name of the parameter, state, input or output where the effect enters.
    variable : str, optional
        Signal that drives it ("v*w" for a product, names sorted; "abs(v - w)" for the size of a difference); None where the form
        has no v.

    Attributes
    ----------
    name : str
        Canonical name.
    kind : {"parameter", "state", "input", "output"}
        What ``location`` names.
    parameters : tuple of Parameter
        Magnitude first.
    equation, signature : str
        The form, and its typical residual in words.
    twins : tuple of str
        Effects that often predict the same.
    nests : tuple of str
        Simpler effects that are special cases of it.
    access : {"trajectory", "step"}
        Coarsest access to the simulator with which the effect can be tested.
    linear : bool
        Whether the change is proportional to the magnitude.
    order : int
        Place in the order in which effects on one input or sensor act.

    Examples
    --------
    >>> from sksurrogate.effects import CATALOGUE
    >>> friction = CATALOGUE["coulomb_friction"]("speed", "speed")
    >>> friction.key
    ('coulomb_friction', 'speed', 'speed')
    >>> [parameter.name for parameter in friction.parameters]
    ['level']
    """

    name: ClassVar[str] = ""
    kind: ClassVar[str] = "state"
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    equation: ClassVar[str] = ""
    signature: ClassVar[str] = ""
    typical: ClassVar[str] = ""  #: What :meth:`plausible` asks for, as the end of a sentence
    twins: ClassVar[tuple[str, ...]] = ()
    nests: ClassVar[tuple[str, ...]] = ()
    access: ClassVar[str] = "step"
    linear: ClassVar[bool] = True
    acts_at_null: ClassVar[bool] = False  #: Whether its other parameters act where its magnitude is null
    order: ClassVar[int] = 0
    late: ClassVar[bool] = False  #: Asked only where something without a name remains beside all others

    def __init__(self, location: str | None = None, variable: str | None = None):
        self.location = location
        self.variable = variable

    @property
    def key(self) -> tuple[str, str | None, str | None]:
        """``(name, location, variable)``."""
        return self.name, self.location, self.variable

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signals in its variable."""
        return signals_in(self.variable)

    @property
    def at_rest(self) -> bool:
        """Whether its memory, where it has one, begins every run at rest."""
        return True

    @property
    def settled_form(self) -> BaseEffect:
        """The effect in a simulator, whose runs begin at rest."""
        return self

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Starting values, a tuple of all parameters each; empty where these data cannot show the effect (a limit at rest)."""
        return [tuple(parameter.null for parameter in self.parameters)]

    def evident(self, probe: Probe) -> list[tuple[float, ...]]:
        """Starting values that the measurements show whatever the model says: always fitted; mostly none."""
        return []

    def scan(self, theta: Sequence[float]) -> list[tuple[float, ...]]:
        """Values near a fit from which to fit again, for effects whose prediction jumps with them; mostly none."""
        return []

    def simpler(self, theta: Sequence[float]) -> dict[str, tuple[float, ...]]:
        """Simpler effects that are nearly the same as this one at these values: name -> their parameters but the first."""
        return {}

    def smaller(self, theta: np.ndarray, share: float) -> np.ndarray | None:
        """Parameters (n_parameters,) with which it changes a ``share`` as much; None where that is not known."""
        return np.r_[share * theta[:1], theta[1:]] if self.linear and len(theta) else None

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """Whether the effect, at these values, shows its typical form in these data; a step before the first reading does not."""
        return True

    def identifiable(self, theta: Sequence[float]) -> tuple[float, ...]:
        """The nearest values at which every parameter has a slope: from values beyond them a fit could not return."""
        return tuple(theta)

    def gain(self, theta: Any, size: float) -> Any:
        """What a unit of the first parameter does, at these values of the others, where the signal has this size."""
        return 1.0

    def either_sign(self, inputs: Collection[str]) -> bool:
        """Whether the magnitude may have either sign, in a plant with these inputs."""
        return bool(self.parameters) and self.parameters[0].low < 0.0

    def lower_bounds(self, duration: float) -> tuple[float, ...]:
        """Lower bounds in a record whose longest run has this duration: what is slower than the run can show is left to other effects."""
        return tuple(p.low for p in self.parameters)

    def canonical(self, theta: Sequence[float]) -> tuple[float, ...]:
        """The same effect with its parameters in the ranges in which they are reported (phases, signs)."""
        return tuple(theta)

    @classmethod
    def instances(cls, plant: Plant, balances: Sequence[str]) -> Iterator[BaseEffect]:
        """All places and variables of a plant where the effect makes sense.

        Parameters
        ----------
        plant : Plant
        balances : sequence of str
            States whose balance may hold an effect (kinematic identities are left out).
        """
        places = {
            "parameter": tuple(plant.params),
            "state": tuple(balances),
            "input": plant.inputs,
            "output": plant.outputs,
        }[cls.kind]
        for place in places:
            for variable in cls.variables(plant, place):
                yield cls(place, variable)

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """Variables that may drive the effect at a location."""
        return (None,)
