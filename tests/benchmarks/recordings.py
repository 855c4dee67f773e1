"""Measured plants with the simulator, the free parameters and the accepted names of each: one place for all scripts.

The data are read below the folder ``SKSURROGATE_DATA``, one folder a recording; long ones are cut or thinned to at most about
1500 rows. ``problem(name)`` gives one of ``NAMES``. Run: ``SKSURROGATE_DATA=FOLDER python tests/benchmarks/recordings.py`` prints
the size of each and how far its simulator is off.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from recording_models import (
    Cell,
    Chain,
    axis,
    building,
    drive,
    exchanger,
    falling,
    heater,
    heater_and_sensor,
    linear_tanks,
    pendulum,
    reactor,
    resonator,
    rolling,
    tanks,
)

from sksurrogate.physics import ODESimulator

__all__ = ["NAMES", "Problem", "problem"]

#: What a friction may be called where dry friction was measured.
DRY = ("coulomb_friction", "stribeck_friction", "asymmetric_friction", "lugre_friction")
#: Losses of a body in air.
AIR = ("linear_loss", "quadratic_drag", "quadratic_loss", "power_law")
#: What a lag between heater and sensor may be called.
LATE = ("sensor_lag", "input_lag", "hidden_relaxation")
#: The sun in the balance of a room that does not know it.
SUN = ("linear_loss", "power_law", "quadratic_loss", "bilinear")


@dataclass(frozen=True)
class Problem:
    """A recording and what is asked of it.

    Attributes
    ----------
    name : str
    simulator : ODESimulator
    X, y, groups : ndarray (n_rows, n_inputs), (n_rows, n_outputs), (n_rows,)
    free : tuple of str or "all"
        Parameters that are re-tuned.
    accepted : tuple of str
        Names that the literature or the physics supports; empty where the catalogue holds none, and for controls.
    places : tuple of str
        Where they sit; empty where that is left open.
    real : bool
        False for recordings that are simulated.
    """

    name: str
    simulator: ODESimulator
    X: np.ndarray
    y: np.ndarray
    groups: np.ndarray
    free: Any
    accepted: tuple[str, ...]
    places: tuple[str, ...]
    real: bool = True


# ---- files ----------------------------------------------------------------------------------------------------------
def _path(*parts: str) -> Path:
    folder = os.environ.get("SKSURROGATE_DATA")
    if not folder:
        raise SystemExit("SKSURROGATE_DATA is not set: expected the folder that holds the recordings")
    return Path(folder).joinpath(*parts)


def _table(name: str) -> dict[str, np.ndarray]:
    """Columns of a csv file by name, (n_rows,)."""
    rows = np.genfromtxt(_path(name, f"{name}.csv"), delimiter=",", names=True)
    return {column: np.asarray(rows[column], dtype=float) for column in rows.dtype.names or ()}


def _arrays(name: str, file: str) -> dict[str, np.ndarray]:
    """Arrays of an npz file, flat."""
    with np.load(_path(name, file)) as data:
        return {key: np.asarray(data[key], dtype=float).ravel() for key in data}


def _thinned(values: np.ndarray, groups: np.ndarray, by: int, mean: bool) -> np.ndarray:
    """Every ``by``-th row of each run, or the mean over the rows up to the next one (an input that is held)."""
    parts = []
    for run in np.unique(groups):
        part = values[groups == run]
        part = part[: len(part) // by * by].reshape(-1, by)
        parts.append(part.mean(axis=1) if mean else part[:, 0])
    return np.concatenate(parts)


def _first(groups: np.ndarray, rows: int) -> np.ndarray:
    """Mask of the first rows of each run."""
    return np.concatenate([np.arange(int(np.sum(groups == run))) < rows for run in np.unique(groups)])


def _columns(*columns: np.ndarray) -> np.ndarray:
    return np.column_stack(columns)


# ---- problems -------------------------------------------------------------------------------------------------------
def _one_run(rows: np.ndarray) -> np.ndarray:
    return np.zeros(len(rows), int)


def _silverbox(name: str) -> Problem:
    data = _arrays("silverbox", "silverbox_SNLS80mV.npz")
    rows = slice(40650, 42150)
    params = {"b": 1.97e5, "c": 43.5, "w2": 1.914e5, "u0": 0.006}
    simulator = ODESimulator(
        resonator, states=["y", "dy"], inputs=["u"], outputs=["y"], params=params, dt=2.0**14 / 1e7, hold="foh"
    )
    u, y = data["V1"][rows, None], data["V2"][rows, None]
    return Problem(name, simulator, u, y, _one_run(u), "all", ("cubic_stiffness",), ("dy",))


def _cascaded_tanks(name: str) -> Problem:
    data = _arrays("cascaded_tanks", "cascaded_tanks.npz")
    params = {"k1": 0.05, "k2": 0.05, "k3": 0.05, "k4": 0.05}
    simulator = ODESimulator(
        tanks, states=["upper", "lower"], inputs=["pump"], outputs=["lower"], params=params, dt=4.0, x0=[5.0, 5.0]
    )
    u, y = data["uEst"][:, None], data["yEst"][:, None]
    return Problem(name, simulator, u, y, _one_run(u), "all", ("overflow", "state_saturation"), ("upper", "lower"))


def _heat_exchanger(name: str) -> Problem:
    data = _arrays("heat_exchanger", "heat_exchanger.npz")
    params = {"b0": 0.05, "T0": 97.5, "g": 0.6, "tau": 8.0}
    simulator = ODESimulator(
        exchanger,
        states=["tube", "sensor"],
        inputs=["flow"],
        outputs=["sensor"],
        params=params,
        dt=1.0,
        x0=[98.6, 98.6],
    )
    u, y = data["q"][:1500, None], data["th"][:1500, None]
    accepted = ("bilinear", "power_law", "input_curve")
    return Problem(name, simulator, u, y, _one_run(u), "all", accepted, ("tube", "flow"))


#: Balls whose drag can be seen from a bridge, and those too heavy for it.
LIGHT = (
    "Blue Basketball", "Green Basketball", "Volleyball", "Tennis Ball", "Whiffle Ball 1", "Whiffle Ball 2",
    "Yellow Whiffle Ball", "Orange Whiffle Ball",
)  # fmt: skip
HEAVY = ("Baseball", "Bowling Ball", "Golf Ball")


def _ball(name: str) -> Problem:
    """Drop 1 without its first three rows (release by hand)."""
    ball = next(one for one in LIGHT + HEAVY if _slug(one) == name)
    text = np.genfromtxt(_path("ball_drops", "ball_drops.csv"), delimiter=",", names=True, dtype=None, encoding="utf-8")
    rows = text[(text["ball"] == ball) & (text["drop"] == 1)][3:]
    dt = 1.0 / 15.0
    regular = np.abs(np.diff(rows["time_s"])) - dt
    rows = rows[:-1] if abs(regular[-1]) > 0.2 * dt else rows
    simulator = ODESimulator(
        falling, states=["height", "velocity"], inputs=[], outputs=["height"], params={"g": 9.81}, dt=dt, x0=[48.0, 0.0]
    )
    y = np.asarray(rows["height_m"], dtype=float)[:, None]
    accepted = () if ball in HEAVY else AIR
    return Problem(name, simulator, np.zeros((len(y), 0)), y, _one_run(y), (), accepted, ("velocity",))


def _slug(ball: str) -> str:
    return "ball_drops_" + ball.lower().replace(" ", "_")


def _ball_and_beam(name: str) -> Problem:
    data = _arrays("ball_and_beam", "ball_and_beam.npz")
    simulator = ODESimulator(
        rolling, states=["position", "velocity"], inputs=["angle"], outputs=["position"],
        params={"k": 7.0, "offset": 0.0}, dt=0.1,
    )  # fmt: skip
    u, y = data["u"][:500, None], data["y"][:500, None]
    accepted = (*AIR, *DRY, "input_bias", "input_backlash")
    return Problem(name, simulator, u, y, _one_run(u), "all", accepted, ("velocity", "angle"))


def _battery(name: str) -> Problem:
    data = _table("battery")
    curve = np.genfromtxt(_path("battery", "ocv.csv"), delimiter=",", names=True)
    simulator = ODESimulator(
        Cell(curve["charge"], curve["ocv"]), states=["voltage"], inputs=["current", "charge"], outputs=["voltage"],
        params={"R0": 0.012, "offset": 0.0}, dt=5.0, x0=[3.5],
    )  # fmt: skip
    X = _columns(data["current"], data["charge"])
    return Problem(
        name, simulator, X, data["v"][:, None], data["run"].astype(int), "all", ("hidden_relaxation", "hysteresis"), ()
    )


def _cstr(name: str) -> Problem:
    data = _arrays("cstr", "cstr.npz")
    simulator = ODESimulator(
        reactor, states=["Ca", "T"], inputs=["q"], outputs=["Ca", "T"], params={"rate": 9.0, "heat": 200.0}, dt=0.1,
        x0=[0.1, 438.5],
    )  # fmt: skip
    rows = slice(0, 1500)
    y = _columns(data["Ca"], data["T"])[rows]
    # The generating model has an Arrhenius rate, which the simulator drops.
    accepted = ("parameter_dependence",)
    return Problem(name, simulator, data["q"][rows, None], y, _one_run(y), "all", accepted, ("rate",), real=False)


def _emps(name: str) -> Problem:
    data = _table("emps")
    groups = data["run"].astype(int)
    by = 4
    simulator = ODESimulator(
        drive, states=["position", "velocity"], inputs=["voltage"], outputs=["position"],
        params={"M": 95.1, "Fv": 203.5, "offset": -3.16}, dt=0.005 * by,
    )  # fmt: skip
    u, y = _thinned(data["voltage"], groups, by, True), _thinned(data["position"], groups, by, False)
    thin = _thinned(groups.astype(float), groups, by, False).astype(int)
    return Problem(name, simulator, u[:, None], y[:, None], thin, ("Fv", "offset"), DRY, ("velocity",))


def _robot_arm(name: str) -> Problem:
    data = _table("robot_arm")
    rows = _first(data["run"], 375)
    simulator = ODESimulator(
        axis, states=["gear", "arm", "w_motor", "w_gear", "w_arm"], inputs=["torque"], outputs=["w_motor"],
        params={"Fv": 0.02}, dt=0.002,
    )  # fmt: skip
    X, y = data["torque"][rows, None], data["w_motor"][rows, None]
    return Problem(name, simulator, X, y, data["run"][rows].astype(int), "all", DRY, ("w_motor",))


def _tclab(name: str) -> Problem:
    data = _table("tclab")
    free: tuple[str, ...]
    accepted: tuple[str, ...]
    if name == "tclab":
        simulator = ODESimulator(
            heater, states=["T1"], inputs=["Q1"], outputs=["T1"], params={"K": 0.67, "tau": 160.0}, dt=1.0, x0=[20.9]
        )
        free, accepted = ("K", "tau"), (*LATE, "sensor_quantization")
    else:
        simulator = ODESimulator(
            heater_and_sensor, states=["heater", "sensor"], inputs=["Q1"], outputs=["sensor"],
            params={"b": 0.04, "Ua": 0.053, "Ub": 0.05, "CH": 7.0, "CS": 1.2}, dt=1.0, x0=[20.9, 20.9],
        )  # fmt: skip
        free, accepted = ("b", "Ua", "Ub"), ("sensor_quantization",)
    X, y = data["Q1"][:, None], data["T1"][:, None]
    return Problem(name, simulator, X, y, _one_run(X), free, accepted, ())


def _two_tanks(name: str) -> Problem:
    data = _arrays("two_tank_simulated", "two_tank_simulated.npz")
    simulator = ODESimulator(
        linear_tanks, states=["upper", "lower"], inputs=["pump"], outputs=["lower"],
        params={"k": 0.005, "a1": 0.1, "a2": 0.1}, dt=0.2, x0=[0.1, 0.1],
    )  # fmt: skip
    u, y = data["u"][:1000, None], data["y"][:1000, None]
    return Problem(name, simulator, u, y, _one_run(u), "all", ("power_law",), ("upper", "lower"), real=False)


def _wiener_hammerstein(name: str) -> Problem:
    data = _arrays("wiener_hammerstein_2009", "wh2009.npz")
    chain = Chain()
    simulator = ODESimulator(
        chain.rhs, states=["a1", "a2", "a3", "b1", "b2", "b3"], inputs=["u"], outputs=["y"], output=chain.output,
        params={"gain": 0.8, "offset": 0.0}, dt=1.0 / 51.2, hold="foh",
    )  # fmt: skip
    rows = slice(5200, 6400)
    u, y = data["uBenchMark"][rows, None], data["yBenchMark"][rows, None]
    return Problem(name, simulator, u, y, _one_run(u), "all", (), ("a2", "b1"))


def _wooden_bob(name: str) -> Problem:
    data = _table("wooden_bob")
    simulator = ODESimulator(
        pendulum, states=["angle", "rate"], inputs=[], outputs=["angle"], params={"g_over_l": 29.5, "tilt": 0.0},
        dt=1.0 / 30.0, x0=[0.9766, 0.0],
    )  # fmt: skip
    y = data["angle"][:, None]
    return Problem(
        name,
        simulator,
        np.zeros((len(y), 0)),
        y,
        data["run"].astype(int),
        "all",
        ("linear_loss", "quadratic_drag"),
        ("rate",),
    )


def _armadillo(name: str) -> Problem:
    data = _table("armadillo")
    simulator = ODESimulator(
        building, states=["wall", "room"], inputs=["T_ext", "heat", "sun"], outputs=["room"],
        params={"Ro": 0.5, "Ri": 0.1, "Cw": 12.0, "Ci": 2.0}, dt=1.0 / 48.0, x0=[26.0, 26.7],
    )  # fmt: skip
    X = _columns(data["T_ext"], data["heat"], data["sun"])
    return Problem(name, simulator, X, data["room"][:, None], _one_run(X), "all", SUN, ("wall", "room"))


_PROBLEMS: dict[str, Callable[[str], Problem]] = {
    **{_slug(ball): _ball for ball in LIGHT + HEAVY},
    "armadillo": _armadillo,
    "tclab": _tclab,
    "tclab_with_heater": _tclab,
    "ball_and_beam": _ball_and_beam,
    "wooden_bob": _wooden_bob,
    "two_tank_simulated": _two_tanks,
    "cascaded_tanks": _cascaded_tanks,
    "heat_exchanger": _heat_exchanger,
    "battery": _battery,
    "silverbox": _silverbox,
    "emps": _emps,
    "cstr": _cstr,
    "robot_arm": _robot_arm,
    "wiener_hammerstein_2009": _wiener_hammerstein,
}

#: All recordings, short ones first.
NAMES = tuple(_PROBLEMS)


def problem(name: str) -> Problem:
    """A recording by name."""
    if name not in _PROBLEMS:
        raise SystemExit(f"recording {name!r} is not known; expected one of {', '.join(NAMES)}")
    return _PROBLEMS[name](name)


def main() -> None:
    """Print the recordings."""
    for name in NAMES:
        one = problem(name)
        runs = [np.asarray(one.simulator.simulate(one.X[one.groups == k])) for k in np.unique(one.groups)]
        error = np.sqrt(np.mean((np.concatenate(runs) - one.y) ** 2, axis=0)) / np.std(one.y, axis=0)
        print(f"{name}: {len(one.y)} rows, {len(runs)} runs, RMSE over deviation {np.round(error, 3)}")


if __name__ == "__main__":
    main()
