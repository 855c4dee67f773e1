"""Networks against their peers: Bishop's four functions, and a lag model of 3 nodes on 1600 and on a million rows.

``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_networks.py [bishop] [small] [big]`` prints the
tables of docs/benchmarks/networks.md. Times are processor seconds: other jobs on the machine do not count.
"""

import sys
import time
import tracemalloc
import warnings

import numpy as np
from scipy.optimize import least_squares
from sklearn.neural_network import MLPRegressor

from sksurrogate.compose import RecursivePredictor
from sksurrogate.neural import FNNRegressor

x = np.linspace(-1, 1, 50)[:, None]
BISHOP = {
    "x^2": x[:, 0] ** 2,
    "abs x": np.abs(x[:, 0]),
    "sin 2 pi x": np.sin(2 * np.pi * x[:, 0]),
    "step": 2.0 * (x[:, 0] >= 0) - 1.0,
}


class ScipyNet:
    """One tanh layer by MINPACK's Levenberg-Marquardt with the analytic Jacobian; Glorot's start."""

    def __init__(self, n_hidden, evaluations, seed):
        self.h, self.evaluations, self.seed = n_hidden, evaluations, seed

    def parts(self, theta, d):
        h = self.h
        return theta[: d * h].reshape(d, h), theta[d * h : (d + 1) * h], theta[(d + 1) * h : -1], theta[-1]

    def fit(self, X, y):
        self.mean, self.scale, self.shift, self.gain = X.mean(0), X.std(0), y.mean(), y.std()
        X, y = (X - self.mean) / self.scale, (y - self.shift) / self.gain
        d, h = X.shape[1], self.h
        rng = np.random.default_rng(self.seed)

        def residual(theta):
            W, b, v, c = self.parts(theta, d)
            return np.tanh(X @ W + b) @ v + c - y

        def jacobian(theta):
            W, b, v, _ = self.parts(theta, d)
            a = np.tanh(X @ W + b)
            back = (1 - a * a) * v
            into = (X[:, :, None] * back[:, None, :]).reshape(len(X), -1)
            return np.hstack([into, back, a, np.ones((len(X), 1))])

        reach = [np.sqrt(6 / (d + h))] * (d * h + h) + [np.sqrt(6 / (h + 1))] * (h + 1)
        start = rng.uniform(-1, 1, len(reach)) * reach
        tight = 1e-15
        self.theta = least_squares(
            residual, start, jacobian, method="lm", max_nfev=self.evaluations, ftol=tight, xtol=tight, gtol=tight
        ).x
        return self

    def predict(self, X):
        W, b, v, c = self.parts(self.theta, X.shape[1])
        return (np.tanh((X - self.mean) / self.scale @ W + b) @ v + c) * self.gain + self.shift


class TorchAdam:
    """The paper's training: Adam (0.002, 0.99, 0.999), all rows, or mini-batches of ``rows``."""

    def __init__(self, n_hidden, steps, seed, rows=None):
        self.h, self.steps, self.seed, self.rows = n_hidden, steps, seed, rows

    def fit(self, X, y):
        import torch

        torch.manual_seed(self.seed)
        X, y = torch.tensor(X), torch.tensor(y)[:, None]
        self.net = torch.nn.Sequential(
            torch.nn.Linear(X.shape[1], self.h, dtype=X.dtype),
            torch.nn.Tanh(),
            torch.nn.Linear(self.h, 1, dtype=X.dtype),
        )
        optimizer = torch.optim.Adam(self.net.parameters(), lr=0.002, betas=(0.99, 0.999))
        for _ in range(self.steps):
            batch = slice(None) if self.rows is None else torch.randint(len(X), (self.rows,))
            optimizer.zero_grad()
            loss = ((self.net(X[batch]) - y[batch]) ** 2).mean()
            loss.backward()
            optimizer.step()
        return self

    def predict(self, X):
        import torch

        with torch.no_grad():
            return self.net(torch.tensor(X)).numpy()[:, 0]


def lbfgs(n_hidden, seed, steps=1000):
    return MLPRegressor(
        hidden_layer_sizes=(n_hidden,), activation="tanh", solver="lbfgs", alpha=0, max_iter=steps, tol=1e-10,
        max_fun=10**6, random_state=seed,
    )  # fmt: skip


def measure(make, X, y, tests, seeds):
    """Processor seconds of the fits and errors on (X, y) of ``tests``, one row a seed."""
    seconds, errors = [], []
    for seed in seeds:
        started = time.process_time()
        model = make(seed).fit(X, y)
        seconds.append(time.process_time() - started)
        errors.append([np.mean((model.predict(a) - b) ** 2) for a, b in tests])
    return np.array(seconds), np.array(errors)


def bishop():
    peers = {
        "FNNRegressor()": (lambda s: FNNRegressor(random_state=s), 10),
        "FNNRegressor(n_starts=10)": (lambda s: FNNRegressor(n_starts=10, random_state=s), 10),
        "MLPRegressor, lbfgs": (lambda s: lbfgs(5, s), 10),
        "MLPRegressor, lbfgs, as it comes": (
            lambda s: MLPRegressor(hidden_layer_sizes=(5,), activation="tanh", solver="lbfgs", random_state=s),
            10,
        ),
        "scipy lm, 200 evaluations": (lambda s: ScipyNet(5, 200, s), 10),
        "scipy lm, 1000 evaluations": (lambda s: ScipyNet(5, 1000, s), 10),
        "torch Adam, 3000 epochs": (lambda s: TorchAdam(5, 3000, s), 3),
    }
    print("| fit | " + " | ".join(f"{name}: ms, median, worst" for name in BISHOP) + " |")
    print("| --- |" + " --- |" * len(BISHOP))
    for name, (make, n_seeds) in peers.items():
        make(0).fit(x, x[:, 0])  # imports
        cells = []
        for y in BISHOP.values():
            seconds, errors = measure(make, x, y, [(x, y)], range(n_seeds))
            cells.append(f"{1e3 * np.median(seconds):.1f}, {np.median(errors):.0e}, {errors.max():.0e}")
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def reactor(n_runs, n_steps, seed):
    """Eq. (9) of the paper on input steps of 10 to 40 samples, starts of 0.5 to 15; dt = 0.02."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(10, 41, (n_runs, n_steps // 10 + 1))
    levels = rng.uniform(0.05, 0.25, lengths.shape)
    U = np.stack([np.repeat(u, n)[:n_steps] for u, n in zip(levels, lengths)])
    U[:, 1:-1] = (U[:, :-2] + U[:, 1:-1] + U[:, 2:]) / 3
    y = rng.uniform(0.5, 15, n_runs)
    Y = np.empty_like(U)
    h = 0.002

    def rate(y, k):
        return 2 * (4 - y) - 1e2 * k * y * y + 1e3 * k * y

    for t in range(n_steps):
        Y[:, t] = y
        k = np.exp(-1 / U[:, t])
        for _ in range(10):
            k1 = rate(y, k)
            k2 = rate(y + h / 2 * k1, k)
            k3 = rate(y + h / 2 * k2, k)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(y + h * k3, k))
    return U, Y


def lagged(U, Y, n_lags=5):
    """Rows (y[t-1..t-5], u[t..t-5]) -> y[t], within runs."""
    n = U.shape[1]
    past = [Y[:, n_lags - k : n - k].ravel() for k in range(1, n_lags + 1)]
    return np.stack([*past, *[U[:, n_lags - k : n - k].ravel() for k in range(n_lags + 1)]], axis=1), Y[
        :, n_lags:
    ].ravel()


class FromRecords:
    """The same fit from the runs themselves: no lag matrix is made."""

    def __init__(self, U, Y, seed):
        self.model = RecursivePredictor(FNNRegressor((3,), random_state=seed), 5, 5)
        self.record = U.reshape(-1, 1), Y.reshape(-1), np.repeat(np.arange(len(U)), U.shape[1])

    def fit(self, X, y):
        U, Y, groups = self.record
        self.model.fit(U, Y, groups=groups)
        return self.model.estimator_


def lag_model(big):
    U, Y = reactor(1000, 1005, 2) if big else reactor(8, 200, 0)
    at_u, at_y = (U.mean(), U.std()), (Y.mean(), Y.std())

    def rows(U, Y):
        return lagged((U - at_u[0]) / at_u[1], (Y - at_y[0]) / at_y[1])

    X, y = rows(U, Y)
    tests = [rows(*reactor(20, U.shape[1], 3)), rows(*reactor(20, 200, 4))]
    peers = {"FNNRegressor((3,))": (lambda s: FNNRegressor((3,), random_state=s), 5)}
    if big:
        own_units = (U - at_u[0]) / at_u[1], (Y - at_y[0]) / at_y[1]
        peers["RecursivePredictor(FNNRegressor((3,)), 5, 5), from the runs"] = (lambda s: FromRecords(*own_units, s), 5)
        peers["MLPRegressor, lbfgs, 300 iterations"] = (lambda s: lbfgs(3, s, 300), 1)
        peers["torch Adam, 3000 mini-batches of 1000"] = (lambda s: TorchAdam(3, 3000, s, 1000), 1)
    else:
        peers["MLPRegressor, lbfgs, 1000 iterations"] = (lambda s: lbfgs(3, s), 5)
        peers["scipy lm, 300 evaluations"] = (lambda s: ScipyNet(3, 300, s), 5)
        peers["torch Adam, 3000 epochs"] = (lambda s: TorchAdam(3, 3000, s), 2)
    print(f"| fit, {len(X)} rows | s | ratio | RMSE, fresh runs alike | RMSE, fresh runs of 200 |")
    print("| --- | --- | --- | --- | --- |")
    own = None
    for name, (make, n_seeds) in peers.items():
        make(0).fit(X[:100], y[:100])
        seconds, errors = measure(make, X, y, tests, range(n_seeds))
        rmse = np.sqrt(np.median(errors, axis=0))
        own = np.median(seconds) if own is None else own
        ratio = f"{np.median(seconds) / own:.1f}"
        print(f"| {name} | {np.median(seconds):.3g} | {ratio} | {rmse[0]:.4f} | {rmse[1]:.4f} |", flush=True)
    tracemalloc.start()
    FNNRegressor((3,), random_state=0).fit(X, y)
    peak = tracemalloc.get_traced_memory()[1] / 2**20
    print(f"\nPeak above the lag matrix ({X.nbytes / 2**20:.0f} MiB) in FNNRegressor.fit: {peak:.1f} MiB.")
    if big:
        own = FromRecords(*own_units, 0)
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        own.fit(None, None)
        print(
            f"Peak above the runs in RecursivePredictor.fit: {(tracemalloc.get_traced_memory()[1] - before) / 2**20:.1f} MiB."
        )


if __name__ == "__main__":
    wanted = sys.argv[1:] or ["bishop", "small", "big"]
    warnings.simplefilter("ignore")
    for name in wanted:
        print(f"\n{name}\n")
        bishop() if name == "bishop" else lag_model(name == "big")
