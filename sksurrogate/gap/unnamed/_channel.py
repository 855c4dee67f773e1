"""One place of a plant at which a free signal enters, and its way to the outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sksurrogate.gap.fit._linear_model import LinearModel
from sksurrogate.gap.fit._pushes import REMEMBERED
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.noise_fit import fit_noise
from sksurrogate.kernels.record import Record

#: Correlation times, in samples, from which the size of a signal is fitted.
CORRELATION_TIMES = (5.0, 25.0)
#: Signals whose way to the outputs is computed at once.
SIGNALS_AT_ONCE = 32


@dataclass(frozen=True)
class Place:
    """A place at which a free signal may enter."""

    location: str
    kind: str
    log_likelihood: float
    balance: str | None = None  #: That an input pushes, and no other: to the data they are one place

    @property
    def to_the_data(self) -> tuple[str, str]:
        """Location and kind, the same of all places that the data do not distinguish."""
        return (self.location, self.kind) if self.balance is None else (self.balance, "state")


def fit_signal(
    D: Disturbance,
    r: np.ndarray,
    sd: np.ndarray,
    spread: np.ndarray,
    unit: float,
    sensor: int | None,
    *,
    near: Noise | None = None,
    rough: bool = False,
) -> tuple[Noise, float, np.ndarray]:
    """The likeliest noise with a free signal at one place, its log likelihood, and which noise parameters stay.

    In a balance or at an input the signal is the force, at a sensor the coloured noise of the sensor. The white noise is
    fitted with it.

    ``D``: with the force at the place.
    ``r`` (n_outputs, n_samples): measured less simulated.
    ``sd, spread`` (n_outputs,): white noise as differences show it, and deviation of the outputs.
    ``unit``: size of the force that counts as one.
    ``sensor``: at which the signal is.
    ``near``: a noise to start from, that of a path nearby, instead of several correlation times.
    ``rough``: from one correlation time, with the white noise as differences show it.
    Returns ``log_likelihood``: -inf where no noise can be followed.
    """
    force, coloured = np.full(D.b, (0.1 if sensor is None else 1e-4) * unit), 1e-2 * sd
    if sensor is not None:
        coloured[sensor] = max(0.1 * float(spread[sensor]), 1e-12)
    tried = (REMEMBERED,) if rough else CORRELATION_TIMES
    times = [(t, REMEMBERED) if sensor is None else (REMEMBERED, t) for t in tried]
    starts = [Noise(sd.copy(), force, a, coloured, b) for a, b in times] if near is None else [near]
    held = starts[0].held(sigma=rough, force=sensor is not None, coloured=np.arange(D.m) != sensor)
    best, value = starts[0], -np.inf
    for start in starts:
        try:
            noise, found, _ = fit_noise(D, r, start, np.full(D.b, unit), held=held, max_iterations=6 if rough else 10)
        except np.linalg.LinAlgError:
            continue
        if found > value:
            best, value = noise, float(found)
    return best, value, held


@dataclass(frozen=True, eq=False)
class Channel:
    """How a signal that enters at one place reaches the outputs."""

    location: str
    kind: str  #: "state", "input", "output" or "parameter"
    record: Record
    D: Disturbance  #: With the one force at the place (for a sensor: a force that is held at nothing)
    noise: Noise  #: With the force, or the coloured sensor noise, that explains the gap
    linear: LinearModel  #: Measured less simulated, about the path, and the parameters that follow
    push: np.ndarray | None  #: (n_states, n_samples): states after one sample of a unit signal; None for a sensor
    sensor: int | None
    unit: float  #: Size of the force that counts as one
    held: np.ndarray  #: Noise parameters that stay
    signals: Mapping[str, np.ndarray]  #: (n_samples,): that a law may depend on
    log_likelihood: float  #: Of the residual with the free signal
    x: np.ndarray | None = None  #: (n_states, n_samples): the path
    n_moved: int = 1  #: Balances that the signal moves

    @property
    def r(self) -> np.ndarray:
        """Residual (n_outputs, n_samples)."""
        return self.linear.r

    def respond(self, signal: np.ndarray) -> np.ndarray:
        """Outputs (n_outputs, n_columns, n_samples) that signals (n_columns, n_samples) cause."""
        out = np.zeros((len(signal), len(self.r), signal.shape[1])).transpose(1, 0, 2)  # each column in one piece
        if self.push is None:
            out[self.sensor] = signal
            return self.D.at_measured(out)
        for a in range(0, len(signal), SIGNALS_AT_ONCE):
            some = slice(a, a + SIGNALS_AT_ONCE)
            out[:, some] = self.D.moved(self.push[:, None] * signal[some])
        return out

    def force(self, r: np.ndarray | None = None) -> np.ndarray:
        """The smoothed signal at the place, (n_samples,)."""
        _, force, coloured = self.D.states(self.r if r is None else r, self.noise)
        return coloured[self.sensor] if self.sensor is not None else force[0]

    def settled(self, J: np.ndarray) -> Noise:
        """The noise that is left beside columns J (n_outputs, n_columns, n_samples)."""
        try:
            return fit_noise(
                self.D,
                self.r,
                self.noise,
                np.full(self.D.b, self.unit),
                J,
                np.full(J.shape[1], 1e-12),
                np.zeros(J.shape[1]),
                held=self.held,
                max_iterations=6,
            )[0]
        except np.linalg.LinAlgError:
            return self.noise
