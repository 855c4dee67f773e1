"""Effects as nature and hardware give them: near the catalogue's forms, and none of them.

A friction has a width, a drag a power that is not two, a limiter acts in samples, a saturation is soft, a step takes time.
Each variant is a named form of a canonical effect; a diagnosis that is asked must answer with the canonical name.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sksurrogate.blind._truths import KINDS, Term, Truth

Params = Mapping[str, Any]

#: A limiter that moves once per sample; a delay that wanders.
SAMPLED, WANDERING = "sampled", "wandering"
#: An actuator that is at 0 before a run, whatever the first row is.
RESTED = "rested"
#: Share by which a delay wanders, and over how many samples.
SWING, PERIOD = 0.15, 60.0
#: What a Bouc-Wen loop forgets with the way that it goes; the rest with the motion's direction. 0.5 each in the catalogue.
LEAN, FULL = "lean", "full"
FORGOTTEN = {LEAN: 0.35, FULL: 0.7}


def _s(h: float) -> float:
    """Spread of the variable: widths of signs are given as a share of it."""
    return h / 3e-3 + 1e-300


def _soft(v: Any, width: Any) -> Any:
    """``max(v, 0)`` with a rounded corner."""
    return width * np.logaddexp(0.0, v / width)


def _power(v: Any, m: float, h: float) -> Any:
    """``sign(v) |v|^m`` as large as ``v |v|`` or ``v^3`` at the spread."""
    return np.sign(v) * np.abs(v) ** m


def _stribeck(p: Params, fading: Any) -> Any:
    return p["level"] + (p["static_level"] - p["level"]) * fading


#: Canonical name -> variant -> equation ``form(t, x, v, w, params, width)``; strings for what the machine itself does.
INEXACT: dict[str, dict[str, Term | str]] = {
    "coulomb_friction": {
        "wide": lambda t, x, v, w, p, h: -p["level"] * np.tanh(v / (0.08 * _s(h))),
        "creeping": lambda t, x, v, w, p, h: -p["level"] * v / np.sqrt(v * v + (0.05 * _s(h)) ** 2),
    },
    "asymmetric_friction": {
        "wide": lambda t, x, v, w, p, h: -p["level"] * np.tanh(v / (0.08 * _s(h))) - p["offset"],
        "creeping": lambda t, x, v, w, p, h: -p["level"] * v / np.sqrt(v * v + (0.05 * _s(h)) ** 2) - p["offset"],
    },
    "stribeck_friction": {
        "exponential": lambda t, x, v, w, p, h: -_stribeck(p, np.exp(-np.abs(v) / p["velocity"])) * np.tanh(v / (0.03 * _s(h))),
        "rational": lambda t, x, v, w, p, h: -_stribeck(p, 1.0 / (1.0 + (v / p["velocity"]) ** 2)) * np.tanh(v / (0.03 * _s(h))),
    },
    "quadratic_drag": {
        "power 1.85": lambda t, x, v, w, p, h: -p["coefficient"] * _power(v, 1.85, h) * _s(h) ** 0.15,
        "laminar core": lambda t, x, v, w, p, h: -p["coefficient"] * v * np.sqrt(v * v + (0.15 * _s(h)) ** 2),
    },
    "quadratic_loss": {
        "power 1.9": lambda t, x, v, w, p, h: -p["coefficient"] * np.abs(v) ** 1.9 * _s(h) ** 0.1,
        "fading": lambda t, x, v, w, p, h: -p["coefficient"] * v * v / (1.0 + 0.03 * np.abs(v) / _s(h)),
    },
    "linear_loss": {
        "power 0.97": lambda t, x, v, w, p, h: -p["coefficient"] * _power(v, 0.97, h) * _s(h) ** 0.03,
        "thinning": lambda t, x, v, w, p, h: -p["coefficient"] * v / (1.0 + 0.02 * np.abs(v) / _s(h)),
    },
    "cubic_stiffness": {
        "power 2.8": lambda t, x, v, w, p, h: -p["coefficient"] * _power(v, 2.8, h) * _s(h) ** 0.2,
        "hardening": lambda t, x, v, w, p, h: -p["coefficient"] * v**3 * (1.0 + 0.03 * (v / _s(h)) ** 2),
    },
    "sqrt_leak": {
        "power 0.54": lambda t, x, v, w, p, h: -p["coefficient"] * np.maximum(v, 0.0) ** 0.54,
        "lip": lambda t, x, v, w, p, h: -p["coefficient"] * np.sqrt(np.maximum(v + 0.05 * _s(h), 0.0)),
    },
    "exchange": {
        "convective": lambda t, x, v, w, p, h: p["coefficient"] * (v - x) * (np.abs(v - x) / _s(h) + 1e-3) ** 0.06,
        "coupled": lambda t, x, v, w, p, h: p["coefficient"] * (v - x) * (1.0 + 0.03 * np.tanh(v / _s(h))),
    },
    "gravity_tilt": {
        "geared": lambda t, x, v, w, p, h: -p["level"] * np.sin(v) * (1.0 + 0.04 * np.cos(v)),
        "second": lambda t, x, v, w, p, h: -p["level"] * (np.sin(v) + 0.04 * np.sin(2.0 * v)),
    },
    "end_stop": {
        "rounded": lambda t, x, v, w, p, h: -p["stiffness"] * _soft(v - p["edge"], 0.04 * _s(h)),
        "hertz": lambda t, x, v, w, p, h: -p["stiffness"] * np.maximum(v - p["edge"], 0.0) ** 1.15 * (0.3 * _s(h)) ** -0.15,
    },
    "periodic_disturbance": {
        "harmonic": lambda t, x, v, w, p, h: p["amplitude"] * (np.sin(p["angular_frequency"] * t + p["phase"]) + 0.06 * np.sin(3.0 * (p["angular_frequency"] * t + p["phase"]))) + 0.0 * x,
        "beating": lambda t, x, v, w, p, h: p["amplitude"] * (1.0 + 0.08 * np.sin(0.13 * p["angular_frequency"] * t)) * np.sin(p["angular_frequency"] * t + p["phase"]) + 0.0 * x,
    },
    "step_disturbance": {
        "approaching": lambda t, x, v, w, p, h: p["size"] * (1.0 - np.exp(-np.maximum(t - p["time"], 0.0) / (0.02 * p["time"]))) + 0.0 * x,
        "ramp": lambda t, x, v, w, p, h: p["size"] * np.clip((t - p["time"]) / (0.03 * p["time"]) + 0.5, 0.0, 1.0) + 0.0 * x,
    },
    "input_saturation": {
        "soft": lambda t, u, v, w, p, h: u / (1.0 + np.abs(u / p["limit"]) ** 14) ** (1 / 14),
        "leaking": lambda t, u, v, w, p, h: np.clip(u, -p["limit"], p["limit"]) + 0.04 * (u - np.clip(u, -p["limit"], p["limit"])),
    },
    "input_dead_zone": {
        "rounded": lambda t, u, v, w, p, h: np.sign(u) * _soft(np.abs(u) - p["half_width"], 0.03 * _s(h)),
        "leaking": lambda t, u, v, w, p, h: np.sign(u) * np.maximum(np.abs(u) - p["half_width"], 0.0) + 0.03 * np.clip(u, -p["half_width"], p["half_width"]),
    },
    "input_curve": {
        "power 1.85": lambda t, u, v, w, p, h: u + p["coefficient"] * _power(u, 1.85, h) * (_s(h) + 1e-300) ** 0.15,
        "rational": lambda t, u, v, w, p, h: u + p["coefficient"] * u * np.abs(u) / (1.0 + 0.03 * np.abs(u) / _s(h)),
    },
    "input_gain": {
        "bent": lambda t, u, v, w, p, h: u * (1.0 + p["relative_error"] * (1.0 + 0.05 * np.tanh(u / _s(h)))),
        "drooping": lambda t, u, v, w, p, h: u * (1.0 + p["relative_error"] * (1.0 - 0.0005 * t / (1e-3 + abs(p["relative_error"])))),
    },
    "hysteresis": {LEAN: LEAN, FULL: FULL},
    "rate_limit": {SAMPLED: SAMPLED, WANDERING: WANDERING, RESTED: RESTED},
    "input_delay": {WANDERING: WANDERING, RESTED: RESTED},
    "input_lag": {RESTED: RESTED},
    "input_backlash": {RESTED: RESTED},
    "sensor_saturation": {
        "rounded": lambda t, y, v, w, p, h: p["limit"] - _soft(p["limit"] - y, 0.03 * _s(h)),
        "leaking": lambda t, y, v, w, p, h: np.minimum(y, p["limit"]) + 0.04 * np.maximum(y - p["limit"], 0.0),
    },
    "sensor_nonlinearity": {
        "power 1.9": lambda t, y, v, w, p, h: y + p["coefficient"] * np.abs(y) ** 1.9 * _s(h) ** 0.1,
        "rational": lambda t, y, v, w, p, h: y + p["coefficient"] * y * y / (1.0 + 0.02 * np.abs(y) / _s(h)),
    },
    "sensor_gain": {
        "bent": lambda t, y, v, w, p, h: y * (1.0 + p["relative_error"] * (1.0 + 0.05 * np.tanh(y / _s(h)))),
    },
    "sensor_quantization": {
        "uneven": lambda t, y, v, w, p, h: p["step"] * np.floor(y / p["step"] + 0.5) + 0.05 * p["step"] * np.sin(y / p["step"]),
    },
}  # fmt: skip


def form_of(truth: Truth) -> Term | None:
    """The equation of an effect: of its variant, or its own."""
    variant = INEXACT[truth.name][truth.variant] if truth.variant else None
    if callable(variant):
        return variant
    return KINDS[truth.name].form if truth.name in KINDS else None


def loop_rate(truth: Truth, moved: Any, z: Any) -> Any:
    """Derivative of a Bouc-Wen state z for a motion: ``v' - (g |v'| z + (1 - g) v' |z|) / limit``."""
    share = FORGOTTEN.get(truth.variant, 0.5)
    return moved - (share * np.abs(moved) * z + (1.0 - share) * moved * np.abs(z)) / truth.params["limit"]


def wandering(truth: Truth, t: float, dt: float) -> float:
    """Factor of a limit or a delay that wanders in time; one for all others."""
    if truth.variant != WANDERING:
        return 1.0
    return 1.0 + SWING * float(np.sin(2.0 * np.pi * t / (PERIOD * dt)))
