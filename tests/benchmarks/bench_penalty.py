"""Is a shooting fit with the penalty by evidence better than one step ahead, and than the best fixed penalty?

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_penalty.py [--sets N] [--first K] [--plants reactor spring tanks]``. 8 runs of
200 samples of each plant with white noise on the outputs, a network of 3 tanh nodes, 5 output lags, the current and 5 past inputs.
RMSE of free runs on 20 unseen runs of the plant without noise, begun at 5 noisy rows, over the spread of the outputs.
"""

import argparse
import time
import warnings

import numpy as np
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.compose import RecursivePredictor
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.physics import ODESimulator

LAGS, NODES, STEPS = 5, 3, 200
PENALTIES = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
#: Of the reactor's output, whose range is about 14; the other plants get the same shares of their ranges.
NOISES, REACTOR_RANGE = (0.0, 0.05, 0.2), 14.0


def spring(t, x, u, p):
    """A mass on a spring with viscous and (smoothed) dry friction."""
    q, v = x
    return v, u[0] - q - 0.3 * v - 0.2 * np.tanh(v / 0.05)


def tanks(t, x, u, p):
    """Two tanks in a row; the level of the lower one is measured."""
    upper, lower = np.sqrt(np.maximum(x[0], 0.0)), np.sqrt(np.maximum(x[1], 0.0))
    return 0.5 * u[0] - 0.5 * upper, 0.5 * upper - 0.4 * lower


PLANTS = {
    "spring": (ODESimulator(spring, states=["q", "v"], inputs=["f"], outputs=["q"], params={}, dt=0.25), (-1.0, 1.0)),
    "tanks": (ODESimulator(tanks, states=["h1", "h2"], inputs=["u"], outputs=["h2"], params={}, dt=0.5), (0.2, 1.5)),
}


def runs(name, n_runs, seed):
    """Inputs (n_runs, STEPS, 1) and outputs (n_runs, STEPS) without noise."""
    if name == "reactor":
        X, y, _ = make_reactor_runs(n_runs, STEPS, random_state=seed)
        return X.reshape(n_runs, STEPS, 1), y.reshape(n_runs, STEPS)
    plant, (low, high) = PLANTS[name]
    rng = np.random.default_rng(seed)
    U = np.repeat(rng.uniform(low, high, (n_runs, STEPS // 8, 1)), 8, axis=1)
    x0 = np.abs(rng.uniform(low, high, n_runs))[:, None] * ([1.0, 0.0] if name == "spring" else [1.0, 1.0])
    return U, np.stack([plant.simulate(u, x0=x)[:, 0] for u, x in zip(U, x0)])


def error(model, U, start, truth):
    """RMSE of free runs over the spread; inf where one diverges."""
    try:
        found = model.predict(
            U.reshape(-1, 1), y0=start[:, :LAGS, None], groups=np.repeat(np.arange(len(U)), STEPS)
        ).reshape(truth.shape)
    except ArithmeticError:
        return np.inf
    except ValueError:  # SimulationDiverged
        return np.inf
    return float(np.sqrt(np.mean((found - truth)[:, LAGS:] ** 2)) / truth.std())


def fits(U, Y, seed):
    """Name -> fitted model and its seconds."""
    net = MLPRegressor(hidden_layer_sizes=(NODES,), activation="tanh", solver="lbfgs", max_iter=2000, random_state=seed)
    given = (U.reshape(-1, 1), Y.ravel(), np.repeat(np.arange(len(U)), STEPS))
    ways = {"one step": {}, "evidence": {"loss": "shooting"}}
    ways |= {f"{alpha:g}": {"loss": "shooting", "alpha": alpha} for alpha in PENALTIES}
    out = {}
    for name, how in ways.items():
        model = RecursivePredictor(make_pipeline(StandardScaler(), net), LAGS, LAGS, random_state=seed, **how)
        started = time.process_time()
        try:
            out[name] = (model.fit(*given[:2], groups=given[2]), time.process_time() - started)
        except FloatingPointError:
            out[name] = (None, time.process_time() - started)
    return out


def main():
    """One line a data set, then ratios."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sets", type=int, default=4)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--plants", nargs="+", default=["reactor", *PLANTS])
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    names = ["one step", "evidence", *(f"{alpha:g}" for alpha in PENALTIES)]
    print("| plant | noise | data set | " + " | ".join(names) + " | s one step | s evidence |", flush=True)
    rows = []
    for name in options.plants:
        for share in NOISES:
            for k in range(options.first, options.first + options.sets):
                U, Y = runs(name, 8, 40_000 + k)
                Ut, Yt = runs(name, 20, 50_000 + k)
                rng = np.random.default_rng(60_000 + k)
                size = share * (1.0 if name == "reactor" else (Y.max() - Y.min()) / REACTOR_RANGE)
                found = fits(U, Y + size * rng.normal(size=Y.shape), k)
                start = Yt + size * rng.normal(size=Yt.shape)
                errors = [np.inf if m is None else error(m, Ut, start, Yt) for m, _ in found.values()]
                rows.append((name, share, *errors))
                seconds = [f"{found[way][1]:.1f}" for way in ("one step", "evidence")]
                print(f"| {name} | {share} | {k} | " + " | ".join([*(f"{e:.4f}" for e in errors), *seconds]) + " |", flush=True)  # fmt: skip
    table = np.array([row[2:] for row in rows], dtype=float)
    with np.errstate(invalid="ignore"):
        by_one_step, by_best = table[:, 1] / table[:, 0], table[:, 1] / table[:, 2:].min(axis=1)
    noisy = np.array([row[1] > 0 for row in rows])
    print(f"no worse than one step: {np.sum(by_one_step <= 1)} of {len(rows)}; median ratio with noise {np.median(by_one_step[noisy]):.3f}")  # fmt: skip
    print(f"beside the best of five penalties: median {np.median(by_best):.3f}, largest {by_best.max():.3f}")


if __name__ == "__main__":
    main()
