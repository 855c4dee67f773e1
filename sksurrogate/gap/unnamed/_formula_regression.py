"""A formula at a place and its regression: coefficients, constants and parameters of the simulator by generalised least squares.

``r = J theta + sum_j c_j G f_j(z; k_j) + noise``: G carries a signal at the place to the outputs. The constants inside the shapes
follow by Gauss-Newton.

References
----------
Golub, Pereyra, *Separable nonlinear least squares*, Inverse Problems 19 (2003); Grunwald, *The minimum description length principle*
(2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from sksurrogate.effects._formula import Term
from sksurrogate.gap.fit._ode import REACH
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._grammar import price_of, structure
from sksurrogate.kernels.disturbance import Noise

#: Formulae whose movement of the outputs is kept: a step begins where the last one was judged.
REMEMBERED_RESPONSES = 4
#: Steps of Gauss-Newton; halvings of a step.
CONSTANT_STEPS, HALVINGS = 6, 3


@dataclass(frozen=True, eq=False)
class Draft:
    """A formula at a place, before its free run."""

    terms: tuple[Term, ...]
    coefficients: np.ndarray  #: (n_terms,)
    late: float | None  #: Time constant of the recent past that it holds
    nats: float = 0.0  #: What it explains beside parameters of the simulator
    worth: float = 0.0  #: The same less the price of the formula and of its constants
    price: float = 0.0  #: That of the formula
    level: float = -np.inf  #: Log likelihood less that price: comparable between places, which have noise of their own

    @property
    def values(self) -> np.ndarray:
        """Coefficients, constants and the time constant, as the parameters of the effect."""
        constants = [c for term in self.terms for c in term.constants]
        return np.array([*self.coefficients, *constants, *([] if self.late is None else [self.late])], dtype=float)

    @property
    def coefficients_alone(self) -> np.ndarray:
        """Coefficients and the time constant: the parameters of the effect whose other constants stand."""
        return np.array([*self.coefficients, *([] if self.late is None else [self.late])], dtype=float)

    @property
    def structure(self) -> Any:
        """Its shapes and drivers."""
        return structure(self.terms)


@dataclass(eq=False)
class Regression:
    """A residual explained by parameters of the simulator and by terms, under one noise."""

    drivers: Drivers
    noise: Noise

    def __post_init__(self) -> None:
        self.channel = channel = self.drivers.channel
        known = channel.linear.known
        self.factor = channel.D.factor(self.noise)
        self.base = self.weights(known)  # S^-1 [r, J]
        self.K = self.base @ known.transpose(1, 0, 2).reshape(known.shape[1], -1).T
        self.half_log = 0.5 * np.log(channel.r.size)
        self.n_drivers = len(self.drivers.moving)
        self.responses = lru_cache(maxsize=REMEMBERED_RESPONSES)(self.drivers.responses)

    def weights(self, columns: np.ndarray) -> np.ndarray:
        """``S^-1`` of columns (n_outputs, n_columns, n_samples): (n_columns, n_outputs * n_samples)."""
        return (
            self.channel.D.weighted(columns, self.noise, self.factor).transpose(1, 0, 2).reshape(columns.shape[1], -1)
        )

    def solved(self, J: np.ndarray) -> tuple[float, np.ndarray, float]:
        """Nats that columns J explain beside the parameters, their weights, the parameters first, and a log determinant."""
        both = self.channel.linear.beside(J)
        known = both.known
        if not np.isfinite(known).all():
            return -np.inf, np.zeros(known.shape[1] - 1), 0.0
        own, log_det = self.channel.D.gram(J, self.noise, self.factor)
        cross = self.base @ J.transpose(1, 0, 2).reshape(J.shape[1], -1).T
        G = np.block([[self.K, cross], [cross.T, own]])
        theta = both.weights(G)
        return 0.5 * float((G[1:, 0] + both.pull) @ theta), theta, log_det

    def judged(self, draft: Draft) -> Draft:
        """Coefficients and worth of a formula with its constants as they are."""
        nats, theta, log_det = self.solved(self.responses(draft.terms))
        price = price_of(draft.terms, self.n_drivers)
        own = theta[len(self.channel.linear.precision) :]
        cost = price + self.half_log * len(draft.values)
        level = nats - cost - 0.5 * (self.K[0, 0] + log_det)
        return replace(draft, coefficients=own, nats=nats, worth=nats - cost, price=price, level=float(level))

    def refined(self, draft: Draft, most_steps: int = CONSTANT_STEPS) -> Draft:
        """A formula with its constants fitted: Gauss-Newton with coefficients and parameters beside them, steps halved."""
        constants = np.array([c for term in draft.terms for c in term.constants])
        if not len(constants):
            return draft
        low, high = np.array([b for term in draft.terms for b in term.bounds]).T
        spread = max(float(np.std(z)) for z in self.drivers.signals.values())
        unit = np.maximum(np.abs(constants), 0.1 * spread if any(constants == 0) else 1e-12)
        for _ in range(most_steps):
            J = self.responses(draft.terms)
            slopes = self.slopes(draft, constants, unit)
            if not np.isfinite(slopes).all():
                break
            _, theta, _ = self.solved(np.concatenate([J, slopes], axis=1))
            step = np.clip(theta[len(theta) - len(constants) :], -REACH * unit, REACH * unit)
            trials = [np.clip(constants + step / 4.0**halving, low, high) for halving in range(HALVINGS)]
            judged = ((self.judged(replace(draft, terms=_at(draft.terms, trial))), trial) for trial in trials)
            better, there = next((one for one in judged if one[0].nats > draft.nats), (draft, constants))
            if better is draft:
                break
            gained = better.nats - draft.nats
            draft, constants = better, there
            unit = np.maximum(np.abs(constants), 0.1 * unit)
            if gained < 0.05:
                break
        return draft

    def slopes(self, draft: Draft, constants: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """Sensitivities of the outputs in the constants (n_outputs, n_constants, n_samples)."""
        here = draft.coefficients @ self.drivers.values(draft.terms)
        moved = []
        for k, size in enumerate(unit):
            other = constants.copy()
            other[k] += STEP_OF_SLOPES * size
            there = draft.coefficients @ self.drivers.values(_at(draft.terms, other))
            moved.append((there - here) / (STEP_OF_SLOPES * size))
        return self.channel.respond(np.stack(moved))


def _at(terms: Sequence[Term], constants: np.ndarray) -> tuple[Term, ...]:
    """The same terms with other constants."""
    left = iter(constants.tolist())
    return tuple(term.at([next(left) for _ in term.constants]) for term in terms)
