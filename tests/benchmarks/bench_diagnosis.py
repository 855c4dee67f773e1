"""How long does a diagnosis take, with the whole catalogue, and how does that grow with the samples?

Run: ``python tests/benchmarks/bench_diagnosis.py [seeds] [largest]``; prints two markdown tables. Seconds of the processor
(one thread) stand beside those of the wall, because other work may share the machine.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

from sksurrogate.effects import AugmentedSimulator
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator


def spring(t, x, u, p):
    """A mass on a spring."""
    q, v = x
    return v, (u[0] - p["k"] * q - p["c"] * v) / p["m"]


def motor(t, x, u, p):
    """Current and speed of a motor."""
    i, w = x
    return (u[0] - p["R"] * i - p["K"] * w) / p["L"], (p["K"] * i - p["b"] * w) / p["J"]


def rooms(t, x, u, p):
    """Two rooms and a heater."""
    a, b, heater = x
    return (
        p["g"] * (heater - a) + p["h"] * (b - a) - p["l"] * a,
        p["h"] * (a - b) - p["l"] * b,
        (u[0] - heater) / p["T"],
    )


PLANTS = {
    "spring (2 states)": (
        ODESimulator(
            spring, states=["q", "v"], inputs=["f"], outputs=["q"], params={"m": 1.0, "k": 20.0, "c": 0.6}, dt=0.03
        ),
        8.0,
        [("cubic_stiffness", "v", "q"), ("coulomb_friction", "v", "v"), ("sensor_bias", "q", None)],
    ),
    "motor (2 states)": (
        ODESimulator(
            motor,
            states=["i", "w"],
            inputs=["volt"],
            outputs=["w"],
            params={"R": 1.0, "K": 0.5, "L": 0.1, "J": 0.05, "b": 0.02},
            dt=0.02,
        ),
        4.0,
        [("quadratic_drag", "w", "w"), ("input_dead_zone", "volt", None), ("input_lag", "volt", None)],
    ),
    "rooms (3 states)": (
        ODESimulator(
            rooms,
            states=["a", "b", "heater"],
            inputs=["power"],
            outputs=["a", "b"],
            params={"g": 0.3, "h": 0.1, "l": 0.05, "T": 2.0},
            dt=0.5,
        ),
        10.0,
        [("linear_loss", "b", "a"), ("sensor_lag", "a", None), ("input_saturation", "power", None)],
    ),
}


def excitation(rng, n, amplitude):
    """Levels held 15 samples."""
    return amplitude * np.repeat(rng.normal(size=n // 15 + 1), 15)[:n, None]


def record(simulator, truth, amplitude, n_runs, n_samples, rng, noise=0.01):
    """(U, Y, groups) with white noise."""
    U = [excitation(rng, n_samples, amplitude) for _ in range(n_runs)]
    Y = [truth.simulate(u, x0=np.zeros(len(simulator.states))) for u in U]
    Y = [y + noise * np.std(y, axis=0) * rng.normal(size=y.shape) for y in Y]
    return np.concatenate(U), np.concatenate(Y), np.repeat(np.arange(n_runs), n_samples)


def planted(simulator, keys, amplitude, rng):
    """The simulator with effects of a size that moves the outputs by a tenth of their deviation."""
    from sksurrogate.effects import CATALOGUE

    U = excitation(rng, 900, amplitude)
    rest = simulator.simulate(U, x0=np.zeros(len(simulator.states)))
    truth, effects, values = simulator, [], []
    for name, location, variable in keys:
        effect = CATALOGUE[name](location, variable) if variable else CATALOGUE[name](location)
        best = None
        for size in np.geomspace(1e-4, 1e3, 57):
            value = size * amplitude if effect.kind == "input" and "dead" in name else size
            trial = {p.name: (1 / value if p.null == np.inf else value) for p in effect.parameters}
            try:
                moved = AugmentedSimulator(simulator, [effect], [trial]).simulate(U, x0=np.zeros(len(simulator.states)))
            except ValueError:
                continue
            gap = np.sqrt(np.mean(((moved - rest) / rest.std(axis=0)) ** 2))
            if best is None or abs(np.log(gap / 0.1 + 1e-12)) < best[0]:
                best = abs(np.log(gap / 0.1 + 1e-12)), trial
        effects.append(effect)
        values.append(best[1])
        truth = AugmentedSimulator(simulator, effects, values)
    return truth


def timed(simulator, U, Y, groups):
    """The report, seconds of the processor and of the wall."""
    cpu, wall = time.process_time(), time.perf_counter()
    report = GapDiagnoser(simulator, random_state=0).fit(U, Y, groups=groups).report_
    return report, time.process_time() - cpu, time.perf_counter() - wall


def kinds(n_seeds):
    """Seconds by plant and by what is planted."""
    print("| plant, 6 runs x 300 samples | planted | processor / s, median | wall / s, median | named as planted |")
    print("| --- | --- | --- | --- | --- |")
    for label, (simulator, amplitude, keys) in PLANTS.items():
        for count in (0, 1, 2):
            cpu, wall, right = [], [], 0
            for seed in range(n_seeds):
                rng = np.random.default_rng(seed)
                chosen = [keys[k] for k in rng.permutation(len(keys))[:count]]
                truth = planted(simulator, chosen, amplitude, rng) if chosen else simulator
                report, c, w = timed(simulator, *record(simulator, truth, amplitude, 6, 300, rng))
                classes = [{(e.name, e.location, e.variable), *e.equivalents} for e in report.effects]
                right += len(classes) == count and all(any(key in c for c in classes) for key in chosen)
                cpu.append(c)
                wall.append(w)
            print(
                f"| {label} | {count} effect(s) | {np.median(cpu):.1f} | {np.median(wall):.1f} | {right} of {n_seeds} |",
                flush=True,
            )


def growth(largest):
    """Seconds and memory by samples: one effect in the spring."""
    print("\n| samples | processor / s | wall / s | peak memory / MB | named | coefficient (true 15) |")
    print("| --- | --- | --- | --- | --- | --- |")
    simulator, amplitude, _ = PLANTS["spring (2 states)"]
    from sksurrogate.effects import CATALOGUE

    truth = AugmentedSimulator(simulator, [CATALOGUE["cubic_stiffness"]("v", "q")], [{"coefficient": 15.0}])
    for n in (1_800, 6_000, 18_000, 60_000, 180_000, 1_000_000):
        if n > largest:
            break
        data = record(simulator, truth, amplitude, 6, n // 6, np.random.default_rng(0))
        report, cpu, wall = timed(simulator, *data)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        named = ", ".join(e.name for e in report.effects)
        value = report.effects[0].params.get("coefficient", np.nan) if report.effects else np.nan
        print(f"| {n:_} | {cpu:.1f} | {wall:.1f} | {memory:.0f} | {named} | {value:.3f} |", flush=True)


if __name__ == "__main__":
    kinds(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
    growth(float(sys.argv[2]) if len(sys.argv) > 2 else 1e6)
