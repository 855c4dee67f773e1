"""A, B, C, D of a recursive model at a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.exceptions import SurrogateError, require
from sksurrogate.export._describe import to_graph
from sksurrogate.export._graph import Graph


@dataclass(frozen=True, eq=False)
class StateSpace:
    """``x_next = x1 + A (x - x0) + B (u - u0)``, ``y = y0 + C (x - x0) + D (u - u0)``.

    Attributes
    ----------
    A, B, C, D : ndarray
        Exact slopes.
    x0, u0, x1, y0 : ndarray
        The point, and the next state and the output there; x1 = x0 at a steady state.
    dt : float or None
        Sample time.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.export import state_space
    >>> local = state_space(make_reactor(), [0.15])
    >>> local.A.shape, local.dt, bool(abs(local.A[0, 0]) < 1)   # stable in discrete time
    ((1, 1), 0.02, True)
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    x0: np.ndarray
    u0: np.ndarray
    x1: np.ndarray
    y0: np.ndarray
    dt: float | None

    def to_control(self) -> Any:
        """The deviation model as ``control.StateSpace``."""
        dt = True if self.dt is None else self.dt
        return require("control", "control").ss(self.A, self.B, self.C, self.D, dt)


def state_space(model: Any, u0: Any, x0: Any = None, n_sub: int | None = None) -> StateSpace:
    """Linearise a recursive model, exactly.

    Parameters
    ----------
    model : RecursivePredictor, HybridRegressor, simulator with ``rhs`` or ``step``, or Graph
    u0 : array-like (n_inputs,)
    x0 : array-like (n_states,), optional
        Default: the steady state under ``u0``, by Newton's method.
    n_sub : int, optional
        Runge-Kutta substeps of right-hand sides; None: as :func:`to_graph` takes them, ``model.substeps(U, x0)``: those of
        ``simulate``.

    Returns
    -------
    StateSpace

    Raises
    ------
    SurrogateError
        The model is not recursive, or no steady state was found.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.export import state_space
    >>> found = state_space(make_reactor(), [0.15], [5.57])
    >>> found.A.shape, bool(0.9 < found.A[0, 0] < 1.0)
    ((1, 1), True)
    """
    graph = model if isinstance(model, Graph) else to_graph(model, n_sub)
    if set(graph.inputs) != {"x", "u"}:
        raise SurrogateError(
            f"{type(model).__name__} is not recursive: A, B, C, D need inputs x and u, got {list(graph.inputs)}."
        )
    u = np.asarray(u0, dtype=float).reshape(-1)
    x = _steady(graph, u) if x0 is None else np.asarray(x0, dtype=float).reshape(-1)
    slopes, values = graph.jacobian(x=x, u=u), graph(x=x, u=u)
    A, B, C, D = (slopes[out, into] for out in ("x_next", "y") for into in ("x", "u"))
    return StateSpace(A, B, C, D, x, u, values["x_next"], values["y"], graph.dt)


def _steady(graph: Graph, u: np.ndarray) -> np.ndarray:
    """A state that stays, reached by a free run and then by Newton's method."""
    n = graph.nodes[graph.inputs["x"]].size
    x = np.zeros(n) if graph.initial is None else graph.initial.copy()
    for _ in range(300):
        x = graph(x=x, u=u)["x_next"]
    for _ in range(20):
        error = graph(x=x, u=u)["x_next"] - x
        if not np.all(np.isfinite(error)):
            break
        if np.max(np.abs(error)) <= 1e-11 * (1.0 + np.max(np.abs(x))):
            return x
        x = x - np.linalg.lstsq(graph.jacobian(x=x, u=u)["x_next", "x"] - np.eye(n), error, rcond=None)[0]
    raise SurrogateError(f"no steady state was found at u0={u.tolist()}: give the state as x0=, or another u0.")
