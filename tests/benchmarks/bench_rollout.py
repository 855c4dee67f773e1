"""How fast is a free run? A 3-node, 5-lag network by RecursivePredictor, a loop of scikit-learn's predict, numpy, numba.

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_rollout.py``. numba is optional.
"""

import time

import numpy as np
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.compose import RecursivePredictor
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.kernels.rollout import free_run

LAGS = 5


def model():
    X, y, groups = make_reactor_runs(8, 200, random_state=0)
    net = MLPRegressor(hidden_layer_sizes=(3,), activation="tanh", solver="lbfgs", max_iter=2000, random_state=0)
    fitted = RecursivePredictor(make_pipeline(StandardScaler(), net), 5, 5, loss="shooting", random_state=0)
    return fitted.fit(X, y, groups=groups)


def sklearn_loop(estimator, U, first):
    """(n_runs, n_steps) by one predict a step for all runs."""
    y = np.empty(U.shape)
    y[:, :LAGS] = first
    for t in range(LAGS, U.shape[1]):
        phi = np.concatenate([y[:, t - LAGS : t][:, ::-1], U[:, t - LAGS : t + 1][:, ::-1]], axis=1)
        y[:, t] = estimator.predict(phi)
    return y


def arrays(fitted):
    """Weights with the scaling inside."""
    net = fitted._lag_net().net.folded()
    return (*(np.ascontiguousarray(w) for w in net.weights), *net.biases)


def numpy_loop(fitted, U, first):
    """The same with plain matrix products."""
    w0, w1, b0, b1 = arrays(fitted)
    y = np.empty(U.shape)
    y[:, :LAGS] = first
    for t in range(LAGS, U.shape[1]):
        phi = np.concatenate([y[:, t - LAGS : t][:, ::-1], U[:, t - LAGS : t + 1][:, ::-1]], axis=1)
        y[:, t] = (np.tanh(phi @ w0 + b0) @ w1 + b1)[:, 0]
    return y


def numba_loop(fitted):
    """The same as compiled loops, or None without numba."""
    try:
        from numba import njit
    except ImportError:
        return None
    w0, w1, b0, b1 = arrays(fitted)

    @njit(fastmath=True)
    def run(U, y, w0, w1, b0, b1):
        for r in range(U.shape[0]):
            for t in range(LAGS, U.shape[1]):
                out = b1[0]
                for i in range(w0.shape[1]):
                    z = b0[i]
                    for k in range(LAGS):
                        z += w0[k, i] * y[r, t - 1 - k]
                    for k in range(LAGS + 1):
                        z += w0[LAGS + k, i] * U[r, t - k]
                    out += w1[i, 0] * np.tanh(z)
                y[r, t] = out
        return y

    def call(U, first):
        y = np.empty(U.shape)
        y[:, :LAGS] = first
        return run(U, y, w0, w1, b0, b1)

    return call


def seconds(function, repeats):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        out = function()
        times.append(time.perf_counter() - start)
    return min(times), out


def row(name, U, first, fitted, compiled, share):
    """One line; the scikit-learn and numpy loops run over the first ``share`` of the steps only."""
    n_runs, n = U.shape
    few = int(n * share)
    X, groups = U.reshape(-1, 1), np.repeat(np.arange(n_runs), n)
    y0 = np.full((LAGS, 1), first)
    ours, y = seconds(lambda: fitted.predict(X, y0=y0, groups=groups), 9)
    lag_net, starts, V = fitted._lag_net(), np.full((n_runs, LAGS, 1), first), U[:, :, None]
    kernel, _ = seconds(lambda: free_run(lag_net, V, starts), 9)
    loop, check = seconds(lambda: sklearn_loop(fitted.estimator_, U[:, :few], first), 2)
    plain, _ = seconds(lambda: numpy_loop(fitted, U[:, :few], first), 2)
    assert np.abs(y.reshape(n_runs, n)[:, :few] - check).max() < 1e-8
    loop, plain = loop / share, plain / share
    numba = "-"
    if compiled:
        compiled(U, first)
        numba = f"{seconds(lambda: compiled(U, first), 5)[0] / kernel:.2f}"
    rate = n_runs * n / ours / 1e6
    print(
        f"| {name} | {1e3 * ours:.2f} | {1e3 * kernel:.2f} | {rate:.1f} | {loop / ours:.0f} | {loop / kernel:.0f} "
        f"| {plain / kernel:.1f} | {numba} |"
    )


def main():
    fitted, rng = model(), np.random.default_rng(0)
    compiled = numba_loop(fitted)
    print(
        "| runs x steps | predict, ms | kernel, ms | predict, Msteps/s | sklearn loop / predict | / kernel "
        "| numpy loop / kernel | numba / kernel |\n|---|---|---|---|---|---|---|---|"
    )
    for n_runs, n, share in ((1, 200, 1.0), (8, 200, 1.0), (1, 100_000, 0.05), (1000, 1000, 0.2)):
        U = np.repeat(rng.uniform(0.05, 0.25, (n_runs, -(-n // 20))), 20, axis=1)[:, :n].copy()
        row(f"{n_runs} x {n}", U, 5.0, fitted, compiled, share)


if __name__ == "__main__":
    main()
