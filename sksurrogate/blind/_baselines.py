"""Simpler ways to the same question, answered in the same form, for the same table.

Each is a ``module:function`` for ``run_blind_check(diagnosis=...)``. On the cases of a check that was done, some of each arm,
resumable::

    python -m sksurrogate.blind._baselines rows.jsonl baselines.jsonl --first 10 --jobs 2
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from joblib import delayed
from scipy.optimize import least_squares
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel
from sklearn.preprocessing import StandardScaler

from sksurrogate._files import append_line
from sksurrogate._parallel._interrupts import workers
from sksurrogate.blind._cases import Question, draw
from sksurrogate.blind._score import score
from sksurrogate.blind._solve import Solver, predict
from sksurrogate.blind._table import stored_rows
from sksurrogate.exceptions import require

#: The functions of this module that answer questions.
BASELINES = ("retuning", "sparse_regression", "whiteness", "gaussian_process")


def retuning(question: Question) -> dict[str, Any]:
    """Re-tune all parameters of the simulator (free run, first rows as initial states) and name those that moved."""
    started = time.perf_counter(), time.process_time()
    simulator = question.simulator
    names = [name for name, value in simulator.params.items() if value]
    runs = _runs(question)
    starts = [_start(simulator, y) for _, y in runs]
    scale = question.y.std(axis=0)

    def residual(log_ratio: np.ndarray) -> np.ndarray:
        tuned = _with(simulator, names, log_ratio)
        return np.concatenate([((_free_run(tuned, U, x0) - y) / scale).ravel() for (U, y), x0 in zip(runs, starts)])

    fit = least_squares(residual, np.zeros(len(names)), bounds=(-1.5, 1.5), x_scale=0.1, max_nfev=15)
    before = float(np.sqrt(np.mean(residual(np.zeros(len(names))) ** 2)))
    after = float(np.sqrt(np.mean(fit.fun**2)))
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * np.mean(fit.fun**2)
    moved = [(n, v, np.sqrt(c)) for n, v, c in zip(names, fit.x, np.diag(covariance)) if abs(v) > 3 * np.sqrt(c) + 0.01]
    effects = [
        {"name": "parameter_error", "location": n, "variable": None, "params": {"relative_error": float(np.expm1(v))},
         "intervals": {"relative_error": [float(np.expm1(v - 1.645 * s)), float(np.expm1(v + 1.645 * s))]},
         "probability": None, "equivalents": []}
        for n, v, s in moved
    ]  # fmt: skip
    verdict = "none" if not moved else ("explained" if after < 0.5 * before else "unknown")
    where = {"location": max(moved, key=lambda m: abs(m[1]))[0] if moved else None}
    return _answer(verdict, effects, where, predict(_with(simulator, names, fit.x), question), started)


def whiteness(question: Question) -> dict[str, Any]:
    """Portmanteau and cross-correlation tests of the free-run error: is there a gap, and in which output or input?"""
    started = time.perf_counter(), time.process_time()
    errors = []
    for U, y in _runs(question):
        errors.append((y - _free_run(question.simulator, U, _start(question.simulator, y))) / question.y.std(axis=0))
    lags = 20
    statistic = np.zeros(question.y.shape[1])
    for error in errors:
        for j, e in enumerate((error - error.mean(axis=0)).T):
            r = np.array([np.sum(e[k:] * e[: len(e) - k]) for k in range(1, lags + 1)]) / (np.sum(e * e) + 1e-300)
            statistic[j] += len(e) * float(np.sum(r**2))
    degrees = lags * len(errors)
    suspicious = statistic > degrees + 4.0 * np.sqrt(2.0 * degrees)
    place = str(question.simulator.outputs[int(np.argmax(statistic))]) if suspicious.any() else None
    predicted = predict(question.simulator, question)
    return _answer("unknown" if suspicious.any() else "none", [], {"location": place}, predicted, started)


def sparse_regression(question: Question) -> dict[str, Any]:
    """Sparse regression (pysindy's STLSQ) of the residual of dx/dt on a polynomial library; measured states only."""
    started = time.perf_counter(), time.process_time()
    ps = require("pysindy", "bench")
    simulator = question.simulator
    states, inputs = list(simulator.states), list(simulator.inputs)
    if list(simulator.outputs) != states:
        raise ValueError("sparse regression needs every state measured")
    X, R = _derivative_gaps(question, ps)
    spread = X.std(axis=0) + 1e-12
    library = ps.PolynomialLibrary(degree=3, include_bias=True).fit(X[:, : len(states) + len(inputs)] / spread)
    features = np.asarray(library.transform(X / spread))
    labels = library.get_feature_names(states + inputs)
    effects, coefficients = [], np.zeros((len(states), features.shape[1]))
    for i, target in enumerate(R.T):
        size = target.std() + 1e-12
        if size < 1e-9:
            continue
        found = ps.STLSQ(threshold=0.1, alpha=1e-3).fit(features, target[:, None] / size).coef_[0] * size
        fitted = 1.0 - np.var(target - features @ found) / np.var(target)
        if fitted < 0.05:
            continue
        coefficients[i] = found
        effects += [_named(states[i], labels[k]) for k in np.flatnonzero(found)]
    place = effects[0]["location"] if effects else None
    predicted = predict(_Added(simulator, library, coefficients, spread), question)
    return _answer("explained" if effects else "none", effects, {"location": place}, predicted, started)


class _Added:
    """The simulator with a sparse polynomial in every balance."""

    def __init__(self, simulator: Any, library: Any, coefficients: np.ndarray, spread: np.ndarray):
        self.simulator, self.library, self.coefficients, self.spread = simulator, library, coefficients, spread

    def simulate(self, U: np.ndarray, x0: np.ndarray) -> np.ndarray:
        """Free run by Heun's method, four steps per sample."""
        x, h = np.array(x0, dtype=float), self.simulator.dt / 4
        rows = np.empty((len(U), len(x)))
        for k, u in enumerate(U):
            rows[k] = x
            for _ in range(4):
                a = self._rate(x, u)
                x = x + h / 2 * (a + self._rate(x + h * a, u))
        return rows

    def _rate(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """dx/dt."""
        nominal = np.array(self.simulator.rhs(0.0, x, u, self.simulator.params), dtype=float).ravel()
        features = np.asarray(self.library.transform((np.concatenate([x, u]) / self.spread)[None]))[0]
        return nominal + self.coefficients @ features


def _named(state: str, label: str) -> dict[str, Any]:
    """A monomial as an effect of the catalogue; other monomials keep their label."""
    parts = label.split()
    variable: str | None = parts[0].split("^")[0]
    if label == "1":
        name, variable, first = "constant_bias", None, "value"
    elif len(parts) == 2 and "^" not in label:
        name, variable, first = "bilinear", "*".join(sorted(parts)), "coefficient"
    elif len(parts) == 1:
        power = label.split("^")[1] if "^" in label else "1"
        name, first = {"1": "linear_loss", "2": "quadratic_loss", "3": "cubic_stiffness"}[power], "coefficient"
    else:
        name, variable, first = f"monomial {label}", None, "coefficient"
    return {
        "name": name, "location": state, "variable": variable, "params": {first: None}, "intervals": {}, "probability": None,
        "equivalents": [],
    }  # fmt: skip


def gaussian_process(question: Question) -> dict[str, Any]:
    """A Gaussian process from simulated outputs and inputs to the free-run error: a correction without a name."""
    started = time.perf_counter(), time.process_time()
    simulator, rng = question.simulator, np.random.default_rng(0)
    rows, errors = [], []
    for U, y in _runs(question):
        simulated = _free_run(simulator, U, _start(simulator, y))
        rows.append(_history(simulated, U))
        errors.append(y - simulated)
    Z, E = np.concatenate(rows), np.concatenate(errors)
    chosen = rng.permutation(len(Z))[:500]
    scaler = StandardScaler().fit(Z)
    kernel = RBF(np.full(Z.shape[1], 3.0)) + WhiteKernel(0.1)
    model = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0).fit(
        scaler.transform(Z[chosen]), E[chosen]
    )
    predicted = []
    for simulated, U in zip(predict(simulator, question), question.X_test):
        base = np.asarray(simulated)
        predicted.append(base + model.predict(scaler.transform(_history(base, U))).reshape(base.shape))
    return _answer("unknown", [], {"location": None}, [p.tolist() for p in predicted], started)


def _history(simulated: np.ndarray, U: np.ndarray) -> np.ndarray:
    """Simulated outputs and inputs, now and four samples ago."""
    late = np.concatenate([np.repeat(simulated[:1], 4, axis=0), simulated[:-4]])
    return np.hstack([simulated, late, U])


def _runs(question: Question) -> list[tuple[np.ndarray, np.ndarray]]:
    """Inputs and outputs of each run."""
    groups = question.groups
    return [(question.X[groups == r], question.y[groups == r]) for r in np.unique(groups)]


def _start(simulator: Any, y: np.ndarray) -> np.ndarray:
    """Initial state: measured states from the first row, the others as the simulator has them."""
    start = np.array(simulator.x0, dtype=float)
    for j, name in enumerate(simulator.outputs):
        if name in simulator.states:
            start[list(simulator.states).index(name)] = y[0, j]
    return start


def _with(simulator: Any, names: list[str], log_ratio: np.ndarray) -> Any:
    """The simulator with its parameters multiplied."""
    from sklearn.base import clone

    tuned = clone(simulator)
    return tuned.set_params(
        **{f"params__{n}": simulator.params[n] * float(np.exp(v)) for n, v in zip(names, log_ratio)}
    )


def _free_run(simulator: Any, U: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """Outputs; a large constant where the run diverges."""
    try:
        return np.asarray(simulator.simulate(U, x0=x0))
    except ValueError:
        return np.full((len(U), len(simulator.outputs)), 1e3)


def _derivative_gaps(question: Question, ps: Any) -> tuple[np.ndarray, np.ndarray]:
    """States and inputs, and what the simulator's derivative lacks there."""
    simulator = question.simulator
    signals, gaps = [], []
    differentiate = ps.SmoothedFiniteDifference()
    for U, y in _runs(question):
        slope = differentiate(y, simulator.dt * np.arange(len(y)))
        nominal = np.stack([np.broadcast_to(d, len(y)) for d in simulator.rhs(0.0, y.T, U.T, simulator.params)], axis=1)
        signals.append(np.hstack([y, U]))
        gaps.append(slope - nominal)
    return np.concatenate(signals), np.concatenate(gaps)


def _answer(
    verdict: str, effects: list[Any], where: dict[str, Any], predicted: Any, started: tuple[float, float]
) -> dict[str, Any]:
    """An answer in the common form."""
    return {
        "verdict": verdict, "effects": effects, "where": where, "predicted": predicted,
        "seconds": time.perf_counter() - started[0], "processor_seconds": time.process_time() - started[1],
    }  # fmt: skip


def run_baselines(rows: Any, out: Any, *, first: int = 10, limit: float = 120.0, n_jobs: int | None = None) -> int:
    """Ask the baselines the first cases of each arm of a check that was done.

    ``rows``: rows of the check (JSON lines).
    ``out``: rows of the baselines; those there count, new ones are appended.
    ``first``: cases of each arm.
    ``limit``: seconds for one answer.
    Returns number of new rows.
    """
    have = {(row["diagnosis"], row["arm"], row["seed"]) for row in stored_rows(out)}
    cases: dict[str, list[int]] = {}
    for row in stored_rows(rows):
        some = cases.setdefault(row["arm"], [])
        if row.get("right") is not None and len(some) < first:
            some.append(row["seed"])
    wanted = [(arm, seed) for arm, seeds in cases.items() for seed in seeds]
    todo = []
    for arm, seed in wanted:
        left = [name for name in BASELINES if (_path(name), arm, seed) not in have]
        if left:
            todo.append((arm, seed, left, limit))
    count = 0
    for found in workers(n_jobs, return_as="generator_unordered", batch_size=1)(delayed(_asked)(*t) for t in todo):
        for row in found:
            append_line(out, json.dumps(row, default=float))
        count += len(found)
    return count


def _path(name: str) -> str:
    """A baseline as ``module:function``."""
    return f"sksurrogate.blind._baselines:{name}"


def _asked(arm: str, seed: int, names: Sequence[str], limit: float) -> list[dict[str, Any]]:
    """Rows of some baselines on one case; the oracle is in the rows of the check."""
    case = draw(arm, seed)
    found = []
    for name in names:
        solver = _BASELINE_SOLVERS.setdefault(name, Solver(_path(name), limit))
        row = score(case, solver.ask(case.question), oracle=False)
        found.append({**row, "diagnosis": _path(name)})
    return found


#: Answering processes of a worker.
_BASELINE_SOLVERS: dict[str, Solver] = {}


def main(argv: Sequence[str] | None = None) -> int:
    """``python -m sksurrogate.blind._baselines``."""
    parser = argparse.ArgumentParser(description="the baselines on the cases of a check that was done")
    parser.add_argument("rows", help="rows of the check")
    parser.add_argument("out", help="rows of the baselines, appended to")
    parser.add_argument("--first", type=int, default=10, help="cases of each arm (default 10)")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds for one answer (default 120)")
    parser.add_argument("--jobs", type=int, default=None, help="cases at once")
    given = parser.parse_args(argv)
    count = run_baselines(given.rows, given.out, first=given.first, limit=given.limit, n_jobs=given.jobs)
    print(f"{count} new rows in {given.out}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
