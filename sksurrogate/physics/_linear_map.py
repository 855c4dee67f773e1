"""A plant that is found to be linear in states and inputs along its data: an exact map from sample to sample for every column of parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sksurrogate.kernels.linear_step import HoldMaps, hold_maps
from sksurrogate.physics._linear import NOT_LINEAR

#: Samples at which the right-hand side of a column is compared with its linear law; the first column's is at all of them.
_PROBES = 16

#: t (n_points,), x (n_states, n_points), u (n_inputs, n_points), theta (n_theta, n_points) -> dx/dt (n_states, n_points).
Derivative = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class LinearMap:
    """Whether a right-hand side is linear along states and inputs, and its exact map if it is.

    It is read off by differences over the range of the data, and compared with the right-hand side at the samples whenever a map is asked
    for: a plant may be linear for some parameters only, or in a part of its range.

    ``t`` (n_samples,), ``u`` (n_inputs, n_samples): times, and inputs at the samples.
    ``rise`` (n_inputs, n_samples): by what they rise until the next sample; None where they are held.
    ``dt``: width of a sample.
    """

    def __init__(self, derivative: Derivative, t: np.ndarray, u: np.ndarray, rise: np.ndarray | None, dt: float):
        self.derivative, self.t, self.dt = derivative, t, dt
        self.u = np.concatenate([u, np.ones((1, len(t)))])  # a constant is an input of 1
        self.rise = None if rise is None else np.concatenate([rise, np.zeros((1, len(t)))])

    def after(self, x: np.ndarray, theta: np.ndarray) -> np.ndarray | None:
        """States (n_states, n_columns, n_samples) one sample later; None where the plant is not linear.

        ``theta`` (n_theta, n_columns), or (n_theta, 1) for all.
        """
        own, which = _distinct(theta)
        with np.errstate(all="ignore"):
            law = self._law(x[:, 0], own)
        if law is None:
            return None
        n, order = len(x), 0 if self.rise is None else 1
        maps = [hold_maps(one[:, :n], one[:, n:], self.dt, order) for one in law]
        F, driven = np.stack([one.F for one in maps]), np.stack([self._driven(one) for one in maps])
        after = np.matmul(F[which], x.transpose(1, 0, 2))
        after += driven[which]
        return after.transpose(1, 0, 2)

    def _driven(self, maps: HoldMaps) -> np.ndarray:
        """What the inputs add over a sample, (n_states, n_samples)."""
        held = maps.G @ self.u
        return held if self.rise is None else held + maps.H @ self.rise

    def _law(self, x: np.ndarray, theta: np.ndarray) -> np.ndarray | None:
        """``[A, B, b]`` of every column of theta, (n_columns, n_states, n_states + n_inputs + 1); None where one is not linear."""
        signals = np.concatenate([x, self.u[:-1]])
        some = np.unique(np.linspace(0, len(self.t) - 1, _PROBES).astype(int))
        if not self._is_straight(signals[:, some], len(x), theta[:, :1]):
            return None
        first, steps = signals[:, :1], _steps(signals)
        points = np.concatenate([first, first + np.diag(steps)], axis=1)
        values = self._at(np.full(points.shape[1], self.t[0]), points, len(x), theta)
        slopes = (values[..., 1:] - values[..., :1]) / steps
        constant = values[..., :1] - slopes @ first
        for k, rows in ((1, slice(None)), (theta.shape[1], some)):
            found = self._at(self.t[rows], signals[:, rows], len(x), theta[:, :k])
            off = np.abs(found - slopes[:k] @ signals[:, rows] - constant[:k])
            terms = np.abs(slopes[:k]) @ np.abs(signals[:, rows]) + np.abs(constant[:k])
            if not np.all(off <= NOT_LINEAR * terms + np.finfo(float).tiny):
                return None
        return np.concatenate([slopes, constant], axis=2)

    def _is_straight(self, signals: np.ndarray, n: int, theta: np.ndarray) -> bool:
        """Whether the right-hand side halfway between samples is the mean of theirs: a look that most plants fail."""
        other = signals[:, ::-1]
        points = np.concatenate([signals, other, (signals + other) / 2.0], axis=1)
        here, there, halfway = np.split(self._at(np.full(points.shape[1], self.t[0]), points, n, theta), 3, axis=2)
        largest = np.max(np.abs(here) + np.abs(there), axis=2, keepdims=True)  # near rest a rate is a rounding
        return bool(np.all(np.abs(halfway - (here + there) / 2.0) <= NOT_LINEAR * largest))

    def _at(self, t: np.ndarray, points: np.ndarray, n: int, theta: np.ndarray) -> np.ndarray:
        """Right-hand side (n_columns, n_states, n_points) of every column of theta at the same points (n_states + n_inputs, n_points)."""
        k, m = theta.shape[1], len(t)
        wide = np.tile(points, k)
        found = self.derivative(np.tile(t, k), wide[:n], wide[n:], np.repeat(theta, m, axis=1))
        return found.reshape(n, k, m).transpose(1, 0, 2)


def _steps(signals: np.ndarray) -> np.ndarray:
    """From the first sample of each signal to the one farthest from it; of one that stands still a small one."""
    apart = signals - signals[:, :1]
    farthest = apart[np.arange(len(apart)), np.argmax(np.abs(apart), axis=1)]
    still = np.where(signals[:, 0] == 0.0, 1.0, 1e-3 * np.abs(signals[:, 0]))
    return np.where(farthest == 0.0, still, farthest)


def _distinct(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct columns of theta, the first one in front, and which of them each column is."""
    others = np.flatnonzero(np.any(theta != theta[:, :1], axis=0))
    which = np.zeros(theta.shape[1], dtype=int)
    which[others] = 1 + np.arange(len(others))
    return theta[:, np.r_[0, others]], which
