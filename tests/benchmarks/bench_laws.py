"""How well is a missing term found as a formula: published systems with one term deleted, against a sparse regression, and recordings.

Run: ``python tests/benchmarks/bench_laws.py systems [NAME ...]``, ``... false [NAME ...]`` (the same systems with nothing
deleted, half of them under a coloured disturbance) or ``... recordings [NAME ...]`` (data below ``SKSURROGATE_DATA``; long
records are cut to ``ROWS`` rows). A term is recovered where the R2 of the formula against the true term, along runs that nobody fitted, is
at least 0.99. The peer is pysindy's STLSQ (extra ``bench``) on the same runs: polynomials of degree three and sines of the states
against the derivative that the simulator leaves; without pysindy it is left out. Recordings are diagnosed with and without the
accepted names: the law should close most of what the name closes.
"""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from published_systems import SYSTEMS, System
from scipy.signal import lfilter

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

#: Noise over the deviation of each state; runs that are fitted, and runs that nobody fits.
NOISE, RUNS, FRESH = 0.01, 6, 4
#: Memory over a sample of the coloured disturbance of readings.
SLOW = 0.9
#: Rows of a recording that are diagnosed.
ROWS = 1500
#: Diagnoses of a recording: names that take the place of those that are excluded are excluded too.
MOST_PASSES = 4


def simulator_of(system: System, with_term: bool) -> ODESimulator:
    """The system, with its term or without."""
    place = system.states.index(system.place)

    def rhs(t: Any, x: Any, u: Any, p: Any) -> Any:
        dx = list(system.rest(x))
        if with_term:
            dx[place] = dx[place] + system.term(x)
        return dx

    return ODESimulator(rhs, states=system.states, inputs=[], outputs=system.states, params={}, dt=system.dt)


def runs_of(system: System, n_runs: int, seed: int) -> np.ndarray:
    """Free runs from drawn initial states (n_runs, n_samples, n_states)."""
    rng = np.random.default_rng(seed)
    starts = rng.uniform(system.low, system.high, (n_runs, len(system.states)))
    return np.asarray(simulator_of(system, True).simulate_batch(np.zeros((n_runs, system.n_samples, 0)), starts))


def r2(found: np.ndarray, truth: np.ndarray) -> float:
    """Of a term along fresh runs."""
    spread = float(np.sum((truth - truth.mean()) ** 2))
    return 1.0 - float(np.sum((truth - found) ** 2)) / spread if np.isfinite(found).all() else -np.inf


def by_law(system: System, runs: np.ndarray, noise: np.ndarray, fresh: np.ndarray) -> tuple[float, str, float]:
    """R2 of the formula, its text, and the processor seconds of the diagnosis."""
    y = (runs + noise).reshape(-1, runs.shape[2])
    groups = np.repeat(np.arange(len(runs)), runs.shape[1])
    started = time.process_time()
    diagnoser = GapDiagnoser(simulator_of(system, False), effects=["sensor_quantization"], n_jobs=1, random_state=0)
    report = diagnoser.fit(np.zeros((len(y), 0)), y, groups=groups).report_
    seconds = time.process_time() - started
    law = report.missing_term.law if report.missing_term is not None else None
    remembers = law is not None and "lag(" in str(law)  # no function of the states
    if law is None or remembers or law.kind != "state" or law.location != system.place:
        return -np.inf, f"{report.verdict}: {law}", seconds
    signals = dict(zip(system.states, fresh))
    return r2(np.broadcast_to(law.value(signals), fresh[0].shape), system.term(fresh)), str(law), seconds


def first_rows(one: Any) -> Any:
    """A recording with at most :data:`ROWS` rows, the first of every run."""
    runs, counts = np.unique(one.groups, return_counts=True)
    most = ROWS // len(runs)
    age = np.concatenate([np.arange(np.sum(one.groups == run)) for run in dict.fromkeys(one.groups.tolist())])
    kept = age < most
    return one if counts.max() <= most else replace(one, X=one.X[kept], y=one.y[kept], groups=one.groups[kept])


def by_sparse_regression(system: System, runs: np.ndarray, noise: np.ndarray, fresh: np.ndarray) -> float:
    """R2 of what STLSQ finds in the derivative that the simulator leaves; nan without pysindy."""
    try:
        import pysindy
    except ImportError:
        return float("nan")
    place = system.states.index(system.place)
    slope = pysindy.SmoothedFiniteDifference(smoother_kws={"window_length": 11})
    t = system.dt * np.arange(runs.shape[1])
    Z, left = [], []
    for run in runs + noise:
        smooth = np.asarray(run)
        rate = np.asarray(slope._differentiate(smooth, t))
        Z.append(smooth)
        left.append(rate[:, place] - np.broadcast_to(np.asarray(system.rest(smooth.T)[place]), rate[:, place].shape))
    library = pysindy.PolynomialLibrary(degree=3) + pysindy.FourierLibrary(n_frequencies=1)
    features = np.asarray(library.fit_transform(np.concatenate(Z)))
    target = np.concatenate(left)[:, None]
    best = -np.inf
    for threshold in (0.02, 0.05, 0.1, 0.2):
        model = pysindy.STLSQ(threshold=threshold).fit(features, target)
        best = max(best, r2(np.asarray(library.transform(fresh.T)) @ np.ravel(model.coef_), system.term(fresh)))
    return best  # the threshold that suits the truth: more than a user can choose


def systems(names: list[str]) -> None:
    """Every system in a line, then the counts."""
    rows = []
    for name in names or list(SYSTEMS):
        system = SYSTEMS[name]
        runs, fresh = runs_of(system, RUNS, 1), runs_of(system, FRESH, 2).reshape(-1, len(system.states)).T
        noise = NOISE * runs.std(axis=(0, 1)) * np.random.default_rng(3).normal(size=runs.shape)
        found, text, seconds = by_law(system, runs, noise, fresh)
        peer = by_sparse_regression(system, runs, noise, fresh)
        rows.append((found, peer))
        print(f"{name}: R2 {found:.4f} [{text}], STLSQ {peer:.4f}, {seconds:.1f} s", flush=True)
    recovered = [sum(value >= 0.99 for value in column) for column in zip(*rows)]
    print(f"recovered: {recovered[0]} of {len(rows)}; STLSQ (its best threshold): {recovered[1]} of {len(rows)}")


def false(names: list[str]) -> None:
    """Systems with nothing deleted: no law may be certified. Every other one has readings with a coloured disturbance."""
    certified = 0
    for k, name in enumerate(names or list(SYSTEMS)):
        system = SYSTEMS[name]
        runs, rng = runs_of(system, RUNS, 1), np.random.default_rng(3)
        noise = rng.normal(size=runs.shape)
        if k % 2:
            slow = lfilter([np.sqrt(1 - SLOW**2)], [1.0, -SLOW], rng.normal(size=runs.shape), axis=1)
            noise = noise + slow
        y = (runs + NOISE * runs.std(axis=(0, 1)) * noise).reshape(-1, runs.shape[2])
        groups = np.repeat(np.arange(RUNS), runs.shape[1])
        diagnoser = GapDiagnoser(simulator_of(system, True), n_jobs=1, random_state=0)
        report = diagnoser.fit(np.zeros((len(y), 0)), y, groups=groups).report_
        law = report.missing_term.law if report.missing_term is not None else None
        certified += law is not None and law.certified
        kind, named = "coloured" if k % 2 else "white", [effect.name for effect in report.effects]
        print(f"{name} ({kind}): {report.verdict} {named}, law {law}", flush=True)
    print(f"certified laws: {certified} of {len(names or SYSTEMS)}")


def recordings(names: list[str]) -> None:
    """What the names close on runs left out, and what a law closes where they are excluded, and all that imitate them."""
    from recordings import problem

    for name in names or ["silverbox", "cascaded_tanks", "two_tank_simulated", "emps"]:
        one, out = first_rows(problem(name)), dict[str, None]()
        closed: list[float] = []
        for _ in range(MOST_PASSES):
            diagnoser = GapDiagnoser(one.simulator, exclude=tuple(out), free_params=one.free, n_jobs=1, random_state=0)
            report = diagnoser.fit(one.X, one.y, groups=one.groups).report_
            law = report.missing_term.law if report.missing_term is not None else None
            closed.append(report.shrink.fraction_law if law is not None and law.certified else report.shrink.fraction)
            named = [effect.name for effect in report.effects]
            print(
                f"{name} without {list(out)}: {report.verdict} {named}, law {law}: closed {closed[-1]:.3f}", flush=True
            )
            twins = [twin[0] for effect in report.effects for twin in effect.equivalents]
            out.update(dict.fromkeys([*one.accepted, *named, *twins]))
            if out and not named:
                break
        print(f"{name}: without names {closed[-1] / max(closed[0], 1e-9):.2f} of what the names close", flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    what, *asked = sys.argv[1:] or ["systems"]
    {"systems": systems, "false": false, "recordings": recordings}[what](asked)
