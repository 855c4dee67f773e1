"""Feature maps as graphs: splines without branches, steps, waves and bumps.

A spline basis of degree p >= 1 is continuous, so that phi(x) = phi(low) + sum_i (P_i(s_i) - P_i(0)), where P_i are the
polynomials of interval i and s_i the place within it, held at 0 before it and at 1 behind it. Only products, minima and
maxima and one matrix are needed, exact on any knots and without cancellation.
"""

from __future__ import annotations

from math import comb, factorial
from typing import Any

import numpy as np

from sksurrogate.exceptions import SurrogateError
from sksurrogate.export._graph import Graph

FEATURE_MAPS = ("SplineFeatures", "HeavisideFeatures", "FourierFeatures", "GaussianFeatures")
#: Stands for "no bound" where a generated text could not hold infinity.
NO_BOUND = 1e30


def add_features(graph: Graph, model: Any, x: int) -> int:
    """The features of a fitted map of :mod:`sksurrogate.features` at node x."""
    kind = type(model).__name__
    if kind == "GaussianFeatures" and model.interaction == "radial":
        return _radial(graph, model, x)
    add = {
        "SplineFeatures": _spline,
        "HeavisideFeatures": _steps,
        "FourierFeatures": _waves,
        "GaussianFeatures": _bumps,
    }[kind]
    blocks = [add(graph, basis, graph.take(x, [j])) for j, basis in enumerate(model.bases_)]
    if model.interaction not in (True, "tensor"):
        return graph.concat(*blocks)
    out = blocks[0]
    for block in blocks[1:]:
        n, m = graph.nodes[out].size, graph.nodes[block].size
        left, right = np.repeat(np.arange(n), m), np.tile(np.arange(m), n)
        out = graph.binary("mul", graph.take(out, left), graph.take(block, right))
    return out


def _spline(graph: Graph, basis: Any, x: int) -> int:
    """Splines of one input."""
    if basis.extrapolation == "periodic":
        raise SurrogateError(
            'SplineFeatures(extrapolation="periodic") cannot be exported, because the graph has no remainder operation: '
            "wrap the input outside, or use FourierFeatures."
        )
    if basis.degree == 0:
        out = _pulses(graph, basis, x)
    else:
        out = _pieces(graph, basis, x)
        if basis.extrapolation == "linear":
            ends = np.array([basis.low, basis.high])
            slopes = _dense(basis, ends, ends, 1) * [[-1.0], [1.0]]
            outside = graph.unary("relu", graph.affine(x, [[-1.0, 1.0]], [basis.low, -basis.high]))
            out = graph.binary("add", out, graph.affine(outside, slopes))
    if basis.extrapolation == "zero":
        inside = graph.binary("mul", _from(graph, x, [basis.low], 1.0), _from(graph, x, [basis.high], -1.0))
        out = graph.binary("mul", out, inside)
    return out


def _dense(basis: Any, place: np.ndarray, x: np.ndarray, derivative: int) -> np.ndarray:
    """Splines at x by the polynomials of the interval in which ``place`` lies, (n_points, n_splines)."""
    first, weights = basis.piece(place, x, derivative)
    out = np.zeros((len(x), basis.n_splines))
    np.put_along_axis(out, first[:, None] + np.arange(basis.degree + 1), weights, axis=1)
    return out


def _pieces(graph: Graph, basis: Any, x: int) -> int:
    """Value at the left end and the rise over every interval up to x."""
    n, degree = basis.n_intervals, basis.degree
    left = basis.knots[degree : degree + n]
    widths = np.diff(basis.knots[degree : degree + n + 1])
    low, high = np.zeros(n), np.ones(n)
    if basis.extrapolation == "continue":
        low[0], high[-1] = -NO_BOUND, NO_BOUND
    place = graph.clipped(graph.affine(x, 1.0 / widths[None, :], -left / widths), low, high)
    powers, rows = [place], [_taylor(basis, left, widths, 1)]
    for k in range(2, degree + 1):
        powers.append(graph.binary("mul", powers[-1], place))
        rows.append(_taylor(basis, left, widths, k))
    return graph.affine(graph.concat(*powers), np.vstack(rows), _dense(basis, left[:1], left[:1], 0)[0])


def _taylor(basis: Any, left: np.ndarray, widths: np.ndarray, k: int) -> np.ndarray:
    """Coefficient of s^k on each interval, (n_intervals, n_splines)."""
    return _dense(basis, left + widths / 2, left, k) * widths[:, None] ** k / factorial(k)


def _from(graph: Graph, x: int, thresholds: Any, direction: float) -> int:
    """1 from the threshold on (direction 1), or up to it (-1), the threshold included; else 0."""
    thresholds = np.asarray(thresholds, dtype=float)
    beyond = graph.affine(x, np.full((1, len(thresholds)), -direction), direction * thresholds)
    return graph.affine(graph.unary("relu", graph.unary("sign", beyond)), -np.eye(len(thresholds)), 1.0)


def _pulses(graph: Graph, basis: Any, x: int) -> int:
    """Adjacent pulses as differences of steps (Remark 1); the ends are open."""
    n = basis.n_intervals
    if n == 1:
        return graph.affine(x, [[0.0]], 1.0)
    differences = np.zeros((n - 1, n))
    differences[np.arange(n - 1), np.arange(n - 1)] = -1.0
    differences[np.arange(n - 1), np.arange(1, n)] = 1.0
    return graph.affine(_from(graph, x, basis.knots[1:-1], 1.0), differences, np.eye(n)[0])


def _steps(graph: Graph, basis: np.ndarray, x: int) -> int:
    """Unit steps."""
    return _from(graph, x, basis, 1.0)


def _waves(graph: Graph, basis: Any, x: int) -> int:
    """Constant, sines and cosines in turn."""
    n = len(basis.lengths)
    turn = graph.affine(x, (2 * np.pi / basis.lengths)[None, :])
    both = graph.concat(graph.unary("sin", turn), graph.unary("cos", turn))
    pairs = graph.take(both, np.stack([np.arange(n), n + np.arange(n)], axis=1))
    return graph.concat(graph.constant(1.0), pairs) if basis.constant else pairs


def _bell(graph: Graph, squares: int) -> int:
    """exp(-z / 2)."""
    return graph.unary("exp", graph.binary("mul", squares, graph.constant(-0.5)))


def _bumps(graph: Graph, basis: Any, x: int) -> int:
    """Gaussians of one input."""
    z = graph.affine(x, np.full((1, len(basis.centers)), 1.0 / basis.width), -basis.centers / basis.width)
    return _bell(graph, graph.binary("mul", z, z))


def _radial(graph: Graph, model: Any, x: int) -> int:
    """Gaussians of the distance over all inputs."""
    n, width = len(model.bases_[0].centers), model.bases_[0].width
    total = -1
    for j, basis in enumerate(model.bases_):
        z = graph.affine(graph.take(x, [j]), np.full((1, n), 1.0 / width), -basis.centers / width)
        squares = graph.binary("mul", z, z)
        total = squares if j == 0 else graph.binary("add", total, squares)
    return _bell(graph, total)


def add_free_basis(graph: Graph, model: Any, x: int) -> int:
    """The prediction of a :class:`~sksurrogate.linear.NonlinearBasisRegressor`: functions with fitted places and widths."""
    x = graph.scaled(x, model._mean, model._scale)
    basis, omega = model._basis, model._omega
    if hasattr(basis, "ramps"):
        functions = _free_knots(graph, basis, omega.reshape(basis.n_inputs, basis.n_basis), x)
    else:
        centres, log_widths = omega.reshape(2, basis.n_basis, basis.n_inputs)
        functions = -1
        for i in range(basis.n_inputs):
            z = graph.scaled(graph.take(x, [i] * basis.n_basis), centres[:, i], np.exp(log_widths[:, i]))
            one = _bell(graph, graph.binary("mul", z, z)) if basis.degree < 0 else _cardinal(graph, basis.degree, z)
            functions = one if i == 0 else graph.binary("mul", functions, one)
    return graph.affine(functions, model._theta[:-1], model._theta[-1])


def _power(graph: Graph, x: int, p: int) -> int:
    """x^p."""
    out = x
    for _ in range(p - 1):
        out = graph.binary("mul", out, x)
    return out


def _cardinal(graph: Graph, p: int, z: int) -> int:
    """The cardinal spline of degree p and height 1, as a sum of truncated powers."""
    half, total = 0.5 * (p + 1), -1
    height = sum((-1) ** k * comb(p + 1, k) * (half - k) ** p for k in range((p + 2) // 2))  # k < half
    for k in range(p + 2):
        ramp = graph.unary("relu", graph.binary("add", z, graph.constant(half - k)))
        part = graph.binary("mul", _power(graph, ramp, p), graph.constant((-1) ** k * comb(p + 1, k) / height))
        total = part if k == 0 else graph.binary("add", total, part)
    inside = graph.unary("relu", graph.unary("sign", graph.binary("sub", graph.constant(half), graph.unary("abs", z))))
    return graph.binary("mul", total, inside)


def _free_knots(graph: Graph, basis: Any, knots: np.ndarray, x: int) -> int:
    """Powers of every input, then truncated powers at its knots."""
    powers = [_power(graph, x, k) for k in range(1, basis.degree + 1)]
    n = basis.n_basis
    ramps = [
        graph.unary("relu", graph.binary("sub", graph.take(x, [i] * n), graph.constant(row)))
        for i, row in enumerate(knots)
    ]
    return graph.concat(*powers, *(_power(graph, ramp, basis.degree) for ramp in ramps))
