"""Which black box runs freely on recorded data? Two tanks with overflow, the Silverbox, Wiener-Hammerstein, EMPS.

Run: ``OMP_NUM_THREADS=1 SKSURROGATE_DATA=FOLDER python tests/benchmarks/bench_recordings.py [tanks] [silverbox] [wiener] [emps]``. Every
model is fitted on the training record; of several the simplest is taken within one standard error of the one that runs best on
thirds left out of that record. The
tests are free runs on the other records from their first 50 rows, these left out.
"""

import os
import sys
import time
import warnings

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LinearRegression
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.compose import RecursivePredictor, StateSpaceRegressor
from sksurrogate.datasets import fetch_cascaded_tanks, fetch_silverbox
from sksurrogate.exceptions import SimulationDiverged
from sksurrogate.model_selection import scan_orders
from sksurrogate.neural import RecurrentRegressor
from sksurrogate.runs import cut_runs

warnings.simplefilter("ignore", ConvergenceWarning)
FIRST = 50


def tanks():
    """Training record, tests by name, unit and its size."""
    data = fetch_cascaded_tanks(os.environ.get("SKSURROGATE_DATA"))
    return data.uEst[:, None], data.yEst, {"test": (data.uVal[:, None], data.yVal)}, "V", 1.0


def silverbox():
    """8000 rows to train; the multisine, the arrow head, and its rows that stay within the range of training to test."""
    data = fetch_silverbox(os.environ.get("SKSURROGATE_DATA"))
    train, arrow = slice(data.train.start, data.train.start + 8000), data.test_arrow
    parts = {"multisine": data.test_multisine, "arrow": arrow, "arrow within": slice(arrow.start, arrow.start + 32000)}
    tests = {name: (data.V1[rows, None], data.V2[rows]) for name, rows in parts.items()}
    return data.V1[train, None], data.V2[train], tests, "mV", 1e3


def wiener():
    """Wiener-Hammerstein 2009: 16000 of the 100000 official training rows; the official test record."""
    data = np.load(os.path.join(os.environ["SKSURROGATE_DATA"], "wiener_hammerstein_2009", "wh2009.npz"))
    u, y = data["uBenchMark"].ravel(), data["yBenchMark"].ravel()
    train, test = slice(5200, 21200), slice(105200, 184000)
    return u[train, None], y[train], {"test": (u[test, None], y[test])}, "mV", 1e3


def emps():
    """A positioning axis: two pieces of one record to train, joined, and the two others to test; the position drifts freely."""
    path = os.path.join(os.environ["SKSURROGATE_DATA"], "emps", "emps.csv")
    run, _, u, y = np.genfromtxt(path, delimiter=",", skip_header=1).T
    pieces = [run == k for k in np.unique(run)]
    train = pieces[0] | pieces[1]
    tests = {f"piece {k + 1}": (u[pieces[k], None], y[pieces[k]]) for k in (2, 3)}
    return u[train, None], y[train], tests, "mm", 1e3


#: Sets; orders of the state-space models of the later two, from simple to rich, with the penalty by the evidence.
SETS = {"tanks": tanks, "silverbox": silverbox, "wiener": wiener, "emps": emps}
ORDERS = {"wiener": (5, 6), "emps": (2, 3)}


def by_evidence(u, y, orders):
    """Name -> list of candidates whose penalties are chosen by the evidence, in the defaults of the package."""
    scan = scan_orders(u, y, max_output_lags=8, max_input_lags=8)
    lags = scan.best_output_lags, scan.best_input_lags
    net = make_pipeline(
        StandardScaler(),
        MLPRegressor(hidden_layer_sizes=(8,), activation="tanh", solver="lbfgs", max_iter=1000, random_state=0),
    )
    linear = make_pipeline(StandardScaler(), LinearRegression())
    return {
        f"lags {lags[0]}, {lags[1]} from scan_orders, linear": [RecursivePredictor(linear, lags[1], lags[0])],
        "the same lags, 8 nodes, shooting": [
            RecursivePredictor(net, lags[1], lags[0], loss="shooting", random_state=0)
        ],
        "state space, linear": [StateSpaceRegressor(n, n_initial=FIRST) for n in orders],
        "state space, 8 nodes": [
            StateSpaceRegressor(n, hidden_layer_sizes=(8,), n_initial=FIRST, random_state=0) for n in orders
        ],
    }


def models(u, y):
    """Name -> list of candidates, from simple to rich."""
    scan = scan_orders(u, y, max_output_lags=6, max_input_lags=6)
    lags = scan.best_output_lags, scan.best_input_lags

    def net(seed, nodes=8, alpha=1e-3):
        mlp = MLPRegressor(
            hidden_layer_sizes=(nodes,),
            activation="tanh",
            solver="lbfgs",
            alpha=alpha,
            max_iter=1000,
            random_state=seed,
        )
        return make_pipeline(StandardScaler(), mlp)

    orders = [(2, False, 1e-3), (2, False, 1e-4), (2, True, 1e-4), (2, True, 1e-6), (3, False, 1e-3)]  # simple first
    return {
        f"lags {lags[0]}, {lags[1]} from scan_orders, linear": [
            RecursivePredictor(make_pipeline(StandardScaler(), LinearRegression()), lags[1], lags[0])
        ],
        "5 lags, 8 nodes, one step": [RecursivePredictor(net(s), 5, 5) for s in range(3)],
        "5 lags, 8 nodes, shooting": [
            RecursivePredictor(net(s), 5, 5, loss="shooting", random_state=s) for s in range(3)
        ],
        "state space, 2 states, linear": [StateSpaceRegressor(2, n_initial=FIRST)],
        "state space, 8 nodes": [
            StateSpaceRegressor(
                n, hidden_layer_sizes=(8,), feedthrough=direct, alpha=alpha, n_initial=FIRST, random_state=0
            )
            for n, direct, alpha in orders
        ],
        "GRU, 16 units": [RecurrentRegressor(n_initial=FIRST, max_epochs=300, batch_size=4, random_state=0)],
    }


def free_run_rmse(model, u, y):
    """From the first FIRST rows."""
    n = model.n_initial_
    try:
        free = model.predict(u[FIRST - n :], y0=y[FIRST - n : FIRST])
    except SimulationDiverged:
        return np.inf
    return float(np.sqrt(np.mean((free[n:] - y[FIRST:]) ** 2)))


def held_out(model, u, y, thirds):
    """Mean squared free-run errors on thirds of the record, each left out of a fit to the two others."""
    labels, squares = cut_runs(len(u), 3), []
    for k in thirds:
        rest = labels != k
        squares.append(free_run_rmse(model.fit(u[rest], y[rest], groups=labels[rest]), u[~rest], y[~rest]) ** 2)
    return np.array(squares)


def chosen(candidates, u, y, thirds):
    """The first, from simple to rich, within one standard error of the best on what was left out."""
    squares = np.array([held_out(model, u, y, thirds) for model in candidates])
    mean = squares.mean(axis=1)
    best = int(np.argmin(mean))
    spread = squares[best].std(ddof=1) / np.sqrt(len(thirds)) if len(thirds) > 1 else 0.0
    return candidates[int(np.flatnonzero(mean <= mean[best] + spread)[0])]


def main(names):
    for name in names:
        u, y, tests, unit, gain = SETS[name]()
        sets = {"train": (u, y), **tests}
        thirds = (0, 1, 2) if name == "tanks" else (2,)  # the longer record says enough with one
        print(f"\n{name}, RMSE in {unit}\n\n| model | s | {' | '.join(sets)} |\n|---|---|{'---|' * len(sets)}")
        candidates_of = by_evidence(u, y, ORDERS[name]) if name in ORDERS else models(u, y)
        for label, candidates in candidates_of.items():
            start = time.perf_counter()
            best = candidates[0]
            if len(candidates) > 1:
                best = chosen(candidates, u, y, thirds)
            best.fit(u, y)
            seconds = time.perf_counter() - start
            errors = [f"{gain * free_run_rmse(best, *pair):.3g}" for pair in sets.values()]
            print(f"| {label} | {seconds:.1f} | {' | '.join(errors)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or list(SETS))
