"""The hybrid's default correction: small nets with a linear part, trained through the free run, chosen on runs left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils import check_random_state

from sksurrogate.compose._residual_fit import (
    CorrectionLoss,
    FreeRunCorrection,
    OneStepCorrection,
    Pieces,
    cut,
    features,
    roll,
    weighed,
)
from sksurrogate.compose._skip_net import SkipNet, merged
from sksurrogate.kernels.shooting import levenberg_marquardt

#: Steps of a piece that is run freely while the nets learn.
LONGEST_STRETCH = 200
#: Work of one Levenberg-Marquardt step, rows * parameters^2; more rows than this allows are thinned.
WORK = 6e7
#: Steps after the penalty is weighed.
WEIGHED_STEPS = 5
#: Every second map begins with a penalty so many times as strong: from a weak one the evidence finds corrections of noise
#: and model errors, from a strong one it follows what is certain (a plant without noise).
STRONGER = 100.0


@dataclass(frozen=True, eq=False)
class _Fit:
    """A map, the penalty of its numbers, and what it pulls to."""

    net: SkipNet
    penalty: np.ndarray  #: (n_theta,)
    prior: np.ndarray  #: (n_theta,)


def _increments(deviation: Sequence[np.ndarray]) -> np.ndarray:
    """RMS change of every output from row to row, (n_outputs,); 1 where it never moves."""
    size = np.sqrt(np.mean(np.concatenate([np.diff(d, axis=0) for d in deviation]) ** 2, axis=0))
    return np.where(size > 0.0, size, 1.0)


class FreeRunResidual(BaseEstimator):
    """``d[t] = S'z + W2' tanh(W1'z + b1) + b2`` of past deviations d and known features, the mean of a few such maps.

    ``hidden``: tanh units of each map.
    ``n_starts``: maps; the ones that follow runs left out best are kept.
    ``alpha``: first penalty on the tanh layer, as a share of the variance of one step's increments; the evidence sets the last.
    ``decay``: weight of a lag relative to the lag before it: older values must explain more to be used.
    ``loss`` {"shooting", "one_step"}.
    ``max_iter``: Levenberg-Marquardt steps of each map.
    ``net_``: the mean of ``members_``.
    ``unit_`` (n_outputs,): what deviations are learned in, the RMS of one step's increments.
    ``n_hidden_``: units of each map; fewer than ``hidden`` for few rows.
    """

    def __init__(
        self,
        hidden: int = 6,
        n_starts: int = 5,
        alpha: float = 1e-2,
        decay: float = 0.4,
        loss: str = "shooting",
        max_iter: int = 15,
        random_state: Any = 0,
    ):
        self.hidden = hidden
        self.n_starts = n_starts
        self.alpha = alpha
        self.decay = decay
        self.loss = loss
        self.max_iter = max_iter
        self.random_state = random_state

    def fit_runs(
        self, known: Sequence[np.ndarray], deviation: Sequence[np.ndarray], ages: np.ndarray, n_lags: int
    ) -> FreeRunResidual:
        """Fit on whole runs.

        ``known`` list of (n_samples, n_known): features that do not depend on the deviation.
        ``deviation`` list of (n_samples, n_outputs).
        ``ages`` (n_known,): lag of every known feature; 1 counts as new.
        """
        o = deviation[0].shape[1]
        self.n_outputs_, self.n_lags_, self.unit_ = o, n_lags, _increments(deviation)
        deviation = [d / self.unit_ for d in deviation]
        lags = np.concatenate([np.repeat(np.arange(1, n_lags + 1), o), np.maximum(ages, 1)])
        weight = self.decay ** (lags - 1.0)
        rows = sum(max(len(k) - n_lags, 1) for k in known)
        # fewer units where the rows could not tell so many weights
        self.n_hidden_ = int(np.clip(rows // (2 * len(lags)), 1, self.hidden))
        n_theta = len(lags) * (o + self.n_hidden_) + self.n_hidden_ * (o + 1) + o
        most = int(np.clip(WORK / (o * n_theta**2), 300, 2000))
        everything = list(range(len(known)))
        # Every fourth run judges the free run of what the others taught; few runs judge themselves.
        judges = everything[1::4] if len(everything) >= 4 else everything
        pupils = [r for r in everything if r not in judges] or everything

        def pieces(chosen: list[int]) -> Pieces:
            return cut([known[r] for r in chosen], [deviation[r] for r in chosen], n_lags, LONGEST_STRETCH, most)

        taught, judged, whole = pieces(pupils), pieces(judges), pieces(everything)
        starts = self._starts(taught, weight)
        if len(starts) > 1:
            starts = self._best([self._learn(start, taught) for start in starts], judged)
        self._settle([self._learn(start, whole) for start in starts], judged)
        return self

    def go_on(self, known: Sequence[np.ndarray], deviation: Sequence[np.ndarray]) -> FreeRunResidual:
        """Go on from the fitted maps with other, usually more, runs."""
        size = self.members_[0].theta.size
        most = int(np.clip(WORK / (self.n_outputs_ * size**2), 300, 2000))
        whole = cut(known, [d / self.unit_ for d in deviation], self.n_lags_, LONGEST_STRETCH, most)
        self._settle([self._learn(one, whole) for one in self._fits], whole)
        return self

    def predict(self, X: Any) -> np.ndarray:
        """Deviation one step on: (n_rows, n_features) -> (n_rows,) or (n_rows, n_outputs)."""
        found = self.net_(np.asarray(X, dtype=float))
        return found[:, 0] if self.n_outputs_ == 1 else found

    def _learn(self, one: _Fit, pieces: Pieces) -> _Fit:
        """One step ahead first, then through the free run; near the end the evidence weighs the penalty."""
        loss: CorrectionLoss = OneStepCorrection(pieces, one.penalty, one.prior)
        net, _ = levenberg_marquardt(loss, one.net, 10, 1e-3)
        if self.loss == "shooting":
            loss = FreeRunCorrection(pieces, one.penalty, one.prior)
            net, _ = levenberg_marquardt(loss, net, self.max_iter - WEIGHED_STEPS, 1e-4)
        loss = replace(loss, weight=weighed(loss, net))
        net, _ = levenberg_marquardt(loss, net, WEIGHED_STEPS, 1e-4)
        return _Fit(net, loss.weight, one.prior)

    @staticmethod
    def _best(fits: list[_Fit], judged: Pieces) -> list[_Fit]:
        """Those whose squared error on runs that taught nobody is at most four times the least, best first."""
        errors = []
        for one in fits:
            loss = FreeRunCorrection(judged, one.penalty, one.prior)
            with np.errstate(over="ignore", invalid="ignore"):
                errors.append(np.mean(loss.errors(loss.run(one.net)) ** 2))
        error = np.where(np.isfinite(errors), errors, np.inf)
        return [fits[k] for k in np.argsort(error, kind="stable") if error[k] <= 4.0 * error.min()]

    def _settle(self, fits: list[_Fit], judged: Pieces) -> None:
        """Keep the maps, and their mean where it runs freely without growing."""
        if not np.all(np.isfinite(roll(merged([one.net for one in fits]), judged.known, np.nan_to_num(judged.first)))):
            fits = fits[:1]
        units = np.ones(len(fits[0].net.mean))
        units[: self.n_lags_ * self.n_outputs_] = np.tile(self.unit_, self.n_lags_)
        self._fits, self.members_ = fits, [one.net.in_units(units, self.unit_) for one in fits]
        self.net_ = merged(self.members_)

    def _starts(self, pieces: Pieces, weight: np.ndarray) -> list[_Fit]:
        """Random tanh layers with the rest by ridge. The penalties pull to the last deviation kept; first ones take turns."""
        rng, n, o = check_random_state(self.random_state), pieces.n_lags, pieces.target.shape[2]
        phi = features(pieces.target, pieces.known, n)
        wanted = pieces.target[n:].reshape(-1, o)
        phi = phi.reshape(-1, phi.shape[2])
        rows = np.isfinite(wanted).all(axis=1) & np.isfinite(phi).all(axis=1)
        phi, wanted = phi[rows], wanted[rows]
        mean, spread = phi.mean(axis=0), phi.std(axis=0)
        # what never moved in training gets no weight later either
        scale = np.where(spread > 1e-9 * (np.abs(mean) + 1e-300), spread, np.inf) / weight
        scale = np.where(np.isfinite(scale), scale, 1e12 * (1.0 + np.abs(mean)))
        z = (phi - mean) / scale
        kept = np.zeros((phi.shape[1], o))
        kept[:o] = np.diag(scale[:o])
        increments = wanted - (z @ kept + mean[:o])
        variance = float(increments.var()) + 1e-300
        found = []
        for k in range(max(self.n_starts, 1)):
            alpha = self.alpha * STRONGER ** (k % 2)
            hidden = rng.normal(size=(len(weight), self.n_hidden_)) / np.sqrt(np.sum(weight**2))
            bias = 0.7 * rng.normal(size=self.n_hidden_)
            basis = np.concatenate([z, np.tanh(z @ hidden + bias), np.ones((len(z), 1))], axis=1)
            normal = basis.T @ basis + 1e-3 * len(basis) * np.eye(basis.shape[1])
            coef = np.linalg.solve(normal, basis.T @ increments)
            m = len(weight)
            net = SkipNet(mean, scale, kept + coef[:m], hidden, bias, coef[m:-1], coef[-1] + mean[:o])
            first = np.array([1e-3, alpha * variance, alpha, 0.0])  # the last for biases, whose group is -1
            penalty = first[net.groups]
            prior = np.concatenate([kept.ravel(), np.zeros(net.theta.size - m * o)])
            found.append(_Fit(net, penalty, prior))
        return found
