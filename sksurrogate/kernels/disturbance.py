"""Likelihood of a free-run residual under white sensor noise, coloured forces in the balances and coloured sensor noise.

``r = C dx + v + e``, ``dx' = A_k dx + B_k w``: w one Ornstein-Uhlenbeck force for every balance, v one for every sensor,
e white; the initial dx is diffuse, so that fitted initial states cost nothing. The states of all runs are one Gaussian
Markov chain; its posterior precision is block tridiagonal and one banded Cholesky factor gives the marginal likelihood.

References
----------
Kristensen, Madsen, Jorgensen, *Parameter estimation in stochastic grey-box models*, Automatica 40 (2004).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs, dtbtrs

from sksurrogate.kernels.banded import (
    a_sample_later,
    block_steps,
    first_order_scan,
    recursion_band,
    solve_blocks,
    solve_recursion,
    solved_squares,
)


@dataclass(frozen=True, eq=False)
class Noise:
    """Parameters of the noise."""

    sigma: np.ndarray  #: (n_outputs,): white sensor noise
    force: np.ndarray  #: (n_balances,): standard deviation of the force in every balance, units of dx/dt
    tau: float  #: Its correlation time in samples
    coloured: np.ndarray  #: (n_outputs,): standard deviation of the coloured sensor noise
    tau_sensor: float  #: Its correlation time in samples

    def pack(self) -> np.ndarray:
        """As one vector of logarithms."""
        return np.log(np.concatenate([self.sigma, self.force, [self.tau], self.coloured, [self.tau_sensor]]))

    def held(self, sigma: Any = False, force: Any = False, coloured: Any = False) -> np.ndarray:
        """Which parameters stay in a fit, in the order of :meth:`pack`; a correlation time where all of its noises do."""
        m, b = len(self.sigma), len(self.force)
        white, forces, sensors = (np.broadcast_to(one, n) for one, n in ((sigma, m), (force, b), (coloured, m)))
        return np.concatenate([white, forces, [forces.all()], sensors, [sensors.all()]]).astype(bool)

    def unpack(self, eta: np.ndarray) -> Noise:
        """The inverse of :meth:`pack`."""
        v = np.exp(eta)
        m, b = len(self.sigma), len(self.force)
        return Noise(v[:m], v[m : m + b], float(v[m + b]), v[m + b + 1 : 2 * m + b + 1], float(v[-1]))


#: Columns that walk through the samples at once: more leave the processor's cache.
MOST_ABREAST = 256


def _together(blocks: Iterable[np.ndarray], most: int) -> Iterator[list[np.ndarray]]:
    """Blocks of columns (n_outputs, n_columns, n_samples) in lists of at most so many columns, or of one block."""
    some: list[np.ndarray] = []
    for block in blocks:
        if some and sum(b.shape[1] for b in some) + block.shape[1] > most:
            yield some
            some = []
        some.append(block)
    if some:
        yield some


class Disturbance:
    """The noise model along one free run.

    ``A`` (n_states, n_states, n_samples): state Jacobians of the step map.
    ``B`` (n_states, n_balances, n_samples): effect of a unit force over one sample.
    ``C`` (n_outputs, n_states, n_samples): output Jacobians.
    ``starts`` int (n_runs,).
    ``start_sd`` (n_states,): standard deviation of the initial dx (wide).
    ``slack`` (n_states,): tiny process noise that keeps the precision finite; far below the sensor noise.
    ``known`` bool (n_outputs, n_samples): which values were measured: the others have no part in any likelihood,
        whatever a residual holds there.
    """

    def __init__(
        self, A: np.ndarray, B: np.ndarray, C: np.ndarray, starts: np.ndarray, start_sd: np.ndarray, slack: np.ndarray,
        known: np.ndarray | None = None,
    ):  # fmt: skip
        self.n, self.n_samples = A.shape[0], A.shape[2]
        self.m, self.b = C.shape[0], B.shape[1]
        self.size = self.n + self.b + self.m
        self.starts = starts
        self.ends = np.r_[starts[1:], self.n_samples] - 1
        self.inner = np.ones(self.n_samples)
        self.inner[self.ends] = 0.0
        self.later = np.ones(self.n_samples)
        self.later[starts] = 0.0
        self.start_sd, self.slack = start_sd, slack
        self.known = known
        C = C if known is None else np.where(known[:, None], C, 0.0)
        self.A, self.B, self.C = A.transpose(2, 0, 1), B.transpose(2, 0, 1), C.transpose(2, 0, 1)
        # States that each output sees; most see one.
        self.seen = [np.flatnonzero(np.any(self.C[:, j] != 0.0, axis=0)) for j in range(self.m)]
        self.constant = self._constant()

    @cached_property
    def counts(self) -> np.ndarray:
        """Measured values of every output in every run, (n_runs, n_outputs)."""
        if self.known is None:
            return np.repeat((self.ends + 1 - self.starts)[:, None], self.m, axis=1)
        return np.add.reduceat(self.known, self.starts, axis=1, dtype=int).T

    @cached_property
    def n_values(self) -> int:
        """Measured values."""
        return int(self.counts.sum())

    def at_measured(self, r: np.ndarray) -> np.ndarray:
        """Columns (n_outputs, ..., n_samples) with 0 where nothing was measured."""
        if self.known is None:
            return r
        return np.where(self.known.reshape(self.m, *(1,) * (r.ndim - 2), self.n_samples), r, 0.0)

    def weight_of(self, j: int) -> np.ndarray:
        """1 where output j was measured, else 0, (n_samples,)."""
        return np.ones(self.n_samples) if self.known is None else self.known[j].astype(float)

    @cached_property
    def _recursion(self) -> np.ndarray:
        """The step map over all samples, as a band."""
        return recursion_band(np.ascontiguousarray(self.A.transpose(1, 2, 0)), self.starts)

    def moved(self, change: np.ndarray) -> np.ndarray:
        """What changes of the next states (n_states, k, n_samples) move the outputs by: (n_outputs, k, n_samples)."""
        states = solve_recursion(self._recursion, a_sample_later(change, self.starts))
        out = np.zeros((self.m, *change.shape[1:]))
        for j, seen in enumerate(self.seen):
            for i in seen:
                out[j] += self.C[:, j, i] * states[i]
        return out

    def _constant(self) -> np.ndarray:
        """Lower band of the posterior precision without what depends on the noise parameters (n_samples, size, size + n)."""
        n, size, top = self.n, self.size, self.n + self.b
        q_x = 1.0 / self.slack**2
        # The parts of F'F that do not depend on the noise parameters.
        G = np.concatenate([self.A, self.B], axis=2) * self.inner[:, None, None]
        GG = G.transpose(0, 2, 1) @ (G / self.slack[:, None] ** 2)
        band = np.zeros((self.n_samples, size, size + n))
        for i in range(top):
            for j in range(i + 1):
                band[:, j, i - j] = GG[:, i, j]
        for i in range(n):
            band[:, i, 0] += self.later * q_x[i] + (1.0 - self.later) / self.start_sd[i] ** 2
            for j in range(top):
                band[:, j, size + i - j] = -q_x[i] * G[:, i, j]
        return band

    def in_runs_from(self, starts: np.ndarray) -> Disturbance:
        """The same noise along the same trajectory, with runs cut into blocks that begin at ``starts``."""
        if np.array_equal(starts, self.starts):
            return self
        A, B, C = (part.transpose(1, 2, 0) for part in (self.A, self.B, self.C))
        return Disturbance(A, B, C, starts, self.start_sd, self.slack, self.known)

    def with_forces(self, B: np.ndarray) -> Disturbance:
        """The same trajectory and sensors under other forces, which move the states by B over one sample."""
        A, C = self.A.transpose(1, 2, 0), self.C.transpose(1, 2, 0)
        return Disturbance(A, B, C, self.starts, self.start_sd, self.slack, self.known)

    def chains(self, noise: Noise) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Size, memory over a sample and precision of the steps of every coloured noise, forces first."""
        spread = np.concatenate([noise.force, noise.coloured])
        a = np.exp(-1.0 / np.repeat([noise.tau, noise.tau_sensor], [self.b, self.m]))
        return spread, a, 1.0 / (spread**2 * (1 - a**2))

    def precision(self, noise: Noise) -> np.ndarray:
        """Lower band of the posterior precision of states, forces and coloured noise (n_samples, size, size + n_states).

        Entry ``[t, j, d]`` belongs to component j at sample t and to what stands d behind it, samples one behind the other.
        """
        n, size, top = self.n, self.size, self.n + self.b
        _, a, q = self.chains(noise)
        band = self.constant.copy()
        # Chains of first order: q (1 + a^2) on the diagonal, q where a run starts and where it ends, -q a beside it.
        band[:, n:, 0] += q * (1 + a**2)
        band[self.starts, n:, 0] -= q * a**2
        band[self.ends, n:, 0] -= q * a**2
        band[:, n:, size] = -q * a
        band[self.ends, n:, size] = 0.0
        band[:, top:, 0] += noise.sigma**-2 if self.known is None else self.known.T * noise.sigma**-2
        for j, seen in enumerate(self.seen):
            for i in seen:
                weighted = self.C[:, j, i] / noise.sigma[j] ** 2
                for k in seen[seen <= i]:
                    band[:, k, i - k] += weighted * self.C[:, j, k]
                band[:, i, top + j - i] += weighted
        return band

    def factor(self, noise: Noise) -> np.ndarray:
        """Banded Cholesky factor of the posterior precision (size + n_states, n_samples * size)."""
        factor, info = dpbtrf(self.precision(noise).reshape(-1, self.size + self.n).T, lower=1, overwrite_ab=1)
        if info != 0:
            raise np.linalg.LinAlgError("the posterior precision is not positive definite")
        return factor

    def _load(self, r: np.ndarray, noise: Noise) -> np.ndarray:
        """``H' R^-1 r`` of residuals (n_outputs, n_columns, n_samples): (n_samples * size, n_columns), column by column."""
        k, top = r.shape[1], self.n + self.b
        out = np.zeros((k, self.n_samples, self.size))
        for j in range(self.m):
            scaled = r[j] / noise.sigma[j] ** 2
            for i in self.seen[j]:
                out[:, :, i] += self.C[:, j, i] * scaled
            out[:, :, top + j] += scaled
        return out.reshape(k, self.n_samples * self.size).T

    def _log_det(self, factor: np.ndarray, noise: Noise) -> np.ndarray:
        """log det S of every run: posterior precision over prior precision, times the white noise."""
        spread, _, q = self.chains(noise)
        lengths = self.ends + 1 - self.starts
        posterior = 2.0 * np.add.reduceat(np.log(factor[0]), self.starts * self.size)
        prior = (lengths - 1) * (np.sum(np.log(q)) - 2 * np.sum(np.log(self.slack)))
        prior = prior - 2 * (np.sum(np.log(self.start_sd)) + np.sum(np.log(spread)))
        if self.known is None:
            return posterior - prior + 2.0 * lengths * np.sum(np.log(noise.sigma))
        return posterior - prior + 2.0 * self.counts @ np.log(noise.sigma)

    def gram(self, r: np.ndarray, noise: Noise, factor: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        """``r' S^-1 r`` of columns r (n_outputs, n_columns, n_samples) with S the covariance of the residual, and log det S."""
        factor = self.factor(noise) if factor is None else factor
        flat, half = self._whitened(factor, self.at_measured(r), noise)
        return flat @ flat.T - half @ half.T, float(np.sum(self._log_det(factor, noise)))

    def grams_beside(self, r: np.ndarray, noise: Noise) -> Callable[[Iterable[np.ndarray]], Iterator[np.ndarray]]:
        """The matrix of :meth:`gram` of columns r with each block of further columns beside them.

        The factor, and what belongs to columns r alone, are computed once.
        """
        steps = self._steps(self.factor(noise), noise)

        def product(a: tuple[np.ndarray, ...], b: tuple[np.ndarray, ...]) -> np.ndarray:
            return a[0].T @ b[0] - a[1].T @ b[1]

        known = self._abreast(steps, self.at_measured(r), noise)
        K = product(known, known)

        def each(blocks: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
            for some in _together(blocks, MOST_ABREAST):
                whole = self._abreast(steps, self.at_measured(np.concatenate(some, axis=1)), noise)
                cross, b = product(known, whole), 0
                for block in some:
                    a, b = b, b + block.shape[1]
                    own, k = (whole[0][:, a:b], whole[1][:, a:b]), len(K)
                    G = np.empty((k + b - a, k + b - a))
                    G[:k, :k], G[:k, k:], G[k:, :k], G[k:, k:] = K, cross[:, a:b], cross[:, a:b].T, product(own, own)
                    yield G

        return each

    def _steps(self, factor: np.ndarray, noise: Noise) -> np.ndarray:
        """The recursion of ``L^-1 H' R^-1/2``."""
        H = np.zeros((self.n_samples, self.size, self.m))
        H[:, : self.n] = self.C.transpose(0, 2, 1) / noise.sigma
        white = np.diag(1.0 / noise.sigma)
        H[:, self.n + self.b :] = white if self.known is None else white * self.known.T[:, None]
        return block_steps(factor, H)

    def _abreast(self, steps: np.ndarray, r: np.ndarray, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
        """What :meth:`_whitened` gives, of hundreds of columns, each (..., n_columns)."""
        scaled = (r / noise.sigma[:, None, None]).transpose(2, 0, 1).copy()
        half = solve_blocks(steps, scaled)
        return scaled.reshape(-1, r.shape[1]), half.reshape(-1, r.shape[1])

    def _whitened(self, factor: np.ndarray, r: np.ndarray, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
        """Columns r over the white noise, and what states and coloured noise take of them; each (n_columns, ...)."""
        half, _ = dtbtrs(factor, self._load(r, noise), uplo="L", overwrite_b=1)
        return (r / noise.sigma[:, None, None]).transpose(1, 0, 2).reshape(r.shape[1], -1), half.T

    def gram_by_run(
        self, r: np.ndarray, noise: Noise, factor: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """The matrix of :meth:`gram` run by run, (n_runs, n_columns, n_columns), and its log determinants; they add up to it."""
        factor, r = self.factor(noise) if factor is None else factor, self.at_measured(r)
        half, _ = dtbtrs(factor, self._load(r, noise), uplo="L", overwrite_b=1)
        flat = r / noise.sigma[:, None, None]
        out = []
        for a, b in zip(self.starts, self.ends + 1):
            white = flat[:, :, a:b].transpose(1, 0, 2).reshape(r.shape[1], -1)
            own = half[a * self.size : b * self.size]
            out.append(white @ white.T - own.T @ own)
        return np.stack(out), self._log_det(factor, noise)

    def gram_rows(
        self, r: np.ndarray, noise: Noise, n_rows: int, unit: np.ndarray | float = 1.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """First rows (n_rows, n_columns) and the diagonal (n_columns,) of :meth:`gram`, for many columns.

        Columns (n_columns, n_outputs, n_samples) lie one behind the other here, each over the ``unit`` of its output.
        """
        factor = self.factor(noise)
        r = r if self.known is None else np.where(self.known, r, 0.0)
        steps, unit = self._steps(factor, noise), np.broadcast_to(unit, self.m)[:, None, None]
        first = r[:n_rows].transpose(1, 0, 2) * unit
        solved, _ = dpbtrs(factor, self._load(first, noise), lower=1)
        # S^-1 = R^-1 - R^-1 H P^-1 H' R^-1
        shown = self._shown(solved.T.reshape(n_rows, self.n_samples, self.size))
        weights = (first - shown) * unit / noise.sigma[:, None, None] ** 2
        rows = weights.transpose(1, 0, 2).reshape(n_rows, -1) @ r.reshape(len(r), -1).T
        diagonal, weight = np.empty(len(r)), unit[:, 0] / noise.sigma[:, None]
        for a in range(0, len(r), MOST_ABREAST):
            whitened = (r[a : a + MOST_ABREAST] * weight).transpose(2, 1, 0).copy()
            white = np.einsum("tok,tok->k", whitened, whitened)
            diagonal[a : a + MOST_ABREAST] = white - solved_squares(steps, whitened)
        return rows, diagonal

    def weighted(self, r: np.ndarray, noise: Noise, factor: np.ndarray | None = None) -> np.ndarray:
        """``S^-1 r`` of columns r (n_outputs, n_columns, n_samples): ``S^-1 = R^-1 - R^-1 H P^-1 H' R^-1``."""
        factor = self.factor(noise) if factor is None else factor
        out = np.empty(r.shape)
        for a in range(0, r.shape[1], MOST_ABREAST):  # the states of one column take the most memory
            some = r[:, a : a + MOST_ABREAST]
            solved, _ = dpbtrs(factor, self._load(some, noise), lower=1, overwrite_b=1)
            shown = self._shown(solved.T.reshape(some.shape[1], self.n_samples, self.size))
            out[:, a : a + MOST_ABREAST] = (some - shown) / noise.sigma[:, None, None] ** 2
        return out

    def _shown(self, states: np.ndarray) -> np.ndarray:
        """What states and coloured noise (n_columns, n_samples, size) show in the outputs: (n_outputs, n_columns, n_samples)."""
        shown = np.einsum("toi,kti->okt", self.C, states[:, :, : self.n])
        return self.at_measured(shown + states[:, :, self.n + self.b :].transpose(2, 0, 1))

    def log_likelihood(self, r: np.ndarray, noise: Noise) -> float:
        """Of a residual (n_outputs, n_samples), without the constant."""
        inner, logdet = self.gram(r[:, None, :], noise)
        return -0.5 * (float(inner[0, 0]) + logdet)

    def spread(self, v: np.ndarray, noise: Noise) -> np.ndarray:
        """``v' S v`` of columns v (n_outputs, n_columns, n_samples): covariance of sums of the residual weighted with v.

        The initial dx are left out: they belong to the fit. By the adjoint of the recursion, force by force.
        """
        n, k, v = self.n, v.shape[1], self.at_measured(v)
        white = np.einsum("okt,olt,o->kl", v, v, noise.sigma**2)
        # Adjoint of dx: p[t] = A[t]' p[t+1] + C[t]' v[t], then the weight of w[t] is B[t]' p[t+1].
        load = np.einsum("toi,okt->ikt", self.C, v)
        back = self.A.transpose(2, 1, 0)[:, :, ::-1] * self.inner[::-1]
        order = np.r_[np.arange(1, self.n_samples), 0]
        starts = np.sort(self.n_samples - 1 - self.ends)
        band = recursion_band(back[:, :, order], starts)
        p = solve_recursion(band, load[:, :, ::-1])[:, :, ::-1]
        ahead = np.concatenate([p[:, :, 1:], np.zeros((n, k, 1))], axis=2) * self.inner
        weights = [np.einsum("ti,ikt->kt", self.B[:, :, b], ahead) for b in range(self.b)]
        out = white
        for series, size, tau in [
            *((w, s, noise.tau) for w, s in zip(weights, noise.force)),
            *((v[j], s, noise.tau_sensor) for j, s in enumerate(noise.coloured)),
        ]:
            a = np.exp(-1.0 / tau)
            forward = first_order_scan(a, series, self.starts)
            cross = series @ (forward - 0.5 * series).T
            out = out + size**2 * (cross + cross.T)
        return out

    def states(self, r: np.ndarray, noise: Noise) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Posterior mean of dx (n_states, n_samples), of the forces (n_balances, n_samples), of coloured sensor noise."""
        s = self.mean(r, noise, self.factor(noise))
        return s[: self.n], s[self.n : self.n + self.b], s[self.n + self.b :]

    def mean(self, r: np.ndarray, noise: Noise, factor: np.ndarray) -> np.ndarray:
        """Posterior mean of dx, forces and coloured noise (size, n_samples) given a residual (n_outputs, n_samples)."""
        solved, _ = dpbtrs(factor, np.asfortranarray(self._load(self.at_measured(r)[:, None, :], noise)), lower=1)
        return solved[:, 0].reshape(self.n_samples, self.size).T
