"""Fitted time-series models as simulators with states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.exceptions import SimulatorError
from sksurrogate.export._describe import to_graph
from sksurrogate.export._graph import Graph
from sksurrogate.physics._contents import contents, same
from sksurrogate.physics._foreign import at_points
from sksurrogate.physics._inner import InnerRunsMixin
from sksurrogate.physics._simulator import BaseSimulator
from sksurrogate.physics._wrappers import StepSimulator

#: Points at which it is seen which states only pass a value on.
_PASSING_PROBES = 5


class _Wiring(NamedTuple):
    """A model as a graph, and what its states hold."""

    graph: Graph
    passed: tuple[int, ...]  #: States that hold what another state or an input was a sample ago
    start: np.ndarray  #: (n_states,)


class SurrogateSimulator(InnerRunsMixin, BaseSimulator):
    """A fitted model with states as a nominal model: its map from sample to sample.

    Parameters
    ----------
    model : fitted estimator or Graph
        :class:`StateSpaceRegressor`, :class:`RecursivePredictor`, :class:`DerivativeRegressor`,
        :class:`LaggedLinearRegressor`, :class:`HybridRegressor`, or any model whose ``to_graph()`` has inputs "x" and "u" and
        outputs "x_next" and "y". It is not copied, by a clone neither: once it is fitted anew, the simulator is the new model.
    inputs, outputs, states : list of str, optional
        Names; those of the columns it was fitted on where it knows them, else u0, y0, x0 and so on.
    dt : float, default=1.0
        Sample time of the data that the model was fitted on; the map itself knows none.
    x0 : array-like (n_states,), optional
        Initial state; by default that which the model starts at, its mean outputs for a lag model.
    n_sub : int, optional
        Runge-Kutta substeps of right-hand sides inside a hybrid; None: its own.
    units : dict of str, optional
        Units of states, inputs, outputs, parameters and "time" by name, for reports and labels: ``{"speed": "rad/s"}``.

    Raises
    ------
    SimulatorError
        The model has no states.
    SurrogateError
        It cannot be written as a graph; the message names the part.

    Notes
    -----
    ``Y[0]`` is the output at ``x0``. The states of a lag model are its past outputs and inputs, newest first. States that only
    pass on a value (``kinematic``) get no effects.

    Examples
    --------
    >>> from sksurrogate.compose import StateSpaceRegressor
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> from sksurrogate.physics import SurrogateSimulator
    >>> X, y, groups = make_reactor_runs(4, 60, u_range=(0.1, 0.2), random_state=0)
    >>> model = StateSpaceRegressor(1).fit(X, y, groups=groups)
    >>> nominal = SurrogateSimulator(model, dt=0.02, inputs=["u"], outputs=["concentration"])
    >>> bool(abs(nominal.simulate(X[:60])[:, 0] - model.predict(X[:60])).max() < 1e-9)
    True
    """

    def __init__(
        self,
        model: Any,
        *,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        states: Sequence[str] | None = None,
        dt: float = 1.0,
        x0: Any = None,
        n_sub: int | None = None,
        units: Mapping[str, str] | None = None,
    ):
        self.model = model
        self.inputs = inputs
        self.outputs = outputs
        self.states = states
        self.dt = dt
        self.x0 = x0
        self.n_sub = n_sub
        self.units = units

    def __getstate__(self) -> dict[str, Any]:
        """The graph is written again."""
        return {key: value for key, value in super().__getstate__().items() if key != "_kept"}

    def __sklearn_clone__(self) -> SurrogateSimulator:
        """A fitted model is data here: a clone keeps it fitted."""
        kept = self.get_params(deep=False)
        return type(self)(kept.pop("model"), **kept)

    def _wiring(self) -> _Wiring:
        """The model as a graph, written again after the model was fitted anew."""
        kept, now = self.__dict__.get("_kept"), contents(self.model, self.n_sub)
        if kept is None or not same(kept[0], now):
            graph = self.model if isinstance(self.model, Graph) else to_graph(self.model, self.n_sub)
            if set(graph.inputs) != {"x", "u"} or not {"x_next", "y"} <= set(graph.outputs):
                raise SimulatorError(
                    f"model={type(self.model).__name__} has no states, only inputs {list(graph.inputs)}: give a time-series model, or use "
                    "CallableSimulator, which asks its predict."
                )
            self._kept = kept = (now, _wired(graph, getattr(self.model, "y_mean_", None)))
        return kept[1]

    def to_graph(self, n_sub: int | None = None) -> Graph:
        """The graph of the model."""
        return self._wiring().graph

    def described(self) -> dict[str, Any]:
        """What the arguments leave to the model: names of ``inputs``, ``outputs`` and ``states``, and ``x0``."""
        wiring, graph = self._wiring(), self._wiring().graph
        sizes = {name: graph.nodes[place].size for name, place in {**graph.inputs, **graph.outputs}.items()}
        known = [str(name) for name in getattr(self.model, "feature_names_in_", ()) if name != getattr(self.model, "run", None)]  # fmt: skip
        return {
            "inputs": known if len(known) == sizes["u"] else [f"u{k}" for k in range(sizes["u"])],
            "outputs": [f"y{k}" for k in range(sizes["y"])],
            "states": [f"x{k}" for k in range(sizes["x"])],
            "x0": wiring.start,
        }

    @property
    def kinematic(self) -> tuple[str, ...]:
        """States that hold what another state or an input was a sample ago."""
        names = self.described()["states"] if self.states is None else list(self.states)
        return tuple(names[k] for k in self._wiring().passed)

    def step(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], dt: float) -> np.ndarray:
        """The states one sample later, (n_states, *s)."""
        return at_points(lambda *given: self._read("x_next", *given), t, x, u, p)

    def output(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> np.ndarray:
        """Outputs, (n_outputs, *s)."""
        return at_points(lambda *given: self._read("y", *given), t, x, u, p)

    def _read(self, what: str, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any]) -> np.ndarray:
        """An output of the graph at flat points."""
        return self._wiring().graph(x=x.T, u=u.T)[what].T

    def _inner(self) -> StepSimulator:
        """The same map as one of this package's simulators."""
        own = self.described()
        given = {name: own[name] if getattr(self, name) is None else getattr(self, name) for name in own}
        sizes = {name: len(own[name]) for name in ("inputs", "outputs", "states")}
        for name, size in sizes.items():
            if len(given[name]) != size:
                raise SimulatorError(f"{name}={list(given[name])}: the model has {size} {name}; name each once.")
        return StepSimulator(self.step, output=self.output, dt=self.dt, **given)


def _wired(graph: Graph, y_mean: Any) -> _Wiring:
    """Which states only pass a value on, and where a run starts."""
    n, m = graph.nodes[graph.inputs["x"]].size, graph.nodes[graph.inputs["u"]].size
    random = np.random.default_rng(0)
    start = np.zeros(n) if graph.initial is None else np.array(graph.initial, dtype=float)
    x, u = start + random.normal(size=(_PASSING_PROBES, n)), random.normal(size=(_PASSING_PROBES, m))
    with np.errstate(all="ignore"):
        found = graph(x=x, u=u)
    after, y = found["x_next"].T, found["y"].T

    def copied(rows: np.ndarray) -> np.ndarray:
        """(n_states, n_rows): whether the next state is this row, number by number."""
        return np.all(after[:, None] == rows[None], axis=2)

    by_state = copied(x.T) & ~np.eye(n, dtype=bool)
    passed = by_state.any(axis=1) | (copied(u.T).any(axis=1) if m else False)
    if graph.initial is None and y_mean is not None:
        newest = copied(y)
        for i in np.flatnonzero(newest.any(axis=1) & ~passed):
            start[i] = np.ravel(y_mean)[int(np.argmax(newest[i]))]
        for _ in range(n):  # older ones follow the newest
            for i in np.flatnonzero(by_state.any(axis=1)):
                start[i] = start[int(np.argmax(by_state[i]))]
    return _Wiring(graph, tuple(np.flatnonzero(passed).tolist()), start)
