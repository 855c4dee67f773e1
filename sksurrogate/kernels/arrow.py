"""Least squares whose normal matrix is an arrow: parameters shared by all runs, initial states of each run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Arrow"]


@dataclass(frozen=True, eq=False)
class Arrow:
    """Normal equations of ``min |r - Jt dtheta - Jx dx0(run)|^2``, columns scaled to norm 1.

    Attributes
    ----------
    Htt : ndarray (n_theta, n_theta)
    Htx : ndarray (n_runs, n_theta, n_x)
    Hxx : ndarray (n_runs, n_x, n_x)
    gt : ndarray (n_theta,)
    gx : ndarray (n_runs, n_x)
    t_scale, x_scale : ndarray
        Norms that the columns were divided by.
    """

    Htt: np.ndarray
    Htx: np.ndarray
    Hxx: np.ndarray
    gt: np.ndarray
    gx: np.ndarray
    t_scale: np.ndarray
    x_scale: np.ndarray

    @classmethod
    def build(
        cls, Jt: np.ndarray, Jx: np.ndarray, r: np.ndarray, starts: np.ndarray, precision: np.ndarray, pull: np.ndarray
    ) -> Arrow:
        """From Jacobians and residuals in units of the noise.

        Parameters
        ----------
        Jt : ndarray (n_outputs, n_theta, n_samples)
        Jx : ndarray (n_outputs, n_x, n_samples)
        r : ndarray (n_outputs, n_samples)
        starts : ndarray of int (n_runs,)
        precision, pull : ndarray (n_theta,)
            Gaussian prior: adds ``precision`` to the normal matrix and ``pull`` to the gradient.
        """
        n_theta, n_x = Jt.shape[1], Jx.shape[1]
        J = np.concatenate([Jt, Jx], axis=1)
        flat = J.transpose(1, 0, 2).reshape(n_theta + n_x, -1)
        norm = np.sqrt(np.einsum("ij,ij->i", flat, flat))
        t_scale = np.sqrt(norm[:n_theta] ** 2 + precision)
        x_scale = norm[n_theta:].copy()
        t_scale[t_scale == 0] = 1.0
        x_scale[x_scale == 0] = 1.0
        bounds = np.r_[starts, r.shape[1]]
        n_runs = len(starts)
        Htt = np.diag(precision / t_scale**2)
        Htx, Hxx = np.empty((n_runs, n_theta, n_x)), np.empty((n_runs, n_x, n_x))
        gt, gx = pull / t_scale, np.empty((n_runs, n_x))
        scale = np.concatenate([t_scale, x_scale])[:, None]
        for k in range(n_runs):
            part = J[:, :, bounds[k] : bounds[k + 1]].transpose(1, 0, 2).reshape(n_theta + n_x, -1) / scale
            H, g = part @ part.T, part @ r[:, bounds[k] : bounds[k + 1]].ravel()
            Htt += H[:n_theta, :n_theta]
            Htx[k], Hxx[k] = H[:n_theta, n_theta:], H[n_theta:, n_theta:]
            gt = gt + g[:n_theta]
            gx[k] = g[n_theta:]
        return cls(Htt, Htx, Hxx, gt, gx, t_scale, x_scale)

    def _eliminated(self, damping: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Schur complement and gradient of theta; (Hxx + ridge)^-1."""
        n_x = self.Hxx.shape[1]
        # The tiny ridge keeps initial states that the data do not show where they are.
        ridge = (damping + 1e-9) * np.eye(n_x)
        inverse = np.linalg.pinv(self.Hxx + ridge, hermitian=True) if n_x else np.zeros_like(self.Hxx)
        S = self.Htt - np.einsum("rij,rjk,rlk->il", self.Htx, inverse, self.Htx)
        g = self.gt - np.einsum("rij,rjk,rk->i", self.Htx, inverse, self.gx)
        return S, g, inverse

    def step(self, damping: float, held: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, float]:
        """Damped step: dtheta (n_theta,), dx0 (n_x, n_runs), and the drop of the sum of squares that it predicts.

        ``held`` (n_theta,) says how far single parameters move, nan for those that the step decides.
        """
        if not (np.all(np.isfinite(self.Htt)) and np.all(np.isfinite(self.gt)) and np.all(np.isfinite(self.Hxx))):
            return np.full(len(self.gt), np.nan), np.full(self.gx.shape[::-1], np.nan), -np.inf
        S, g, inverse = self._eliminated(damping)
        n_theta = len(g)
        damped = S + damping * np.eye(n_theta)
        if held is None or np.all(np.isnan(held)):
            dt = np.linalg.lstsq(damped, g, rcond=1e-12)[0] if n_theta else np.zeros(0)
        else:
            free = np.isnan(held)
            dt = np.where(free, 0.0, held * self.t_scale)
            if free.any():
                dt[free] = np.linalg.lstsq(damped[np.ix_(free, free)], (g - S @ dt)[free], rcond=1e-12)[0]
        dx = np.einsum("rij,rj->ri", inverse, self.gx - np.einsum("rij,i->rj", self.Htx, dt))
        quadratic = (
            dt @ self.Htt @ dt
            + 2 * np.einsum("i,rij,rj->", dt, self.Htx, dx)
            + np.einsum("ri,rij,rj->", dx, self.Hxx, dx)
        )
        drop = 2 * (self.gt @ dt + np.sum(self.gx * dx)) - quadratic
        return dt / self.t_scale, (dx / self.x_scale).T, float(drop)

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
