"""The region that the data covered, and how a correction fades outside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Share of a range outside it where a correction is hardly to be trusted any more, faded or not.
DOUBTFUL = 0.5


@dataclass(frozen=True, eq=False)
class Domain:
    """A box of features."""

    #: low, high: (n_features,): range in the training data
    low: np.ndarray
    high: np.ndarray
    #: Share of the range by which a feature may leave it before the correction fades; after twice that more, little is
    #: left (``exp(-4)``). ``inf``: never.
    fade: float

    @classmethod
    def of(cls, phi: np.ndarray, fade: float) -> Domain:
        """The box of the rows of ``phi``."""
        return cls(phi.min(axis=0), phi.max(axis=0), float(fade))

    @property
    def size(self) -> np.ndarray:
        """Range of every feature; a hundredth of its size for one that did not move."""
        return np.maximum(self.high - self.low, 1e-2 * np.maximum(np.abs(self.high), np.abs(self.low)) + 1e-12)

    def held(self, z: np.ndarray, margin: float = 0.1) -> np.ndarray:
        """Features (n_features, *s) held within the box widened by a share of its size."""
        if np.isinf(self.fade):
            return z
        wide = (slice(None), *(None,) * (z.ndim - 1))
        room = margin * (self.high - self.low)
        return np.clip(z, (self.low - room)[wide], (self.high + room)[wide])

    def distance(self, phi: np.ndarray) -> np.ndarray:
        """How far rows lie outside, as a share of the range of the feature that lies farthest: (n_rows,)."""
        return np.max(np.maximum(np.maximum(self.low - phi, phi - self.high), 0.0) / self.size, axis=1, initial=0.0)

    def weight(self, phi: np.ndarray) -> np.ndarray:
        """1 inside and a little beyond, then down to 0: (n_rows,)."""
        if np.isinf(self.fade):
            return np.ones(len(phi))
        beyond = np.maximum(self.distance(phi) - self.fade, 0.0)
        return np.exp(-((beyond / max(self.fade, 1e-12)) ** 2))

    def doubt(self, phi: np.ndarray) -> np.ndarray:
        """0 within the box, towards 1 for rows of a run in time outside it, and from then on: a free run remembers."""
        return 1.0 - np.exp(-((np.maximum.accumulate(self.distance(phi)) / DOUBTFUL) ** 2))
