"""What a diagnosis asks of a simulator, whether its right-hand side is known or ``simulate`` alone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._smooth import KINK_SHARPNESS
from sksurrogate.gap.fit._closeness import LARGEST_DISTURBANCE, NEARLY_WHITE
from sksurrogate.gap.fit._known_parameters import KnownParameters
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import Plant


class Fitted(Protocol):
    """A free run with fitted parameters."""

    @property
    def theta(self) -> np.ndarray:
        """Parameters of the effects in turn, then a number for every free parameter."""

    @property
    def y(self) -> np.ndarray:
        """Outputs (n_outputs, n_samples)."""

    @property
    def cost(self) -> float:
        """Sum of squares over the noise, with the prior."""


class Backend(ABC):
    """A simulator over a record, to which candidates are fitted; theta holds the parameters of effects, then the free ones."""

    plant: Plant
    record: Record  #: What was measured
    sd: np.ndarray  #: (n_outputs,): sensor noise, first estimate
    free: tuple[str, ...]  #: Parameters that are re-tuned with every candidate
    #: (n_balances,), (n_outputs,): largest force of every balance, and coloured noise of every sensor, that count as
    #: disturbance
    caps: tuple[np.ndarray, np.ndarray] | None
    known: KnownParameters  #: What the user knows of the simulator's parameters
    #: Sharpness of the kinks of a simulator that carries what was found: as it was fitted
    sharpness: float = KINK_SHARPNESS

    @property
    def largest_disturbance(self) -> float:
        """The share of its deviation by which what counts as noise may move an output: more where the record is known to be disturbed."""
        return LARGEST_DISTURBANCE + float(np.max(self.record.disturbance / self.record.spread))

    def bounds(self, effects: Sequence[BaseEffect]) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the parameters."""
        duration = self.record.dt * float(self.record.lengths.max())
        return self.known.bounds_of(self.plant.params, effects, self.free, duration, self.plant.inputs)

    def within(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> np.ndarray:
        """The nearest parameters within their bounds that a fit can leave again."""
        theta, position = np.clip(theta, *self.bounds(effects)), 0
        for effect in effects:
            own = slice(position, position + len(effect.parameters))
            theta[own], position = effect.identifiable(tuple(theta[own])), own.stop
        return theta

    def prior(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of the prior: on free parameters, and on what the user knows."""
        return self.known.prior_of(self.plant.params, effects, self.free, theta)

    @abstractmethod
    def first_noise(self) -> Noise:
        """Where the noise parameters start."""

    @abstractmethod
    def force_unit(self) -> np.ndarray:
        """Size of the force that counts as one in every balance."""

    @abstractmethod
    def quiet_force(self) -> np.ndarray:
        """Force of every balance that counts as none."""

    def white_sensors(self, noise: Noise) -> Noise:
        """A noise with sensors as white as differences of the outputs show them."""
        return replace(noise, sigma=self.sd, coloured=1e-2 * self.sd)

    def forced_noises(self, start: Noise) -> list[Noise]:
        """Noises with forces beside quiet sensors, from which a fit may start too; none where one start finds them."""
        return []


@dataclass(frozen=True, eq=False)
class BaseCandidate(ABC):
    """A set of effects fitted through the free run; one that is fitted again is another."""

    effects: tuple[BaseEffect, ...]
    fit: Fitted
    problem: Backend  #: What it was fitted to
    #: Whether white noise, where it is likelier near the data, takes the place of the noise that a fit starts from: one that
    #: explains what was coloured before must not start from that colour. A linear surrogate may colour what is white.
    white_alone: ClassVar[bool] = True

    @property
    def residual(self) -> np.ndarray:
        """Measured less simulated (n_outputs, n_samples), 0 where nothing was measured."""
        return self.problem.record.residual(self.fit.y)

    @property
    @abstractmethod
    def sensitivities(self) -> np.ndarray:
        """Of the outputs in the parameters, (n_outputs, n_theta, n_samples)."""

    @property
    def step_prior(self) -> tuple[np.ndarray, np.ndarray]:
        """What holds a step of the parameters: precision of their prior, and its pull."""
        mean, sd = self.problem.prior(self.effects, self.fit.theta)
        precision = 1.0 / sd**2
        return precision, precision * (mean - self.fit.theta)

    @abstractmethod
    def without_starts(self, columns: np.ndarray, starts: np.ndarray | None = None) -> np.ndarray:
        """Columns (n_columns, n_outputs, n_samples) in units of the noise, initial states of the runs at ``starts`` taken out."""

    @property
    @abstractmethod
    def disturbance(self) -> Disturbance:
        """Noise model along the free run."""

    @abstractmethod
    def columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Residual, sensitivities (n_outputs, n_theta, n_samples), and what holds a step of the parameters: precision and pull."""

    def other_noises(self, start: Noise) -> tuple[list[Noise], list[Noise]]:
        """Where a noise fit may start too: with forces beside quiet sensors; near the data as white noise, for it does not find out
        of a colour."""
        problem, rms = self.problem, self.problem.record.rms(self.residual)
        near = np.all(rms < NEARLY_WHITE * problem.sd)
        return problem.forced_noises(start), [as_white(start, rms, problem.quiet_force())] if near else []

    @abstractmethod
    def taken_out(self, i: int) -> BaseCandidate | None:
        """Without effect i, everything else as it is but for the initial states; None where that has no free run."""

    @abstractmethod
    def at_nominal(self) -> BaseCandidate | None:
        """With its free parameters at their nominal values, the effects as they are; None where that has no free run."""

    @abstractmethod
    def fitted_as(self, effects: tuple[BaseEffect, ...], theta: np.ndarray | None = None) -> Any:
        """With other forms of its effects, of the same parameters, fitted from some values of these, where it stands by default.

        None where that has no free run.
        """

    @abstractmethod
    def refitted(self, record: Record) -> BaseCandidate | None:
        """The same effects fitted to a record of the same runs; None where that has no free run."""

    @abstractmethod
    def left_out(self, record: Record, train: np.ndarray, test: np.ndarray) -> np.ndarray | None:
        """Outputs on the test runs of a record of these samples, refitted on the training runs; None without a free run."""

    @abstractmethod
    def numerical_change(self) -> np.ndarray:
        """How far numerics may have moved the parameters (n_theta,)."""

    @abstractmethod
    def initial_states(self) -> np.ndarray:
        """Of the runs (n_runs, n_states); nan where the simulator is given none."""

    @property
    @abstractmethod
    def signals(self) -> dict[str, np.ndarray]:
        """Inputs, and states where they are known, else measured outputs, by name (n_samples,)."""

    @abstractmethod
    def untuned(self) -> BaseCandidate | None:
        """The simulator with its free parameters at their nominal values, initial states fitted; None without a free run."""

    @abstractmethod
    def baselines(self, record: Record) -> tuple[BaseCandidate, BaseCandidate | None]:
        """The simulator as it is, and with all parameters re-tuned and nothing else, over a record of these samples."""

    @property
    def prior_square(self) -> float:
        """``sum ((theta - mean) / sd)^2`` of the prior at the parameters."""
        mean, sd = self.problem.prior(self.effects, self.fit.theta)
        return float(np.sum(((self.fit.theta - mean) / sd) ** 2))

    @property
    def prior_known(self) -> np.ndarray:
        """On which parameters the user gives the prior, (n_theta,) of bool."""
        return self.problem.known.given_on(self.effects, self.problem.free)

    @property
    def keys(self) -> tuple[tuple[str, str | None, str | None], ...]:
        """Keys of the effects."""
        return tuple(effect.key for effect in self.effects)

    @property
    def n_parameters(self) -> int:
        """Parameters of the effects, without re-tuned ones."""
        return sum(len(effect.parameters) for effect in self.effects)

    @property
    def n_chosen(self) -> int:
        """Numbers that effects hold beside their parameters: the value of an input before a run, where it is not its first."""
        return sum(getattr(effect, "before", None) is not None for effect in self.effects)

    @property
    def path(self) -> np.ndarray | None:
        """States along the free run (n_states, n_samples); None where the simulator shows none."""
        return None

    @property
    def n_fitted(self) -> int:
        """All that was fitted: parameters, and initial states that are not known."""
        return len(self.fit.theta) + self.n_starts

    @property
    @abstractmethod
    def n_starts(self) -> int:
        """Initial states that are not known, of all runs."""

    def slice_of(self, i: int) -> slice:
        """Where the parameters of effect i stand."""
        first = sum(len(effect.parameters) for effect in self.effects[:i])
        return slice(first, first + len(self.effects[i].parameters))

    def theta_of(self, i: int) -> np.ndarray:
        """Parameters of effect i."""
        return self.fit.theta[self.slice_of(i)]

    def theta_with(self, added: np.ndarray) -> np.ndarray:
        """Parameters with those of one effect more, the last."""
        n = self.n_parameters
        return np.concatenate([self.fit.theta[:n], added, self.fit.theta[n:]])

    def without_effect(self, *out: int) -> tuple[tuple[BaseEffect, ...], np.ndarray]:
        """The effects but some, and the parameters but theirs."""
        keep = np.ones(len(self.fit.theta), bool)
        for i in out:
            keep[self.slice_of(i)] = False
        return tuple(e for j, e in enumerate(self.effects) if j not in out), self.fit.theta[keep]


#: One kind of candidate.
C = TypeVar("C", bound=BaseCandidate)


def as_white(start: Noise, rms: np.ndarray, quiet: np.ndarray) -> Noise:
    """White noise of the size of a residual, in the place of a noise that may be coloured."""
    coloured = np.minimum(start.coloured, 0.05 * start.sigma)
    return replace(start, sigma=rms, force=np.minimum(start.force, quiet), coloured=coloured)
