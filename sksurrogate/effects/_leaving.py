"""A simulator with effects as others want it: a graph (CasADi, C, ONNX), a linearisation, a system of python-control."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._effect import BaseEffect
from sksurrogate.effects._points import stacked
from sksurrogate.effects._sampled import SampledForm
from sksurrogate.effects._small_signal import SampledPoint, SmallSignal, refuse_slopes
from sksurrogate.exceptions import SimulatorError, SurrogateError
from sksurrogate.export._graph import Graph
from sksurrogate.export._symbol import joined, symbols
from sksurrogate.physics._simulator import Plant

__all__ = ["graph_of", "sampled_of", "small_signal_of"]

Parts = tuple[Plant, Sequence[BaseEffect], np.ndarray]


def _checked(parts: Parts) -> Parts:
    """A plant that can have a state-space form."""
    plant, name = parts[0], type(parts[0].simulator).__name__
    if plant.access == "trajectory":
        raise SimulatorError(
            f"{name} gives trajectories only: a state-space form needs a simulator with rhs or step, and states."
        )
    if getattr(plant.simulator, "events", None):
        raise SurrogateError(
            f"{name} has events and cannot be exported: finding the moment of an event is not a fixed formula."
        )
    return parts


def sampled_of(parts: Parts, n_sub: int, scale: Any, sharpness: float, symbols: bool = False) -> SampledForm:
    """The map from sample to sample."""
    plant, effects, theta = _checked(parts)
    return SampledForm(plant, effects, theta, n_sub=n_sub, scale=scale, sharpness=sharpness, symbols=symbols)


def small_signal_of(parts: Parts, order: int, scale: Any, sharpness: float) -> Any:
    """What a linearisation is taken of: a right-hand side, or a step where the simulator has only that."""
    plant, effects, theta = _checked(parts)
    if plant.access == "rhs":
        return SmallSignal(plant, effects, theta, order, scale, sharpness)
    refuse_slopes(effects)
    return SampledPoint(sampled_of(parts, 1, scale, sharpness))


def graph_of(parts: Parts, n_sub: int, scale: Any, sharpness: float) -> Graph:
    """The map from sample to sample as a graph; its last state is the time where something depends on it."""
    form = sampled_of(parts, n_sub, scale, sharpness, symbols=True)
    plant = form.plant
    try:
        graph, timed = _drawn(form, clock=True)
        graph = graph if timed else _drawn(form, clock=False)[0]
    except (TypeError, AttributeError) as error:
        raise SurrogateError(f"{type(plant.simulator).__name__} cannot be exported: {error}") from error
    start = form.begin(list(plant.x0), [0.0] * len(plant.inputs))
    graph.initial = np.array([float(v) for v in start] + [0.0] * timed)
    graph.dt, graph.states = plant.dt, [*form.states, *(["time"] if timed else [])]
    graph.signals = list(plant.inputs), list(plant.outputs)
    return graph


def _drawn(form: SampledForm, clock: bool) -> tuple[Graph, bool]:
    """The graph, and whether the clock drives anything."""
    graph, n = Graph(), len(form.states)
    x, u = graph.input("x", n + clock), graph.input("u", len(form.plant.inputs))
    xs, us = symbols(graph, x), symbols(graph, u)
    t: Any = xs[n] if clock else 0.0
    y = joined(graph, stacked(form.output(t, list(xs[:n]), list(us))))
    later = joined(graph, stacked(form.step(t, list(xs[:n]), list(us))))
    timed = clock and graph.depends({y, later}, t.node)
    if clock:
        later = graph.concat(later, (t + form.plant.dt).node)
    graph.outputs["x_next"], graph.outputs["y"] = later, y
    return graph, timed
