"""The fit of a calibration: lifted, from thinned data where there are many, and single shooting where it fails."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.output_error import Fit, output_error
from sksurrogate.kernels.record import Record
from sksurrogate.physics._coarse_start import coarse_start
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._free_parameters import FreeParameters
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._prepare import prepared

#: Squared residuals, in units of the noise, above which single shooting is tried as well.
POOR = 4.0
#: Single shooting is taken where it leaves less than this share of what the lifted fit leaves.
CLEARLY_LESS = 0.99
#: Open steps converge quadratically: after one that moves by less than this share, the next would change nothing.
CALIBRATION_SETTLED = 3e-2
#: Slopes serve again after a step by less than this share.
SLOPES_SERVE = 2e-2
#: Dampings of a step before the descent ends, each ten times the last.
DAMPINGS = 12
#: Open steps of a fit, and by how many times its size a step moves a parameter: of a stiff plant none, and less, since one that nothing
#: fixes must not carry it off.
OPEN_STEPS, LARGEST_MOVE, STIFF_MOVE = 6, 10.0, 0.7


@dataclass(frozen=True, eq=False)
class LiftedFit:
    """What came of a fit."""

    model: FitModel
    fit: Fit | None  #: None: no finite free run was found
    method: str = "lifted"  #: Or "single shooting"
    said: tuple[str, ...] = ()  #: What the user should know


def lifted_fit(
    inner: PlantModel, record: Record, sd: np.ndarray, free: FreeParameters, starts: np.ndarray, given: bool, *, max_steps: int, fit_start: bool
) -> LiftedFit:  # fmt: skip
    """Fit parameters and initial states.

    ``starts`` (n_runs, n_states): initial states to begin at; ``given``: whether the user gave them.
    ``fit_start``: whether they are fitted.
    """
    options: dict[str, Any] = {
        "unit": free.unit,
        "bounds": free.bounds,
        "max_steps": max_steps,
        "fit_start": fit_start,
        "settled": CALIBRATION_SETTLED,
        "tries": DAMPINGS,
        "reach": LARGEST_MOVE,
        "near": SLOPES_SERVE,
        **free.prior.options,
    }
    most = POOR * record.n_values
    started = coarse_start(inner, record, sd, free.names, free.start, starts, given, options)
    if started is not None:
        model, near, x = started
        fit = output_error(model, near, x, sd, open_steps=OPEN_STEPS, **options)
        if fit is not None and fit.converged and fit.cost < most:
            return LiftedFit(model, fit)
    model, x = prepared(inner, record, sd, free.names, free.start, starts, given, fit_start)
    if model.stiff:
        options["reach"] = STIFF_MOVE
    fit = output_error(model, free.start, x, sd, open_steps=0 if model.stiff else OPEN_STEPS, **options)
    if fit is not None and fit.converged and fit.cost < most:
        return LiftedFit(model, fit)
    shot = free_run(model, free.start, starts.T)
    other = output_error(model, free.start, shot, sd, open_steps=0, **options) if np.all(np.isfinite(shot)) else None
    return nearer(LiftedFit(model, fit), other)


def nearer(lifted: LiftedFit, shot: Fit | None) -> LiftedFit:
    """The lifted fit, or single shooting where that is clearly nearer or the lifted one did not converge, with what is to be said of it."""
    fit, said = lifted.fit, []
    if shot is not None and (fit is None or not fit.converged or shot.cost < CLEARLY_LESS * fit.cost):
        why = "ended in a poor optimum" if fit is not None and fit.converged else "did not converge"
        said.append(f"the lifted fit {why}; parameters are those of single shooting.")
        fit = shot
    if fit is not None and not fit.converged:
        said.append(
            f"the fit stopped after {fit.n_iterations} iterations without converging: raise max_iter, or start nearer."
        )
    return LiftedFit(
        lifted.model, fit, "single shooting" if fit is shot and shot is not None else "lifted", tuple(said)
    )
