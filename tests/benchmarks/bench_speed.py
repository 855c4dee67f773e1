"""Where does a diagnosis, or a long free run, take its time? Processor seconds, calls of the right-hand side and peak memory.

Run: ``python tests/benchmarks/bench_speed.py [CASE ...] [--roots BEFORE AFTER] [--repeat N]``. Every case runs in a process of
its own, one thread; with ``--roots`` (folders of two checkouts) before and after take turns, and the medians stand side by side.
Cases: ``run_spring``, ``run_friction`` (one run of 100 000 samples), ``spring``, ``friction``, ``unknown`` (two states, 6 x 300),
``chain4``, ``chain8``, ``chain12`` (states in a row), ``long4`` (four states, 10 000 samples), and the names of the recordings
(below ``SKSURROGATE_DATA``).
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import json
import resource
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve()
#: What is measured where nothing is asked for.
DEFAULT = ("run_spring", "run_friction", "spring", "friction", "unknown", "chain4", "chain8")
CALLS = [0]


def counted(function: Any) -> Any:
    """A right-hand side that counts its calls."""

    def rhs(t: Any, x: Any, u: Any, p: Any) -> Any:
        CALLS[0] += 1
        return function(t, x, u, p)

    return rhs


MISSING = {
    "spring": lambda x: -0.5 * x[0] ** 3,
    "friction": lambda x: -0.3 * np.tanh(x[1] / 1e-3),
    "unknown": lambda x: -0.6 * np.sin(3 * x[0]) * np.cos(2 * x[1]),
}


def oscillator(missing: str, dt: float) -> tuple[Any, Any]:
    """A simulator of two states, and the plant with a term more, in steps ten times shorter."""
    from sksurrogate.physics import ODESimulator

    def rhs(t: Any, x: Any, u: Any, p: Any) -> Any:
        return [x[1], u[0] - p["k"] * x[0] - p["c"] * x[1]]

    def plant(t: Any, x: Any, u: Any, p: Any) -> Any:
        return [x[1], u[0] - p["k"] * x[0] - p["c"] * x[1] + MISSING[missing](x)]

    how: dict[str, Any] = {"states": ["x", "v"], "inputs": ["u"], "outputs": ["x"], "params": {"k": 1.0, "c": 0.3}}
    return ODESimulator(counted(rhs), dt=dt, **how), ODESimulator(counted(plant), dt=dt / 10, **how)


def chain(n: int, outputs: int) -> tuple[Any, Any]:
    """States in a row, each driven by the one before; the plant has a cubic loss in the middle."""
    from sksurrogate.physics import ODESimulator

    def rhs(t: Any, x: Any, u: Any, p: Any) -> Any:
        return [(u[0] if i == 0 else p["k"] * x[i - 1]) - p["k"] * x[i] for i in range(n)]

    def plant(t: Any, x: Any, u: Any, p: Any) -> Any:
        out = rhs(t, x, u, p)
        out[n // 2] = out[n // 2] - 0.4 * x[n // 2] ** 3
        return out

    names = [f"x{i}" for i in range(n)]
    seen = [names[i] for i in np.unique(np.linspace(0, n - 1, outputs).round().astype(int))]
    how: dict[str, Any] = {"states": names, "inputs": ["u"], "outputs": seen, "params": {"k": 1.0}, "dt": 0.1}
    return ODESimulator(counted(rhs), **how), ODESimulator(counted(plant), **how)


def data_of(case: str) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, Any]:
    """Simulator, inputs, outputs, runs and free parameters of a case."""
    rng = np.random.default_rng(0)
    if case in MISSING:
        simulator, plant = oscillator(case, 0.1)
        U = np.repeat(rng.uniform(-2, 2, (6, 30)), 10, axis=1)
        Y = np.concatenate([plant.simulate(np.repeat(u, 10)[:, None])[::10] for u in U])
    elif case.startswith(("chain", "long")):
        n = int(case.removeprefix("chain").removeprefix("long"))
        rows, runs = (200, 6) if case.startswith("chain") else (1000, 10)
        simulator, plant = chain(n, n if case.startswith("long") else n // 2 + 1)
        U = np.repeat(rng.uniform(0, 2, (runs, rows // 10)), 10, axis=1)
        Y = np.concatenate([plant.simulate(u[:, None]) for u in U])
    else:
        import recordings

        one = recordings.problem(case)
        return one.simulator, one.X, one.y, one.groups, one.free
    Y = Y + 0.005 * rng.normal(size=Y.shape)
    return simulator, U.reshape(-1, 1), Y, np.repeat(np.arange(len(U)), U.shape[1]), ()


def ask(case: str) -> dict[str, Any]:
    """One case in this process."""
    warnings.simplefilter("ignore")
    if case.startswith("run_"):
        _, plant = oscillator(case.removeprefix("run_"), 1.0)
        U = np.repeat(np.random.default_rng(0).uniform(-1, 1, 5_000), 20)[:, None]
        CALLS[0], started = 0, time.process_time()
        answer = f"{plant.simulate(U)[-1, 0]:.9g}"
    else:
        from sksurrogate.gap import GapDiagnoser

        simulator, X, y, groups, free = data_of(case)
        CALLS[0], started = 0, time.process_time()
        report = GapDiagnoser(simulator, free_params=free, n_jobs=1, random_state=0).fit(X, y, groups=groups).report_
        answer = f"{report.verdict}: {', '.join(e.name for e in report.effects)}"
    seconds = time.process_time() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return {"seconds": seconds, "calls": CALLS[0], "peak": peak, "answer": answer}


def measured(root: Path, case: str) -> dict[str, Any]:
    """One case in a fresh process of a checkout."""
    command = [sys.executable, str(HERE), "--child", case]
    environment = {**os.environ, "PYTHONPATH": f"{root}{os.pathsep}{HERE.parent}"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=DEFAULT)
    parser.add_argument("--roots", nargs="+", type=Path, default=[HERE.parents[2]])
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--child", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        print(json.dumps(ask(given.child)))
        return
    print("| case | processor s | calls | peak MB | answer |\n|---|---|---|---|---|", flush=True)
    for case in given.cases:
        found: list[list[dict[str, Any]]] = [[] for _ in given.roots]
        for _ in range(given.repeat):
            for root, rows in zip(given.roots, found):
                rows.append(measured(root, case))
        columns = (
            " -> ".join(f"{np.median([r[key] for r in rows]):.4g}" for rows in found)
            for key in ("seconds", "calls", "peak")
        )
        answers = " -> ".join(dict.fromkeys(rows[0]["answer"] for rows in found))
        print(f"| {case} | {' | '.join(columns)} | {answers} |", flush=True)


if __name__ == "__main__":
    main()
