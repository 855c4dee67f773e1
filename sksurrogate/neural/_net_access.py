"""What a fitted network gives: predictions, slopes, a skorch net."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.utils.validation import check_is_fitted

from sksurrogate._checks import checked
from sksurrogate.exceptions import DataError
from sksurrogate.neural._evidence import Posterior
from sksurrogate.neural._network import Layers
from sksurrogate.neural._settings import read_device, read_options
from sksurrogate.neural._training import GRADIENT


class NetAccess:
    """Predictions and slopes of a network of arrays, and ``net_``, made on first access and left out of pickles."""

    _layers: Layers
    _one_column: bool
    _posterior: Posterior | None
    solver_: str
    dtype: str
    device: str
    learning_rate: float | None
    batch_size: int | None
    momentum: float
    betas: tuple[float, float]
    net_params: dict[str, Any] | None

    def predict(self, X: Any, return_std: bool = False) -> Any:
        """Output of the network.

        Parameters
        ----------
        X : array-like (n_samples, n_features)
        return_std : bool, default=False
            Also the standard deviation of a new measurement, noise included; after a fit with ``alpha="evidence"``.

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)
            In the shape of the y that was fitted, float64; with ``return_std`` a pair of them.
        """
        check_is_fitted(self)
        X = checked(self, X, reset=False, dtype=np.float64)
        parts = [self._layers(X)]
        if return_std:
            if getattr(self, "_posterior", None) is None:
                raise DataError('return_std=True needs a fit with alpha="evidence", which knows the noise.')
            parts.append(self._posterior.deviation(np.asarray(X[:])))  # type: ignore[union-attr]
        found = [part[:, 0] if self._one_column else part for part in parts]
        return tuple(found) if return_std else found[0]

    def jacobian(self, X: Any) -> np.ndarray:
        """Exact slopes of the prediction by the inputs.

        Parameters
        ----------
        X : array-like (n_samples, n_features)

        Returns
        -------
        ndarray (n_samples, n_features) or (n_samples, n_outputs, n_features)
            The first for a y of one axis. Zero through a binary step.
        """
        check_is_fitted(self)
        slopes = self._layers.jacobian(checked(self, X, reset=False, dtype=np.float64))
        return slopes[:, 0] if self._one_column else slopes

    @property
    def net_(self) -> Any:
        """Initialised skorch net with the fitted weights, for raw inputs (n_samples, n_features)."""
        check_is_fitted(self, "coefs_")
        if "_net" not in self.__dict__:
            from sksurrogate.neural._torch import build_net

            solver = self.solver_ if self.solver_ in GRADIENT else "adam"
            self._net = build_net(
                self._layers,
                solver=solver,
                dtype=self.dtype,
                device=read_device(self.device),
                learning_rate=self.learning_rate or GRADIENT[solver],
                batch_size=self.batch_size or -1,
                options=read_options(solver, self.momentum, self.betas, self.net_params),
            )
        return self._net

    def __getstate__(self) -> dict[str, Any]:
        state: dict[str, Any] = super().__getstate__().copy()  # type: ignore[misc, attr-defined]
        state.pop("_net", None)  # made again on access
        return state

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "coefs_")
