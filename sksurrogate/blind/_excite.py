"""What is done to a plant while it is recorded, and what disturbs it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sksurrogate.blind._plants import Drive, PlantSpec

#: Kinds of excitation with how often each is drawn.
EXCITATIONS = {"multisine": 0.3, "steps": 0.25, "operating_log": 0.2, "closed_loop": 0.15, "single_sine": 0.1}


def multisine(rng: np.random.Generator, n: int) -> np.ndarray:
    """Twelve sines, logarithmically spread, about unit size."""
    t = np.arange(n)
    frequency = np.exp(rng.uniform(np.log(0.003), np.log(0.09), 12))
    wave = sum(
        a * np.sin(2 * np.pi * f * t + p) for a, f, p in zip(rng.normal(size=12), frequency, rng.uniform(0, 6.3, 12))
    )
    return np.asarray(wave / (1.5 * np.std(wave) + 1e-12))  # fmt: skip


def steps(rng: np.random.Generator, n: int) -> np.ndarray:
    """Levels held for a random time."""
    hold = int(rng.integers(6, 30))
    return np.repeat(rng.uniform(-1.2, 1.2, n // hold + 1), hold)[:n]


def single_sine(rng: np.random.Generator, n: int) -> np.ndarray:
    """One frequency."""
    return np.sin(2 * np.pi * rng.uniform(0.008, 0.04) * np.arange(n) + rng.uniform(0, 6.3))


def operating_log(rng: np.random.Generator, n: int) -> np.ndarray:
    """Long holds, ramps between them, small adjustments."""
    level, parts = float(rng.uniform(-0.8, 0.8)), [np.empty(0)]
    while sum(map(len, parts)) < n:
        hold, ramp = int(rng.integers(15, 70)), int(rng.integers(1, 25))
        following = float(np.clip(level + rng.normal() * 0.8, -1.2, 1.2))
        small = np.repeat(rng.normal(size=hold // 10 + 1) * 0.08, 10)[:hold]
        parts += [level + small, np.linspace(level, following, ramp)]
        level = following
    return np.concatenate(parts)[:n]


_SHAPES: dict[str, Callable[[np.random.Generator, int], np.ndarray]] = {
    "multisine": multisine,
    "steps": steps,
    "single_sine": single_sine,
    "operating_log": operating_log,
    "closed_loop": steps,
}


def inputs(rng: np.random.Generator, plant: PlantSpec, kind: str, n_runs: int, n_samples: int) -> np.ndarray:
    """Commanded inputs, (n_runs, n_samples, n_inputs), within the feasible ranges."""
    U = np.empty((n_runs, n_samples, len(plant.drives)))
    for r in range(n_runs):
        for j, drive in enumerate(plant.drives):
            U[r, :, j] = limited(drive, drive.middle + drive.swing * _SHAPES[kind](rng, n_samples))
    return U


def limited(drive: Drive, u: np.ndarray) -> np.ndarray:
    """Within the feasible range."""
    return np.clip(u, drive.low, drive.high)


def initial_states(rng: np.random.Generator, plant: PlantSpec, n_runs: int) -> np.ndarray:
    """(n_runs, n_states)."""
    start = np.array(plant.start) + np.array(plant.spread) * rng.uniform(-1, 1, (n_runs, len(plant.states)))
    return np.maximum(start, 0.1 * np.array(plant.start)) if plant.positive else start


def coloured(rng: np.random.Generator, shape: tuple[int, ...], samples: float) -> np.ndarray:
    """Noise of unit variance whose correlation fades over some samples of the second axis."""
    keep = np.exp(-1.0 / samples)
    white = rng.normal(size=shape)
    noise = np.empty(shape)
    noise[:, 0] = white[:, 0]
    for k in range(1, shape[1]):
        noise[:, k] = keep * noise[:, k - 1] + np.sqrt(1 - keep**2) * white[:, k]
    return noise


class Controller:
    """A proportional controller on the first input and first output, within the feasible range.

    ``feedforward`` (n_runs, n_samples, n_inputs): what the inputs do without it.
    ``middle, gain``: ``u = feedforward + gain (middle - y)``.
    ``noise`` (n_runs, n_samples): what the sensor adds.
    """

    def __init__(self, drive: Drive, feedforward: np.ndarray, middle: float, gain: float, noise: np.ndarray):
        self.drive = drive
        self.feedforward = feedforward
        self.middle = middle
        self.gain = gain
        self.noise = noise

    def __call__(self, k: int, y: np.ndarray) -> np.ndarray:
        u = self.feedforward[:, k].copy()
        u[:, 0] = limited(self.drive, u[:, 0] + self.gain * (self.middle - y[:, 0] - self.noise[:, k]))
        return u

    def tiled(self, times: int, runs: int) -> Controller:
        """The same for the first runs, repeated."""
        return Controller(
            self.drive, np.tile(self.feedforward[:runs], (times, 1, 1)), self.middle, self.gain, np.tile(self.noise[:runs], (times, 1))
        )  # fmt: skip
