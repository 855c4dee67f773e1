"""The linear model in which an estimator ends: what it demands of its coefficients, and how found ones are put into it."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.linear_model import (
    ElasticNet,
    ElasticNetCV,
    Lars,
    LassoCV,
    MultiTaskElasticNetCV,
    MultiTaskLassoCV,
    OrthogonalMatchingPursuit,
    OrthogonalMatchingPursuitCV,
)
from sklearn.pipeline import Pipeline
from sklearn.utils import get_tags

from sksurrogate.exceptions import DataError
from sksurrogate.linear._sparse import SparseRegressor

#: Linear models whose point is that terms are left out; ``Lasso`` and others are kinds of these.
_SPARSE = (
    SparseRegressor,
    ElasticNet,
    ElasticNetCV,
    LassoCV,
    MultiTaskElasticNetCV,
    MultiTaskLassoCV,
    Lars,
    OrthogonalMatchingPursuit,
    OrthogonalMatchingPursuitCV,
)
#: Rows from which a model learns what is not its coefficients.
_ROWS = 1000


def last_model(estimator: Any) -> Any:
    """The model behind the steps of pipelines and scaled targets, unfitted as it was given."""
    while True:
        if getattr(estimator, "steps", None):
            estimator = estimator.steps[-1][1]
        elif type(estimator).__name__ == "TransformedTargetRegressor":
            estimator = estimator.regressor
        else:
            return estimator


def has_intercept(estimator: Any) -> bool:
    """Whether a constant is added at the end."""
    return bool(getattr(last_model(estimator), "fit_intercept", True))


def refuse_demands(estimator: Any, fit: str, instead: str) -> None:
    """Raise DataError where the model demands of its coefficients what a fit through the free run cannot keep.

    ``fit``: what asks for that fit, as typed.
    ``instead``: a fit that keeps it, as typed.
    """
    model = last_model(estimator)
    name, constraints = type(model).__name__, getattr(model, "constraints", None)
    said = None
    if getattr(model, "positive", False):
        said = "positive=True"
    elif constraints is not None and len(constraints):
        said = f"constraints=[{', '.join(type(one).__name__ for one in constraints)}]"
    if said is not None:
        raise DataError(
            f"{fit} fits the coefficients freely and cannot keep {name}({said}): use {instead}, or leave {said.split('=')[0]} out."
        )
    if isinstance(model, _SPARSE) and getattr(model, "l1_ratio", 1.0) != 0:
        raise DataError(
            f"{fit} fits all coefficients and leaves no term out, as {name} does: use {instead}, or another linear model "
            "such as Ridge, with the terms that are wanted."
        )


def functions_of(residual: Any) -> Any:
    """The transformer that makes what the coefficients stand for; None: the features as they are."""
    steps = getattr(residual, "steps", None) or []
    inner = getattr(last_model(residual), "features", None)
    if inner is not None:
        return Pipeline([*steps[:-1], ("features of the model", inner)])
    return residual[:-1] if len(steps) > 1 else None


def with_coefficients(
    residual: Any, transformer: Any, rows: np.ndarray, coef: np.ndarray, offset: np.ndarray, form: str
) -> Any:
    """The residual, fitted, with given coefficients.

    ``transformer``: :func:`functions_of` it, fitted.
    ``rows`` (n_rows, n_features): what it is to be asked for.
    ``coef`` (n_targets, n_basis), ``offset`` (n_targets,).
    Raises DataError where it is another function than ``transformer(rows) @ coef.T + offset``.
    """
    fitted = clone(residual)
    last, seen = last_model(fitted), rows[:: max(len(rows) // _ROWS, 1)]
    inner = getattr(last, "features", None) is not None
    steps = list(getattr(transformer, "steps", []))
    outer, made = steps[:-1] if inner else steps, seen
    if getattr(fitted, "steps", None):
        fitted.steps = [*outer, fitted.steps[-1]]
    for _, step in outer:
        made = made if step in (None, "passthrough") else step.transform(made)
    phi = seen if transformer is None else np.asarray(transformer.transform(seen), dtype=float)
    value = phi @ coef.T + offset
    several = get_tags(last).target_tags.multi_output
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of coefficients that are not kept
        try:
            last.fit(made, value if several else value[:, 0])
        except ValueError as error:
            raise _not_linear(last, form) from error
    put(fitted, coef, offset)
    if inner:
        last.features_ = steps[-1][1]
    found = np.asarray(fitted.predict(seen), dtype=float)
    if found.size != value.size or not np.allclose(found.reshape(value.shape), value, rtol=1e-6, atol=1e-8 * np.ptp(value)):  # fmt: skip
        raise _not_linear(last, form)
    return fitted


def put(fitted: Any, coef: np.ndarray, offset: np.ndarray) -> None:
    """Other coefficients for :func:`with_coefficients`."""
    last = last_model(fitted)
    last.coef_, last.intercept_ = coef, offset


def _not_linear(model: Any, form: str) -> DataError:
    """The error for models that make something else of their coefficients."""
    return DataError(
        f'form="{form}" fits the coefficients of a linear model, and {type(model).__name__} makes something else of them, or of '
        'several outputs: use LinearRegression, Ridge or PenalizedRegressor, or form="static" or "output".'
    )
