"""The augmented model at single points: parameters are numbers, states are numbers, arrays of points or symbols of a graph."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sksurrogate.effects._model import AugmentedModel, BoundModel
from sksurrogate.export._symbol import Symbol, joined, symbols
from sksurrogate.physics._forces import wired
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant


def stacked(rows: list[Any]) -> np.ndarray:
    """Components one above the other: arrays of points, or objects where one is a symbol."""
    plain = [row.item() if isinstance(row, np.ndarray) and not row.ndim else row for row in rows]
    if all(isinstance(row, np.ndarray) or np.isscalar(row) for row in plain):
        return np.stack(np.broadcast_arrays(*plain)).astype(float) if plain else np.empty(0)
    out = np.empty(len(plain), dtype=object)
    out[:] = plain
    return out


class SymbolModel:
    """The functions of a plant as :class:`PlantModel` has them, called with symbols.

    ``plant``: with access "rhs" or "step".
    """

    def __init__(self, plant: Plant):
        self.plant = plant
        self._graph: Any = plant.simulator.to_graph() if hasattr(plant.simulator, "to_graph") else None
        self._function = wired(plant)(plant.simulator.rhs if plant.access == "rhs" else plant.simulator.step)
        self._output = None if plant.output_states is not None else wired(plant)(plant.simulator.output)

    def derivative(self, t: Any, x: np.ndarray, u: np.ndarray, varied: Mapping[str, Any] | None = None) -> np.ndarray:
        """dx/dt."""
        return stacked(list(self._function(t, x, u, {**self.plant.params, **(varied or {})})))

    def step(
        self, t: Any, x: np.ndarray, u: np.ndarray, dt: float, varied: Mapping[str, Any] | None = None
    ) -> np.ndarray:
        """The states one step later."""
        if self._graph is not None and x.dtype == object:
            return self._embedded("x_next", x, u)
        return stacked(list(self._function(t, x, u, {**self.plant.params, **(varied or {})}, dt)))

    def output(self, t: Any, x: np.ndarray, u: np.ndarray, varied: Mapping[str, Any] | None = None) -> np.ndarray:
        """Measured outputs."""
        if self._output is None:
            return x[list(self.plant.output_states or ())]
        if self._graph is not None and x.dtype == object:
            return self._embedded("y", x, u)
        return stacked(list(self._output(t, x, u, {**self.plant.params, **(varied or {})})))

    def _embedded(self, what: str, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """An output of a model that is a graph itself."""
        graph = next(value.graph for value in (*x, *u) if isinstance(value, Symbol))
        found = graph.embed(self._graph, x=joined(graph, x), u=joined(graph, u))
        return symbols(graph, found[what])


class PointModel(AugmentedModel):
    """An :class:`AugmentedModel` whose parameters are numbers."""

    def parameters_of(self, i: int, theta: np.ndarray) -> list[Any]:
        """Parameters of effect i."""
        return [float(value) for value in theta[self.slice_of(i)]]


class _PointBound(BoundModel):
    """A :class:`BoundModel` that is asked at single points: inputs come with the call."""

    def _inputs(self) -> Any:
        return np.empty(0), None, np.empty(0)


def bound_at_points(whole: PointModel, theta: np.ndarray, symbols: bool) -> BoundModel:
    """The model with its parameters filled in; with ``symbols`` the plant's functions are called as they are."""
    if symbols:
        whole.model = SymbolModel(whole.plant)  # type: ignore[assignment]
    else:
        assert isinstance(whole.model, PlantModel)
    return _PointBound(whole, theta)
