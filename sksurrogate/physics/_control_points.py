"""Systems of python-control at many points: each function is called once for all of them, where it allows that."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import numpy as np

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._branches import Branches

#: Steps from a point, over its size, at which a function is asked for several points and for each of them.
SPREAD = np.array([0.0, 1e-3, -1e-3, 0.5, -0.5, 2.0, -2.0])


class ControlPoints:
    """``dynamics`` and ``output`` of a system, and of the subsystems of an interconnected one, at points.

    Points are arrays (n, n_points), times (n_points,), parameters floats or (n_points,).
    """

    def __init__(self, system: Any):
        self.system = system
        self.known: dict[str, tuple[Any, Callable[..., Any] | None]] = {}  #: How each function takes points together

    @cached_property
    def parts(self) -> list[ControlPoints]:
        """The subsystems."""
        return [ControlPoints(one) for one in getattr(self.system, "syslist", ())]

    def __call__(self, what: str, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: dict[str, Any]) -> np.ndarray:
        """``what`` is "dynamics" or "output"; (n_states or n_outputs, n_points)."""
        system = self.system
        if hasattr(system, "A"):
            of_states, of_inputs = (system.A, system.B) if what == "dynamics" else (system.C, system.D)
            return np.asarray(of_states) @ x + np.asarray(of_inputs) @ u
        together = self.together(what, t, x, u, p) if x.shape[1] > 1 else None
        if together is not None:
            try:
                return np.stack(list(map(_full(x.shape[1]), together(t, x, u, {**system.params, **p}))))
            except (TypeError, ValueError):  # parameters of every point, a branch that no trial met
                pass
        return one_by_one(system, what, t, x, u, p)

    def ways(self, what: str) -> tuple[Any, list[Callable[..., Any]]]:
        """The function that answers, and how it may be asked for all points at once."""
        system = self.system
        size = system.nstates if what == "dynamics" else system.noutputs
        if self.parts:
            return system, [partial(self.interconnected, what)]
        if type(system).__name__ != "NonlinearIOSystem":
            return system, []
        function = system.updfcn if what == "dynamics" else system.outfcn
        if function is None:  # outputs without a function are the first states
            return None, [lambda t, x, u, p: x[:size]] if what == "output" else []
        return function, [function, Branches(function, size), Branches(function, size, vectors=True)]

    def together(
        self, what: str, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: dict[str, Any]
    ) -> Callable[..., Any] | None:
        """A function of all points; None where they are asked one by one. A few points are asked both ways, once."""
        function, ways = self.ways(what)
        if what not in self.known or self.known[what][0] is not function:
            found = (one for one in ways if _takes_points(self.system, one, what, t, x, u, p))
            self.known[what] = function, next(found, None)
            if isinstance(chosen := self.known[what][1], Branches):
                chosen.patient = chosen.vectors
        return self.known[what][1]

    def interconnected(self, what: str, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: dict[str, Any]) -> np.ndarray:
        """Of subsystems whose inputs are sums of their outputs and of the inputs from outside."""
        system, parts = self.system, self.parts
        states = np.split(x, np.cumsum([one.system.nstates for one in parts])[:-1])
        params = [{**one.system.params, **p} for one in parts]

        def asked(what: str, inputs: np.ndarray) -> np.ndarray:
            own = np.split(inputs, np.cumsum([one.system.ninputs for one in parts])[:-1])
            return np.concatenate([part(what, t, *given) for part, given in zip(parts, zip(states, own, params))])

        outside = np.asarray(system.input_map) @ u
        inputs = outside
        for _ in range(len(parts) + 1):  # in a round a signal passes through one subsystem at least
            outputs = asked("output", inputs)
            before, inputs = inputs, np.asarray(system.connect_map) @ outputs + outside
            if np.array_equal(before, inputs, equal_nan=True):
                break
        else:
            raise RuntimeError("algebraic loop detected")
        if what == "output":
            return np.asarray(system.output_map) @ np.concatenate([outputs, inputs])
        return asked("dynamics", inputs)


def one_by_one(
    system: Any, what: str, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: dict[str, Any]
) -> np.ndarray:  # fmt: skip
    """``dynamics`` or ``output`` point by point."""
    function, n = getattr(system, what), x.shape[1]
    of_points = zip(*(np.broadcast_to(v, n).tolist() for v in p.values())) if p else [()] * n
    own = (dict(zip(p, values)) or None for values in of_points)
    try:
        columns = [np.atleast_1d(function(*point)) for point in zip(t, x.T, u.T, own)]
    except RuntimeError as error:
        if "algebraic loop" not in str(error):
            raise
        raise SimulatorError(
            f"system={system.name!r}: {error}: in every loop of subsystems one needs an output that does not depend on its input at "
            "once; give it a state (a short lag) or solve the loop by hand."
        ) from error
    size = system.nstates if what == "dynamics" else system.noutputs
    return np.stack(columns, axis=1) if columns else np.empty((size, 0))


def _full(n_points: int) -> Callable[[Any], np.ndarray]:
    """A component as an array over the points."""
    return lambda component: np.broadcast_to(np.asarray(component, dtype=float), (n_points,))


def _takes_points(
    system: Any, function: Any, what: str, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: dict[str, Any]
) -> bool:  # fmt: skip
    """Whether a function of the system gives the same for points together as one by one, at points of both signs."""
    xs, us = (v[:, :1] + SPREAD[::side] * np.maximum(np.abs(v[:, :1]), 0.1) for v, side in ((x, 1), (u, -1)))
    ts, own = t[0] + 0.1 * np.arange(len(SPREAD)), {name: np.ravel(v)[0] for name, v in p.items()}
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            single = one_by_one(system, what, ts, xs, us, own)
            together = list(map(_full(len(SPREAD)), function(ts, xs, us, {**system.params, **own})))
            return len(together) == len(single) and bool(
                np.allclose(together, single, rtol=1e-9, atol=1e-12, equal_nan=True)
            )
        except Exception:  # a function of one point, whatever it says of arrays
            return False
