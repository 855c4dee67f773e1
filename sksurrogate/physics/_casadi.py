"""CasADi functions as simulators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from sklearn.utils.metaestimators import available_if

from sksurrogate.exceptions import SimulatorError, require
from sksurrogate.physics._casadi_tape import MANY_POINTS, Tape, tape_of
from sksurrogate.physics._foreign import at_points, offered
from sksurrogate.physics._inner import InnerRunsMixin, held_over_samples
from sksurrogate.physics._ode import ODESimulator
from sksurrogate.physics._params import ParametricSimulator, numbers_of
from sksurrogate.physics._wrappers import StepSimulator

#: What the inputs of a function may be called at length.
_LONG = {"states": "x", "inputs": "u", "params": "p"}


def _is_continuous(self: CasadiSimulator) -> bool:
    return not self.discrete


def _is_discrete(self: CasadiSimulator) -> bool:
    return bool(self.discrete)


def _has_output(self: CasadiSimulator) -> bool:
    return self.output_function is not None or self.function.n_out() > 1


class CasadiSimulator(InnerRunsMixin, ParametricSimulator):
    """A ``casadi.Function`` as right-hand side, or as the map from sample to sample.

    Parameters
    ----------
    function : casadi.Function
        The first output is dx/dt, or the next state. A second output, if there is one, is the measured output. Its inputs are
        found by their names: "t", "x" or "states", "u" or "inputs", "p" or "params", or a parameter by its own name;
        unnamed ones (CasADi's i0, i1, i2) are x, u and p in this order.
    states, inputs, outputs : list of str
        Names, in the order of the entries of x, u and what is measured. Without a second output, outputs are states.
    params : dict of float, optional
        Parameters; their order is that of the entries of p.
    dt : float, default=1.0
        Sample time.
    discrete : bool, default=False
        Whether ``function`` gives the next state.
    hold : {"zoh", "foh"}, default="zoh"
    method : str, default="auto"
        Integrator, as in :class:`ODESimulator`.
    output_function : casadi.Function, optional
        The measured output, if it is not a second output of ``function``.
    x0 : array-like (n_states,), optional
        Initial state; zeros by default.
    units : dict of str, optional
        Units of states, inputs, outputs, parameters and "time" by name, for reports and labels: ``{"speed": "rad/s"}``.

    Raises
    ------
    SimulatorError
        The sizes of the function and the names do not fit.

    Notes
    -----
    All points are computed in one call. If CasADi raises an error, for example because a root is not found, points are computed
    one by one, and those that fail are nan. Points that are not finite, or beyond 1e100, are not computed.

    Examples
    --------
    >>> import casadi as ca
    >>> from sksurrogate.physics import CasadiSimulator
    >>> x, u, k = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("k")
    >>> tank = ca.Function("tank", [x, u, k], [u - k * ca.sqrt(x)], ["x", "u", "k"], ["dx"])
    >>> plant = CasadiSimulator(
    ...     tank, states=["level"], inputs=["flow"], outputs=["level"], params={"k": 1.0}, dt=0.1, x0=[1.0]
    ... )
    >>> plant.simulate([[1.0], [2.0], [2.0]]).ravel().round(4)
    array([1.    , 1.    , 1.0976])
    """

    def __init__(
        self,
        function: Any,
        *,
        states: Sequence[str],
        inputs: Sequence[str],
        outputs: Sequence[str],
        params: Mapping[str, float] | None = None,
        dt: float = 1.0,
        discrete: bool = False,
        hold: str = "zoh",
        method: str = "auto",
        output_function: Any = None,
        x0: Any = None,
        units: Mapping[str, str] | None = None,
    ):
        self.function = function
        self.states = states
        self.inputs = inputs
        self.outputs = outputs
        self.params = params
        self.dt = dt
        self.discrete = discrete
        self.hold = hold
        self.method = method
        self.output_function = output_function
        self.x0 = x0
        self.units = units

    def __getstate__(self) -> dict[str, Any]:
        """What is looked up again stays behind."""
        return {key: value for key, value in super().__getstate__().items() if key != "_tapes"}

    @available_if(_is_continuous)
    def rhs(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> np.ndarray:
        """dx/dt, (n_states, *s)."""
        return self._asked(self.function, 0, len(self.states), t, x, u, p)

    @available_if(_is_discrete)
    def step(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], dt: float) -> np.ndarray:
        """The states one sample later, (n_states, *s)."""
        return self._asked(self.function, 0, len(self.states), t, x, u, p)

    @available_if(_has_output)
    def output(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> np.ndarray:
        """What is measured, (n_outputs, *s)."""
        own = self.output_function is None
        return self._asked(
            self.function if own else self.output_function, 1 if own else 0, len(self.outputs), t, x, u, p
        )

    def _inner(self) -> Any:
        """The same system as one of this package's simulators."""
        if not callable(getattr(self.function, "n_out", None)):
            raise SimulatorError(
                f"function={self.function!r} is not a casadi.Function: make one, casadi.Function('f', [x, u, p], [dx]), or give a "
                "Python function to ODESimulator."
            )
        params = numbers_of(self.params)
        self._check_params(list(params))
        output = self.output if _has_output(self) else None
        names: dict[str, Any] = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs, "x0": self.x0}
        names |= {"params": params, "dt": self.dt, "output": output}
        if self.discrete:
            held_over_samples(self.hold, self.method)
            return StepSimulator(self.step, **names)
        return ODESimulator(self.rhs, hold=self.hold, method=self.method, **names)

    def _check_params(self, params: list[str]) -> None:
        """Every parameter goes somewhere, and to one place."""
        functions = [f for f in (self.function, self.output_function) if callable(getattr(f, "n_in", None))]
        named = {function.name_in(i) for function in functions for i in range(function.n_in())}
        for name in params:
            if name in named & {"t", *_LONG, *_LONG.values()} - {"p", "params"}:
                raise SimulatorError(
                    f"params: {name!r} is also what the function calls its time, states or inputs: give the parameter another name."
                )
            if not named & {name, "p", "params", "i2"}:
                raise SimulatorError(
                    f"params: no input of the function takes {name!r}; its inputs are {sorted(named)}: leave it out, or make the "
                    f"function with an input 'p' or {name!r}."
                )

    def _asked(
        self, function: Any, place: int, size: int, t: Any, x: Any, u: Any, p: Mapping[str, Any]
    ) -> np.ndarray:  # fmt: skip
        """An output of a function at points."""
        if any(hasattr(v, "graph") for v in (*x, *u)):  # symbols of an export
            raise TypeError(
                "it is a CasADi function already: use simulator.function itself, or write the equations in Python."
            )
        slots = self._slots(function, place, size)
        tapes = self.__dict__.setdefault("_tapes", {})
        if id(function) not in tapes:  # the function is kept, and with it its identity
            tapes[id(function)] = function, tape_of(function)
        tape = tapes[id(function)][1]
        return at_points(lambda *given: _evaluated(function, tape, place, size, slots, *given), t, x, u, p)

    def _slots(self, function: Any, place: int, size: int) -> list[tuple[str, tuple[str, ...]]]:
        """For every input of a function: "t", "x", "u" or "p" and, for p, names of the parameters."""
        params = tuple(self.params or {})
        names = {"t": ("t",), "x": tuple(self.states), "u": tuple(self.inputs), "p": params}
        slots: list[tuple[str, tuple[str, ...]]] = []
        for i in range(function.n_in()):
            name = function.name_in(i)
            kind = "xup"[i] if name == f"i{i}" and i < 3 else _LONG.get(name, name)
            if kind not in names and name not in params:
                raise SimulatorError(
                    f"{function.name()}: its input {name!r} is none of t, x, u, p and no parameter of params={list(params)}; name the "
                    "inputs, casadi.Function('f', [x, u, p], [dx], ['x', 'u', 'p'], ['dx'])."
                )
            slots.append((kind, names[kind]) if kind in names else ("p", (name,)))
            entries = slots[-1][1]
            if function.numel_in(i) != len(entries) or (entries and function.size2_in(i) != 1):
                raise SimulatorError(
                    f"{function.name()}: its input {name!r} is of shape {tuple(function.size_in(i))}, expected ({len(entries)}, 1): "
                    f"one entry for each of {list(entries)}."
                )
        if function.n_out() <= place or function.numel_out(place) != size:
            sizes = [tuple(function.size_out(i)) for i in range(function.n_out())]
            raise SimulatorError(
                f"{function.name()}: its outputs are of shape {sizes}, expected ({size}, 1) at place {place}: "
                f"{list(self.outputs) if place or function is self.output_function else list(self.states)}."
            )
        return slots


def _evaluated(
    function: Any, tape: Tape | None, place: int, size: int, slots: list[tuple[str, tuple[str, ...]]], t: Any, x: np.ndarray, u: np.ndarray,
    p: Mapping[str, Any],
) -> np.ndarray:  # fmt: skip
    """An output of a function at flat points, (size, n_points); nan where it fails."""
    matrix, n_points = require("casadi", "casadi").DM, x.shape[1]
    rows = {"x": x, "u": u, "t": np.broadcast_to(np.asarray(t, dtype=float), (1, n_points))}
    arguments = []
    for kind, names in slots:
        if kind == "p":
            own = [np.broadcast_to(np.asarray(p[name], dtype=float), (n_points,)) for name in names]
            arguments.append(np.array(own).reshape(len(names), n_points))
        else:
            arguments.append(rows[kind])
    good = np.flatnonzero(offered(x, *arguments))
    out = np.full((size, n_points), np.nan)

    def called(columns: np.ndarray) -> np.ndarray:
        given = [matrix(np.ascontiguousarray(a[:, columns])) if len(a) else matrix(0, 1) for a in arguments]
        found = function.call(given)[place].full()
        return np.broadcast_to(found, (size, len(columns)))  # one column where nothing depends on the points

    if not len(good):
        return out
    try:
        if tape is not None and len(good) >= MANY_POINTS:
            out[:, good] = tape(place, [a[:, good] for a in arguments], len(good))
        else:
            out[:, good] = called(good)
    except RuntimeError:  # CasADi's own: a root that is not found, an integrator that stops
        for k in good:
            try:
                out[:, [k]] = called(np.array([k]))
            except RuntimeError:
                continue
    return out
