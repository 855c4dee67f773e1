"""Normal priors of a calibration, weighed against the data by the noise that a fit leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate.kernels.free_run_model import FreeRunModel
from sksurrogate.kernels.output_error import Fit, output_error

#: A fit is made again where the noise that it leaves differs from the assumed one by more than this factor.
SAME_NOISE = 1.01
#: Rounds at most: noise and parameters hardly move each other, so that two or three settle it.
ROUNDS = 5


@dataclass(frozen=True, eq=False)
class Prior:
    """Normal priors of k parameters."""

    #: mean, sd: (k,): in the units of the parameters; sd is inf where there is none
    mean: np.ndarray
    sd: np.ndarray
    noise: float = 1.0  #: Size of what a fit leaves, in units of the assumed noise

    @classmethod
    def of(cls, priors: Mapping[str, tuple[float, float]], names: Sequence[str]) -> Prior:
        """From (mean, sd) by name."""
        pairs = [priors.get(name, (0.0, np.inf)) for name in names]
        return cls(np.array([m for m, _ in pairs], float), np.array([s for _, s in pairs], float))

    @property
    def precision(self) -> np.ndarray:
        """Beside squares of residuals over the assumed noise (k,)."""
        return (self.noise / self.sd) ** 2

    @property
    def options(self) -> dict[str, Any]:
        """Of :func:`~sksurrogate.kernels.output_error.output_error`."""
        return {"prior": self.sd / self.noise, "centre": self.mean} if np.isfinite(self.sd).any() else {}


def weighed(
    model: FreeRunModel,
    fit: Fit,
    sd: np.ndarray,
    prior: Prior,
    unit: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    fit_start: bool,
) -> tuple[Fit, Prior]:
    """The fit with the prior beside the noise that is left, and that prior; as it is without a prior."""
    for _ in range(ROUNDS if prior.options else 0):
        record = model.record
        left = float(np.sqrt(np.sum((record.residual(fit.y) / sd[:, None]) ** 2) / record.n_values))
        left = max(left, 1e-12)  # data without noise: the prior says nothing beside them
        if max(left / prior.noise, prior.noise / left) < SAME_NOISE:
            break
        prior = replace(prior, noise=left)
        own: dict[str, Any] = {"prior": prior.sd, "centre": prior.mean}  # beside residuals over the noise that is left
        again = output_error(
            model, fit.theta, fit.x, left * sd, unit=unit, bounds=bounds, open_steps=0, fit_start=fit_start, **own
        )
        if again is None:
            break
        fit = again
    return fit, prior
