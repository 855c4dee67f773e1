"""Which correction a form of the hybrid is."""

from __future__ import annotations

from typing import Any

from sksurrogate.compose._hybrid_dynamics import DynamicsCorrection, ends_linear
from sksurrogate.compose._hybrid_force import ForceCorrection
from sksurrogate.compose._hybrid_output import OutputCorrection
from sksurrogate.compose._residual import FreeRunResidual
from sksurrogate.exceptions import DataError

__all__ = ["correction_of"]


def correction_of(
    simulator: Any, residual: Any, form: str, loss: str | None, n_lags: int, states: Any, fade: float, shrinkage: float,
    random_state: Any,
) -> OutputCorrection | DynamicsCorrection:  # fmt: skip
    """The unfitted correction of a form; parameters as of :class:`HybridRegressor`.

    Raises
    ------
    DataError
        The residual is not an estimator.
    """
    inside = form in ("dynamics", "input")
    slopes = residual is None or (inside and ends_linear(residual))
    loss = loss if loss is not None else ("shooting" if slopes else "one_step")
    if residual is not None and not hasattr(residual, "fit") and not isinstance(residual, FreeRunResidual):
        raise DataError(
            f"residual={residual!r} is not an estimator: it has no method fit. Give a regressor, or a pipeline that ends in one."
        )
    if not inside:
        return OutputCorrection(simulator, residual, form, loss, n_lags, fade, shrinkage, random_state)
    own = residual is not None and not ends_linear(residual)
    if own and not hasattr(residual, "predict"):
        raise DataError(
            f"residual={residual!r} is not a regressor: it has no method predict. Give a regressor, or a pipeline that ends in one."
        )
    kind = ForceCorrection if own else DynamicsCorrection
    return kind(simulator, residual, form, loss, states, fade, shrinkage)
