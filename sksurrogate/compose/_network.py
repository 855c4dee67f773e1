"""Regressors that are networks or affine models, read as plain arrays and written back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate.export._agreement import agree, beyond
from sksurrogate.export._scalers import affine_map, scaling_of
from sksurrogate.kernels.net import Net
from sksurrogate.kernels.rows import LagRows

#: Activations that the kernels know.
_KINDS_OF_LAYERS = ("identity", "tanh", "logistic", "relu")


@dataclass(frozen=True)
class _Parts:
    """An estimator taken apart: ``y = model(phi @ matrix + offset) * y_scale + y_mean``."""

    model: Any
    matrix: np.ndarray | None
    offset: np.ndarray | float
    y_scale: np.ndarray | float = 1.0
    y_mean: np.ndarray | float = 0.0


def describe_network(estimator: Any) -> Net | None:
    """The network on raw features that a fitted regressor looks like, or None; :func:`agrees` says whether it is that.

    ``MLPRegressor``, ``FNNRegressor`` and models with ``coef_`` and ``intercept_``, also behind affine transformers of
    features (scalers, ``PCA``) in a pipeline or of the target (``TransformedTargetRegressor`` with a scaler).
    """
    parts = _take_apart(estimator)
    found = None if parts is None else _layers(parts.model)
    if parts is None or found is None:
        return None
    weights, biases, activations = found
    if parts.matrix is not None and parts.matrix.shape[-1] != len(weights[0]):
        return None
    biases[0] = biases[0] + np.broadcast_to(parts.offset, len(weights[0])) @ weights[0]
    if parts.matrix is not None:
        weights[0] = parts.matrix @ weights[0] if parts.matrix.ndim == 2 else parts.matrix[:, None] * weights[0]
    weights[-1], biases[-1] = weights[-1] * parts.y_scale, biases[-1] * parts.y_scale + parts.y_mean
    n = len(weights[0])
    return Net(tuple(weights), tuple(biases), activations, np.zeros(n), np.ones(n))


def write_network(estimator: Any, net: Net) -> bool:
    """Put a network on scaled features into the regressor that :func:`describe_network` read; False where it cannot."""
    parts = _take_apart(estimator)
    if parts is None or (parts.matrix is not None and parts.matrix.ndim == 2):
        return False
    if not {"coef_", "coefs_"} & set(vars(parts.model)):  # they show those of a model inside, which predicts
        return False
    weights, biases = list(net.weights), list(net.biases)
    weights[0] = weights[0] / net.scale[:, None]
    biases[0] = biases[0] - net.mean @ weights[0]
    weights[0] = weights[0] / (1.0 if parts.matrix is None else parts.matrix[:, None])
    biases[0] = biases[0] - np.broadcast_to(parts.offset, len(weights[0])) @ weights[0]
    weights[-1], biases[-1] = weights[-1] / parts.y_scale, (biases[-1] - parts.y_mean) / parts.y_scale
    model = parts.model
    if hasattr(model, "coefs_"):
        model.coefs_ = [w.astype(old.dtype) for w, old in zip(weights, model.coefs_)]
        model.intercepts_ = [b.astype(old.dtype) for b, old in zip(biases, model.intercepts_)]
        if hasattr(model, "_layers"):  # FNNRegressor predicts from these
            model._layers = replace(model._layers, weights=tuple(model.coefs_), biases=tuple(model.intercepts_))
            model.__dict__.pop("_net", None)
        return True
    flat = np.ndim(model.coef_) == 1
    model.coef_ = weights[0][:, 0].copy() if flat else weights[0].T.copy()
    model.intercept_ = float(biases[0][0]) if flat else biases[0].copy()
    return True


def agrees(function: Callable[[np.ndarray], np.ndarray], estimator: Any, phi: np.ndarray | LagRows) -> bool:
    """Whether a plain function is what the regressor predicts, at some of its training rows and far beyond them."""
    some = np.asarray(phi[:: max(len(phi) // 16, 1)])
    return agree(function, estimator.predict, [some, *beyond(some)])


def _take_apart(estimator: Any) -> _Parts | None:
    """The model inside, with the affine maps around it."""
    y_scale: Any = 1.0
    y_mean: Any = 0.0
    if type(estimator).__name__ == "TransformedTargetRegressor":
        scaling = scaling_of(estimator.transformer_)
        if scaling is None:
            return None
        y_scale, y_mean = scaling.scale, scaling.center
        estimator = estimator.regressor_
    steps = list(getattr(estimator, "steps", None) or [("model", estimator)])
    matrix: Any = None
    offset: Any = 0.0
    for _, step in steps[:-1]:
        if step is None or step == "passthrough":
            continue
        affine = affine_map(step)
        if affine is None:
            return None
        # (phi M + o) A + c, where M and A are matrices or diagonals
        A, c = affine
        offset = (offset @ A if np.ndim(offset) else np.broadcast_to(offset, len(A)) @ A) if A.ndim == 2 else offset * A
        offset = offset + c
        matrix = A if matrix is None else _product(matrix, A)
    return _Parts(steps[-1][1], matrix, offset, y_scale, y_mean)


def _product(M: np.ndarray, A: np.ndarray) -> np.ndarray:
    """Product of two maps, each a matrix or a diagonal."""
    if M.ndim == 1:
        return M * A if A.ndim == 1 else M[:, None] * A
    return M * A if A.ndim == 1 else M @ A


def _layers(model: Any) -> tuple[list[np.ndarray], list[np.ndarray], tuple[str, ...]] | None:
    """Weights, biases and hidden activations of a network or linear model."""
    if hasattr(model, "coefs_") and hasattr(model, "intercepts_"):
        weights = [np.asarray(w, dtype=float) for w in model.coefs_]
        last = getattr(model, "out_activation_", "identity")  # MLPRegressor; FNNRegressor names every layer's
        every = getattr(model, "activations_", None) or (*(model.activation,) * (len(weights) - 1), last)
        kinds = tuple(every[:-1])
        if len(every) != len(weights) or every[-1] != "identity" or not all(kind in _KINDS_OF_LAYERS for kind in kinds):
            return None
        return weights, [np.asarray(b, dtype=float) for b in model.intercepts_], kinds
    if not hasattr(model, "coef_") or not hasattr(model, "intercept_") or getattr(model, "features_", None) is not None:
        return None  # weights of features that the model makes itself are not weights of its inputs
    coef = np.atleast_2d(np.asarray(model.coef_, dtype=float))
    if coef.ndim != 2 or hasattr(model, "dual_coef_"):
        return None
    bias = np.broadcast_to(np.atleast_1d(model.intercept_), (len(coef),)).astype(float)
    return [np.ascontiguousarray(coef.T)], [bias], ()
