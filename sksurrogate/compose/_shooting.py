"""What a lag model is fitted with on its free runs, and what it knows of itself afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.utils import check_random_state

from sksurrogate.compose._evidence_fit import Posterior
from sksurrogate.compose._feature_fit import FeatureModel
from sksurrogate.compose._lagged import barely_fitted, fitted
from sksurrogate.compose._linear_end import has_intercept, last_model, refuse_demands
from sksurrogate.compose._network import write_network
from sksurrogate.compose._penalty import shoot_with
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.net import LagNet
from sksurrogate.kernels.start_rows import found_start
from sksurrogate.runs import Runs


class ShootingMixin:
    """Fit on free runs, standard deviations, and starts that are found from more rows than the lags."""

    estimator: Any
    estimator_: Any
    alpha: Any
    horizon: int | None
    stability: float
    n_starts: int
    random_state: Any
    n_initial_: int
    output_lags_: list[int]
    input_terms_: list[tuple[int, int]]
    y_mean_: np.ndarray
    y_spread_: np.ndarray
    one_step_rmse_: float
    _posterior: Posterior | None

    def _shoot(self, runs: Runs, Phi: np.ndarray, target: np.ndarray) -> None:
        """Fit on free runs."""
        refuse_demands(self.estimator, 'loss="shooting"', 'loss="one_step"')
        self.estimator_ = barely_fitted(clone(self.estimator), Phi, target)
        model: LagNet | None = self._lag_net()  # type: ignore[attr-defined]
        compiles = model is not None and self._compiles(Phi)  # type: ignore[attr-defined]
        fixed = not has_intercept(self.estimator)
        if model is None or not compiles or fixed or not write_network(self.estimator_, model.net):
            self._shoot_features(runs, Phi, target, linear=compiles and fixed)
            return
        settings = {"n_first": self.n_initial_, "horizon": self.horizon, "stability": self.stability}
        settings |= {"n_starts": self.n_starts, "random_state": check_random_state(self.random_state)}
        found, self.shooting_loss_, self.alpha_, self._posterior = shoot_with(self.alpha, model, list(runs), **settings)
        self._keep_noise()
        write_network(self.estimator_, found.net)

    def _keep_noise(self) -> None:
        """Standard deviation of the residual, where it is known."""
        if self._posterior is not None:
            self.noise_ = np.sqrt(self._posterior.fit.evidence.noise) * self._posterior.scaling.y_std

    def _shoot_features(self, runs: Runs, Phi: np.ndarray, target: np.ndarray, linear: bool) -> None:
        """Fit on free runs where features lead into a linear model; ``linear``: a linear model without an intercept."""
        self.estimator_ = fitted(self.estimator, Phi, target)
        model = FeatureModel(self.estimator_, Phi)
        if self.alpha == "auto":
            raise DataError(
                'alpha="auto" is for networks and linear models with an intercept; behind features, or with fit_intercept=False, '
                'give a number, or "evidence".'
            )
        if linear and not model.fits:
            raise DataError(
                f'loss="shooting" cannot keep {type(last_model(self.estimator)).__name__}(fit_intercept=False) behind a scaled '
                'target: leave the scaling of the target out, or use loss="one_step".'
            )
        if not model.fits:
            raise DataError(
                f'loss="shooting" needs slopes of the estimator, and {type(self.estimator_).__name__} gives none: use a '
                "network of tanh, logistic, relu or identity layers (MLPRegressor, FNNRegressor), a linear model, also "
                'behind scalers or features in a pipeline, or loss="one_step".'
            )
        self.shooting_loss_, self.alpha_ = model.shoot(
            runs,
            self.output_lags_,
            self.input_terms_,
            n_first=self.n_initial_,
            horizon=self.horizon,
            alpha=(0.0 if linear else 0.1) if self.alpha is None else self.alpha,
            stability=self.stability,
        )
        if linear:
            self._posterior = model.posterior
            self._keep_noise()

    def _deviation(self, inputs: Sequence[np.ndarray], free: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Standard deviation of new measurements along free runs, (n_steps, n_outputs) each."""
        posterior = self._posterior
        if posterior is None:
            raise DataError(
                'return_std=True needs a fit with loss="shooting" and alpha="evidence" of a network or linear model, '
                "which knows the noise and how sure its weights are."
            )
        n = self.n_initial_
        return [
            posterior.deviation(U[None], y[None])[0] if len(U) > n else np.broadcast_to(self.noise_, y.shape)
            for U, y in zip(inputs, free)
        ]

    def _more_rows(self, y0: Any, runs: Runs) -> np.ndarray | None:
        """``y0`` as (n_runs, n_rows, n_outputs) where it has more rows than a start needs, else None."""
        given = None if y0 is None or isinstance(y0, str) else np.asarray(y0, dtype=float)
        n, o = self.n_initial_, len(self.y_mean_)
        if given is None:
            return None
        given = given[None] if given.ndim == 2 and len(runs) == 1 else given
        fits = given.ndim == 3 and given.shape[::2] == (len(runs), o) and given.shape[1] > n
        return given if fits else None

    def _start_from(self, runs: Runs, rows: np.ndarray) -> np.ndarray:
        """First rows (n_runs, n_initial, n_outputs) from more measured ones (n_runs, n_rows, n_outputs)."""
        n, k = self.n_initial_, rows.shape[1]
        short = next((run for run in runs if len(run) < k), None)
        if short is not None:
            raise DataError(
                f"y0 has {k} rows per run, but run {short.label!r} has {len(short)}: give no more than X has."
            )
        U, mean, spread = np.stack([run.X[:k] for run in runs]), self.y_mean_, self.y_spread_
        size = (
            self.one_step_rmse_ if self._posterior is None else self.noise_
        )  # what a step misses stands for the noise

        def run_scaled(first: np.ndarray) -> np.ndarray:
            return (self._roll(U, first * spread + mean) - mean) / spread  # type: ignore[attr-defined]

        noise = float(np.mean((size / spread) ** 2))
        return found_start(run_scaled, (rows - mean) / spread, n, noise) * spread + mean
