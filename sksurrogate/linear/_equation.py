"""A linear model as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.exceptions import DataError
from sksurrogate.export._agreement import dense, is_affine, probes
from sksurrogate.export._scalers import affine_map


def equation(left: str, coef: np.ndarray, names: Sequence[Any] | np.ndarray, intercept: float, digits: int = 4) -> str:
    """``left = intercept + coef * name ...`` with the terms that are not zero.

    ``coef`` (n_terms,).
    ``names`` (n_terms,): "1" stands for a constant.
    ``digits``: significant ones.

    >>> import numpy as np
    >>> equation("dq/dt", np.array([0.0, -2.0, 1.0]), ["q", "v", "q v"], 0.5)
    'dq/dt = 0.5 - 2 v + 1 q v'
    """
    terms = [(float(intercept), "")] + [(float(c), "" if name == "1" else f" {name}") for c, name in zip(coef, names)]
    text = ""
    for value, name in terms:
        if value:
            sign = ("- " if value < 0 else "+ ") if text else ("-" if value < 0 else "")
            text += f"{' ' if text else ''}{sign}{abs(value):.{digits}g}{name}"
    return f"{left} = {text or '0'}"


def named_terms(model: Any, steps: Sequence[Any], names: Any) -> tuple[np.ndarray, np.ndarray, Any]:
    """A fitted linear model behind transformers, as coefficients of named functions of the signals.

    ``steps``: fitted transformers before the model. Scalers and PCA that come last are folded into the coefficients.
    ``names``: of the signals.
    Returns coefficients (n_outputs, n_terms), constants (n_outputs,), names (n_terms,).
    Raises DataError where the coefficients are those of something that has no name.
    """
    if not hasattr(model, "coef_"):
        raise DataError(f"{type(model).__name__} has no coef_: equations need a model that is linear in features.")
    if not is_affine(model):
        raise DataError(
            f"{type(model).__name__} does not predict features @ coef_ + intercept_ (it has a link, labels, or a centre of its own): "
            "equations need a plain linear model, such as Ridge or SparseRegressor."
        )
    made = [*_flat(steps), *_flat([getattr(model, "features_", None)])]
    coef = np.atleast_2d(np.asarray(model.coef_, dtype=float))
    constant = np.broadcast_to(np.atleast_1d(model.intercept_), (len(coef),)).astype(float)
    while made and (affine := affine_map(made[-1])) is not None:
        A, c = affine
        constant = constant + coef @ c
        coef = coef * A if A.ndim == 1 else coef @ A.T
        made.pop()
    names, rows = np.asarray(names, dtype=object), np.concatenate(probes(len(names)))
    for k, step in enumerate(made):
        if not hasattr(step, "get_feature_names_out"):
            raise DataError(f"{type(step).__name__} names no features: it needs get_feature_names_out.")
        before, names = names, step.get_feature_names_out(names)
        try:
            with np.errstate(all="ignore"):
                seen, rows = rows, dense(step.transform(rows))
        except ValueError:  # rows outside of what the step takes
            seen, rows = np.zeros((1, len(before))), np.full((1, len(names)), np.nan)
        places = {name: j for j, name in enumerate(before)}
        for j, name in enumerate(names):
            if name in places and not np.allclose(rows[:, j], seen[:, places[name]], rtol=1e-9, atol=0.0):
                _refuse(step, made[k + 1 :])
    return coef, constant, names


def _flat(steps: Sequence[Any]) -> list[Any]:
    """Transformers one by one, those of pipelines inside too."""
    out: list[Any] = []
    for step in steps:
        if getattr(step, "steps", None) is not None:
            out += _flat([part for _, part in step.steps])
        elif step is not None and not isinstance(step, str):
            out.append(step)
    return out


def _refuse(step: Any, behind: Sequence[Any]) -> None:
    """The names of a step's features are those of the signals, and their values are not."""
    kind, maps = type(step).__name__, [type(other).__name__ for other in behind]
    way = f"Put it behind them: make_pipeline({', '.join([*maps, kind])}, ...)." if maps else "Leave it out."
    way = f"{way} Set clip=False." if getattr(step, "clip", False) else way
    before = f" before {', '.join(maps)}" if maps else ""
    raise DataError(
        f"equations: {kind}{before} changes the signals and keeps their names, so no coefficient belongs to a signal. {way}"
    )
