"""Right-hand sides of the recordings' simulators, without the effect that each plant has."""

from __future__ import annotations

from typing import Any

import numpy as np


def tanks(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Torricelli's law for both tanks, no overflow."""
    upper, lower = np.sqrt(np.maximum(x[0], 0)), np.sqrt(np.maximum(x[1], 0))
    return p["k4"] * u[0] - p["k1"] * upper, p["k2"] * upper - p["k3"] * lower


def resonator(t: Any, x: Any, u: Any, p: Any) -> Any:
    """``y'' = b (u - u0) - c y' - w2 y``."""
    return x[1], p["b"] * (u[0] - p["u0"]) - p["c"] * x[1] - p["w2"] * x[0]


def exchanger(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A linear tube and a sensor that lags."""
    tube, sensor = x
    return -p["b0"] * (tube - p["T0"]) - p["g"] * (u[0] - 0.3), (tube - sensor) / p["tau"]


def falling(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Free fall."""
    return x[1], -p["g"] + 0.0 * x[1]


def rolling(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A ball on a tilted beam, without friction."""
    return x[1], p["k"] * np.sin(u[0] + p["offset"])


def drive(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A positioning axis with viscous friction and an offset."""
    return x[1], (35.15065 * u[0] - p["Fv"] * x[1] - p["offset"]) / p["M"]


def pendulum(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A free swing without losses, seen by a tilted camera."""
    return x[1], -p["g_over_l"] * np.sin(x[0] - p["tilt"])


def heater(t: Any, x: Any, u: Any, p: Any) -> Any:
    """One temperature, first order."""
    return ((p["K"] * u[0] - (x[0] - 20.9)) / p["tau"],)


def heater_and_sensor(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A heater and the sensor that it warms."""
    H, S = x
    return (p["b"] * u[0] - p["Ua"] * (H - 20.9) - p["Ub"] * (H - S)) / p["CH"], p["Ub"] * (H - S) / p["CS"]


def axis(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Motor, gear and arm, joined by two linear springs; viscous friction at the motor."""
    gear, arm, w_motor, w_gear, w_arm = x
    J, am, ag = 0.03292, 0.17910, 0.61206
    s = 20.5927 * gear + 0.06242 * (w_motor - w_gear)
    e = 20.2307 * arm + 0.00988 * (w_gear - w_arm)
    moved = (u[0] - s - p["Fv"] * w_motor) / (J * am)
    return w_motor - w_gear, w_gear - w_arm, moved, (s - e) / (J * ag), e / (J * (1 - am - ag))


class Cell:
    """Open-circuit voltage over the charge, a series resistance, a short lag."""

    def __init__(self, charge: np.ndarray, voltage: np.ndarray):
        self.charge, self.voltage = charge, voltage

    def __call__(self, t: Any, x: Any, u: Any, p: Any) -> Any:
        open_circuit = np.interp(u[1], self.charge, self.voltage)
        return ((open_circuit + p["offset"] - p["R0"] * u[0] - x[0]) / 2.0,)


def building(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A wall and a room between the outdoor temperature and a convector; the sun, third input, does nothing."""
    wall, room = x
    return (
        ((u[0] - wall) / p["Ro"] + (room - wall) / p["Ri"]) / p["Cw"],
        ((wall - room) / p["Ri"] + 24.0 * u[1]) / p["Ci"],
    )


def reactor(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A stirred tank whose reaction rate does not depend on the temperature."""
    Ca, T = x
    cooled = 0.01 * u[0] * (1.0 - np.exp(-700.0 / u[0])) * (350.0 - T)
    return 1.0 - Ca - p["rate"] * Ca, 350.0 - T + p["heat"] * p["rate"] * Ca + cooled


def linear_tanks(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Two tanks whose outflow is proportional to the level."""
    return p["k"] * u[0] - p["a1"] * x[0], p["a1"] * x[0] - p["a2"] * x[1]


class Chain:
    """A Chebyshev filter (0.5 dB, 4.4 kHz) and an inverse one (40 dB from 5 kHz), each of order 3; time in ms.

    Every filter is a first-order lag and a resonant pair of unit static gain; the zeros of the second stand in the output.
    """

    def __init__(self) -> None:
        from scipy.signal import cheb1ap, cheb2ap

        edge = 2.0 * np.pi * 5.0
        first, second = cheb1ap(3, 0.5)[1] * 2.0 * np.pi * 4.4, cheb2ap(3, 40.0)[1] * edge
        self.parts = [self._part(poles) for poles in (first, second)]
        self.zero = float(np.abs(cheb2ap(3, 40.0)[0][0])) * edge

    @staticmethod
    def _part(poles: np.ndarray) -> tuple[float, float, float]:
        """Rate of the lag, angular frequency and damping of the pair."""
        lag = float(-poles[np.argmin(np.abs(poles.imag))].real)
        pair = poles[np.argmax(poles.imag)]
        return lag, float(np.abs(pair)), float(-pair.real / np.abs(pair))

    def rhs(self, t: Any, x: Any, u: Any, p: Any) -> Any:
        """Six states: lag, pair, lag, pair."""
        out, driven = [], p["gain"] * u[0]
        for (lag, w, damping), (a, b, c) in zip(self.parts, (x[:3], x[3:])):
            out += [lag * (driven - a), w * c, w * (a - b) - 2.0 * damping * w * c]
            driven = b
        return tuple(out)

    def output(self, t: Any, x: Any, u: Any, p: Any) -> Any:
        """The second pair with the zeros."""
        _, w, damping = self.parts[1]
        return (x[4] + (w / self.zero) ** 2 * (x[3] - x[4] - 2.0 * damping * x[5]) + p["offset"],)
