"""A fitted hybrid as a graph in state-space form: the simulator's states, past deviations, past inputs."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate._domain import Domain
from sksurrogate.compose._hybrid_dynamics import DynamicsCorrection
from sksurrogate.compose._hybrid_force import ForceCorrection
from sksurrogate.compose._hybrid_output import OutputCorrection
from sksurrogate.compose._residual import FreeRunResidual
from sksurrogate.exceptions import SimulatorError
from sksurrogate.export import Graph, to_graph
from sksurrogate.export._describe import SUBSTEPS, add_estimator, add_step
from sksurrogate.physics._simulator import describe


def hybrid_graph(correction: OutputCorrection | DynamicsCorrection, n_inputs: int, n_sub: int | None) -> Graph:
    """The hybrid as ``x_next, y = f(x, u)``; ``n_sub`` None: the correction's own number of substeps."""
    n_sub = n_sub or correction.n_sub or SUBSTEPS
    graph = Graph()
    if isinstance(correction, DynamicsCorrection):
        plant = describe(correction.simulator)
        x, u = graph.input("x", len(plant.states)), graph.input("u", len(plant.inputs))
        if isinstance(correction, ForceCorrection):
            both = graph.concat(u, _force(graph, correction, u if correction.form == "input" else graph.concat(x, u)))
            graph.outputs["x_next"], graph.outputs["y"] = add_step(graph, _Forced(correction), x, both, n_sub)
        else:
            graph.outputs["x_next"], graph.outputs["y"] = add_step(graph, _Corrected(correction), x, u, n_sub)
        graph.initial, graph.dt = plant.x0.copy(), plant.dt
        return graph
    n, o, n_states = correction.n_lags, correction.n_outputs, _n_states(correction.simulator)
    past = n * o if correction.form == "output" else 0
    memory = n_states + past + n * n_inputs
    # a correction that can fade has a last, constant state: what the first rows of the run leave of it
    fades = bool(np.isfinite(correction.domain.fade))
    x, u = graph.input("x", memory + fades), graph.input("u", n_inputs)
    own = graph.take(x, np.arange(n_states))
    d, before = graph.take(x, n_states + np.arange(past)), graph.take(x, n_states + past + np.arange(n * n_inputs))
    if correction.simulator is None:
        own_next, y_s = own, graph.constant(np.zeros(o))
    else:
        own_next, y_s = add_step(graph, correction.simulator, own, u, n_sub)
        graph.dt = getattr(correction.simulator, "dt", None)
    phi = graph.concat(d, u, before, y_s)
    fitted = correction.fitted
    value = _net(graph, fitted.net_, phi) if isinstance(fitted, FreeRunResidual) else add_estimator(graph, fitted, phi)
    if correction.form == "series":
        value = graph.binary("sub", value, y_s)
    value = _faded(graph, correction.domain, phi, value)
    if correction.form == "output":
        value = graph.clipped(value, -correction.bound, correction.bound)
    following = [own_next]
    if past:
        following += [value, graph.take(d, np.arange(past - o))]
    following += [u, graph.take(before, np.arange((n - 1) * n_inputs))]
    kept = graph.binary("mul", graph.constant(np.broadcast_to(correction.factor, (o,)).astype(float)), value)
    start = np.zeros(memory + fades)
    if fades:
        trust = graph.take(x, np.array([memory]))
        kept = graph.binary("mul", kept, trust)
        following, start[memory] = [*following, trust], 1.0
    graph.outputs["x_next"] = graph.concat(*following)
    graph.outputs["y"] = graph.binary("add", y_s, kept)
    if correction.simulator is not None:
        start[:n_states] = describe(correction.simulator).x0
    graph.initial = start
    return graph


def hybrid_state(correction: Any, U: np.ndarray, y0: np.ndarray | None, n_sub: int | None) -> np.ndarray:
    """State of the graph before row ``len(y0)`` of a run (before row 0 without y0)."""
    inside = isinstance(correction, DynamicsCorrection)
    simulator = correction.simulator
    own = np.zeros(0) if simulator is None else describe(simulator).x0.copy()
    places = None if simulator is None else describe(simulator).output_states
    if y0 is not None and places is not None:
        own[list(places)] = y0[0]
    if inside:
        graph = hybrid_graph(correction, U.shape[1], n_sub)
        for row in U[: len(y0) if y0 is not None else 0]:
            own = graph(x=own, u=row)["x_next"]
        return own
    n, o = correction.n_lags, correction.n_outputs
    if y0 is not None and correction.starts is not None:
        own = correction.starts(simulator, [U], [y0[:n]])[0]
    d, before = np.zeros((n, o)), np.repeat(U[:1], n, axis=0)
    step = None if simulator is None else to_graph(simulator, n_sub or correction.n_sub)
    for t in range(0 if y0 is None else len(y0)):
        assert y0 is not None
        at = {"y": np.zeros(o), "x_next": own} if step is None else step(x=own, u=U[t])
        d = np.concatenate([(y0[t] - at["y"])[None], d[:-1]])
        before = np.concatenate([U[t : t + 1], before[:-1]])
        own = at["x_next"]
    lags = d.ravel() if correction.form == "output" else np.zeros(0)
    trust = [correction.trust(y0)] if np.isfinite(correction.domain.fade) else []
    return np.concatenate([own, lags, before.ravel(), trust])


def _n_states(simulator: Any) -> int:
    if simulator is None:
        return 0
    if describe(simulator).access == "trajectory":
        raise SimulatorError(
            f"{type(simulator).__name__} gives trajectories only: a hybrid can be exported only around a simulator with rhs or step."
        )
    return len(describe(simulator).states)


def _net(graph: Graph, net: Any, phi: int) -> int:
    """A :class:`SkipNet`."""
    raw = net.raw()
    units = graph.unary("tanh", graph.affine(phi, raw.hidden, raw.hidden_bias))
    return graph.binary("add", graph.affine(phi, raw.skip), graph.affine(units, raw.out, raw.bias))


def _faded(graph: Graph, domain: Domain, phi: int, value: int) -> int:
    """The correction times its weight."""
    if not np.isfinite(domain.fade):
        return value
    over = graph.binary("max", graph.binary("sub", graph.constant(domain.low), phi), graph.binary("sub", phi, graph.constant(domain.high)))  # fmt: skip
    distance = graph.peak(graph.binary("div", over, graph.constant(domain.size)))
    beyond = graph.binary("max", graph.binary("sub", distance, graph.constant(domain.fade)), graph.constant(0.0))
    ratio = graph.binary("div", beyond, graph.constant(max(domain.fade, 1e-12)))
    weight = graph.unary("exp", graph.binary("mul", graph.binary("mul", ratio, ratio), graph.constant(-1.0)))
    return graph.binary("mul", value, weight)


def _force(graph: Graph, correction: ForceCorrection, z: int) -> int:
    """The learned force at features z, held over a sample."""
    domain, held = correction.domain, z
    if np.isfinite(domain.fade):
        room = 0.1 * (domain.high - domain.low)
        held = graph.clipped(z, domain.low - room, domain.high + room)
    found = _faded(graph, domain, z, add_estimator(graph, correction.fitted, held))
    return graph.binary("mul", graph.constant(correction.factor), found)


class _Forced:
    """The simulator with forces as further inputs, on single points of any kind of number."""

    def __init__(self, correction: ForceCorrection):
        plant, simulator = describe(correction.simulator), correction.simulator
        self.params, self.dt, self.hold = dict(plant.params), plant.dt, plant.hold
        self.states, self.outputs = plant.states, plant.outputs
        n, targets, inside = len(plant.inputs), correction.targets, correction.form == "input"

        def moved(function: Any, t: Any, x: Any, both: Any, p: Any, *extra: Any) -> list[Any]:
            u = list(both[:n])
            if inside:
                for k, value in zip(targets, both[n:]):
                    u[k] = u[k] + value
            out = list(function(t, x, np.array(u, dtype=object), p, *extra))
            for k, value in zip(() if inside else targets, both[n:]):
                out[k] = out[k] + value
            return out

        if plant.access == "rhs":
            self.rhs = lambda t, x, u, p: moved(simulator.rhs, t, x, u, p)
        else:
            self.step = lambda t, x, u, p, dt: moved(simulator.step, t, x, u, p, dt)
        if plant.output_states is None:
            self.output = lambda t, x, u, p: simulator.output(t, x, np.array(list(u)[:n], dtype=object), p)


class _Corrected:
    """The simulator with its learned term, on single points of any kind of number."""

    def __init__(self, correction: DynamicsCorrection):
        plant = describe(correction.simulator)
        if correction.residual is not None:
            raise SimulatorError("a term made of your own transformers cannot be exported: use the default residual.")
        self._c, self.params, self.dt, self.hold = correction, dict(plant.params), plant.dt, plant.hold
        self.states, self.outputs = plant.states, plant.outputs
        if plant.access == "rhs":
            self.rhs = lambda t, x, u, p: self._moved(correction.simulator.rhs, t, x, u, p)
        else:
            self.step = lambda t, x, u, p, dt: self._moved(correction.simulator.step, t, x, u, p, dt)
        if plant.output_states is None:
            self.output = correction.simulator.output

    def _moved(self, function: Any, t: Any, x: Any, u: Any, p: Any, *extra: Any) -> list[Any]:
        term, u = self._c.terms, list(u)
        if term.on_inputs:
            for k, value in zip(term.targets, self._terms(u)):
                u[k] = u[k] + value
            return list(function(t, x, np.array(u, dtype=object), p, *extra))
        out = list(function(t, x, np.array(u, dtype=object), p, *extra))
        for k, value in zip(term.targets, self._terms([*x, *u])):
            out[k] = out[k] + value
        return out

    def _terms(self, z: list[Any]) -> list[Any]:
        """Values of the terms, one a target."""
        basis, domain = self._c.terms.basis, self._c.domain
        weight = None
        if np.isfinite(domain.fade):
            far: Any = 0.0
            for v, a, b, size in zip(z, domain.low, domain.high, domain.size):
                far = np.maximum(np.maximum((a - v) / size, (v - b) / size), far)
            ratio = np.maximum(far - domain.fade, 0.0) / max(domain.fade, 1e-12)
            weight = np.exp(-(ratio * ratio))
        scaled = [(v - m) / s for v, m, s in zip(z, basis.mean, basis.scale)]
        kernels = []
        for centre in basis.centres:
            away = sum((v - c) * (v - c) for v, c in zip(scaled, centre))
            kernels.append(np.exp(away * (-0.5 / basis.length**2)))
        of_kernels = self._c.coef[:, 1 + len(scaled) :] @ basis.mix  # one weight a kernel
        found = [
            float(row[0]) + sum(float(c) * v for c, v in zip([*row[1:], *weights], [*scaled, *kernels]))
            for row, weights in zip(self._c.coef[:, : 1 + len(scaled)], of_kernels)
        ]
        return found if weight is None else [v * weight for v in found]
