"""State-space forms of a simulator with effects: a graph (for CasADi, C, ONNX), a linearisation, a system of python-control."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._model import BoundModel
from sksurrogate.effects._points import bound_at_points, stacked
from sksurrogate.effects._sampled import SampledForm, point_model
from sksurrogate.effects._small_signal import SampledPoint, SmallSignal, refuse_slopes
from sksurrogate.exceptions import SimulatorError, SurrogateError
from sksurrogate.export._graph import Graph
from sksurrogate.export._symbol import joined, symbols
from sksurrogate.physics._simulator import Plant

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


def steps_of(parts: Parts, X: np.ndarray, bound: BoundModel, scale: Any, sharpness: float) -> int:
    """Substeps of a run with which an export equals it.

    ``parts``: plant, effects, their parameters in a row.
    ``X`` (n_states, n_samples): the run.
    ``bound``: the model that made it.
    ``scale, sharpness``: as in :class:`AugmentedSimulator`.
    Raises SimulatorError where the run smooths kinks over other sizes than an export, or has another sample time.
    """
    plant, effects, theta = parts
    if not np.isclose(bound.record.dt, plant.dt, rtol=1e-9, atol=0.0):
        raise SimulatorError(
            f"t has steps of {bound.record.dt:g}: an export takes those of the simulator, dt={plant.dt:g}."
        )
    other = copy.copy(bound)
    other._widths = bound_at_points(point_model(plant, effects, bound.a.n_sub, scale, sharpness), theta, False)._widths
    with np.errstate(all="ignore"):
        later, exported = bound(X[:, None]), other(X[:, None])
    if not np.allclose(later, exported, rtol=1e-12, atol=0.0, equal_nan=True):
        sizes = [float(f"{size:.4g}") for size in bound.a.nominal_scale]
        raise SimulatorError(
            f"scale={scale}: simulate smooths kinks over the sizes of the signals in this run, an export does not know them. "
            f"Give scale={sizes} for both."
            if scale is None
            else "a kink over an input is smoothed over the size of the input in each run: no export equals such runs exactly."
        )
    return bound.a.n_sub


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
