"""Regressors that are networks or linear models, read as plain arrays and written back."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.kernels.rollout import Net

__all__ = ["describe_network", "write_network"]

#: Linear models whose ``coef_`` and ``intercept_`` are the whole prediction.
_LINEAR = ("LinearRegression", "Ridge", "RidgeCV", "Lasso", "LassoCV", "ElasticNet", "ElasticNetCV")


def describe_network(estimator: Any) -> Net | None:
    """The fitted regressor as a network, or None where it is something else."""
    steps = list(getattr(estimator, "steps", None) or [("model", estimator)])
    scalers, model = [step for _, step in steps[:-1]], steps[-1][1]
    if len(scalers) > 1 or any(type(scaler).__name__ != "StandardScaler" for scaler in scalers):
        return None
    kind = type(model).__name__
    if kind == "MLPRegressor" and type(model).__module__.startswith("sklearn."):
        weights, biases, activation = tuple(model.coefs_), tuple(model.intercepts_), model.activation
    elif kind in _LINEAR and type(model).__module__.startswith("sklearn."):
        coef = np.atleast_2d(model.coef_)
        bias = np.broadcast_to(np.atleast_1d(model.intercept_), (len(coef),)).astype(float)
        weights, biases, activation = (np.ascontiguousarray(coef.T),), (bias,), "identity"
    else:
        return None
    n = len(weights[0])
    mean, scale = np.zeros(n), np.ones(n)
    if scalers:
        mean = mean if scalers[0].mean_ is None else scalers[0].mean_
        scale = scale if scalers[0].scale_ is None else scalers[0].scale_
    return Net(weights, biases, activation, mean, scale)


def write_network(estimator: Any, net: Net) -> None:
    """Put the weights of a network back into the regressor that :func:`describe_network` read."""
    steps = list(getattr(estimator, "steps", None) or [("model", estimator)])
    model = steps[-1][1]
    if hasattr(model, "coefs_"):
        model.coefs_, model.intercepts_ = [w.copy() for w in net.weights], [b.copy() for b in net.biases]
        return
    flat = np.ndim(model.coef_) == 1
    model.coef_ = net.weights[0][:, 0].copy() if flat else net.weights[0].T.copy()
    model.intercept_ = float(net.biases[0][0]) if flat else net.biases[0].copy()
