"""How well is a missing term found as a formula: published systems with one term deleted, against peers, and recordings.

Run: ``python tests/benchmarks/bench_laws.py systems [NAME ...]``, ``... peers [NAME ...]`` (the peers alone),
``... false [NAME ...]`` (the same systems with nothing deleted, half of them under a coloured disturbance),
``... stages [NAME ...]`` (seconds of the search for a law; systems of two states by default) or
``... recordings [NAME ...]`` (data below ``SKSURROGATE_DATA``; long records are cut to ``ROWS`` rows). A term is recovered where
the R2 of the formula against the true term, along runs that nobody fitted, is at least 0.99. The peers of ``law_peers.py`` (pysindy,
gplearn) see the same runs; one that is not installed is nan. Recordings are diagnosed with and without the accepted names: the law
should close most of what the name closes.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from law_peers import PEERS, best_of, r2, residual
from published_systems import SYSTEMS, System
from scipy.signal import lfilter

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap._pipeline import DiagnosisPipeline
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


def questions(names: list[str]) -> Iterator[tuple[str, System, np.ndarray, np.ndarray, np.ndarray]]:
    """Name, system, runs, noise, and states along fresh runs (n_states, n_samples)."""
    for name in names or list(SYSTEMS):
        system = SYSTEMS[name]
        runs, fresh = runs_of(system, RUNS, 1), runs_of(system, FRESH, 2).reshape(-1, len(system.states)).T
        yield (
            name,
            system,
            runs,
            NOISE * runs.std(axis=(0, 1)) * np.random.default_rng(3).normal(size=runs.shape),
            fresh,
        )


def by_peers(system: System, runs: np.ndarray, noise: np.ndarray, fresh: np.ndarray) -> dict[str, float]:
    """R2 of every peer of ``law_peers.py``."""
    Z, left = residual(system, runs + noise)
    return {peer: best_of(peer, Z, left, fresh.T, system.term(fresh)) for peer in PEERS}


def counted(rows: list[dict[str, float]]) -> None:
    """How many terms each recovers."""
    for way in rows[0]:
        counts = (sum(row[way] >= bar for row in rows) for bar in (0.99, 0.999))
        print("{}: R2 of 0.99 in {}, of 0.999 in {} of {}".format(way, *counts, len(rows)))


def systems(names: list[str]) -> None:
    """Every system in a line, then the counts."""
    rows = []
    for name, *question in questions(names):
        found, text, seconds = by_law(*question)
        rows.append({"law": found, **by_peers(*question)})
        said = ", ".join(f"{way} {value:.4f}" for way, value in rows[-1].items())
        print(f"{name}: {said} [{text}], {seconds:.1f} s", flush=True)
    counted(rows)


def peers(names: list[str]) -> None:
    """The peers alone."""
    rows = []
    for name, *question in questions(names):
        started = time.process_time()
        rows.append(by_peers(*question))
        said = ", ".join(f"{way} {value:.4f}" for way, value in rows[-1].items())
        print(f"{name}: {said}, {time.process_time() - started:.1f} s", flush=True)
    counted(rows)


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


@contextmanager
def timed_stages() -> Iterator[dict[str, float]]:
    """Processor seconds of every stage of the diagnoses within, by name."""
    spent, asked = dict[str, float](), DiagnosisPipeline.ask

    def timed(pipeline: Any, stage: Any) -> None:
        begun = time.process_time()
        asked(pipeline, stage)
        spent[stage.name] = spent.get(stage.name, 0.0) + time.process_time() - begun

    DiagnosisPipeline.ask = timed  # type: ignore[method-assign]
    try:
        yield spent
    finally:
        DiagnosisPipeline.ask = asked  # type: ignore[method-assign]


def stages(names: list[str]) -> None:
    """Processor seconds of a diagnosis with the whole catalogue, and of its last stage, the search for a law."""
    shares = []
    for name, system, runs, noise, _ in questions(names or [n for n, one in SYSTEMS.items() if len(one.states) == 2]):
        y = (runs + noise).reshape(-1, runs.shape[2])
        groups = np.repeat(np.arange(len(runs)), runs.shape[1])
        with timed_stages() as spent:
            diagnoser = GapDiagnoser(simulator_of(system, False), n_jobs=1, random_state=0)
            report = diagnoser.fit(np.zeros((len(y), 0)), y, groups=groups).report_
        law, whole = spent.get("law", 0.0), sum(spent.values())
        shares.append((law, law / whole))
        named = [effect.name for effect in report.effects]
        print(f"{name}: {report.verdict} {named}: law {law:.1f} of {whole:.1f} s", flush=True)
    seconds, part = np.median(shares, axis=0)
    print(f"median {seconds:.1f} s, share {part:.2f}, largest share {max(share for _, share in shares):.2f}")


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
    ways = {"systems": systems, "peers": peers, "false": false, "stages": stages, "recordings": recordings}
    ways[what](asked)
