"""Diagnoses of plants that are unstable, recorded under a controller, and of a chaotic one: right names, times.

    python tests/benchmarks/bench_unstable.py --seeds 3
    python tests/benchmarks/bench_unstable.py levitation --seeds 1

Every plant has its own equations in the loop, integrated in steps twenty times shorter than a sample. The diagnosis gets the recorded
commands and readings, the simulator of the plant alone, and the whole catalogue.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

SUBSTEPS = 20


def in_the_loop(
    rng: np.random.Generator,
    plant: Callable[[np.ndarray, float], list[float]],
    start: Callable[[], np.ndarray],
    command: Callable[[np.ndarray, float], float],
    goals: tuple[float, float],
    dt: float,
    noise: np.ndarray,
    n_rows: int = 300,
    n_runs: int = 4,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Commands, readings of the first states and runs; the goal jumps every 30 to 80 rows."""
    U, Y, h = [], [], dt / SUBSTEPS
    for _ in range(n_runs):
        x, goal, until = np.array(start(), float), 0.0, 0
        for k in range(n_rows):
            if k >= until:
                goal, until = rng.uniform(*goals), k + int(rng.integers(30, 80))
            y = x[: len(noise)] + noise * rng.normal(size=len(noise))
            u = command(y, goal)
            U.append([u])
            Y.append(y)
            for _ in range(SUBSTEPS):
                slopes = [np.array(plant(x, u))]
                for share in (0.5, 0.5, 1.0):
                    slopes.append(np.array(plant(x + share * h * slopes[-1], u)))
                x = x + h / 6 * (slopes[0] + 2 * slopes[1] + 2 * slopes[2] + slopes[3])
    return np.array(U), np.array(Y), np.repeat(np.arange(n_runs), n_rows)


def levitation(rng: np.random.Generator) -> tuple[Any, ...]:
    """A ball under a magnet: the coil follows the command with a lag of 12 ms."""
    rest = float(np.sqrt(0.05 * 9.81 / 2e-3) * 0.05)

    def plant(x: np.ndarray, u: float) -> list[float]:
        return [x[1], 9.81 - 2e-3 * (x[2] / max(x[0], 1e-3)) ** 2 / 0.05, (u - x[2]) / 0.012]

    def rhs(t: Any, x: Any, u: Any, p: Any) -> Any:
        return [x[1], p["g"] - p["c"] * (u[0] / x[0]) ** 2 / p["m"]]

    data = in_the_loop(
        rng,
        plant,
        lambda: np.array([0.05, 0.0, rest]),
        lambda y, goal: float(np.clip(rest + 160 * (y[0] - 0.05 - goal) + 9 * y[1], 0.02, 3)),
        (-0.008, 0.008),
        0.005,
        np.array([5e-5, 1e-3]),
    )
    params = {"m": 0.05, "c": 2e-3, "g": 9.81}
    how: dict[str, Any] = {"states": ["gap", "speed"], "outputs": ["gap", "speed"], "params": params}
    return ODESimulator(rhs, inputs=["current"], dt=0.005, x0=[0.05, 0.0], **how), *data, {"input_lag"}


def balancing_robot(rng: np.random.Generator) -> tuple[Any, ...]:
    """A pendulum on a cart: dry friction of the wheels, 1.2 N."""

    def rates(x: Any, F: Any) -> list[Any]:
        _, th, v, w = x
        c, s = np.cos(th), np.sin(th)
        a = (F + 0.24 * w * w * s - 0.4 * 9.81 * s * c) / (1.0 + 0.4 * s**2)
        return [v, w, a, (9.81 * s - a * c) / 0.6]

    data = in_the_loop(
        rng,
        lambda x, u: rates(x, u - 0.3 * x[2] - 1.2 * np.tanh(x[2] / 0.02)),
        lambda: np.r_[0.1 * rng.normal(), 0.05 * rng.normal(), 0.0, 0.0],
        lambda y, goal: float(np.clip(3.0 * (y[0] - goal) + 38 * y[1] + 6 * y[2] + 9 * y[3], -20, 20)),
        (-0.5, 0.5),
        0.02,
        np.full(4, 0.003),
    )
    names = ["place", "angle", "speed", "rate"]
    simulator = ODESimulator(
        lambda t, x, u, p: rates(x, u[0] - p["b"] * x[2]),
        states=names,
        inputs=["force"],
        outputs=names,
        params={"b": 0.3},
        dt=0.02,
    )
    return simulator, *data, {"coulomb_friction", "stribeck_friction"}


def pitch(rng: np.random.Generator, gain: float) -> tuple[Any, ...]:
    """An airframe that is unstable in pitch, angle and rate measured; a rudder of another gain than 20."""
    data = in_the_loop(
        rng,
        lambda x, u: [x[1], 9.0 * np.sin(x[0]) - 0.4 * x[1] + gain * u],
        lambda: np.r_[0.1 * rng.normal(), 0.0],
        lambda y, goal: float(np.clip(-1.4 * (y[0] - goal) - 0.25 * y[1], -2, 2)),
        (-0.4, 0.4),
        0.02,
        np.full(2, 0.004),
    )
    simulator = ODESimulator(
        lambda t, x, u, p: [x[1], p["k"] * np.sin(x[0]) - p["d"] * x[1] + p["b"] * u[0]],
        states=["angle", "rate"],
        inputs=["rudder"],
        outputs=["angle", "rate"],
        params={"k": 9.0, "d": 0.4, "b": 20.0},
        dt=0.02,
    )
    return simulator, *data, {"input_gain", "parameter_error", "parameter_step", "linear_loss"}


def weak_rudder(rng: np.random.Generator) -> tuple[Any, ...]:
    """The rudder has three quarters of its gain."""
    return pitch(rng, 15.0)


def nothing_missing(rng: np.random.Generator) -> tuple[Any, ...]:
    """The same airframe as it is simulated: nothing may be named."""
    return *pitch(rng, 20.0)[:-1], set()


def chaos(rng: np.random.Generator) -> tuple[Any, ...]:
    """Lorenz's equations with a quadratic loss of z."""

    def rates(x: Any, u: Any, loss: float) -> list[Any]:
        a, b, c = x
        return [10.0 * (b - a) + u, a * (28.0 - c) - b, a * b - 8.0 / 3.0 * c - loss * c * c]

    data = in_the_loop(
        rng,
        lambda x, u: rates(x, u, 0.02),
        lambda: np.r_[5 * rng.normal(size=2), 20.0],
        lambda y, goal: goal,
        (-5.0, 5.0),
        0.02,
        np.full(3, 0.05),
    )
    simulator = ODESimulator(
        lambda t, x, u, p: rates(x, u[0], 0.0),
        states=["a", "b", "c"],
        inputs=["u"],
        outputs=["a", "b", "c"],
        params={},
        dt=0.02,
    )
    return simulator, *data, {"quadratic_loss", "quadratic_drag", "power_law"}


PLANTS = {f.__name__: f for f in (levitation, balancing_robot, weak_rudder, nothing_missing, chaos)}


def main() -> None:
    """Print a row for every plant and seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plants", nargs="*", default=list(PLANTS))
    parser.add_argument("--seeds", type=int, default=3)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| plant | seed | verdict | names | right | error before, after, noise | processor seconds |")
    print("|---|---|---|---|---|---|---|")
    for name in asked.plants:
        for seed in range(asked.seeds):
            simulator, U, Y, runs, accepted = PLANTS[name](np.random.default_rng([seed, len(name)]))
            begun = time.process_time()
            report = GapDiagnoser(simulator, random_state=0, n_jobs=1).fit(U, Y, groups=runs).report_
            spent = time.process_time() - begun
            names = [effect.name for effect in report.effects]
            right = report.verdict == "none" if not accepted else len(names) == 1 and names[0] in accepted
            said = f"{report.shrink.before:.3f}, {report.shrink.after:.3f}, {report.shrink.floor:.3f}"
            row = name, seed, report.verdict, ", ".join(names) or "-", "yes" if right else "no", said, f"{spent:.0f}"
            print("| " + " | ".join(map(str, row)) + " |", flush=True)


if __name__ == "__main__":
    main()
