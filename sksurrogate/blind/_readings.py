"""What the sensors of a case read: white noise, and what the arm does to them."""

from __future__ import annotations

import numpy as np

from sksurrogate.blind._choose import Setting
from sksurrogate.blind._excite import coloured
from sksurrogate.blind._march import Course


def readings(rng: np.random.Generator, arm: str, setting: Setting, course: Course) -> np.ndarray:
    """Outputs (n_runs, n_samples, n_outputs) with their noise."""
    read = setting.read
    clean, noise = course.outputs[..., read], setting.noise * setting.scale[read]
    y = clean + noise * rng.normal(size=clean.shape)
    if setting.controller is not None and 0 in read:  # the controller read this very noise
        y[..., read.index(0)] = clean[..., read.index(0)] + setting.controller.noise
    y = y + spoiled(rng, arm, y, noise)
    if arm == "coloured":
        y = y + 0.015 * setting.scale[read] * coloured(rng, y.shape, float(rng.uniform(5, 20)))
    return y


def spoiled(rng: np.random.Generator, arm: str, y: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """What is wrong with readings (n_runs, n_samples, n_outputs) beside their white noise.

    Spikes; the difference from white noise to one with heavy tails of the same deviation; a slow trend or an offset from
    run to run of one sensor.
    """
    out = np.zeros_like(y)
    if arm == "spikes":
        hit = rng.random(y.shape) < 0.02
        out = np.where(hit, rng.choice([-1.0, 1.0], y.shape) * rng.uniform(5.0, 50.0, y.shape) * noise, 0.0)
    elif arm == "tails":
        out = noise * (rng.standard_t(3, size=y.shape) / np.sqrt(3.0) - rng.normal(size=y.shape))
    elif arm == "trends":
        j, size = int(rng.integers(y.shape[2])), float(rng.uniform(2.0, 8.0))
        if rng.random() < 0.5:
            out[..., j] = size * noise[j] * np.linspace(-1.0, 1.0, y.shape[1]) * rng.choice([-1.0, 1.0])
        else:
            out[..., j] = size * noise[j] * rng.uniform(-1.0, 1.0, (len(y), 1))
    return out
