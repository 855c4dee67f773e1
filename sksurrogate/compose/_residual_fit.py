"""Losses of a correction, one step ahead and through its own free run: pieces of runs at once, exact slopes, penalties."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dtbtrs

from sksurrogate.compose._skip_net import SkipNet
from sksurrogate.kernels.evidence import weigh


@dataclass(frozen=True, eq=False)
class Pieces:
    """Stretches of runs, all of one length, that are run freely from their own first rows."""

    known: np.ndarray  #: (n_steps, n_pieces, n_known): features that do not depend on what is learned
    target: np.ndarray  #: (n_steps, n_pieces, n_outputs): nan behind the end of shorter runs
    n_lags: int  #: Rows that are given; also the number of past outputs among the features

    @property
    def first(self) -> np.ndarray:
        """Given rows."""
        return self.target[: self.n_lags]


def cut(known: Sequence[np.ndarray], target: Sequence[np.ndarray], n_lags: int, longest: int, most_rows: int) -> Pieces:
    """Cut runs into pieces of at most ``longest`` steps, evenly thinned to about ``most_rows`` rows in all."""
    length = min(max(len(k) for k in known), longest + n_lags)
    pieces = []
    for k, y in zip(known, target):
        # every piece begins with n_lags measured rows, shared with the end of the piece before it
        for start in range(0, max(len(k) - n_lags, 1), length - n_lags):
            if len(k) - start > n_lags or not start:
                pieces.append((k[start : start + length], y[start : start + length]))
    stride = max(1, int(np.ceil(len(pieces) * (length - n_lags) / most_rows)))
    pieces = pieces[::stride]
    known_out = np.zeros((length, len(pieces), known[0].shape[1]))
    target_out = np.full((length, len(pieces), target[0].shape[1]), np.nan)
    for p, (k, y) in enumerate(pieces):
        known_out[: len(k), p], known_out[len(k) :, p] = k, k[-1]
        target_out[: len(y), p] = y
    return Pieces(known_out, target_out, n_lags)


def features(y: np.ndarray, known: np.ndarray, n_lags: int) -> np.ndarray:
    """(n_steps - n_lags, n_pieces, n_features): past outputs, newest first, then the known."""
    n = len(y)
    return np.concatenate([*(y[n_lags - k : n - k] for k in range(1, n_lags + 1)), known[n_lags:]], axis=2)


def roll(net: SkipNet, known: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Free runs, all at once: (n_steps, n_pieces, n_outputs)."""
    raw, n_lags, o = net.raw(), len(first), first.shape[2]
    steps, pieces = known.shape[:2]
    past, units = n_lags * o, raw.hidden.shape[1]
    by_past = np.concatenate([raw.hidden[:past], raw.skip[:past]], axis=1)
    sums = np.concatenate([known @ raw.hidden[past:] + raw.hidden_bias, known @ raw.skip[past:] + raw.bias], axis=2)
    # newest first: the past of a row is one slice
    newest_first = np.empty((pieces, steps * o))
    y = newest_first.reshape(pieces, steps, o)[:, ::-1].transpose(1, 0, 2)
    y[:n_lags] = first
    z, h = np.empty((pieces, units + o)), np.empty((pieces, units))
    with np.errstate(all="ignore"):
        for t in range(n_lags, steps):
            row = (steps - t) * o
            np.matmul(newest_first[:, row : row + past], by_past, out=z)
            z += sums[t]
            np.tanh(z[:, :units], out=h)
            np.add(h @ raw.out, z[:, units:], out=newest_first[:, row - o : row])
    return y


def sensitivities(by_phi: np.ndarray, by_theta: np.ndarray, n_lags: int) -> np.ndarray:
    """Slopes of free runs by the parameters: one banded triangular solve a piece.

    ``by_phi`` (n_steps, n_pieces, n_outputs, n_features), ``by_theta`` (n_steps, n_pieces, n_outputs, n_theta).
    """
    m, pieces, o, _ = by_phi.shape
    out = np.empty_like(by_theta)
    for r in range(pieces):
        band = np.zeros(((n_lags + 1) * o, m * o))
        for k in range(1, n_lags + 1):
            for j in range(o):
                for i in range(o):
                    band[k * o + j - i, i : max(m - k, 0) * o : o] = -by_phi[k:, r, j, (k - 1) * o + i]
        out[:, r] = dtbtrs(band, by_theta[:, r].reshape(m * o, -1), uplo="L", diag="U")[0].reshape(by_theta[:, r].shape)
    return out


@dataclass(frozen=True, eq=False)
class CorrectionLoss(ABC):
    """``sum e^2 + sum penalty_i (theta_i - prior_i)^2`` of a correction."""

    pieces: Pieces
    weight: np.ndarray  #: (n_theta,): penalty of every number
    prior: np.ndarray  #: (n_theta,): what the penalty pulls to
    held: np.ndarray | None = None  #: bool (n_theta,): numbers that stay as they are

    @abstractmethod
    def run(self, net: SkipNet, guess: np.ndarray | None = None, rtol: float = 0.0) -> np.ndarray:
        """What the correction gives."""

    @abstractmethod
    def errors(self, y: np.ndarray) -> np.ndarray:
        """Errors of measured rows, (n_errors,)."""

    @abstractmethod
    def slopes(self, net: SkipNet, y: np.ndarray) -> np.ndarray:
        """Slopes of :meth:`errors`, (n_errors, n_theta)."""

    def jacobian(self, net: SkipNet, y: np.ndarray) -> np.ndarray:
        """The same, 0 for numbers that are held."""
        J = self.slopes(net, y)
        if self.held is not None:
            J[:, self.held] = 0.0
        return J

    def penalty(self, net: SkipNet) -> np.ndarray:
        """Penalty of every number, (n_theta,)."""
        return self.weight

    def pull(self, net: SkipNet) -> np.ndarray:
        """Half the slope of the penalty, (n_theta,)."""
        return self.weight * (net.theta - self.prior)

    def value(self, net: SkipNet, y: np.ndarray) -> float:
        """The loss; inf where a run diverged."""
        with np.errstate(over="ignore", invalid="ignore"):
            total = float(np.sum(self.errors(y) ** 2) + self.pull(net) @ (net.theta - self.prior))
        return total if np.isfinite(total) else np.inf


class FreeRunCorrection(CorrectionLoss):
    """Errors of free runs of the pieces."""

    @cached_property
    def _measured(self) -> np.ndarray:
        """Which numbers behind the first rows were measured."""
        return np.isfinite(self.pieces.target[self.pieces.n_lags :])

    def run(self, net: SkipNet, guess: np.ndarray | None = None, rtol: float = 0.0) -> np.ndarray:
        """Free runs, (n_steps, n_pieces, n_outputs)."""
        return roll(net, self.pieces.known, np.nan_to_num(self.pieces.first))

    def errors(self, y: np.ndarray) -> np.ndarray:
        """Errors of measured rows, (n_errors,)."""
        n = self.pieces.n_lags
        return (y[n:] - self.pieces.target[n:])[self._measured]

    def slopes(self, net: SkipNet, y: np.ndarray) -> np.ndarray:
        """Slopes of :meth:`errors`, (n_errors, n_theta)."""
        n = self.pieces.n_lags
        with np.errstate(all="ignore"):
            phi = features(y, self.pieces.known, n)
            _, by_phi, by_theta = net.jacobians(phi.reshape(-1, phi.shape[2]))
            shape = (*self._measured.shape, -1)
            return sensitivities(by_phi.reshape(shape), by_theta.reshape(shape), n)[self._measured]


class OneStepCorrection(CorrectionLoss):
    """Errors of one step from measured rows."""

    @cached_property
    def _rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Features and targets of rows that are measured, with their past."""
        pieces, n = self.pieces, self.pieces.n_lags
        phi = features(pieces.target, pieces.known, n)
        phi, wanted = phi.reshape(-1, phi.shape[2]), pieces.target[n:].reshape(-1, pieces.target.shape[2])
        rows = np.isfinite(wanted).all(axis=1) & np.isfinite(phi).all(axis=1)
        return phi[rows], wanted[rows]

    def run(self, net: SkipNet, guess: np.ndarray | None = None, rtol: float = 0.0) -> np.ndarray:
        """One step on, (n_rows, n_outputs)."""
        return net(self._rows[0])

    def errors(self, y: np.ndarray) -> np.ndarray:
        """Errors of measured rows, (n_errors,)."""
        return (y - self._rows[1]).ravel()

    def slopes(self, net: SkipNet, y: np.ndarray) -> np.ndarray:
        """Slopes of :meth:`errors`, (n_errors, n_theta)."""
        by_theta = net.jacobians(self._rows[0])[2]
        return by_theta.reshape(-1, by_theta.shape[2])


def weighed(loss: CorrectionLoss, net: SkipNet) -> np.ndarray:
    """The penalty of every number by the evidence, (n_theta,): one for each group of weights, see :attr:`SkipNet.groups`."""
    y = loss.run(net)
    J, e = loss.jacobian(net, y), loss.errors(y)
    if not (np.isfinite(J).all() and np.isfinite(e).all()):
        return loss.weight
    groups = net.groups
    first = np.array([np.mean(loss.weight[groups == g]) for g in range(groups.max() + 1)])
    found = weigh(J.T @ J, net.theta - loss.prior, groups, first, float(e @ e), float(len(e)))
    return np.where(groups >= 0, found.penalty[np.maximum(groups, 0)], 0.0)
