"""The hybrid's default correction: small nets with a linear part, trained through the free run, chosen on runs left out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils import check_random_state

from sksurrogate.compose._residual_fit import Pieces, cut, features, levenberg_marquardt, one_step, roll, shooting
from sksurrogate.compose._skip_net import SkipNet, merged

#: Steps of a piece that is run freely while the nets learn.
LONGEST_STRETCH = 200
#: Work of one Levenberg-Marquardt step, rows * parameters^2; more rows than this allows are thinned.
WORK = 6e7


class FreeRunResidual(BaseEstimator):
    """``d[t] = S'z + W2' tanh(W1'z + b1) + b2`` of past deviations d and known features, the mean of a few such maps.

    ``hidden``: tanh units of each map.
    ``n_starts``: maps; the ones that follow runs left out best are kept.
    ``alpha``: penalty on the tanh layer, as a share of the variance of one step's increments.
    ``decay``: weight of a lag relative to the lag before it: older values must explain more to be used.
    ``loss`` {"shooting", "one_step"}.
    ``max_iter``: Levenberg-Marquardt steps of each map.
    ``net_``: the mean of ``members_``.
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
        self.n_outputs_, self.n_lags_ = o, n_lags
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
        ranked = []
        starts = self._starts(taught, weight)
        for net, penalty, prior in starts:
            if len(starts) == 1:  # nothing to choose
                ranked.append((0.0, net, penalty, prior))
                break
            net = self._learn(net, taught, penalty, prior, self.max_iter)
            error, _ = shooting(judged)(net, False)
            mean = float(np.mean(error**2))
            ranked.append((mean if np.isfinite(mean) else np.inf, net, penalty, prior))
        ranked.sort(key=lambda entry: entry[0])
        good = [entry for entry in ranked if np.isfinite(entry[0]) and entry[0] <= 4.0 * ranked[0][0]] or ranked[:1]
        self._penalties = [(penalty, prior) for _, _, penalty, prior in good]
        nets = [net for _, net, _, _ in good]
        steps = 15 if len(starts) > 1 else self.max_iter
        self._settle([self._learn(n, whole, p, q, steps) for n, (p, q) in zip(nets, self._penalties)], judged)
        return self

    def go_on(self, known: Sequence[np.ndarray], deviation: Sequence[np.ndarray]) -> FreeRunResidual:
        """Go on from the fitted maps with other, usually more, runs."""
        size = self.members_[0].theta.size
        most = int(np.clip(WORK / (self.n_outputs_ * size**2), 300, 2000))
        whole = cut(known, deviation, self.n_lags_, LONGEST_STRETCH, most)
        nets = [self._learn(n, whole, p, q, self.max_iter) for n, (p, q) in zip(self.members_, self._penalties)]
        self._settle(nets, whole)
        return self

    def predict(self, X: Any) -> np.ndarray:
        """Deviation one step on: (n_rows, n_features) -> (n_rows,) or (n_rows, n_outputs)."""
        found = self.net_(np.asarray(X, dtype=float))
        return found[:, 0] if self.n_outputs_ == 1 else found

    def _learn(self, net: SkipNet, pieces: Pieces, penalty: np.ndarray, prior: np.ndarray, max_iter: int) -> SkipNet:
        """One step ahead first, then through the free run."""
        net, _ = levenberg_marquardt(net, one_step(pieces), penalty, prior, 10, 1e-3)
        if self.loss == "shooting":
            net, _ = levenberg_marquardt(net, shooting(pieces), penalty, prior, max_iter, 1e-4)
        return net

    def _settle(self, nets: list[SkipNet], judged: Pieces) -> None:
        """Keep the maps, and their mean where it runs freely without growing."""
        self.members_ = nets
        self.net_ = merged(nets)
        if not np.all(np.isfinite(roll(self.net_, judged.known, np.nan_to_num(judged.first)))):
            self.net_, self.members_ = nets[0].raw(), nets[:1]

    def _starts(self, pieces: Pieces, weight: np.ndarray) -> list[tuple[SkipNet, np.ndarray, np.ndarray]]:
        """Random tanh layers with the rest by ridge; penalties; and what the penalties pull to: the last deviation kept."""
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
        for _ in range(max(self.n_starts, 1)):
            hidden = rng.normal(size=(len(weight), self.n_hidden_)) / np.sqrt(np.sum(weight**2))
            bias = 0.7 * rng.normal(size=self.n_hidden_)
            basis = np.concatenate([z, np.tanh(z @ hidden + bias), np.ones((len(z), 1))], axis=1)
            normal = basis.T @ basis + 1e-3 * len(basis) * np.eye(basis.shape[1])
            coef = np.linalg.solve(normal, basis.T @ increments)
            m = len(weight)
            net = SkipNet(mean, scale, kept + coef[:m], hidden, bias, coef[m:-1], coef[-1] + mean[:o])
            penalty = np.concatenate(
                [
                    np.full(m * o, 1e-3),
                    np.full(hidden.size, self.alpha * variance),
                    np.zeros(self.n_hidden_),
                    np.full(self.n_hidden_ * o, self.alpha),
                    np.zeros(o),
                ]
            )
            prior = np.concatenate([kept.ravel(), np.zeros(net.theta.size - m * o)])
            found.append((net, penalty, prior))
        return found
