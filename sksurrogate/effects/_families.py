"""The families of effects, one for each place in a plant; a member writes one formula.

Parameters have shape (n_columns, 1), signals (n_columns, n_samples).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect, Theta
from sksurrogate.effects._parts import Probe, SensorPath
from sksurrogate.effects._smooth import stable
from sksurrogate.kernels.signals import Signal
from sksurrogate.physics._simulator import Plant


class ParameterEffect(BaseEffect):
    """A parameter of the simulator has a wrong value.

    Parameters
    ----------
    location : str, optional
        Where it enters, as in :class:`BaseEffect`.
    variable : str, optional
        The signal that drives it.

    Examples
    --------
    >>> from sksurrogate.effects import Parameter, ParameterEffect
    >>> class Softening(ParameterEffect):
    ...     name, equation = "softening", "p (1 - share)"
    ...     parameters = (Parameter("share", high=1.0),)
    ...     def value(self, p, t, theta, width):
    ...         return p * (1 - theta[0])
    >>> float(Softening("stiffness").value(4.0, 0.0, (0.25,), 0.0))
    3.0
    """

    kind, access = "parameter", "trajectory"

    @abstractmethod
    def value(self, p: Any, t: Any, theta: Sequence[Any], width: float) -> Any:
        """The parameter, given its nominal value ``p`` and the time; jumps are smoothed over ``width``, a variable comes last."""


class BalanceEffect(BaseEffect):
    """A term is missing in the balance of a state, or at a port.

    Parameters
    ----------
    location : str, optional
        The state, or an input or other port: the law then adds to the force that enters there, in the port's unit.
    variable : str, optional
        The signal that drives it.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.effects import BalanceEffect, Parameter
    >>> class Convection(BalanceEffect):
    ...     name, equation = "convection", "- c v abs(v)^0.25"
    ...     parameters = (Parameter("coefficient", low=0.0),)
    ...     def term(self, t, x, v, theta, width):
    ...         return -theta[0] * v * np.abs(v) ** 0.25
    >>> float(Convection("wall", "wall").term(0.0, 0.0, 16.0, (0.5,), 0.0))
    -16.0
    """

    #: Signals that may be the variable: "state", "input" or both; () for forms without v.
    drivers: ClassVar[tuple[str, ...]] = ("state",)
    #: What may drive the law at a port by default: "speed" and "position" of a joint, a "level" that a flow moves; () for none.
    at_port: ClassVar[tuple[str, ...]] = ("speed", "position", "level")
    #: What must not drive it unless a user asks for it by name: a "speed" or a "position".
    implausible: ClassVar[tuple[str, ...]] = ()
    #: Whether it depends on what enters beside it: it is sought at every port where that is known, and in no balance.
    of_load: ClassVar[bool] = False

    @abstractmethod
    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """What is added to dx/dt, or to what enters at a port.

        Parameters
        ----------
        t : ndarray
            Time.
        x : ndarray
            State of the location; at a port the input, at a further port 0 or, ``of_load``, what the drives bring there.
        v : ndarray, or tuple of two ndarrays for "v*w"
            Variable.
        theta : sequence of ndarray
            Parameters, magnitude first.
        width : float
            Half width over which kinks such as sign(v) are smoothed, in units of v (of time where there is no v).
        """

    def jump(self, theta: Sequence[Any], load: Any = 0.0) -> Any:
        """Half the height by which the term jumps where v changes its sign, with a ``load`` beside it; mostly 0."""
        return 0.0

    def smoothed(self, theta: Sequence[Any], width: float, h: float) -> Any:
        """Width of its kinks: as far as steps ``h`` can follow a force against its own variable (0: it is against none)."""
        return stable(width, self.jump(theta), h)

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        if not cls.drivers:
            return (None,)
        return (plant.states if "state" in cls.drivers else ()) + (plant.inputs if "input" in cls.drivers else ())

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        v = probe.v if probe.v is not None else probe.x
        theta = tuple(1.0 if p is self.parameters[0] else p.null for p in self.parameters)
        form = self.term(np.zeros_like(probe.x), probe.x, v, theta, 0.02 * float(np.std(v)) + 1e-12)
        return [(probe.unit(np.broadcast_to(form, probe.x.shape)), *theta[1:])]


class LimitEffect(BaseEffect):
    """A state cannot pass a limit.

    Parameters
    ----------
    location : str, optional
        Where it enters, as in :class:`BaseEffect`.
    variable : str, optional
        The signal that drives it.

    Examples
    --------
    >>> from sksurrogate.effects import CATALOGUE, LimitEffect
    >>> issubclass(CATALOGUE["state_saturation"], LimitEffect)
    True
    """

    linear = False

    @abstractmethod
    def clip(
        self, x: np.ndarray, v: np.ndarray | None, theta: Sequence[Any], final: bool
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """The limited state, and the variable's state with what it receives.

        Parameters
        ----------
        x, v : ndarray (n_columns, n_samples)
            State of the location, and that of the variable (None where there is none).
        theta : sequence of ndarray
        final : bool
            True at the end of a substep, where what was cut off goes elsewhere; False at the stages within.
        """

    def flow(
        self, x: np.ndarray, dx: np.ndarray, dv: np.ndarray, theta: Sequence[Any]
    ) -> tuple[np.ndarray, np.ndarray]:
        """The rates dx/dt and dv/dt at the limit; :meth:`clip` alone passes on what is cut off a substep too late."""
        return dx, dv


class HiddenEffect(BalanceEffect):
    """The balance depends on a state that the simulator does not have.

    Parameters
    ----------
    location : str, optional
        Where it enters, as in :class:`BaseEffect`.
    variable : str, optional
        The signal that drives it.
    settled : bool, default=True
        Whether the hidden state begins every run at rest, as in simulations; else the diagnosis fits where it began.

    Examples
    --------
    >>> from sksurrogate.effects import CATALOGUE, HiddenEffect
    >>> [name for name, effect in CATALOGUE.items() if issubclass(effect, HiddenEffect)]
    ['hysteresis', 'lugre_friction', 'hidden_relaxation', 'hidden_mode']
    """

    n_hidden: ClassVar[int] = 1
    settled: bool = True
    rarity = 10.0
    linear = False

    def __init__(self, location: str | None = None, variable: str | None = None, settled: bool = True):
        super().__init__(location, variable)
        self.settled = settled

    @property
    def at_rest(self) -> bool:
        """As ``settled`` says."""
        return self.settled

    def rest(self, v: np.ndarray, theta: Sequence[Any]) -> Sequence[Any]:
        """Hidden states (n_hidden entries) at the start of a run, given the variable there."""
        return [np.zeros_like(v)] * self.n_hidden

    @abstractmethod
    def rates(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float
    ) -> Sequence[Any]:
        """Derivatives of the hidden states ``z`` (n_hidden, n_columns, n_samples); ``dv`` is dv/dt."""

    def rates_within(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float, h: float
    ) -> Sequence[Any]:
        """:meth:`rates` that an explicit step of width ``h`` can follow, however fast the hidden state is."""
        return self.rates(z, t, v, dv, theta, width)

    @abstractmethod
    def force(self, z: np.ndarray, v: np.ndarray, theta: Sequence[Any]) -> Any:
        """What is added to dx/dt."""

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return np.zeros_like(x)


class InputEffect(BaseEffect):
    """The actuator changes the input before it acts.

    Parameters
    ----------
    location : str, optional
        Where it enters, as in :class:`BaseEffect`.
    variable : str, optional
        The signal that drives it.

    Examples
    --------
    >>> from sksurrogate.effects import CATALOGUE, InputEffect
    >>> isinstance(CATALOGUE["input_gain"]("force"), InputEffect)
    True
    """

    kind = "input"
    access = "trajectory"
    linear = False

    @abstractmethod
    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        """The input that acts.

        Parameters
        ----------
        u, v : Signal
            The input, and the variable (another input) where there is one; arrays (n_sub, n_columns, n_samples).
        theta : sequence of ndarray (n_columns, 1)
        h : float
            Width of a substep.
        starts : ndarray of int (n_runs,)
            First samples of the runs.
        """


class SensorEffect(BaseEffect):
    """The sensor does not show the true output.

    Parameters
    ----------
    location : str, optional
        Where it enters, as in :class:`BaseEffect`.
    variable : str, optional
        The signal that drives it.

    Examples
    --------
    >>> from sksurrogate.effects import CATALOGUE, SensorEffect
    >>> bias = CATALOGUE["sensor_bias"]("level")
    >>> isinstance(bias, SensorEffect), bias.kind
    (True, 'output')
    """

    kind = "output"
    access = "trajectory"
    #: Whether the effect has a memory and needs the path between samples (:meth:`follow`), or not (:meth:`read`).
    memory: ClassVar[bool] = False
    #: Whether readings hide the sign or the like of an output, so that a fit must not start from states read off them.
    folds: ClassVar[bool] = False

    def read(self, y: np.ndarray, v: np.ndarray | None, t: np.ndarray, theta: Sequence[Any]) -> np.ndarray:
        """The reading of a sensor without memory, from the output ``y``, another output or an input ``v`` and the time."""
        return y

    def beside(self, outputs: Sequence[str], y: Any, inputs: Sequence[str], u: Any) -> Any:
        """What drives it beside its own output: another output without its sensor, or an input; None where nothing does.

        ``y``, ``u``: values of the outputs and of the inputs, in the order of their names.
        """
        if self.variable is None:
            return None
        return y[outputs.index(self.variable)] if self.variable in outputs else u[inputs.index(self.variable)]

    def soft(
        self,
        y: np.ndarray,
        v: np.ndarray | None,
        t: np.ndarray,
        theta: Sequence[Any],
        width: float,
        readings: np.ndarray | None = None,
    ) -> np.ndarray:
        """The reading in a fit: jumps are spread over ``width`` of their distance; by default :meth:`read`.

        ``readings`` (n_samples,) are the measured ones, for sensors that do not tell where within a step a value lies.
        """
        return self.read(y, v, t, theta)

    def follow(self, path: SensorPath, theta: Theta, dt: float, starts: np.ndarray) -> SensorPath:
        """The reading of a sensor with a memory."""
        return path
