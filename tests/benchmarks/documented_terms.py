"""The documented terms of the real recordings: what a diagnosis that may not name them should draw."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.physics import CalibratedSimulator, ODESimulator


@dataclass(frozen=True)
class Documented:
    """A recording's simulator with the term that the literature documents."""

    rhs: Callable[..., Any]  #: ``rhs(t, x, u, p)`` with the term
    params: Mapping[str, float]  #: Where the fit starts; values of the recording's source
    #: location, variable: balance in which the term sits, signal over which it is drawn
    location: str
    variable: str
    words: str  #: Legend


def duffing(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A resonator with a hardening spring."""
    force = p["b"] * (u[0] - p["u0"]) - p["c"] * x[1] - p["w2"] * x[0]
    return x[1], force - p["k3"] * x[0] ** 3 - p["k2"] * x[0] ** 2


def overflowing(t: Any, x: Any, u: Any, p: Any) -> Any:
    """Two tanks; both overflow at their brims, and part of the upper one's overflow falls into the lower one.

    A brim is a steep weir: what stands above it runs off within a second or two.
    """
    upper, lower = np.sqrt(np.maximum(x[0], 0)), np.sqrt(np.maximum(x[1], 0))
    over, spilt = np.maximum(x[0] - p["brim"], 0), np.maximum(x[1] - 10.0, 0)
    return (
        p["k4"] * u[0] - p["k1"] * upper - p["l1"] * x[0] - over,
        p["k2"] * upper - p["k3"] * lower + p["l2"] * x[0] - p["l3"] * x[1] + p["k5"] * over - spilt,
    )


def convecting(t: Any, x: Any, u: Any, p: Any) -> Any:
    """A tube in steam: convection carries heat off, and the transfer grows with the flow to the power 0.8."""
    tube, sensor = x
    flow = np.maximum(u[0], 1e-6)
    return (
        p["b"] * (flow * (p["cold"] - tube) + p["transfer"] * flow**0.8 * (p["steam"] - tube)),
        (tube - sensor) / p["tau"],
    )


DOCUMENTED = {
    "silverbox": Documented(
        duffing, {"b": 1.936e5, "c": 41.76, "w2": 1.844e5, "u0": 0.006, "k3": 7.33e5, "k2": -1.3e4}, "dy", "y",
        "documented: cubic spring",
    ),
    "cascaded tanks": Documented(
        overflowing,
        {"k1": 0.0562, "k2": 0.0342, "k3": 0.0387, "k4": 0.0384, "brim": 9.35, "k5": 1.0, "l1": -0.0046, "l2": 0.0029, "l3": 0.0016},
        "lower", "lower", "documented: overflow of both tanks",
    ),
    "heat exchanger": Documented(
        convecting, {"b": 0.1, "cold": 20.0, "transfer": 3.0, "steam": 125.0, "tau": 8.0}, "tube", "flow",
        "documented: flow to the power 0.8",
    ),
}  # fmt: skip


def documented_term(recording: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """What the documented model has and the nominal one lacks, along the training record.

    The documented model is fitted to the training record by its free run. The nominal right-hand side, linear in its
    parameters or tuned to the same rates, is taken from it by least squares: whatever re-tuning can follow is not a missing
    term.

    ``recording``: one of those in :data:`DOCUMENTED`.
    Returns ``signal`` (n_rows,): the variable of the term.
    Returns ``term`` (n_rows,): in units of the derivative.
    Returns ``error``: RMSE of the fitted documented model on the training record.
    """
    known = DOCUMENTED[recording.name]
    nominal = recording.simulator
    plant = ODESimulator(
        known.rhs, states=nominal.states, inputs=nominal.inputs, outputs=nominal.outputs, params=dict(known.params),
        dt=nominal.dt, x0=nominal.x0, hold=nominal.hold,
    )  # fmt: skip
    fit = CalibratedSimulator(plant).fit(recording.X, recording.y[:, 0], groups=recording.groups)
    full = fit.simulator_
    watched = ODESimulator(
        known.rhs, states=nominal.states, inputs=nominal.inputs, outputs=nominal.states, params=full.params, dt=nominal.dt,
        hold=nominal.hold,
    )  # fmt: skip
    path = np.asarray(watched.simulate(recording.X, x0=fit.x0_[0]))
    place = list(nominal.states).index(known.location)

    def rate(rhs: Callable[..., Any], params: Mapping[str, float]) -> np.ndarray:
        found = rhs(0.0, path.T, recording.X.T, params)[place]
        return np.broadcast_to(np.asarray(found, dtype=float), (len(path),))

    true = rate(known.rhs, full.params)
    columns = [np.ones(len(path))]
    for name, value in nominal.params.items():
        moved = {**nominal.params, name: value * 1.01 + 1e-9}
        columns.append(rate(nominal.rhs, moved) - rate(nominal.rhs, nominal.params))
    A = np.stack(columns, axis=1)
    A = A / (np.linalg.norm(A, axis=0) + 1e-300)
    base = rate(nominal.rhs, nominal.params)
    term = true - base - A @ np.linalg.lstsq(A, true - base, rcond=1e-9)[0]
    names = [*nominal.states, *nominal.inputs]
    signal = np.hstack([path, recording.X])[:, names.index(known.variable)]
    return signal, term, float(fit.noise_[0])


def documented_curve(recording: Any, missing: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """The learned curve with the documented one at the same points; None where the diagnosis accuses another place.

    ``missing``: missing term as plain data.
    Returns dict or None: location, variable, at, value, low, high, true (all of mean zero along the points), documented
        (words), correlation.
    """
    known = DOCUMENTED.get(recording.name)
    if known is None or not missing or missing["location"] != known.location:
        return None
    curve = next((c for c in missing["curves"] if c["variable"] == known.variable), None)
    if curve is None:
        return None
    at, value = np.asarray(curve["at"], dtype=float), np.asarray(curve["value"], dtype=float)
    signal, term, _ = documented_term(recording)
    edges = np.concatenate([[-np.inf], 0.5 * (at[1:] + at[:-1]), [np.inf]])
    bins = np.digitize(signal, edges) - 1
    true = np.array([term[bins == k].mean() if np.any(bins == k) else np.nan for k in range(len(at))])
    kept = np.isfinite(true)
    middle = value[kept].mean()
    lines = {"at": at, "value": value - middle, "true": true - true[kept].mean()}
    for key in ("low", "high"):
        if curve.get(key) is not None:
            lines[key] = np.asarray(curve[key], dtype=float) - middle
    plain = {key: [float(f"{v:.5g}") for v in line[kept]] for key, line in lines.items()}
    correlation = float(np.corrcoef(plain["true"], plain["value"])[0, 1])
    return {"location": known.location, "variable": known.variable, "documented": known.words,
            "correlation": correlation, **plain}  # fmt: skip
