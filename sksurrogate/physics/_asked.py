"""What a calibration is asked for, checked: names, bounds, values and initial states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np

from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.physics._simulator import Plant


def asked_names(plant: Plant, params: Sequence[str] | None) -> list[str]:
    """Names to fit."""
    if plant.access == "trajectory":
        raise SimulatorError(
            f"CalibratedSimulator needs a simulator with rhs or step and states; {type(plant.simulator).__name__} gives trajectories only: "
            "fit its parameters with GridSearchCV over simulator__params__<name>."
        )
    if isinstance(params, str):
        raise SimulatorError(f"params={params!r}: expected a list of names, params=[{params!r}].")
    if params is None and not plant.params:
        raise SimulatorError(
            f"{type(plant.simulator).__name__} has no parameters to fit: name them in params={{...}} of the simulator and read "
            'them in its function (p["k"]), or fit initial states alone with params=[].'
        )
    names = list(plant.params) if params is None else list(params)
    unknown = [name for name in names if name not in plant.params]
    if unknown:
        raise SimulatorError(
            f"params={names}: the simulator has no parameter {unknown[0]!r}; it has {sorted(plant.params)}."
        )
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise SimulatorError(f"params={names}: {twice[0]!r} is named twice; name every parameter once.")
    return names


def nominal_values(plant: Plant, names: Sequence[str]) -> np.ndarray:
    """Where the fit starts, (n_names,)."""
    values = []
    for name in names:
        given = plant.params[name]
        try:
            value = float(given)
        except (TypeError, ValueError):
            value = np.nan
        if not np.isfinite(value):
            raise SimulatorError(
                f"the simulator's params[{name!r}]={given!r}: expected a finite number, from which the fit starts; "
                f"set_params(params__{name}=...), or leave it out of params=[...] of the calibration."
            )
        values.append(value)
    return np.array(values, dtype=float)


def asked_bounds(bounds: Any, names: Sequence[str], unknown_is: str = "is not fitted") -> tuple[np.ndarray, np.ndarray]:
    """(low, high) of every name; ``unknown_is`` says what is wrong with another name."""
    if bounds is not None and not isinstance(bounds, Mapping):
        raise DataError(f"bounds={bounds!r}: expected a dict by name, for instance bounds={{{[*names, 'k'][0]!r}: (0, None)}}.")  # fmt: skip
    given = dict(bounds or {})
    unknown = sorted(set(given) - set(names), key=str)
    if unknown:
        raise DataError(f"bounds names {unknown[0]!r}, which {unknown_is}; params are {list(names)}.")
    pairs = []
    for name in names:
        try:
            a, b = given.get(name, (None, None))
            pair = (-np.inf if a is None else float(a), np.inf if b is None else float(b))
        except (TypeError, ValueError):
            pair = (np.nan, np.nan)
        if not pair[0] < pair[1]:
            raise DataError(
                f"bounds[{name!r}]={given[name]!r}: expected (low, high) with low < high; None leaves a side open."
            )
        pairs.append(pair)
    return np.array([a for a, _ in pairs], dtype=float), np.array([b for _, b in pairs], dtype=float)


def asked_priors(
    priors: Any, nominal: Mapping[str, float], unknown_is: str = "is not fitted"
) -> dict[str, tuple[float, float]]:
    """(mean, standard deviation) in the unit of the parameter, by name.

    ``priors``: one number is a standard deviation relative to the nominal value, which is then the mean.
    ``nominal``: the parameters that a prior may be about.
    ``unknown_is``: what is wrong with another name.
    Raises DataError.

    >>> asked_priors({"k": 0.05, "c": (1.0, 0.2)}, {"k": -2.0, "c": 0.0})
    {'k': (-2.0, 0.1), 'c': (1.0, 0.2)}
    """
    if priors is not None and not isinstance(priors, Mapping):
        raise DataError(
            f"priors={priors!r}: expected a dict by name, for instance priors={{{[*nominal, 'k'][0]!r}: 0.05}}."
        )
    out = {}
    for name, given in (priors or {}).items():
        if name not in nominal:
            raise DataError(f"priors names {name!r}, which {unknown_is}; params are {list(nominal)}.")
        relative = isinstance(given, Real) and not isinstance(given, bool)
        if relative and nominal[name] == 0:
            raise DataError(
                f"priors[{name!r}]={given!r} is relative to the simulator's {name}, which is 0: give (mean, standard deviation)."
            )
        try:
            pair = (nominal[name], float(given) * abs(nominal[name])) if relative else tuple(float(v) for v in given)
        except (TypeError, ValueError):
            pair = ()
        if len(pair) != 2 or not (np.isfinite(pair).all() and pair[1] > 0.0):
            raise DataError(
                f"priors[{name!r}]={given!r}: expected a relative standard deviation above 0, for instance 0.05, or (mean, "
                f"standard deviation) in the unit of {name}, for instance ({nominal[name]:g}, {abs(nominal[name]) / 20 or 0.1:g})."
            )
        out[name] = (float(pair[0]), float(pair[1]))
    return out


def initial_states(plant: Plant, x0: Any, n_runs: int) -> np.ndarray:
    """(n_runs, n_states), those of the simulator by default."""
    n = len(plant.states)
    given = plant.x0 if x0 is None else np.asarray(x0, dtype=float)
    if given.shape not in ((n,), (1, n), (n_runs, n)):
        raise DataError(
            f"x0 has shape {given.shape}, expected ({n},) or ({n_runs}, {n}): one value for each of states={list(plant.states)}, "
            "for all runs or run by run."
        )
    if not np.all(np.isfinite(given)):
        raise DataError(
            f"x0={given.tolist()} is not finite: give numbers, or leave x0 out, so that the fit finds them."
        )
    return np.broadcast_to(given, (n_runs, n)).copy()
