"""Shooting fits by the evidence from several starts; fits that diverge from other initial rows are refused."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sklearn.utils.parallel import _get_threadpool_controller

from sksurrogate.compose._free_fit import Scaling, cut_pieces, displaced, small_weights
from sksurrogate.compose._other_starts import OtherStarts
from sksurrogate.kernels.net import LagNet
from sksurrogate.kernels.shooting import FreeRunLoss, fit_free_run
from sksurrogate.kernels.shooting_evidence import EvidenceFit, first_penalty, fit_by_evidence
from sksurrogate.neural import FNNRegressor

#: Penalty of the reference, and of the fit from random weights: with it no fit has diverged in our measurements.
STRONG = 0.1
#: Penalties beside the mean squared error of one-step starts, until one does not diverge; the first only keeps the weights
#: within the digits of doubles.
STARTING_PENALTIES = (1e-10, 1e-6, 1e-4)
#: Standard errors by which another fit must be better than the first.
SURELY = 2.0
#: Steps of Levenberg-Marquardt to the reference.
REFERENCE_STEPS = 40
#: Rows whose slopes are held at once.
SLOPE_ROWS = 4096


@dataclass(frozen=True, eq=False)
class Posterior:
    """Gaussian posterior of the weights of a shooting fit, and the noise."""

    scaling: Scaling
    fit: EvidenceFit  #: In scaled numbers
    n_first: int

    def deviation(self, U: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Standard deviation of new measurements along free runs (n_runs, n_steps, n_outputs), in units of y."""
        s, n = self.scaling, self.n_first
        u, z = (U - s.u_mean) / s.u_std, (y - s.y_mean) / s.y_std
        evidence, loss = self.fit.evidence, self.fit.loss
        variance = np.full(y.shape, evidence.noise)
        at_once = max(1, SLOPE_ROWS // max(y.shape[1], 1))
        for a in range(0, len(y), at_once):
            part = slice(a, a + at_once)
            own = replace(loss, U=u[part], target=z[part], weight=None)
            J = own.slopes(self.fit.model, z[part])
            variance[part, n:] += np.einsum("rtop,pq,rtoq->rto", J, evidence.covariance, J)
            variance[part] += self._by_start(own, z[part])
        return np.sqrt(variance) * s.y_std

    def _by_start(self, loss: FreeRunLoss, z: np.ndarray) -> np.ndarray:
        """Variance that the noise of the first rows leaves along the runs."""
        n, o = self.n_first, z.shape[2]
        found, size = np.zeros(z.shape), np.sqrt(self.fit.evidence.noise)
        for k in range(n * o):
            push = size * (np.arange(n * o) == k).reshape(n, o)
            ends = []
            for side in (1, -1):
                moved = replace(loss, target=np.concatenate([z[:, :n] + side * push, z[:, n:]], axis=1))
                ends.append(moved.run(self.fit.model, z))
            with np.errstate(all="ignore"):
                away = 0.5 * (ends[0] - ends[1])
            found[:, n:] += np.where(np.isfinite(away), away, np.inf)[:, n:] ** 2
        return found


def shoot_by_evidence(
    model: LagNet,
    runs: Sequence[Any],
    *,
    n_first: int,
    horizon: int | None,
    stability: float,
    n_starts: int,
    random_state: np.random.RandomState,
) -> tuple[LagNet, Posterior]:
    """The model in units of the data, and the posterior of its weights.

    A network is fitted from random weights under a strong penalty, and from the one-step fit (almost without a penalty, and
    with that of its own evidence); a linear model from its own weights. From each start the penalty follows the evidence, and
    the fit ends before a model that :class:`OtherStarts` refuses. The fit from the one-step start is taken, unless another
    one is better on runs left out by more than two standard errors.
    """
    scaling = Scaling(runs)
    U, target = cut_pieces(runs, n_first, horizon)
    U, target = (U - scaling.u_mean) / scaling.u_std, (target - scaling.y_mean) / scaling.y_std
    data = FreeRunLoss(U, target, n_first, STRONG)
    loss = displaced(data, stability) if stability > 0 else data
    with _get_threadpool_controller().limit(limits=1, user_api="blas"):  # small matrices
        if model.net.activations:
            ends = list(_ways(model, loss, data, n_starts, random_state))
        else:
            start = within(loss, scaling.scaled(model))
            ends = [fit_by_evidence(replace(loss, alpha=first_penalty(loss, start)), start, n_rounds=20, n_steps=10)]
        found = [end for end in ends if end is not None]
        if not found:
            raise FloatingPointError
        best = _chosen(found)
    return scaling.raw(best.model), Posterior(scaling, best, n_first)


def _chosen(ends: list[EvidenceFit]) -> EvidenceFit:
    """The first fit, unless another is better on what is left out by :data:`SURELY` standard errors."""
    errors = [end.left_out() for end in ends]
    best = int(np.argmin([error.mean() for error in errors]))
    gain = errors[0] - errors[best]
    return ends[best] if gain.mean() > SURELY * gain.std(ddof=1) / np.sqrt(len(gain)) else ends[0]


def _ways(
    model: LagNet, loss: FreeRunLoss, data: FreeRunLoss, n_starts: int, rng: np.random.RandomState
) -> Iterator[EvidenceFit | None]:
    """Fits of a network, those from one-step fits first; the reference itself where every other is refused."""
    starts = [model.at(small_weights(model.net, rng)) for _ in range(n_starts)]
    reference = fit_free_run(loss, starts, max_iter=REFERENCE_STEPS)[0]
    guard = OtherStarts(reference, data.U, data.target, data.n_first, rng)
    for alphas in (STARTING_PENALTIES, ("evidence",)):
        for alpha in alphas:
            start = _one_step(model, data, alpha, rng)
            if start is not None and guard.accepts(start):
                yield fit_by_evidence(replace(loss, alpha=first_penalty(loss, start)), start, accepts=guard.accepts)
                break
    down = fit_by_evidence(loss, reference, accepts=guard.accepts)
    yield down if down is not None else fit_by_evidence(loss, reference, n_rounds=1)


def _one_step(model: LagNet, loss: FreeRunLoss, alpha: Any, rng: np.random.RandomState) -> LagNet | None:
    """The one-step fit of a network of this shape; None where it has too many weights for the evidence."""
    n, o = loss.n_first, model.n_outputs
    phi = np.concatenate([model.past_rows(loss.target, n), model.input_rows(loss.U, n)]).T
    wanted = loss.target[:, n:].reshape(-1, o)
    known = np.isfinite(phi).all(axis=1) & np.isfinite(wanted).all(axis=1)
    sizes, kinds = [len(b) for b in model.net.biases[:-1]], model.net.activations
    solver = "lm" if model.theta.size <= MOST_WEIGHTS else "lbfgs"
    if solver != "lm" and alpha == "evidence":
        return None
    net = FNNRegressor(sizes, list(kinds), solver=solver, alpha=alpha, random_state=rng.randint(2**31 - 1))
    net.fit(phi[known], wanted[known])
    return replace(model, net=replace(model.net, weights=tuple(net.coefs_), biases=tuple(net.intercepts_)))


#: Weights up to which a one-step start is fitted by Levenberg-Marquardt, as FNNRegressor does by itself.
MOST_WEIGHTS = 300


def within(loss: Any, model: Any) -> Any:
    """A linear model whose free runs diverge, its weights shrunk until they do not."""
    for _ in range(30):
        if np.isfinite(loss.value(model, loss.run(model))):
            break
        model = model.at(0.8 * model.theta)
    return model
