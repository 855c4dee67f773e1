"""Time-series models in state-space form: derivatives behind an integrator, state-space models, filters of inputs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sksurrogate.exceptions import SurrogateError
from sksurrogate.export._graph import Graph

AddEstimator = Callable[[Graph, Any, int], int]


def substeps_of(n_sub: Any, default: int) -> int:
    """Substeps per sample as they were asked for, a default where they were not.

    >>> substeps_of(None, 4), substeps_of(2, 4)
    (4, 2)
    """
    if n_sub is None:
        return default
    if not isinstance(n_sub, (int, np.integer)) or isinstance(n_sub, bool) or n_sub < 1:
        raise SurrogateError(f"n_sub={n_sub!r}: expected a whole number of substeps of at least 1, or None.")
    return int(n_sub)


def runge_kutta(graph: Graph, rate: Callable[[int], int], x: int, dt: float, n_sub: int) -> int:
    """The state a sample later, by ``n_sub`` steps of order 4."""
    h = dt / n_sub

    def moved(at: int, slope: int, by: float) -> int:
        return graph.binary("add", at, graph.binary("mul", slope, graph.constant(by)))

    for _ in range(n_sub):
        k1 = rate(x)
        k2 = rate(moved(x, k1, h / 2))
        k3 = rate(moved(x, k2, h / 2))
        k4 = rate(moved(x, k3, h))
        middle = graph.binary("mul", graph.binary("add", k2, k3), graph.constant(2.0))
        x = moved(x, graph.binary("add", graph.binary("add", k1, k4), middle), h / 6)
    return x


def _n_inputs(model: Any) -> int:
    """Columns of X that are inputs."""
    named = [getattr(model, name, None) for name in ("run", "time")]
    return int(model.n_features_in_) - sum(name is not None and name != "index" for name in named)


def add_derivative_model(graph: Graph, model: Any, add_estimator: AddEstimator) -> None:
    """A :class:`DerivativeRegressor`: the state is the outputs."""
    if model.hold != "zoh" or model.method != "RK4":
        raise SurrogateError(
            f'DerivativeRegressor(hold={model.hold!r}, method={model.method!r}) cannot be exported: only hold="zoh" with '
            'method="RK4" is a fixed number of operations.'
        )
    if model.dt is None and model.time is not None:
        raise SurrogateError("DerivativeRegressor(time=...) has no sample time of its own: set_params(dt=...) first.")
    graph.dt = float(model.dt or 1.0)
    x, u = graph.input("x", len(model.y_mean_)), graph.input("u", _n_inputs(model))
    graph.outputs["x_next"] = runge_kutta(
        graph, lambda at: add_estimator(graph, model.estimator_, graph.concat(at, u)), x, graph.dt, int(model.n_sub_)
    )
    graph.outputs["y"] = x
    graph.initial = np.array(model.y_mean_, dtype=float)


def add_state_model(graph: Graph, model: Any) -> None:
    """A :class:`StateSpaceRegressor`."""
    inner = model.model_
    x, raw = graph.input("x", inner.n_states), graph.input("u", inner.n_inputs)
    u = graph.scaled(raw, model.u_mean_, model.u_spread_)
    both, size = graph.concat(x, u), inner.f.size

    def block(parts: list[np.ndarray], z: int) -> int:
        out = graph.affine(z, parts[0], parts[1])
        layers = parts[2:]
        if not layers:
            return out
        for k in range(0, len(layers) - 2, 2):
            z = graph.unary("tanh", graph.affine(z, layers[k], layers[k + 1]))
        return graph.binary("add", out, graph.affine(z, layers[-2], layers[-1]))

    graph.outputs["x_next"] = block(inner.f.parts(model.theta_[:size]), both)
    y = block(inner.g.parts(model.theta_[size:]), both if inner.feedthrough else x)
    graph.outputs["y"] = graph.affine(y, np.diag(model.y_spread_), model.y_mean_)
    graph.initial = np.array(model.x_mean_, dtype=float)
    graph.dt = None if getattr(model, "dt", None) is None else float(model.dt)


def add_filter(graph: Graph, model: Any) -> None:
    """A :class:`LaggedLinearRegressor`: the state is the past rows of X, newest first."""
    n, deepest = _n_inputs(model), int(model.max_lag_)
    x, u = graph.input("x", n * deepest), graph.input("u", n)
    whole = graph.concat(u, x)
    coef = np.atleast_2d(np.asarray(model.coef_, dtype=float))
    seen = graph.take(whole, [lag * n + column for column, lag in model.columns_])
    graph.outputs["x_next"] = graph.take(whole, np.arange(n * deepest))
    graph.outputs["y"] = graph.affine(seen, coef.T, np.ravel(model.intercept_))
