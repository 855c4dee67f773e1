"""Plants of six to twelve states: chains whose links are all of one kind, of a length that the name states."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sksurrogate.blind._plants import Drive, PlantSpec

Rates = Callable[[Any, Any, Any, Any], Any]


# ---- equations ------------------------------------------------------------------------------------------------------
def tank_chain(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Tanks, each draining into the next one."""
    out = [p["drain"] * np.sqrt(np.maximum(level, 1e-9)) for level in x]
    into = [p["lift"] * u[0], *out[:-1]]
    return [(gained - lost) / p["area"] for gained, lost in zip(into, out)]


def heat_bar(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A bar, heated at one end, that loses heat to the air along its length."""
    left, right = [x[0], *x[:-1]], [*x[1:], x[-1]]
    rates = [p["conduction"] * (a - 2 * b + c) - p["loss"] * (b - u[1]) for a, b, c in zip(left, x, right)]
    rates[0] = rates[0] + p["heating"] * u[0]
    return rates


def mass_chain(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Masses on a line between springs and dampers, the first one tied to a wall and pushed."""
    n = len(x) // 2
    q, v = x[:n], x[n:]
    stretch = [q[0], *(b - a for a, b in zip(q, q[1:]))]
    speed = [v[0], *(b - a for a, b in zip(v, v[1:]))]
    link = [p["stiffness"] * d + p["damping"] * s for d, s in zip(stretch, speed)]
    after = [*link[1:], 0.0]
    force = [b - a - p["drag"] * w for a, b, w in zip(link, after, v)]
    force[0] = force[0] + u[0]
    return [*v, *(f / p["mass"] for f in force)]


def ladder(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Sections of inductor and capacitor from a source to a load: currents, then voltages."""
    n = len(x) // 2
    i, v = x[:n], x[n:]
    before, after = [u[0], *v[:-1]], [*i[1:], p["load"] * v[-1]]
    currents = [(a - p["resistance"] * c - b) / p["inductance"] for a, b, c in zip(before, v, i)]
    return [*currents, *((c - d) / p["capacitance"] for c, d in zip(i, after))]


def cascade(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A substance in stirred tanks in a row, consumed at a rate that saturates."""
    before = [p["feed"], *x[:-1]]
    return [u[0] * (a - c) - p["rate"] * c / (p["half"] + c) for a, c in zip(before, x)]


# ---- plants ---------------------------------------------------------------------------------------------------------
def _numbered(*letters: str, n: int) -> tuple[str, ...]:
    return tuple(f"{letter}{k}" for letter in letters for k in range(1, n + 1))


def _chain(name: str, domain: str, rhs: Rates, states: tuple[str, ...], drives: tuple[Drive, ...], params: dict[str, float], dt: float,
           start: float, spread: float, **more: Any) -> PlantSpec:  # fmt: skip
    """A chain with one kind of start; every other state has a sensor where sensors are few."""
    return PlantSpec(
        f"{name}_{len(states)}", domain, rhs, states, drives, states, params, dt, (start,) * len(states), (spread,) * len(states),
        states[::2], more.pop("kinematic", {}), **more,
    )  # fmt: skip


def _tanks(n: int) -> PlantSpec:
    return _chain("tank_chain", "hydraulics", tank_chain, _numbered("level", n=n), (Drive("pump", 3.0, 1.4, 0.3, 7.0),),
                  {"lift": 0.5, "drain": 0.8, "area": 1.0}, 0.4, 3.5, 1.2, positive=True)  # fmt: skip


def _bar(n: int) -> PlantSpec:
    drives = (Drive("power", 5.0, 4.0, 0.0, 15.0), Drive("air", 15.0, 5.0, -10.0, 35.0))
    return _chain("heat_bar", "heat", heat_bar, _numbered("temperature", n=n), drives,
                  {"conduction": 0.6, "loss": 0.08, "heating": 1.2}, 0.5, 25.0, 6.0, warm=True)  # fmt: skip


def _masses(n: int) -> PlantSpec:
    names = _numbered("position", "velocity", n=n // 2)
    return _chain("mass_chain", "mechanics", mass_chain, names, (Drive("force", 0.0, 4.0),),
                  {"mass": 1.0, "stiffness": 12.0, "damping": 0.4, "drag": 0.2}, 0.05, 0.0, 0.3,
                  kinematic=dict(zip(names, names[n // 2 :])))  # fmt: skip


def _ladder(n: int) -> PlantSpec:
    return _chain("ladder", "electricity", ladder, _numbered("current", "voltage", n=n // 2), (Drive("source", 0.0, 5.0, -15.0, 15.0),),
                  {"resistance": 0.5, "inductance": 0.4, "capacitance": 0.3, "load": 0.5}, 0.1, 0.0, 1.0)  # fmt: skip


def _cascade(n: int) -> PlantSpec:
    return _chain("cascade", "chemistry", cascade, _numbered("concentration", n=n), (Drive("flow", 0.5, 0.25, 0.1, 1.2),),
                  {"feed": 6.0, "rate": 0.3, "half": 1.0}, 0.4, 3.0, 1.2, positive=True)  # fmt: skip


#: Name -> plant: five kinds of chains, 6 to 12 states.
BIG_PLANTS: dict[str, PlantSpec] = {
    plant.name: plant for build in (_tanks, _bar, _masses, _ladder, _cascade) for plant in map(build, (6, 8, 10, 12))
}
