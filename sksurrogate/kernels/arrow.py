"""Least squares whose normal matrix is an arrow: parameters shared by all runs, initial states of each run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dposv

from sksurrogate.kernels.linear_fit import linear_least_squares


@dataclass(frozen=True, eq=False)
class Arrow:
    """Normal equations of ``min |r - Jt dtheta - Jx dx0(run)|^2``, columns scaled to norm 1."""

    Htt: np.ndarray  #: (n_theta, n_theta)
    Htx: np.ndarray  #: (n_runs, n_theta, n_x)
    Hxx: np.ndarray  #: (n_runs, n_x, n_x)
    gt: np.ndarray  #: (n_theta,)
    gx: np.ndarray  #: (n_runs, n_x)
    #: t_scale, x_scale: norms that the columns were divided by
    t_scale: np.ndarray
    x_scale: np.ndarray

    @classmethod
    def build(
        cls, Jt: np.ndarray, Jx: np.ndarray, r: np.ndarray, sd: np.ndarray, starts: np.ndarray, precision: np.ndarray,
        pull: np.ndarray,
    ) -> Arrow:  # fmt: skip
        """From Jacobians and residuals.

        ``Jt`` (n_outputs, n_theta, n_samples), ``Jx`` (n_outputs, n_x, n_samples), ``r`` (n_outputs, n_samples).
        ``sd`` (n_outputs,): size of the noise, which rows are divided by.
        ``starts`` int (n_runs,).
        ``precision, pull`` (n_theta,): Gaussian prior: adds ``precision`` to the normal matrix and ``pull`` to the
            gradient.
        """
        k, n = Jt.shape[1], Jt.shape[1] + Jx.shape[1]
        rows = np.concatenate([Jt, Jx, r[:, None]], axis=1)
        M = np.zeros((len(starts), n + 1, n + 1))  # [J r]' [J r] of every run
        ends = [*starts[1:], r.shape[1]]
        for row, size in zip(rows, sd):
            for run, (a, b) in enumerate(zip(starts, ends)):
                M[run] += row[:, a:b] @ row[:, a:b].T / size**2
        squares = M.sum(axis=0).diagonal()[:n].copy()
        squares[:k] += precision
        scale = np.sqrt(np.where(squares == 0, 1.0, squares))
        H, g = M[:, :n, :n] / np.outer(scale, scale), M[:, :n, n] / scale
        t_scale, x_scale = scale[:k], scale[k:]
        Htt = H[:, :k, :k].sum(axis=0) + np.diag(precision / t_scale**2)
        gt = g[:, :k].sum(axis=0) + pull / t_scale
        return cls(Htt, H[:, :k, k:], H[:, k:, k:], gt, g[:, k:], t_scale, x_scale)

    def _eliminated(self, damping: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Schur complement and gradient of theta; ``(Hxx + ridge)^-1 [Hxt, gx]``, (n_runs, n_x, n_theta + 1)."""
        n_x = self.Hxx.shape[1]
        right = np.concatenate([self.Htx.transpose(0, 2, 1), self.gx[:, :, None]], axis=2)
        if n_x == 0:
            return self.Htt, self.gt, right
        # The tiny ridge keeps initial states that the data do not show where they are.
        solved = np.linalg.solve(self.Hxx + (damping + 1e-9) * np.eye(n_x), right)
        both = (self.Htx @ solved).sum(axis=0)
        return self.Htt - both[:, :-1], self.gt - both[:, -1], solved

    def step(self, damping: float, held: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, float]:
        """Damped step: dtheta (n_theta,), dx0 (n_x, n_runs), and the drop of the sum of squares that it predicts.

        ``held`` (n_theta,) says how far single parameters move, nan for those that the step decides.
        """
        if not (np.all(np.isfinite(self.Htt)) and np.all(np.isfinite(self.gt)) and np.all(np.isfinite(self.Hxx))):
            return np.full(len(self.gt), np.nan), np.full(self.gx.shape[::-1], np.nan), -np.inf
        S, g, solved = self._eliminated(damping)
        damped = S + damping * np.eye(len(g))
        free = np.full(len(g), True) if held is None else np.isnan(held)
        if free.all():
            dt = _solve(damped, g)
        else:
            dt = np.where(free, 0.0, held * self.t_scale)
            dt[free] = _solve(damped[np.ix_(free, free)], (g - S @ dt)[free])
        dx = solved[:, :, -1] - solved[:, :, :-1] @ dt
        quadratic = dt @ self.Htt @ dt + np.sum((2 * (dt @ self.Htx) + (dx[:, None] @ self.Hxx)[:, 0]) * dx)
        drop = 2 * (self.gt @ dt + np.sum(self.gx * dx)) - quadratic
        return dt / self.t_scale, (dx / self.x_scale).T, float(drop)

    def information(self) -> np.ndarray:
        """Normal matrix of theta with the initial states eliminated, (n_theta, n_theta)."""
        return self._eliminated(0.0)[0] * np.outer(self.t_scale, self.t_scale)

    def covariance(self) -> np.ndarray:
        """Covariance of theta with the initial states eliminated (white residual of unit variance); inf where not seen."""
        S, _, _ = self._eliminated(0.0)
        if not len(S):
            return S
        values, vectors = np.linalg.eigh((S + S.T) / 2)
        seen = values > 1e-12 * max(values[-1], 1e-300)
        out = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
        blind = np.sum(vectors[:, ~seen] ** 2, axis=1) > 1e-6
        out[blind, blind] = np.inf
        return out / np.outer(self.t_scale, self.t_scale)


def _solve(M: np.ndarray, b: np.ndarray) -> np.ndarray:
    """``M^-1 b`` of a symmetric matrix, by Cholesky; by least squares where rounding has made it indefinite; nan of what is not finite."""
    if not len(b):
        return np.zeros(0)
    if not (np.isfinite(M).all() and np.isfinite(b).all()):
        return np.full(len(b), np.nan)
    _, x, info = dposv(M, b)
    return x if info == 0 else linear_least_squares(M, b, rcond=1e-12)
