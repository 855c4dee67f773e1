"""Shooting fit of a linear model behind features: splines, polynomials, steps of a pipeline."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.utils.parallel import _get_threadpool_controller

from sksurrogate.compose._evidence_fit import STRONG, Posterior, within
from sksurrogate.compose._free_fit import Scaling, cut_pieces, displaced
from sksurrogate.compose._linear_end import has_intercept
from sksurrogate.compose._network import agrees
from sksurrogate.export._agreement import dense
from sksurrogate.kernels.lag_basis import BasisLoss, LagBasis
from sksurrogate.kernels.shooting import FreeRunLoss, levenberg_marquardt
from sksurrogate.kernels.shooting_evidence import fit_by_evidence

#: Steps of the free runs on the way to whole runs: each is started where the shorter ones ended.
HORIZONS = (3, 10, 30)


class FeatureModel:
    """A fitted regressor taken apart: features, then a linear model.

    ``phi`` (n_rows, n_features): rows that it was fitted to.
    ``posterior``: what a fit by the evidence knows of its weights and of the noise.
    """

    posterior: Posterior | None = None

    def __init__(self, estimator: Any, phi: np.ndarray):
        steps = list(getattr(estimator, "steps", None) or [("model", estimator)])
        self.model, self.steps = steps[-1][1], [step for _, step in steps[:-1] if step not in (None, "passthrough")]
        inner = getattr(self.model, "features_", None)
        if inner is not None:
            self.steps.append(inner)
        self.estimator, self.phi = estimator, phi
        self.intercept = has_intercept(self.model)
        known = bool(self.steps) or not self.intercept  # a plain linear model with an intercept is a network
        self.fits = known and hasattr(self.model, "coef_") and hasattr(self.model, "intercept_")
        if self.fits:
            coef = np.atleast_2d(np.asarray(self.model.coef_, dtype=float))
            self.fits = agrees(lambda rows: self.features(rows) @ coef.T + self.model.intercept_, estimator, phi)

    def features(self, phi: np.ndarray) -> np.ndarray:
        """What the linear model sees, (n_rows, n_basis)."""
        for step in self.steps:
            phi = step.transform(phi)
        return dense(phi)

    def shoot(
        self,
        runs: Any,
        output_lags: list[int],
        input_terms: list[tuple[int, int]],
        *,
        n_first: int,
        horizon: int | None,
        alpha: float | str,
        stability: float,
        max_iter: int = 100,
    ) -> tuple[float, float]:
        """Fit the linear model on free runs, started at what it is; loss and penalty, in numbers scaled as for networks."""
        scaling = Scaling(runs)
        mean, std = scaling.of_lags(len(output_lags), [j for j, _ in input_terms])
        made = self.features(self.phi)
        middle, spread = made.mean(axis=0) * self.intercept, made.std(axis=0)
        spread = np.where(spread > 1e-9 * (1e-300 + np.abs(made).max(axis=0)), spread, 1.0)
        coef, offset = np.atleast_2d(self.model.coef_).T, np.broadcast_to(self.model.intercept_, len(scaling.y_std))
        model = LagBasis(
            lambda z: (self.features(z * std + mean) - middle) / spread,
            coef * spread[:, None] / scaling.y_std,
            (offset + middle @ coef - scaling.y_mean) / scaling.y_std,
            tuple(output_lags),
            tuple(input_terms),
            fixed_bias=not self.intercept,
        )
        longest = max(len(run) for run in runs) - n_first
        end = longest if horizon is None else min(horizon, longest)
        with _get_threadpool_controller().limit(limits=1, user_api="blas"):
            for steps in [*(h for h in HORIZONS if 2 * h <= end), end]:
                U, target = cut_pieces(runs, n_first, steps)
                U, target = (U - scaling.u_mean) / scaling.u_std, (target - scaling.y_mean) / scaling.y_std
                loss: FreeRunLoss = BasisLoss(U, target, n_first, STRONG if isinstance(alpha, str) else alpha)
                model = within(loss, model)
                model, value = levenberg_marquardt(loss, model, max_iter if steps == end else 15)
            if stability > 0:
                loss = displaced(loss, stability)
                model, value = levenberg_marquardt(loss, model, max_iter)
            found = fit_by_evidence(loss, model) if isinstance(alpha, str) else None
            if found is not None:
                model, loss = found.model, found.loss
                value = loss.value(model, found.y)
                self.posterior = Posterior(scaling, found, n_first)
        coef = model.weights * scaling.y_std / spread[:, None]
        offset = (model.bias * scaling.y_std + scaling.y_mean - middle @ coef) * self.intercept
        flat = np.ndim(self.model.coef_) == 1
        self.model.coef_ = coef[:, 0].copy() if flat else coef.T.copy()
        self.model.intercept_ = float(offset[0]) if np.ndim(self.model.intercept_) == 0 else offset
        return value, loss.alpha
