"""Withheld on real data: the simulator lacks an effect that the literature documents; is it named, and what does it win?

Run: ``python tests/benchmarks/withheld_recordings.py FOLDER [--withhold] >> docs/blind_recorded.jsonl``; FOLDER holds the recordings.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from documented_terms import documented_curve

from sksurrogate.blind._solve import missing
from sksurrogate.blind._truths import remaining
from sksurrogate.datasets import fetch_ball_drops, fetch_cascaded_tanks, fetch_heat_exchanger, fetch_silverbox
from sksurrogate.exceptions import SurrogateError
from sksurrogate.physics import CalibratedSimulator, ODESimulator

#: Balls too heavy for their drag to be seen from a bridge.
HEAVY = ("Baseball", "Bowling Ball", "Golf Ball")


@dataclass(frozen=True)
class Recording:
    """A recording whose documented effect its simulator lacks.

    Attributes
    ----------
    name : str
    simulator : ODESimulator
    X, y, groups : ndarray
        What is diagnosed.
    tests : tuple of (U, y, x0, skipped)
        Test records: inputs, outputs, initial state (None: that of the first training run), rows left out of the score.
    free : tuple of str or "all"
    documented : tuple of str
        Names that count as right; empty for a control.
    places : tuple of str
        Where the effect sits.
    variables : tuple of str
        What drives it; empty where that is left open.
    unit : str
        Of the error.
    published : str
        Results beside.
    """

    name: str
    simulator: ODESimulator
    X: np.ndarray
    y: np.ndarray
    groups: np.ndarray
    tests: tuple[tuple[np.ndarray, np.ndarray, Any, int], ...]
    free: Any
    documented: tuple[str, ...]
    places: tuple[str, ...]
    unit: str
    published: str
    variables: tuple[str, ...] = ()


def resonator(t: Any, x: Any, u: Any, p: Any) -> Any:
    """``y'' = b (u - u0) - c y' - w2 y``."""
    return x[1], p["b"] * (u[0] - p["u0"]) - p["c"] * x[1] - p["w2"] * x[0]


def tanks(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Torricelli's law for both tanks, no overflow."""
    upper, lower = np.sqrt(np.maximum(x[0], 0)), np.sqrt(np.maximum(x[1], 0))
    return p["k4"] * u[0] - p["k1"] * upper, p["k2"] * upper - p["k3"] * lower


def falling(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Free fall."""
    return x[1], -p["g"] + 0.0 * x[1]


def exchanger(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A linear tube and a sensor that lags."""
    tube, sensor = x
    return -p["b0"] * (tube - p["T0"]) - p["g"] * (u[0] - 0.3), (tube - sensor) / p["tau"]


def silverbox(data_home: Any) -> Recording:
    """A linear resonator for the circuit with a hardening spring."""
    data = fetch_silverbox(data_home)
    simulator = ODESimulator(
        resonator, states=["y", "dy"], inputs=["u"], outputs=["y"],
        params={"b": 1.97e5, "c": 43.5, "w2": 1.914e5, "u0": 0.006}, dt=1 / data.fs, hold="foh",
    )  # fmt: skip
    train = slice(data.train.start, data.train.start + 6000)
    u, y = data.V1[:, None], data.V2[:, None]

    def start(part: slice) -> list[float]:
        a = part.start
        return [float(y[a, 0]), float((y[a + 1, 0] - y[a - 1, 0]) * data.fs / 2)]

    tests = tuple((u[part], y[part], start(part), 50) for part in (data.test_multisine, data.test_arrow))
    return Recording(
        "silverbox", simulator, u[train], y[train], np.zeros(6000, int), tests, "all", ("cubic_stiffness",), ("dy",), "V",
        "0.00026 (polynomial nonlinear state space), 0.0137 (linear), arrow", ("y",),
    )  # fmt: skip


def cascaded_tanks(data_home: Any) -> Recording:
    """Two tanks without overflow."""
    data = fetch_cascaded_tanks(data_home)
    simulator = ODESimulator(
        tanks, states=["upper", "lower"], inputs=["pump"], outputs=["lower"],
        params={"k1": 0.05, "k2": 0.05, "k3": 0.05, "k4": 0.05}, dt=data.Ts, x0=[5.0, 5.0],
    )  # fmt: skip
    return Recording(
        "cascaded tanks", simulator, data.uEst[:, None], data.yEst[:, None], np.zeros(1024, int),
        ((data.uVal[:, None], data.yVal[:, None], None, 0),), "all", ("overflow", "state_saturation"), ("upper", "lower"),
        "V", "0.45 (polynomial nonlinear state space), 0.34 (NLSS2), 0.76 (linear)",
    )  # fmt: skip


def heat_exchanger(data_home: Any) -> Recording:
    """A linear model of the steam heat exchanger."""
    data = fetch_heat_exchanger(data_home)
    simulator = ODESimulator(
        exchanger, states=["tube", "sensor"], inputs=["flow"], outputs=["sensor"],
        params={"b0": 0.05, "T0": 97.5, "g": 0.6, "tau": 8.0}, dt=data.Ts, x0=[98.6, 98.6],
    )  # fmt: skip
    q, th = data.q[:, None], data.th[:, None]
    test = slice(data.test.start - 200, data.test.stop)  # 200 rows to settle, left out
    start = [float(th[test.start, 0])] * 2
    return Recording(
        "heat exchanger", simulator, q[data.train], th[data.train], np.zeros(3000, int), ((q[test], th[test], start, 200),),
        "all", ("bilinear", "power_law", "input_curve"), ("tube", "flow"), "degC", "none with this split is known to us",
    )  # fmt: skip


def ball(data_home: Any, name: str) -> Recording:
    """Free fall for a ball that meets air; drop 1 trains, drop 2 tests."""
    data = fetch_ball_drops(data_home)
    simulator = ODESimulator(
        falling, states=["height", "velocity"], inputs=[], outputs=["height"], params={"g": 9.81}, dt=data.Ts, x0=[48.0, 0.0]
    )  # fmt: skip
    drops = [_regular(data, name, k) for k in (1, 2)]
    none = [np.zeros((len(drop), 0)) for drop in drops]
    documented = () if name in HEAVY else ("linear_loss", "quadratic_drag", "quadratic_loss", "power_law")
    return Recording(
        name, simulator, none[0], drops[0], np.zeros(len(drops[0]), int), ((none[1], drops[1], "fit", 0),), (), documented,
        ("velocity",), "m", "", ("velocity",),
    )  # fmt: skip


def _regular(data: Any, name: str, drop: int) -> np.ndarray:
    """Heights without the first three rows (release by hand) and up to the last regular step, (n_rows, 1)."""
    rows = np.flatnonzero((data.ball == name) & (data.drop == drop))[3:]
    if abs(data.time[rows[-1]] - data.time[rows[-2]] - data.Ts) > 0.2 * data.Ts:
        rows = rows[:-1]
    return np.asarray(data.height[rows][:, None])


#: Name -> function of the data's folder that gives the recording; balls by their own names.
RECORDINGS = {"silverbox": silverbox, "cascaded_tanks": cascaded_tanks, "heat_exchanger": heat_exchanger}


def recorded(name: str, data_home: Any = None) -> Recording:
    """A recording by name: one of :data:`RECORDINGS` or of the balls.

    ``data_home``: as in the loaders.
    """
    return RECORDINGS[name](data_home) if name in RECORDINGS else ball(data_home, name)


def run_recorded(
    names: Sequence[str] | None = None, data_home: Any = None, *, withhold: bool = False, verbose: int = 0
) -> list[dict[str, Any]]:
    """Diagnose real recordings and score the augmented simulators on their official test records.

    ``names``: default: all recordings and all balls.
    ``data_home``: folder of the recordings, as in the loaders.
    ``withhold``: the second pass: the documented names and their twins leave the catalogue; right is "unknown" at the
        right place.
    Returns list of dict: recording, verdict, named, place, right, before, retuned, after (test RMSE of each test
        record), unit, published, seconds, missing_term, and in the second pass curve: the learned term over the
        documented one.
    """
    chosen = names if names is not None else [*RECORDINGS, *fetch_ball_drops(data_home).names]
    rows = []
    for name in chosen:
        try:
            row = _diagnosed(recorded(name, data_home), withhold)
        except SurrogateError as error:
            row = {"recording": name, "error": str(error)}
        rows.append(row)
        if verbose:
            print(f"[blind] {row}", flush=True)
    return rows


def _diagnosed(recording: Recording, withhold: bool) -> dict[str, Any]:
    """One recording."""
    from sksurrogate.gap import GapDiagnoser

    left = remaining(list(recording.documented)) if withhold and recording.documented else None
    started = time.perf_counter()
    diagnoser = GapDiagnoser(recording.simulator, effects=left, free_params=recording.free, random_state=0)
    report = diagnoser.fit(recording.X, recording.y, groups=recording.groups).report_
    seconds = time.perf_counter() - started
    names = [(e.name, e.location, e.variable) for e in report.effects]
    every = names + [(q[0], q[1], q[2]) for e in report.effects for q in e.equivalents]
    hit = any(
        name in recording.documented and place in recording.places and variable in (recording.variables or (variable,))
        for name, place, variable in every
    )
    if not recording.documented:
        right = report.verdict == "none"
    elif withhold:
        right = report.verdict == "unknown" and report.where.location in recording.places
    else:
        right = hit
    start, term = diagnoser.initial_states_[0], missing(report.missing_term)
    return {
        "recording": recording.name + (" (withheld)" if left is not None else ""), "verdict": report.verdict,
        "named": ", ".join(f"{n} at {p}" + (f" in {v}" if v else "") for n, p, v in names) or "-",
        "class": len(every), "place": report.where.location, "right": right, "before": _errors(recording, recording.simulator, start),
        "after": _errors(recording, diagnoser.augmented_, start), "unit": recording.unit, "published": recording.published,
        "sentence": report.sentence, "seconds": seconds,
        "retuned": _retuned(recording), "missing_term": term, "curve": documented_curve(recording, term) if left is not None else None,
    }  # fmt: skip


def _retuned(recording: Recording) -> list[float | None]:
    """Test errors when the free parameters are re-tuned and nothing is added."""
    if not recording.free:
        return []
    names = list(recording.simulator.params) if recording.free == "all" else list(recording.free)
    calibration = CalibratedSimulator(recording.simulator, params=names)
    tuned = calibration.fit(recording.X, recording.y[:, 0], groups=recording.groups)  # each has one output
    start = np.asarray(tuned.x0_)[0]
    return list(_errors(recording, tuned.simulator_, start))


def _errors(recording: Recording, simulator: Any, start: np.ndarray) -> list[float]:
    """RMSE of the free run on each test record."""
    found = []
    for U, y, x0, skipped in recording.tests:
        if isinstance(x0, str):
            found.append(_fitted_start(simulator, U, y))
            continue
        predicted = simulator.simulate(U, x0=start if x0 is None else x0)
        found.append(float(np.sqrt(np.mean((predicted - y)[skipped:] ** 2))))
    return found


def _fitted_start(simulator: Any, U: np.ndarray, y: np.ndarray) -> float:
    """RMSE with the initial height and velocity of a drop fitted, as the sources do."""
    from scipy.optimize import least_squares

    first = [float(y[0, 0]), 0.0]
    fit = least_squares(lambda x0: (simulator.simulate(U, x0=x0) - y).ravel(), first, diff_step=1e-4)
    return float(np.sqrt(np.mean(fit.fun**2)))


if __name__ == "__main__":
    for line in run_recorded(data_home=sys.argv[1], withhold="--withhold" in sys.argv):
        print(json.dumps(line, default=float))
