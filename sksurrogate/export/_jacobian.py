"""Exact slopes of any prediction by its inputs: pipelines by the chain rule."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from sklearn.utils.validation import check_is_fitted

from sksurrogate.exceptions import DataError, SurrogateError
from sksurrogate.export._describe import refuse_two_faces, to_graph
from sksurrogate.export._scalers import SCALERS, scaling_of


def input_jacobian(model: Any, X: Any) -> np.ndarray:
    """Exact slopes of the prediction of a fitted model by its inputs.

    Parameters
    ----------
    model : fitted estimator
        Any with a ``jacobian`` of its own (:class:`FNNRegressor`, :class:`PenalizedRegressor`, :class:`PCRRegressor`,
        :class:`NonlinearBasisRegressor`), what :func:`to_graph` knows (linear models, ``MLPRegressor``), pipelines and
        searches over these behind scalers, PCA, polynomials and the feature maps, and scaled targets.
    X : array-like (n_samples, n_features)
        Rows as for ``predict``.

    Returns
    -------
    ndarray (n_samples, n_features) or (n_samples, n_outputs, n_features)
        The first where ``predict`` gives one axis. Units of y over units of X. 0 by an input that a scaler clips.

    Raises
    ------
    SurrogateError
        A part has no slopes that are known; the message names it.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.3 (slope).

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.pipeline import make_pipeline
    >>> from sklearn.preprocessing import StandardScaler
    >>> from sksurrogate.export import input_jacobian
    >>> from sksurrogate.features import SplineFeatures
    >>> from sksurrogate.linear import PCRRegressor
    >>> x = np.linspace(0, 4, 50)[:, None]
    >>> model = make_pipeline(StandardScaler(), SplineFeatures(8, 3), PCRRegressor()).fit(x, x[:, 0] ** 2)
    >>> input_jacobian(model, [[1.0], [3.0]]).round(6)
    array([[2.],
           [6.]])
    """
    check_is_fitted(model)
    rows = np.asarray(X, dtype=float)
    if rows.ndim != 2 or not np.isfinite(rows).all():
        raise DataError(f"X has shape {rows.shape}: give finite rows (n_samples, n_features), as for predict.")
    slopes = chained_slopes(model, rows)
    return slopes[:, 0] if np.ndim(model.predict(X[:1])) == 1 else slopes


def chained_slopes(model: Any, X: np.ndarray, transforms: bool = False) -> np.ndarray:
    """Slopes (n_samples, n_outputs, n_inputs) of an estimator's prediction, or (``transforms``) of a transformer's columns."""
    best = getattr(model, "best_estimator_", None)
    if best is not None:
        return chained_slopes(best, X, transforms)
    if getattr(model, "steps", None) is not None:
        return _pipeline(model, X, transforms)
    refuse_two_faces(model, transforms)
    if type(model).__name__ == "TransformedTargetRegressor":
        return _scale_back(model.transformer_, chained_slopes(model.regressor_, X))
    if hasattr(model, "jacobian"):
        found = np.asarray(model.jacobian(X))
        return found[:, None] if found.ndim == 2 else found
    scaling = scaling_of(model)
    if scaling is not None:
        return scaling.slopes(X)[:, :, None] * np.eye(X.shape[1])
    slopes = to_graph(model).jacobian(x=X)["y", "x"]
    return np.broadcast_to(slopes, (len(X), *slopes.shape[1:]))


def _pipeline(model: Any, X: np.ndarray, transforms: bool) -> np.ndarray:
    """The chain rule over the steps."""
    slopes = np.repeat(np.eye(X.shape[1])[None], len(X), axis=0)
    parts = [step for _, step in model.steps if step is not None and step != "passthrough"]
    for k, step in enumerate(parts):
        last = k == len(parts) - 1
        slopes = chained_slopes(step, X, transforms or not last) @ slopes
        if not last:
            out = step.transform(X)
            X = out.toarray() if sparse.issparse(out) else np.asarray(out, dtype=float)
    return slopes


def _scale_back(transformer: Any, slopes: np.ndarray) -> np.ndarray:
    """Slopes of the target from those of the scaled one."""
    scaling = scaling_of(transformer)
    if scaling is None:
        raise SurrogateError(
            f"a target transformed by {type(transformer).__name__} has no known slopes: use a scaler "
            f"({', '.join(SCALERS)})."
        )
    return slopes * scaling.scale[:, None]
