"""What do missing readings, sensors at two rates and stamps that jitter cost the diagnosis?

Run: ``python tests/benchmarks/bench_records.py [--cases N] [--stamps N]``. Blind cases of the frozen list are diagnosed with all
readings, with 20 % of them missing, and with every other output read at every fifth sample; plants that are integrated from
stamp to stamp with even stamps and with stamps that jitter by a fifth of a sample. Each row is paired with the complete one.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from frozen_cases import ORDER, SEED

from sksurrogate.blind import PLANTS, draw
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

#: Quick plants, and the arms that are drawn in turn.
QUICK, ARMS = ORDER[:8], ("effect", "none", "time", "region", "effect")
#: Name of an effect -> change of the right-hand side of the oscillator, and of its input.
STAMPED = {
    "quadratic_drag": lambda q, v, u: -0.3 * v * abs(v),
    "cubic_stiffness": lambda q, v, u: -0.6 * q**3,
    "coulomb_friction": lambda q, v, u: -0.25 * np.tanh(v / 0.005),
    "constant_bias": lambda q, v, u: 0.2,
    "input_gain": lambda q, v, u: 0.2 * u,
    "none": lambda q, v, u: 0.0,
}


def missing(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One reading in five is lost."""
    return np.where(rng.random(y.shape) < 0.2, np.nan, y)


def two_rates(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Every other output is read at every fifth sample; a single one too."""
    out = y.copy()
    slow = np.arange(y.shape[1]) % 2 == 0
    out[np.ix_(np.arange(len(y)) % 5 != 0, slow)] = np.nan
    return out


VARIANTS: dict[str, Callable[[np.ndarray, np.random.Generator], np.ndarray]] = {
    "complete": lambda y, rng: y, "missing 20 %": missing, "rates 1:5": two_rates,
}  # fmt: skip


def is_right(report: Any, truths: list[tuple[str, str, str | None]]) -> bool:
    """Whether every true effect is named up to its class, and nothing else."""
    classes = [{(e.name, e.location, e.variable), *map(tuple, e.equivalents)} for e in report.effects]
    return all(any(t in c for c in classes) for t in truths) and all(any(t in c for t in truths) for c in classes)


def blind_cases(count: int) -> None:
    """Pairs of blind cases."""
    right = dict.fromkeys(VARIANTS, 0)
    for i in range(count):
        arm, plant = ARMS[i % len(ARMS)], QUICK[i % len(QUICK)]
        case = draw(arm, SEED + 1000 + i, plant=PLANTS[plant])
        said = []
        for name, spoil in VARIANTS.items():
            question, rng = case.question, np.random.default_rng(i)
            started = time.process_time()
            y = np.asarray(question.y, dtype=float)
            y = y.reshape(len(y), -1)
            diagnoser = GapDiagnoser(question.simulator, free_params=question.free_params, random_state=0, n_jobs=1)
            report = diagnoser.fit(question.X, spoil(y, rng), groups=question.groups).report_
            good = is_right(report, [(t.name, t.location, t.variable) for t in case.truths])
            right[name] += good
            named = ",".join(e.name for e in report.effects) or "-"
            said.append(
                f"{name}: {'right' if good else 'WRONG'} {report.verdict} {named} {time.process_time() - started:.1f} s"
            )
        truths = ",".join(t.name for t in case.truths) or "none"
        print(f"{arm}/{plant}/{i} [{truths}]  " + " | ".join(said), flush=True)
    print({name: f"{k} of {count}" for name, k in right.items()}, flush=True)


def stamped(effect: str, jitter: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, inputs held from stamp to stamp, readings."""
    rng, n = np.random.default_rng(seed), 400
    t = 0.1 * (np.arange(n) + jitter * rng.uniform(-1, 1, n))
    u = np.repeat(rng.uniform(-2, 2, n // 10), 10)
    x, y = np.zeros(2), np.zeros((n, 2))

    def rate(x: np.ndarray, u: float) -> np.ndarray:
        return np.array([x[1], u - 2.0 * x[0] - 0.3 * x[1] + STAMPED[effect](x[0], x[1], u)])

    for k in range(n - 1):
        h = (t[k + 1] - t[k]) / 30
        for _ in range(30):
            x = x + h * rate(x + h / 2 * rate(x, u[k]), u[k])
        y[k + 1] = x
    return t, u, y + 0.01 * rng.normal(size=y.shape)


def stamps(count: int) -> None:
    """Pairs of plants with even and with uneven stamps."""
    plant = ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["k"] * x[0] - p["c"] * x[1]), states=["q", "v"], inputs=["u"],
        outputs=["q", "v"], params={"k": 2.0, "c": 0.3}, dt=0.1,
    )  # fmt: skip
    right = {0.0: 0, 0.2: 0}
    for i in range(count):
        effect = list(STAMPED)[i % len(STAMPED)]
        for jitter in right:
            t, u, y = stamped(effect, jitter, i)
            report = GapDiagnoser(plant, time=1, random_state=0, n_jobs=1).fit(np.column_stack([u, t]), y).report_
            named = [e.name for e in report.effects]
            kin = {q[0] for e in report.effects for q in e.equivalents} | set(named)
            good = not named if effect == "none" else len(named) == 1 and effect in kin
            right[jitter] += good
            print(
                f"stamps {effect} jitter {jitter}: {'right' if good else 'WRONG'} {report.verdict} {named}", flush=True
            )
    print({f"jitter {jitter}": f"{k} of {count}" for jitter, k in right.items()}, flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=16)
    parser.add_argument("--stamps", type=int, default=6)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    blind_cases(given.cases)
    stamps(given.stamps)
