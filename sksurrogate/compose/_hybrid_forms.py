"""The forms of a hybrid: which correction each of them is, which a simulator allows, and which is best on runs left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.compose._correction_report import CorrectionReport, keep_supported, reach, surrogate_alone
from sksurrogate.compose._hybrid_dynamics import DynamicsCorrection, ends_linear
from sksurrogate.compose._hybrid_force import ForceCorrection
from sksurrogate.compose._hybrid_output import OutputCorrection
from sksurrogate.compose._left_out import RUN_FOLDS
from sksurrogate.compose._residual import FreeRunResidual
from sksurrogate.exceptions import DataError, SurrogateError
from sksurrogate.physics._simulator import Plant, describe

__all__ = ["CorrectionSettings", "chosen_form"]


@dataclass(frozen=True, eq=False)
class CorrectionSettings:
    """Parameters of :class:`HybridRegressor` that its correction takes, as they are named there."""

    residual: Any
    loss: str | None
    n_lags: int
    states: Any
    fade: float | str
    shrinkage: float
    random_state: Any

    def correction(self, simulator: Any, form: str) -> OutputCorrection | DynamicsCorrection:
        """The unfitted correction of a form.

        Raises
        ------
        DataError
            The residual is not an estimator.
        """
        residual, fade = self.residual, reach(self.fade)
        inside = form in ("dynamics", "input")
        slopes = residual is None or (inside and ends_linear(residual))
        loss = self.loss if self.loss is not None else ("shooting" if slopes else "one_step")
        if residual is not None and not hasattr(residual, "fit") and not isinstance(residual, FreeRunResidual):
            raise DataError(
                f"residual={residual!r} is not an estimator: it has no method fit. Give a regressor, or a pipeline that ends in one."
            )
        if not inside:
            return OutputCorrection(
                simulator, residual, form, loss, self.n_lags, fade, self.shrinkage, self.random_state
            )
        own = residual is not None and not ends_linear(residual)
        if own and not hasattr(residual, "predict"):
            raise DataError(
                f"residual={residual!r} is not a regressor: it has no method predict. Give a regressor, or a pipeline that ends in one."
            )
        kind = ForceCorrection if own else DynamicsCorrection
        return kind(simulator, residual, form, loss, self.states, fade, self.shrinkage)


def chosen_form(
    form: str, settings: CorrectionSettings, simulator: Any, inputs: list, measured: list, names: Sequence[str],
    start: tuple[Any, str | None],
) -> tuple[str, Any, CorrectionReport]:  # fmt: skip
    """The form, its correction and report; with "auto" those of the smallest error on what is left out.

    ``start``: a fitted correction to go on from, and its form.
    """
    if form != "auto":
        return (form, *_fitted(form, settings, simulator, inputs, measured, names, start[0]))
    plant = None
    if simulator is not None:
        plant = describe(simulator, n_inputs=inputs[0].shape[1], n_outputs=measured[0].shape[1])
    size, found = np.maximum(np.std(np.concatenate(measured), axis=0), 1e-300), []
    # blocks of one or two runs do not speak of other runs, and a term inside the plant reaches farther than one on outputs
    several = len(inputs) >= RUN_FOLDS
    for one in _possible(plant, settings.residual) if several else ["output"]:
        before = start[0] if one == start[1] else None
        try:
            correction, report = _fitted(one, settings, simulator, inputs, measured, names, before)
        except (SurrogateError, np.linalg.LinAlgError):
            if one == "output":  # what every simulator allows
                raise
            continue
        error = float(np.nan_to_num(np.mean((report.rmse / size) ** 2), nan=np.inf))
        found.append((error, one, correction, report))
    return min(found, key=lambda entry: entry[0])[1:]


def _possible(plant: Plant | None, residual: Any) -> list[str]:
    """Forms among which "auto" chooses, the most general first; ``plant`` None: no simulator."""
    if plant is None:
        return ["output"]
    inside = plant.access != "trajectory" and (residual is None or ends_linear(residual))
    return ["output", "static"] + (["dynamics"] + (["input"] if len(plant.inputs) else []) if inside else [])


def _fitted(
    form: str, settings: CorrectionSettings, simulator: Any, inputs: list, measured: list, names: Sequence[str], before: Any
) -> tuple[Any, CorrectionReport]:  # fmt: skip
    """The correction of one form, and the share of it that left-out runs support."""
    correction = settings.correction(simulator, form).fit(inputs, measured, before)
    if simulator is None:
        own = settings.residual is None or isinstance(settings.residual, FreeRunResidual)
        return correction, surrogate_alone(correction, inputs, measured, judged=not (own and form == "output"))
    fade = None if settings.fade == "evidence" else reach(settings.fade)
    return correction, keep_supported(correction, inputs, measured, names, fade)
