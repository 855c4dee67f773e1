"""Fitted estimators and simulators as graphs."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.utils.validation import check_is_fitted

from sksurrogate.exceptions import SurrogateError
from sksurrogate.export._agreement import agree, dense, is_affine, probes
from sksurrogate.export._dynamic import add_derivative_model, add_filter, add_state_model, runge_kutta, substeps_of
from sksurrogate.export._features import FEATURE_MAPS, add_features, add_free_basis
from sksurrogate.export._graph import Graph
from sksurrogate.export._scalers import SCALERS, projection_of, scaling_of
from sksurrogate.export._symbol import joined, symbols

#: sklearn's activations -> the graph's.
_ACTIVATIONS = {
    "tanh": "tanh",
    "logistic": "logistic",
    "sigmoid": "logistic",
    "relu": "relu",
    "exp": "exp",
    "identity": "",
}

#: Substeps of a right-hand side a sample where nothing else is known.
SUBSTEPS = 4


def to_graph(model: Any, n_sub: int | None = None) -> Graph:
    """A fitted model as a graph.

    Parameters
    ----------
    model : fitted estimator or simulator
        Linear models, ``MLPRegressor``, ``FNNRegressor``, scalers (centred or not, with ``clip`` or not), ``PCA``, ``PolynomialFeatures``,
        the feature maps (splines, steps, waves, bumps), ``NonlinearBasisRegressor`` and pipelines of them: input "x", output "y".
        :class:`RecursivePredictor`, :class:`StateSpaceRegressor`, :class:`DerivativeRegressor`, :class:`LaggedLinearRegressor`,
        :class:`HybridRegressor` and simulators with a right-hand side or a step: inputs "x" (state) and "u", outputs "x_next" and "y".
    n_sub : int, optional
        Runge-Kutta substeps per sample of a right-hand side; None: those of the model where it has its own (hybrids), else 4.
        ``simulator.substeps(U, x0)`` gives the number that its ``simulate`` takes: with it both are equal to 1e-9.

    Returns
    -------
    Graph
        Callable with arrays; has exact Jacobians.

    Raises
    ------
    SurrogateError
        The model cannot be written as a graph; the message names the part.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.linear_model import LinearRegression
    >>> from sksurrogate.export import to_graph
    >>> to_graph(LinearRegression().fit([[0.0], [1.0]], [1.0, 3.0]))(x=[2.0])["y"].round(6)
    array([5.])
    """
    substeps = substeps_of(n_sub, SUBSTEPS)
    if hasattr(model, "to_graph"):
        return model.to_graph(n_sub=n_sub)
    graph = Graph()
    kind = type(model).__name__
    if kind in ("DerivativeRegressor", "StateSpaceRegressor", "LaggedLinearRegressor"):
        check_is_fitted(model)
        if kind == "DerivativeRegressor":
            add_derivative_model(graph, model, add_estimator)
        else:
            (add_state_model if kind == "StateSpaceRegressor" else add_filter)(graph, model)
        return graph
    if hasattr(model, "output_lags") and hasattr(model, "input_lags"):
        return _recursive(graph, model)
    if getattr(model, "states", None) is not None and (hasattr(model, "rhs") or hasattr(model, "step")):
        if getattr(model, "inputs", None) is None or getattr(model, "outputs", None) is None:
            raise SurrogateError(f"{kind} does not name its signals: give it inputs=[...] and outputs=[...].")
        x, u = graph.input("x", len(model.states)), graph.input("u", len(model.inputs))
        graph.outputs["x_next"], graph.outputs["y"] = add_step(graph, model, x, u, substeps)
        graph.dt = float(getattr(model, "dt", None) or 1.0)
        return graph
    check_is_fitted(model)
    x = graph.input("x", int(model.n_features_in_))
    graph.outputs["y"] = add_estimator(graph, model, x)
    return graph


def add_estimator(graph: Graph, model: Any, x: int, transforms: bool = False) -> int:
    """The prediction (or transformation) of a fitted estimator at node x; ``transforms``: others come behind it."""
    steps = getattr(model, "steps", None)
    if steps is not None:
        parts = [step for _, step in steps if step is not None and step != "passthrough"]
        for k, step in enumerate(parts):
            x = add_estimator(graph, step, x, transforms or k < len(parts) - 1)
        return x
    kind = type(model).__name__
    refuse_two_faces(model, transforms)
    if kind == "TransformedTargetRegressor":
        return _back(graph, model.transformer_, add_estimator(graph, model.regressor_, x))
    scaling, projection = scaling_of(model), projection_of(model)
    if scaling is not None:
        z = graph.scaled(x, scaling.center, scaling.scale)
        return z if scaling.bounds is None else graph.clipped(z, *scaling.bounds)
    if projection is not None:
        return graph.affine(graph.binary("sub", x, graph.constant(model.mean_)), projection)
    if kind == "PolynomialFeatures":
        return _monomials(graph, x, model.powers_)
    if kind in FEATURE_MAPS:
        return add_features(graph, model, x)
    if kind == "NonlinearBasisRegressor":
        return add_free_basis(graph, model, x)
    if hasattr(model, "classes_"):
        raise SurrogateError(
            f"{kind} cannot be exported: it is a classifier, whose predict gives labels. Fit a regressor to "
            "its predict_proba or decision_function, and export that."
        )
    return _by_coefficients(graph, model, x)


def _by_coefficients(graph: Graph, model: Any, x: int) -> int:
    """A model whose attributes look like those of a network or linear model, if it predicts what they say."""
    kind, inner = type(model).__name__, getattr(model, "features_", None)
    features = x if inner is None else add_estimator(graph, inner, x, transforms=True)
    n = graph.nodes[features].size
    if hasattr(model, "coefs_") and hasattr(model, "intercepts_"):
        alone = Graph()
        alone.outputs["y"] = _network(alone, model, alone.input("x", n))
        rows = probes(graph.nodes[x].size)
        made = (lambda rows: rows) if inner is None else (lambda rows: dense(inner.transform(rows)))
        if agree(lambda rows: alone(x=made(rows))["y"], model.predict, rows):
            return _network(graph, model, features)
    elif hasattr(model, "coef_") and hasattr(model, "intercept_") and hasattr(model, "predict"):
        coef = np.atleast_2d(np.asarray(model.coef_, dtype=float))
        centred = getattr(model, "_x_mean", None) if kind in ("PLSRegression", "PLSCanonical", "CCA") else None
        if coef.shape[1] == n and centred is not None:
            features = graph.binary("sub", x, graph.constant(centred))
            bias = np.ravel(model.intercept_)
            if agree(lambda rows: (rows - centred) @ coef.T + bias, model.predict, probes(n)):
                return graph.affine(features, coef.T, bias)
        elif coef.shape[1] == n and is_affine(model):
            return graph.affine(features, coef.T, np.ravel(model.intercept_))
    raise SurrogateError(
        f"{kind} cannot be exported: its prediction is not a fixed formula that is known here. Linear models, PLS, "
        "MLPRegressor, FNNRegressor, scalers, PCA, PolynomialFeatures, the feature maps of sksurrogate.features, NonlinearBasisRegressor and pipelines "
        "of them can; for CasADi or ONNX of other models see skl2onnx, or fit one of these to its predictions."
    )


def refuse_two_faces(model: Any, transforms: bool) -> None:
    """Inside a pipeline a regressor that also transforms, such as ``PLSRegression``, is not its prediction."""
    if transforms and hasattr(model, "predict"):
        raise SurrogateError(
            f"{type(model).__name__} before the last step of a pipeline has no formula here: its transform is not its "
            "predict. Let it be the last step, or use PCA in its place."
        )


def _back(graph: Graph, transformer: Any, y: int) -> int:
    """Inverse of a scaler of targets; none of them clips on the way back."""
    scaling = scaling_of(transformer)
    if scaling is None:
        raise SurrogateError(
            f"a target transformed by {type(transformer).__name__} cannot be exported: use a scaler ({', '.join(SCALERS)})."
        )
    return graph.affine(y, np.diag(scaling.scale), scaling.center)


def _network(graph: Graph, model: Any, x: int) -> int:
    """Layers of a feedforward network."""
    n = len(model.coefs_)
    last = getattr(model, "out_activation_", "identity")
    names = list(getattr(model, "activations_", None) or [model.activation] * (n - 1) + [last])
    for weight, bias, name in zip(model.coefs_, model.intercepts_, names):
        if name not in _ACTIVATIONS:
            raise SurrogateError(
                f"activation={name!r} of {type(model).__name__} cannot be exported: {', '.join(_ACTIVATIONS)} can."
            )
        x = graph.affine(x, weight, bias)
        x = graph.unary(_ACTIVATIONS[name], x) if _ACTIVATIONS[name] else x
    return x


def _monomials(graph: Graph, x: int, powers: np.ndarray) -> int:
    """Products of powers, one factor at a time for all monomials together."""
    n = graph.nodes[x].size
    factors = [np.repeat(np.arange(n), row) for row in powers]
    one = graph.concat(x, graph.constant(1.0))
    degree = max([1, *map(len, factors)])
    table = np.full((degree, len(factors)), n)
    for k, row in enumerate(factors):
        table[: len(row), k] = row
    out = graph.take(one, table[0])
    for row in table[1:]:
        out = graph.binary("mul", out, graph.take(one, row))
    return out


def _recursive(graph: Graph, model: Any) -> Graph:
    """A lag model in state-space form; the state holds past outputs and inputs, newest first."""
    check_is_fitted(model, "estimator_")
    lags = list(model.output_lags_)
    terms = [(int(column), int(lag)) for column, lag in model.input_terms_]
    o, deepest = len(model.y_mean_), max(lags)
    n_u = int(model.n_features_in_) - (0 if model.run is None or model.run == "index" else 1)
    back = max([lag for _, lag in terms], default=0)
    x, u = graph.input("x", deepest * o + back * n_u), graph.input("u", n_u)
    whole = graph.concat(x, u)
    places = [(lag - 1) * o + j for lag in lags for j in range(o)]
    places += [deepest * o + (lag - 1) * n_u + c if lag else deepest * o + back * n_u + c for c, lag in terms]
    y = add_estimator(graph, model.estimator_, graph.take(whole, places))
    graph.outputs["x_next"] = shifted(graph, x, u, y, deepest * o, back * n_u)
    graph.outputs["y"] = y
    return graph


def shifted(graph: Graph, x: int, u: int, y: int, past: int, inputs: int) -> int:
    """Windows of ``past`` numbers of y and ``inputs`` numbers of u, moved on by one sample."""
    o, n_u = graph.nodes[y].size, graph.nodes[u].size
    parts = [y]
    if past > o:
        parts.append(graph.take(x, np.arange(past - o)))
    if inputs:
        parts.append(u)
    if inputs > n_u:
        parts.append(graph.take(x, past + np.arange(inputs - n_u)))
    return graph.concat(*parts)


def add_step(graph: Graph, simulator: Any, x: int, u: int, n_sub: int) -> tuple[int, int]:
    """Next state and output of a simulator with ``rhs`` (held inputs, Runge-Kutta of order 4) or ``step``."""
    params = dict(getattr(simulator, "params", None) or {})
    if getattr(simulator, "events", None):
        raise SurrogateError(
            "a right-hand side with events cannot be exported: finding the moment of an event is not a fixed formula."
        )
    _refuse_time(simulator, params)
    try:
        return _stepped(graph, simulator, params, x, u, n_sub)
    except (TypeError, AttributeError) as error:  # a function of numpy or others that a graph does not have
        raise SurrogateError(f"{type(simulator).__name__} cannot be exported: {error}") from error


def _stepped(graph: Graph, simulator: Any, params: dict[str, Any], x: int, u: int, n_sub: int) -> tuple[int, int]:
    """:func:`add_step` of functions that take symbols."""
    if getattr(simulator, "hold", "zoh") != "zoh":
        raise SurrogateError('hold="foh" cannot be exported: a step needs the input held, hold="zoh".')
    dt, us = float(getattr(simulator, "dt", None) or 1.0), symbols(graph, u)
    output = getattr(simulator, "output", None)
    if callable(output):
        y = joined(graph, output(0.0, symbols(graph, x), us, params))
    else:
        outputs = [simulator.outputs] if isinstance(simulator.outputs, str) else list(simulator.outputs)
        y = graph.take(x, [list(simulator.states).index(name) for name in outputs])
    if not hasattr(simulator, "rhs"):
        return joined(graph, simulator.step(0.0, symbols(graph, x), us, params, dt)), y

    if hasattr(simulator, "held_map"):  # linear, stepped by the matrix exponential
        F, G, g = simulator.held_map()
        return graph.affine(graph.concat(x, u), np.vstack([F.T, G.T]), g), y

    def rate(at: int) -> int:
        return joined(graph, simulator.rhs(0.0, symbols(graph, at), us, params))

    return runge_kutta(graph, rate, x, dt, n_sub), y


def _refuse_time(simulator: Any, params: dict[str, Any]) -> None:
    """A graph has no clock: functions that use t must not pass in silence."""
    rng = np.random.default_rng(0)
    x, u = (
        rng.uniform(0.3, 0.9, len(simulator.states)),
        rng.uniform(0.3, 0.9, len(getattr(simulator, "inputs", ()) or ())),
    )
    dt = float(getattr(simulator, "dt", None) or 1.0)
    for name, extra in (("rhs", ()), ("step", (dt,)), ("output", ())):
        function = getattr(simulator, name, None)
        if not callable(function) or (name == "step" and callable(getattr(simulator, "rhs", None))):
            continue
        try:
            with np.errstate(all="ignore"):
                values = [np.asarray(function(t, x, u, params, *extra), dtype=float) for t in (0.0, 0.7391, 12.9)]
        except Exception:  # points that the functions do not like prove nothing
            continue
        if not all(np.array_equal(values[0], value, equal_nan=True) for value in values[1:]):
            raise SurrogateError(
                f"{name} depends on the time t, and x_next, y = f(x, u) has no time: make t a state with dt/dt = 1, or "
                "make the signal that it drives an input."
            )
