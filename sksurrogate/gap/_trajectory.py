"""Simulators that only give trajectories: input, sensor and parameter effects around ``simulate``.

Initial states are the simulator's own. Every rival is fitted by least squares through ``simulate``; its evidence is
``n_eff ln(cost_null / cost)`` with as many independent values as the correlation of the residual leaves.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from sksurrogate.effects._catalogue import CATALOGUE, build_effects
from sksurrogate.effects._effect import BaseEffect, Probe
from sksurrogate.effects._simulator import AugmentedSimulator
from sksurrogate.exceptions import SimulatorError
from sksurrogate.gap._answer import sentence_of
from sksurrogate.gap._evidence import bar
from sksurrogate.gap._report import EffectEstimate, GapReport, Table, Trace, Where
from sksurrogate.gap._shrink import HeldOut, blocked, measure
from sksurrogate.gap._where import by_frequency, by_output
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import noise_of_differences
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Runs

__all__ = ["diagnose_trajectory"]

#: Most effects named at once.
MOST_EFFECTS = 3
#: Share of the gap (amplitude) that may be left by an explanation.
SHARE = 0.20


@dataclass(frozen=True, eq=False)
class _Fit:
    """Effects with their values, free parameters, and the outputs that they give."""

    effects: tuple[BaseEffect, ...]
    theta: np.ndarray
    y: np.ndarray
    cost: float
    J: np.ndarray


class _Fitter:
    """Least squares through ``simulate``."""

    def __init__(self, simulator: Any, plant: Plant, record: Record, free: tuple[str, ...]):
        self.simulator, self.plant, self.record, self.free = simulator, plant, record, free
        self.sd = noise_of_differences(record.y, record.starts)

    def augmented(self, effects: tuple[BaseEffect, ...], theta: np.ndarray) -> AugmentedSimulator:
        """The simulator with effects and re-tuned parameters."""
        values, position = [], 0
        for effect in effects:
            values.append({p.name: float(v) for p, v in zip(effect.parameters, theta[position:])})
            position += len(effect.parameters)
        tuned = {name: float(v) for name, v in zip(self.free, theta[position:])}
        return AugmentedSimulator(self.simulator, list(effects), values, tuned or None)

    def outputs(self, effects: tuple[BaseEffect, ...], theta: np.ndarray) -> np.ndarray:
        """All runs, (n_outputs, n_samples)."""
        model = self.augmented(effects, theta) if effects or self.free else self.simulator
        bounds = np.r_[self.record.starts, self.record.n_samples]
        runs = [
            np.asarray(model.simulate(self.record.u[:, a:b].T)).reshape(b - a, -1)
            for a, b in zip(bounds[:-1], bounds[1:])
        ]
        return np.concatenate(runs).T

    def residual(self, theta: np.ndarray, effects: tuple[BaseEffect, ...]) -> np.ndarray:
        r = ((self.record.y - self.outputs(effects, theta)) / self.sd[:, None]).ravel()
        return np.where(np.isfinite(r), r, 1e6)

    def fit(self, effects: tuple[BaseEffect, ...], start: np.ndarray, evaluations: int = 12) -> _Fit:
        """From one start."""
        if not len(start):
            r = self.residual(start, effects)
            return _Fit(effects, start, self.outputs(effects, start), float(r @ r), np.zeros((len(r), 0)))
        low = np.array([p.low for e in effects for p in e.parameters] + [-np.inf] * len(self.free))
        high = np.array([p.high for e in effects for p in e.parameters] + [np.inf] * len(self.free))
        start = np.clip(start, np.where(np.isfinite(low), low + 1e-9, low), high)
        scale = np.where(np.abs(start) > 0, np.abs(start), 1e-3)
        found = least_squares(
            self.residual,
            start,
            args=(effects,),
            bounds=(low, high),
            x_scale=scale,
            diff_step=1e-4,
            max_nfev=evaluations,
        )
        return _Fit(effects, found.x, self.outputs(effects, found.x), float(2 * found.cost), found.jac)

    def independent(self, r: np.ndarray) -> float:
        """Independent values in a residual (n_outputs, n_samples): its size over its correlation time."""
        out = 0.0
        for row in r:
            z = row - row.mean()
            power = float(z @ z) + 1e-300
            lags = min(60, len(z) // 4)
            rho = np.array([float(z[k:] @ z[: len(z) - k]) / power for k in range(1, lags)])
            positive = rho[: int(np.argmax(rho < 0.05))] if (rho < 0.05).any() else rho
            out += len(z) / (1.0 + 2.0 * positive.sum())
        return out


def _starts(fitter: _Fitter, effect: BaseEffect) -> list[tuple[float, ...]]:
    """Starting values of an effect."""
    record, plant = fitter.record, fitter.plant
    where = np.zeros(record.n_samples)
    if effect.kind == "input":
        where = record.u[plant.inputs.index(str(effect.location))]
    elif effect.kind == "output":
        where = record.y[plant.outputs.index(str(effect.location))]
    v = where
    if effect.variable:
        v = (
            record.u[plant.inputs.index(effect.variable)]
            if effect.variable in plant.inputs
            else record.y[plant.outputs.index(effect.variable)]
        )
    return list(effect.starts(Probe(v, where, 0.0, record.dt, record.dt * int(record.lengths.max()), record.starts)))


def _expand(fitter: _Fitter, base: _Fit, candidates: list[BaseEffect]) -> list[_Fit]:
    """Base with one effect more, best first."""
    out = []
    split = sum(len(e.parameters) for e in base.effects)
    taken = {e.key for e in base.effects}
    for effect in candidates:
        if effect.key in taken:
            continue
        effects = (*base.effects, effect)
        tries = []
        for values in _starts(fitter, effect)[:5]:
            theta = np.concatenate([base.theta[:split], values, base.theta[split:]])
            r = fitter.residual(theta, effects)
            tries.append((float(r @ r), theta))
        if tries:
            out.append(fitter.fit(effects, min(tries, key=lambda item: item[0])[1]))
    return sorted(out, key=lambda fit: fit.cost)


def diagnose_trajectory(
    diagnoser: Any, plant: Plant, runs: Runs, free: tuple[str, ...], seed: int, begun: float
) -> tuple[GapReport, AugmentedSimulator]:
    """The diagnosis of a simulator with ``simulate`` alone.

    Returns
    -------
    report : GapReport
    augmented : AugmentedSimulator
    """
    record = Record.from_runs([r.X for r in runs], [r.y for r in runs], [r.t for r in runs], runs.dt)
    fitter = _Fitter(plant.simulator, plant, record, free)
    y = fitter.outputs((), np.array([plant.params[name] for name in free]))
    if y.shape != record.y.shape:
        raise SimulatorError(
            f"simulate returned {y.shape[0]} outputs, but y has {record.y.shape[0]} columns: one for each output."
        )
    candidates = [e for e in build_effects(plant, (), diagnoser.effects) if e.access == "trajectory"]
    untestable = tuple(name for name, kind in CATALOGUE.items() if kind.access != "trajectory")
    nominal = np.array([plant.params[name] for name in free], dtype=float)
    null = best = fitter.fit((), nominal)
    rivals: list[_Fit] = []
    effective = fitter.independent(record.y - null.y)
    ties: list[list[_Fit]] = []
    while len(best.effects) < MOST_EFFECTS:
        found = _expand(fitter, best, candidates)
        rivals = rivals or found
        if not found:
            break
        k = len(found[0].theta) - len(best.theta)
        gain = effective * np.log(best.cost / max(found[0].cost, 1e-300))
        if gain < bar(k, len(candidates), record.y.size) + (10.0 if best.effects else 0.0):
            break
        near = [
            f
            for f in found[1:]
            if effective * np.log(f.cost / found[0].cost) < 6.0 and len(f.theta) <= len(found[0].theta)
        ]
        ties.append(near)
        best = found[0]
        effective = max(fitter.independent(record.y - best.y), 10.0)
    return _report(diagnoser, plant, runs, record, fitter, null, best, rivals, ties, untestable, seed, begun)


def _report(diagnoser, plant, runs, record, fitter, null, best, rivals, ties, untestable, seed, begun):  # type: ignore[no-untyped-def]
    """Certificate on runs left out, and the report."""
    cut = blocked(record)
    plain = np.concatenate([np.asarray(plant.simulator.simulate(run.X)).reshape(len(run), -1) for run in runs]).T
    after = np.full(record.y.shape, np.nan)
    n_runs = len(record.starts)
    for fold in range(min(n_runs, 4)):
        test = [r for r in range(n_runs) if r % min(n_runs, 4) == fold]
        train = [r for r in range(n_runs) if r not in test]
        theta = best.theta
        if train and len(theta):
            theta = (
                _Fitter(fitter.simulator, plant, record.select(train), fitter.free).fit(best.effects, theta, 6).theta
            )
        rows = np.isin(record.run_of_row, test)
        after[:, rows] = _Fitter(fitter.simulator, plant, record.select(test), fitter.free).outputs(best.effects, theta)
    nothing = np.full(record.y.shape, np.nan)
    held = HeldOut(cut, plain, after, null.y if fitter.free else nothing, nothing)
    shrink = measure(held, fitter.sd, plant.outputs, seed)
    left = np.sqrt(np.mean(((record.y - best.y) / fitter.sd[:, None]) ** 2))
    if not best.effects and not fitter.free:
        verdict = "unknown" if left > 5.0 else "none"
    else:
        verdict = "explained" if shrink.fraction > 1 - SHARE or left < 1.15 else ("unknown" if left > 1.5 else "none")
    effects = _estimates(best, fitter, shrink.fraction_power, ties) if verdict != "none" else []
    share = (record.y - null.y) / fitter.sd[:, None]
    worst = plant.outputs[int(np.argmax(np.mean(share**2, axis=1)))]
    location, kind = (
        (effects[0].location, best.effects[0].kind)
        if effects
        else ((worst, "output") if verdict == "unknown" else (None, None))
    )
    where = Where(location, kind, by_output(shrink), by_frequency=by_frequency(cut, plain, fitter.sd))
    table = Table(
        tuple(
            {
                "name": f.effects[-1].name,
                "location": f.effects[-1].location,
                "variable": f.effects[-1].variable,
                "evidence": float(fitter.independent(record.y - null.y) * np.log(null.cost / max(f.cost, 1e-300))),
                "cost": f.cost,
                "named": f.effects[-1].key in {e.key for e in best.effects},
            }
            for f in rivals
        )
    )
    note = (
        "The simulator gives trajectories only: effects inside its balances could not be tested, and initial states are the "
        "simulator's own. Give it rhs or step to test the whole catalogue."
    )
    tuned = best.theta[len(best.theta) - len(fitter.free) :]
    retuned = Table(
        tuple(
            {
                "parameter": n,
                "nominal": plant.params[n],
                "value": float(v),
                "low": np.nan,
                "high": np.nan,
                "moved": bool(v != plant.params[n]),
            }
            for n, v in zip(fitter.free, tuned)
        )
    )
    bounds = np.r_[cut.starts, cut.n_samples]
    traces = tuple(
        Trace(i, cut.t[a:b], cut.y[:, a:b].T, plain[:, a:b].T, after[:, a:b].T)
        for i, (a, b) in enumerate(zip(bounds[:-1], bounds[1:]))
        if i < 4
    )
    report = GapReport(
        verdict,
        sentence_of(verdict, effects, where, shrink, None, None),
        effects,
        table,
        retuned,
        where,
        shrink,
        notes=(note,),
        untestable=untestable,
        outputs=plant.outputs,
        states=plant.states,
        inputs=plant.inputs,
        traces=traces,
        seconds=time.perf_counter() - begun,
    )
    return report, fitter.augmented(best.effects, best.theta)


def _estimates(best: _Fit, fitter: _Fitter, total: float, ties: list[list[_Fit]]) -> list[EffectEstimate]:
    """Effects with intervals from the Jacobian, widened by the correlation of the residual."""
    r = fitter.record.y - best.y
    inflate = best.cost / max(fitter.independent(r), 1.0)
    H = best.J.T @ best.J
    spread = np.sqrt(np.maximum(np.diag(np.linalg.pinv(H)) * inflate, 0.0))
    out, position = [], 0
    for i, effect in enumerate(best.effects):
        names = [p.name for p in effect.parameters]
        rows = range(position, position + len(names))
        position += len(names)
        twins = [f.effects[-1].key for f in (ties[i] if i < len(ties) else [])]
        out.append(
            EffectEstimate(
                effect.name,
                str(effect.location),
                effect.variable,
                float(total) / len(best.effects),
                {n: float(best.theta[k]) for n, k in zip(names, rows)},
                {
                    n: (float(best.theta[k] - 1.645 * spread[k]), float(best.theta[k] + 1.645 * spread[k]))
                    for n, k in zip(names, rows)
                },
                1.0 / (1 + len(twins)),
                [(str(k[0]), str(k[1]), k[2]) for k in twins],
                "These effects explain the data equally well; vary the amplitude and the speed of the inputs to part them."
                if twins
                else "No other effect that can be tested here explains these data as well.",
            )
        )
    return out
