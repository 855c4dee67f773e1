"""Do the intervals of free runs hold on unseen runs, within the excitation of the training runs and at 1.5 times of it?

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_coverage.py [--seeds 3]``. The plant of Eq. (9), 30 runs of 100 samples with
a noise of 0.05, 60 unseen runs of each kind: inputs and initial states from the same ranges, and from ranges 1.5 times as wide about
the same middle. Error bars count as intervals of ``y +- 1.645 std``. Printed: share of rows in the interval, and of runs that
lie in it as a whole, 90 % wanted.
"""

import argparse
import warnings

import numpy as np
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.compose import HybridRegressor, RecursivePredictor
from sksurrogate.datasets import linear_reactor, make_reactor_runs
from sksurrogate.model_selection import ConformalFreeRun

N_RUNS, N_NEW, N_SAMPLES, NOISE, WANTED, SIGMAS = 30, 60, 100, 0.05, 0.9, 1.645
INPUTS, STARTS = (0.1, 0.2), (4.0, 8.0)


def runs(count, wider, seed):
    """Runs whose ranges are ``wider`` times those of the training runs."""
    ranges = [tuple(np.mean(pair) + wider * (np.array(pair) - np.mean(pair))) for pair in (INPUTS, STARTS)]
    return make_reactor_runs(count, N_SAMPLES, u_range=ranges[0], y0_range=ranges[1], noise=NOISE, random_state=seed)


def net():
    return make_pipeline(
        StandardScaler(), MLPRegressor(hidden_layer_sizes=(4,), activation="tanh", solver="lbfgs", random_state=0)
    )


def predictor():
    return RecursivePredictor(net(), 5, 5, loss="shooting", random_state=0)


#: Name -> model; the conformal ones give intervals, the others standard deviations.
MODELS = {
    "surrogate, spread of five nets": lambda: HybridRegressor(None),
    "hybrid, output": lambda: HybridRegressor(linear_reactor()),
    "hybrid, dynamics": lambda: HybridRegressor(linear_reactor(), form="dynamics"),
    "network, shooting, evidence": predictor,
    "the same, conformal by row": lambda: ConformalFreeRun(predictor(), kind="row", random_state=0),
    "the same, conformal by run": lambda: ConformalFreeRun(predictor(), kind="run", random_state=0),
}


def interval(model, X, first, groups):
    """Low and high end, (n_samples,)."""
    if isinstance(model, ConformalFreeRun):
        return model.predict_interval(X, y0=first, groups=groups)
    mean, std = model.predict(X, y0=first, groups=groups, return_std=True)
    return mean - SIGMAS * std, mean + SIGMAS * std


def coverage(model, X, y, groups):
    """Share of rows and of runs in the interval, given rows left out, and the median width in units of the noise."""
    n = (model.estimator_ if isinstance(model, ConformalFreeRun) else model).n_initial_
    first = np.stack([y[groups == k][:n] for k in range(N_NEW)])[:, :, None]
    low, high = interval(model, X, first, groups)
    judged = np.tile(np.arange(N_SAMPLES) >= n, N_NEW)
    inside = (y >= low) & (y <= high)
    whole = np.mean([np.all(inside[judged & (groups == k)]) for k in range(N_NEW)])
    return np.mean(inside[judged]), whole, np.median((high - low)[judged]) / NOISE


def main():
    """Print one table, means over the seeds."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--models", nargs="+", default=list(MODELS))
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    print(
        "| model | rows within | runs within | width | rows, 1.5 times | runs, 1.5 times | width |\n|---|---|---|---|---|---|---|"
    )
    for name in options.models:
        found = []
        for seed in range(options.seeds):
            X, y, groups = runs(N_RUNS, 1.0, seed)
            model = MODELS[name]().fit(X, y, groups=groups)
            found.append([coverage(model, *runs(N_NEW, wider, 1000 + seed)) for wider in (1.0, 1.5)])
        mean = np.mean(found, axis=0)
        print(
            f"| {name} | {' | '.join(f'{100 * a:.0f} % | {100 * b:.0f} % | {w:.1f}' for a, b, w in mean)} |", flush=True
        )


if __name__ == "__main__":
    main()
