"""Right-hand sides of the check's plants, ``rhs(t, x, u, p)`` with columns at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


class Chosen:
    """Some of the outputs of an output function.

    ``there, wanted``: outputs that ``output`` gives, and those wanted.
    """

    def __init__(self, output: Callable[..., Any], there: tuple[str, ...], wanted: tuple[str, ...]):
        self.output = output
        self.there = there
        self.wanted = wanted

    def __call__(self, t: Any, x: Any, u: Any, p: Any) -> list[Any]:
        everything = self.output(t, x, u, p)
        return [everything[self.there.index(name)] for name in self.wanted]


def reactor(t: Any, x: Any, u: Any, p: Any) -> Any:
    """The paper's Eq. (9)."""
    y = x[0]
    rate = np.exp(-1.0 / u[0])
    return [p["flow"] * (p["feed"] - y) - p["second"] * rate * y**2 + p["first"] * rate * y]


def cooled_reactor(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A stirred tank with an exothermic reaction of first order and a jacket."""
    c, temperature = x
    rate = p["rate"] * np.exp(p["activation"] * (1.0 - 330.0 / temperature)) * c
    return (
        u[1] * (p["feed"] - c) - rate,
        u[1] * (p["feed_temperature"] - temperature) + p["heat"] * rate - p["cooling"] * (temperature - u[0]),
    )


def oscillator(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Mass, spring, damper, per unit of mass."""
    q, v = x
    return v, p["gain"] * u[0] - p["stiffness"] * q - p["damping"] * v


def pendulum(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A pendulum with a motor."""
    q, v = x
    return v, p["gain"] * u[0] - p["gravity"] * np.sin(q) - p["damping"] * v


def two_mass_drive(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Motor and load joined by a soft shaft."""
    twist, motor, load = x
    torque = p["shaft"] * twist + p["shaft_damping"] * (motor - load)
    return (
        motor - load,
        (u[0] - torque - p["motor_damping"] * motor) / p["motor_inertia"],
        (torque - p["load_damping"] * load) / p["load_inertia"],
    )


def dc_motor(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A motor with permanent magnets."""
    _, speed, current = x
    return (
        speed,
        (p["torque"] * current - p["friction"] * speed) / p["inertia"],
        (u[0] - p["resistance"] * current - p["torque"] * speed) / p["inductance"],
    )


def rlc_circuit(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Resistor, coil and capacitor in series."""
    charge, current = x
    return current, (u[0] - p["resistance"] * current - charge / p["capacitance"]) / p["inductance"]


def battery(t: Any, x: Any, u: Any, p: Any) -> Any:
    """State of charge and two relaxations; the load is positive when it discharges."""
    _, fast, slow = x
    return (
        -u[0] / p["capacity"],
        u[0] / p["c1"] - fast / (p["r1"] * p["c1"]),
        u[0] / p["c2"] - slow / (p["r2"] * p["c2"]),
    )


def battery_voltage(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Terminal voltage over a smooth curve of the open circuit."""
    charge, fast, slow = x
    return [3.4 + 0.6 * charge + 0.12 * np.tanh(6.0 * (charge - 0.5)) - p["r0"] * u[0] - fast - slow]


def cascaded_tanks(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Two tanks that drain by Torricelli's law."""
    first, second = np.sqrt(np.maximum(x[0], 1e-9)), np.sqrt(np.maximum(x[1], 1e-9))
    return p["lift"] * u[0] - p["drain_1"] * first, p["drain_1"] * first - p["drain_2"] * second


def mixing_tank(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Level and concentration of a tank fed by water and brine."""
    level, salt = np.maximum(x[0], 0.05), x[1]
    water, brine = p["water_gain"] * u[0], p["brine_gain"] * u[1]
    return (
        (water + brine - p["outflow"] * np.sqrt(level)) / p["area"],
        (brine * (p["strength"] - salt) - water * salt) / (p["area"] * level),
    )


def two_rooms(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A heater in a room that loses heat to the outdoors; temperatures in degrees Celsius."""
    heater, room = x
    return (
        p["heating"] * u[0] - p["to_room"] * (heater - room) - p["to_air"] * (heater - 20.0),
        p["from_heater"] * (heater - room) - p["walls"] * (room - u[1]),
    )


def heat_exchanger(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Two well mixed streams that exchange heat."""
    hot, cold = x
    return (
        u[0] * (p["hot_in"] - hot) - p["transfer_hot"] * (hot - cold),
        u[1] * (p["cold_in"] - cold) + p["transfer_cold"] * (hot - cold),
    )


def vehicle(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Longitudinal motion with rolling and air resistance."""
    speed = x[0]
    return [p["thrust"] * u[0] - p["rolling"] - p["air"] * speed * np.abs(speed) - p["gravity"] * np.sin(u[1])]


def quarter_car(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Body and wheel over a road, per unit of the body's mass; the input is the road's vertical speed."""
    travel, body, tyre, wheel = x
    force = p["spring"] * travel + p["damper"] * (wheel - body)
    return (
        wheel - body,
        force,
        u[0] - wheel,
        (p["tyre_stiffness"] * tyre - force) / p["wheel_mass"],
    )


def bioprocess(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Chemostat with Monod growth."""
    biomass, substrate = x
    growth = p["growth"] * substrate / (p["half"] + substrate)
    return growth * biomass - u[0] * biomass, u[0] * (p["feed"] - substrate) - growth * biomass / p["yield"]
