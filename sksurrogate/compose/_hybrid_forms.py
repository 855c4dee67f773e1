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
from sksurrogate.compose._linear_end import refuse_demands
from sksurrogate.compose._residual import FreeRunResidual
from sksurrogate.exceptions import DataError, SurrogateError
from sksurrogate.physics._simulator import Plant, describe


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

        Raises DataError where the residual is not an estimator, or demands what the fit cannot keep.
        """
        residual, fade = self.residual, reach(self.fade)
        inside = form in ("dynamics", "input")
        linear = residual is None or (inside and ends_linear(residual))
        loss = self.loss if self.loss is not None else ("shooting" if linear else "one_step")
        if residual is not None and not hasattr(residual, "fit") and not isinstance(residual, FreeRunResidual):
            raise DataError(
                f"residual={residual!r} is not an estimator: it has no method fit. Give a regressor, or a pipeline that ends in one."
            )
        if inside and linear and residual is not None:
            refuse_demands(residual, f'form="{form}"', 'form="static" or "output"')
        elif form == "output" and loss == "shooting" and residual is not None:
            refuse_demands(residual, 'loss="shooting"', 'loss="one_step"')
        if not inside:
            return OutputCorrection(
                simulator, residual, form, loss, self.n_lags, fade, self.shrinkage, self.random_state
            )
        if not linear and not hasattr(residual, "predict"):
            raise DataError(
                f"residual={residual!r} is not a regressor: it has no method predict. Give a regressor, or a pipeline that ends in one."
            )
        kind = DynamicsCorrection if linear else ForceCorrection
        return kind(simulator, residual, form, loss, self.states, fade, self.shrinkage)


def chosen_form(
    form: str, settings: CorrectionSettings, simulator: Any, inputs: list, measured: list, names: Sequence[str],
    start: tuple[Any, str | None],
) -> tuple[str, Any, CorrectionReport]:  # fmt: skip
    """The form, its correction and report.

    With "auto" the first of :func:`_possible` whose gain on what is left out is within one standard error of the largest, and
    of which left-out runs support no smaller share: with few data forms that know more of the plant are not separated by
    held-out runs, but err less on other runs. Of two terms inside the plant the one of the larger evidence is a candidate.

    ``start``: a fitted correction to go on from, and its form.
    """
    plant: Plant | None = None
    found: list[tuple[str, Any]] = []
    if simulator is not None and form == "auto":
        plant = describe(simulator, n_inputs=inputs[0].shape[1], n_outputs=measured[0].shape[1])
    for one in _possible(plant, settings.residual) if form == "auto" else [form]:
        before = start[0] if form != "auto" or one == start[1] else None
        try:
            found.append((one, settings.correction(simulator, one).fit(inputs, measured, before)))
        except (SurrogateError, np.linalg.LinAlgError):
            if one in (form, "output"):  # "output" is what every simulator allows
                raise
    smooth = [entry for entry in found if getattr(entry[1], "smooth", None) is not None]
    if len(smooth) > 1:
        found.remove(min(smooth, key=lambda entry: entry[1].smooth.log_evidence))
    judged = [(*entry, _report(entry[1], settings, inputs, measured, names)) for entry in found]
    if len(judged) == 1:
        return judged[0]
    best = max((report for _, _, report in judged), key=lambda report: report.gain)
    as_good = [entry for entry in judged if entry[2].gain >= best.gain - best.standard_error]
    return next(entry for entry in as_good if np.all(entry[2].shrinkage >= best.shrinkage))


def _possible(plant: Plant | None, residual: Any) -> list[str]:
    """Forms among which "auto" chooses, from the most physics to the least; ``plant`` None: no simulator."""
    if plant is None:
        return ["output"]
    inside = plant.access != "trajectory" and (residual is None or ends_linear(residual))
    return [*((["input"] if len(plant.inputs) else []) + ["dynamics"] if inside else []), "static", "output"]


def _report(
    correction: Any, settings: CorrectionSettings, inputs: list, measured: list, names: Sequence[str]
) -> CorrectionReport:
    """The share of a fitted correction that left-out runs support."""
    if correction.simulator is None:
        own = settings.residual is None or isinstance(settings.residual, FreeRunResidual)
        return surrogate_alone(correction, inputs, measured, judged=not (own and correction.form == "output"))
    fade = None if settings.fade == "evidence" else reach(settings.fade)
    return keep_supported(correction, inputs, measured, names, fade)
