"""How do time and memory grow with states, rows, runs and outputs? One case a function, each in a fresh process of one thread.

    python tests/benchmarks/bench_growth.py [--cases NAME ...] [--groups states rows ...] [--limit SECONDS] [--roots BEFORE AFTER]

Processor seconds of the call that is measured (data and imports left out), and the largest resident memory of the process. A
case that needs more processor seconds than ``--limit`` is stopped. With ``--roots`` (folders of two checkouts) before and after
take turns. Below a group of cases stand the exponents: the slopes of log seconds and log memory over log size.
"""

from __future__ import annotations

import os

os.environ.update({"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"})

import argparse
import json
import resource
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve()
#: A call to measure, which answers with a word or a number.
Call = Callable[[], object]


def said(diagnoser: Any) -> str:
    """Verdict and names."""
    report = diagnoser.report_
    return f"{report.verdict}: {', '.join(f'{e.name}@{e.location}' for e in report.effects)}"


def asked(simulator: Any, X: np.ndarray, y: np.ndarray, groups: np.ndarray, **how: Any) -> Call:
    """A diagnosis with one worker."""
    from sksurrogate.gap import GapDiagnoser

    diagnoser = GapDiagnoser(simulator, random_state=0, n_jobs=1, **how)
    return lambda: said(diagnoser.fit(X, y, groups=groups))


def small(name: str) -> Call:
    """Two states, 6 x 300: a term of ``bench_speed``."""
    from bench_speed import data_of

    simulator, X, y, groups, _ = data_of(name)
    return asked(simulator, X, y, groups)


def chain(n: int, outputs: int, runs: int = 6, rows: int = 200) -> Call:
    """States in a row, a cubic loss in the middle."""
    from bench_speed import chain as plants

    rng = np.random.default_rng(0)
    simulator, plant = plants(n, outputs)
    U = np.repeat(rng.uniform(0, 2, (runs, rows // 10)), 10, axis=1)
    Y = np.concatenate([plant.simulate(u[:, None]) for u in U])
    Y = Y + 0.005 * rng.normal(size=Y.shape)
    return asked(simulator, U.reshape(-1, 1), Y, np.repeat(np.arange(runs), rows))


def springs(runs: int, rows: int) -> Call:
    """A spring that stiffens."""
    from bench_diagnosis import PLANTS, record

    from sksurrogate.effects import CATALOGUE, AugmentedSimulator

    simulator, amplitude, _ = PLANTS["spring (2 states)"]
    truth = AugmentedSimulator(simulator, [CATALOGUE["cubic_stiffness"]("v", "q")], [{"coefficient": 15.0}])
    return asked(simulator, *record(simulator, truth, amplitude, runs, rows, np.random.default_rng(0)))


def reactors(runs: int, rows: int = 20) -> Call:
    """A reactor whose sensor has an offset, asked for four effects."""
    from bench_load import reactor

    return lambda: reactor(0, runs, rows)


def rods(n: int, free: int) -> Call:
    """A rod one of whose cells loses more, or with free parameters, asked for four effects."""
    from bench_load import rod

    return lambda: rod(n, free)


def recording(name: str) -> Call:
    """A measured plant."""
    import recordings

    one = recordings.problem(name)
    return asked(one.simulator, one.X, one.y, one.groups, free_params=one.free)


def oscillator(runs: int, rows: int) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray]:
    """Simulator, inputs, outputs with 1 % noise, and runs of a spring that stiffens."""
    from bench_speed import oscillator as plants

    rng = np.random.default_rng(0)
    simulator, _ = plants("spring", 0.1)
    _, plant = plants("spring", 1.0)
    U = np.repeat(rng.uniform(-2, 2, (runs, rows // 10)), 10, axis=1)
    Y = np.stack([plant.simulate(u[:, None])[:, 0] for u in U])
    Y = Y + 0.01 * Y.std() * rng.normal(size=Y.shape)
    return simulator, U.reshape(-1, 1), Y.ravel(), np.repeat(np.arange(runs), rows)


def hybrid(runs: int, rows: int) -> Call:
    """The default hybrid."""
    from sksurrogate.compose import HybridRegressor

    simulator, X, y, groups = oscillator(runs, rows)
    return lambda: f"rmse {HybridRegressor(simulator).fit(X, y, groups=groups).free_run_rmse_:.4f}"


def derivative(rows: int) -> Call:
    """Polynomial features of a reactor in runs of 1000 rows."""
    from sklearn.linear_model import LinearRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures

    from sksurrogate.compose import DerivativeRegressor
    from sksurrogate.datasets import make_reactor_runs

    runs = max(rows // 1000, 1)
    X, y, groups = make_reactor_runs(runs, rows // runs, u_range=(0.1, 0.15), random_state=0)
    model = DerivativeRegressor(make_pipeline(PolynomialFeatures(3), LinearRegression()), dt=0.02)
    return lambda: f"rmse {model.fit(X, y, groups=groups).free_run_rmse_:.4f}"


def derivative_run(rows: int) -> Call:
    """Polynomial features of one long run."""
    from sklearn.linear_model import LinearRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures

    from sksurrogate.compose import DerivativeRegressor
    from sksurrogate.datasets import make_reactor_runs

    X, y, groups = make_reactor_runs(1, rows, u_range=(0.1, 0.15), random_state=0)
    model = DerivativeRegressor(make_pipeline(PolynomialFeatures(3), LinearRegression()), dt=0.02)
    return lambda: f"rmse {model.fit(X, y, groups=groups).free_run_rmse_:.4f}"


def one_run(missing: str) -> Call:
    """One simulator run of 100 000 rows."""
    from bench_speed import oscillator as plants

    _, plant = plants(missing, 1.0)
    U = np.repeat(np.random.default_rng(0).uniform(-1, 1, 5_000), 20)[:, None]
    return lambda: f"{plant.simulate(U)[-1, 0]:.9g}"


def augmented_run(rows: int) -> Call:
    """One run of a simulator whose named friction sticks now and then."""
    from sksurrogate.effects import CATALOGUE, AugmentedSimulator
    from sksurrogate.physics import ODESimulator

    cart = ODESimulator(
        lambda t, x, u, p: [x[1], u[0] - x[0] - 0.3 * x[1]],
        states=["x", "v"], inputs=["u"], outputs=["x"], params={}, dt=0.1,
    )  # fmt: skip
    named = AugmentedSimulator(cart, [CATALOGUE["coulomb_friction"]("v", "v")], [{"level": 0.3}])
    U = np.repeat(np.random.default_rng(0).uniform(-1, 1, rows // 20), 20)[:, None]
    return lambda: f"{named.simulate(U)[-1, 0]:.9g}"


def duffing() -> Call:
    """Five parameters of two states, 4 x 500."""
    from bench_calibration import TRUE, data, ours

    U, Y, X0 = data()
    return lambda: f"largest error {np.abs(ours(U, Y, X0, False) - list(TRUE.values())).max():.4f}"


def calibration(n: int, free: int) -> Call:
    """Parameters of a rod of n cells, 4 x 500."""
    from bench_load import Chain

    from sksurrogate.physics import CalibratedSimulator

    rng, plant = np.random.default_rng(0), Chain(n).simulator()
    names = ([f"k{i}" for i in range(n - 1)] + [f"h{i}" for i in range(n)])[:free]
    U = np.repeat(rng.uniform(0, 2, (4, 50)), 10, axis=1)
    Y = np.concatenate([plant.simulate(u[:, None]) for u in U])
    Y = Y + 0.01 * Y.std(axis=0) * rng.normal(size=Y.shape)
    off = Chain(n).simulator(**{name: plant.params[name] * rng.uniform(0.8, 1.25) for name in names})
    X, groups = U.reshape(-1, 1), np.repeat(np.arange(4), 500)
    model = CalibratedSimulator(off, params=names)

    def fitted() -> str:
        model.fit(X, Y, groups=groups)
        return f"largest error {max(abs(model.params_[k] / plant.params[k] - 1) for k in names):.3f}, {model.method_}"

    return fitted


def shooting(runs: int, rows: int) -> Call:
    """A network of three nodes and five lags through its free run."""
    import bench_shooting
    from bench_shooting import data, judged, ours

    bench_shooting.STEPS = rows
    U, Y, Ut, Yt = data(8200, runs)
    return lambda: f"objective {judged(ours(U, Y, 0.01, 0)[1], 0.01, U, Y, Ut, Yt)[0]:.4f}"


def lags(n: int) -> Call:
    """A lag matrix of 1e6 rows and 2 channels: the answer is its time over that of writing its bytes."""
    from bench_lags import by_turns

    from sksurrogate.features import LagEmbedding

    X = np.random.default_rng(0).normal(size=(1_000_000, 2))
    embedding = LagEmbedding(list(range(n))).fit(X)

    def ratio() -> str:
        both = {"writing": lambda: np.full((len(X), 2 * n), 1.0), "ours": lambda: embedding.transform(X)}
        taken = by_turns(both)
        return f"{np.median(taken['ours'] / taken['writing']):.2f} of writing"

    return ratio


def predict() -> Call:
    """A free run of 200 steps of a network: the answer is the time of ``predict`` and of its kernel."""
    from bench_rollout import LAGS, model, seconds

    from sksurrogate.kernels.rollout import free_run

    fitted = model()
    U = np.repeat(np.random.default_rng(0).uniform(0.05, 0.25, (1, 10)), 20, axis=1)
    y0, net, starts = np.full((LAGS, 1), 5.0), fitted._lag_net(), np.full((1, LAGS, 1), 5.0)

    def both() -> str:
        whole, _ = seconds(lambda: fitted.predict(U.reshape(-1, 1), y0=y0), 400)
        kernel, _ = seconds(lambda: free_run(net, U[:, :, None], starts), 400)
        return f"{1e3 * whole:.3f} ms, {1e3 * (whole - kernel):.3f} above the kernel"

    return both


#: Groups of cases: name -> size and what is measured.
GROUPS: dict[str, dict[str, tuple[int, Callable[[], Call]]]] = {
    "issue": {
        "friction": (0, lambda: small("friction")),
        "spring": (0, lambda: small("spring")),
        "unknown": (0, lambda: small("unknown")),
        "four": (0, lambda: chain(4, 4, 6, 300)),
        "four_10000": (0, lambda: chain(4, 4, 10, 1000)),
        "emps": (0, lambda: recording("emps")),
        "cascaded_tanks": (0, lambda: recording("cascaded_tanks")),
        "rod20": (0, lambda: rods(20, 0)),
        "rod16_30_parameters": (0, lambda: rods(16, 30)),
        "runs_5000": (0, lambda: springs(5000, 20)),
        "hybrid_100_runs": (0, lambda: hybrid(100, 1000)),
        "hybrid_one_run": (0, lambda: hybrid(1, 100_000)),
        "run_spring": (0, lambda: one_run("spring")),
        "run_friction": (0, lambda: one_run("friction")),
        "run_named_friction": (0, lambda: augmented_run(20_000)),
        "calibration_2": (0, duffing),
        "calibration_8": (0, lambda: calibration(8, 10)),
        "calibration_20": (0, lambda: calibration(20, 30)),
        "shooting": (0, lambda: shooting(100, 1000)),
        "lags_5": (0, lambda: lags(5)),
        "lags_50": (0, lambda: lags(50)),
        "predict": (0, predict),
    },
    "states": {f"chain{n}": (n, lambda n=n: chain(n, n // 2 + 1)) for n in (2, 4, 8, 12, 20)},
    "outputs": {f"outputs{n}": (n, lambda n=n: chain(4, n)) for n in (1, 2, 3, 4)},
    "rows": {f"rows{6 * n}": (6 * n, lambda n=n: springs(6, n)) for n in (300, 1000, 3000, 10_000, 30_000, 166_666)},
    "runs": {f"runs{n}": (n, lambda n=n: reactors(n)) for n in (10, 30, 100, 300, 1000)},
    "springs": {f"springs{n}": (n, lambda n=n: springs(n, 60)) for n in (10, 30, 100, 300)},
    "derivative": {f"derivative{n}": (n, lambda n=n: derivative(n)) for n in (10_000, 100_000, 1_000_000)},
    "derivative_run": {f"derivative_run{n}": (n, lambda n=n: derivative_run(n)) for n in (3_000, 10_000, 30_000)},
}  # fmt: skip
CASES = {name: case for group in GROUPS.values() for name, case in group.items()}


def here(name: str, limit: float) -> dict[str, Any]:
    """One case in this process."""
    warnings.simplefilter("ignore")
    call = CASES[name][1]()

    def late(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGPROF, late)
    started = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        answer = str(call())
    except TimeoutError:
        answer = "not finished"
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"seconds": time.process_time() - started, "MiB": peak, "answer": answer}


def measured(root: Path, name: str, limit: float) -> dict[str, Any]:
    """One case in a fresh process of a checkout; the scripts are those beside this one."""
    command = [sys.executable, str(HERE), "--here", name, "--limit", str(limit)]
    environment = {**os.environ, "PYTHONPATH": f"{root}{os.pathsep}{HERE.parent}"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no words"])[-1]
        return {"seconds": np.nan, "MiB": np.nan, "answer": f"ended with {done.returncode}: {last}"}
    return json.loads(done.stdout.splitlines()[-1])


def exponents(sizes: list[int], rows: list[dict[str, Any]]) -> str:
    """Slopes of log seconds and log memory over log size, of the cases that came to an end."""
    kept = [
        (n, row) for n, row in zip(sizes, rows) if n and np.isfinite(row["seconds"]) and row["answer"] != "not finished"
    ]
    if len(kept) < 2:
        return ""
    size = np.log([n for n, _ in kept])
    slopes = [np.polyfit(size, np.log([row[key] for _, row in kept]), 1)[0] for key in ("seconds", "MiB")]
    return f"seconds ~ size^{slopes[0]:.2f}, memory ~ size^{slopes[1]:.2f}"


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=[])
    parser.add_argument("--groups", nargs="+", choices=list(GROUPS), default=[])
    parser.add_argument("--roots", nargs="+", type=Path, default=[HERE.parents[2]])
    parser.add_argument("--limit", type=float, default=90.0, help="processor seconds of a case")
    parser.add_argument("--here", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.here:
        print(json.dumps(here(given.here, given.limit)))
        return
    chosen = given.groups or ([] if given.cases else list(GROUPS))
    asked_for = ([("", {name: CASES[name] for name in given.cases})] if given.cases else []) + [
        (group, GROUPS[group]) for group in chosen
    ]
    print("| case | processor s | peak MiB | answer |\n|---|---|---|---|", flush=True)
    for group, cases in asked_for:
        found: list[list[dict[str, Any]]] = [[] for _ in given.roots]
        for name in cases:
            for root, rows in zip(given.roots, found):
                rows.append(measured(root, name, given.limit))
            seconds, peaks = (" -> ".join(f"{rows[-1][key]:.3g}" for rows in found) for key in ("seconds", "MiB"))
            answers = " -> ".join(dict.fromkeys(rows[-1]["answer"] for rows in found))
            print(f"| {name} | {seconds} | {peaks} | {answers} |", flush=True)
        for rows in found:
            line = exponents([n for n, _ in cases.values()], rows)
            if line:
                print(f"{group}: {line}", flush=True)


if __name__ == "__main__":
    main()
