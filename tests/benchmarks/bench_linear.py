"""Linear fits on a million rows: processor seconds, memory above the inputs and error, each fit in a process of its own.

``OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_linear.py [rows]`` prints the tables of docs/benchmarks/linear.md.
"""

import json
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np


def spline_data(n):
    """Four inputs; a smooth additive truth."""
    rng = np.random.default_rng(0)
    X = rng.uniform(size=(n, 4))
    truth = np.sin(6 * X[:, 0]) + X[:, 1] ** 2 + np.exp(-X[:, 2]) * np.cos(3 * X[:, 2]) + np.abs(X[:, 3] - 0.5)
    return X, truth + 0.3 * rng.normal(size=n), truth


def arx_data(n):
    """y[t] = 1.5 y[t-1] - 0.7 y[t-2] + u[t-1] + noise."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(0)
    u = rng.normal(size=n)
    y = lfilter([0, 1.0], [1, -1.5, 0.7], u) + lfilter([0.1], [1, -1.5, 0.7], rng.normal(size=n))
    return np.c_[u, y], y, None


def sklearn_ridge(X, y):
    from sklearn.linear_model import Ridge
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import SplineTransformer

    return make_pipeline(SplineTransformer(20, degree=3, sparse_output=True), Ridge(1.0)).fit(X, y).predict


def our_ridge(X, y):
    from sksurrogate.features import SplineFeatures
    from sksurrogate.linear import PenalizedRegressor, Ridge

    return PenalizedRegressor([Ridge()], features=SplineFeatures(20, 3, sparse_output=True)).fit(X, y).predict


def our_gcv(X, y):
    from sksurrogate.features import SplineFeatures
    from sksurrogate.linear import Curvature, PenalizedRegressor, Ridge

    splines = SplineFeatures(20, 3, sparse_output=True)
    penalties = [Ridge(1e-6), Curvature()]
    return PenalizedRegressor(penalties, alpha="gcv", features=splines).fit(X, y).predict


def sklearn_slash(X, y):
    from sklearn.linear_model import LinearRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import SplineTransformer

    return make_pipeline(SplineTransformer(20, degree=3, sparse_output=True), LinearRegression()).fit(X, y).predict


def our_slash(X, y):
    from sksurrogate.features import SplineFeatures
    from sksurrogate.linear import PenalizedRegressor

    return PenalizedRegressor(features=SplineFeatures(20, 3, sparse_output=True)).fit(X, y).predict


def sklearn_pcr(X, y):
    from sklearn.decomposition import PCA
    from sklearn.linear_model import LinearRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import SplineTransformer, StandardScaler

    model = make_pipeline(
        SplineTransformer(20, degree=3), StandardScaler(), PCA(60, random_state=0), LinearRegression()
    )
    return model.fit(X, y).predict


def our_pcr(X, y):
    from sksurrogate.features import SplineFeatures
    from sksurrogate.linear import PCRRegressor

    return PCRRegressor(60, scale=True, features=SplineFeatures(20, 3, sparse_output=True)).fit(X, y).predict


def sklearn_pls(X, y):
    from sklearn.cross_decomposition import PLSRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import SplineTransformer

    return make_pipeline(SplineTransformer(20, degree=3), PLSRegression(10)).fit(X, y).predict


def sklearn_arx(Z, y):
    from sklearn.linear_model import LinearRegression

    # the lag matrix by contiguous column copies: the quickest of the ways measured
    rows = len(Z) - 50
    lags = np.empty((rows, 101), order="F")
    for k in range(51):
        lags[:, k] = Z[50 - k : len(Z) - k, 0]
    for k in range(1, 51):
        lags[:, 50 + k] = Z[50 - k : len(Z) - k, 1]
    return LinearRegression().fit(lags, y[50:])


def our_arx(Z, y):
    from sksurrogate.linear import LaggedLinearRegressor

    return LaggedLinearRegressor({0: range(51), 1: range(1, 51)}).fit(Z, y)


SPLINE = {
    "scikit-learn: SplineTransformer (sparse) + Ridge": sklearn_ridge,
    "PenalizedRegressor([Ridge()], features=SplineFeatures)": our_ridge,
    'the same, Ridge + Curvature, alpha="gcv"': our_gcv,
    "scikit-learn: SplineTransformer (sparse) + LinearRegression": sklearn_slash,
    "PenalizedRegressor(features=SplineFeatures) (null space: QR)": our_slash,
    "scikit-learn: SplineTransformer + StandardScaler + PCA(60) + LinearRegression": sklearn_pcr,
    "PCRRegressor(60, scale=True, features=SplineFeatures)": our_pcr,
    "scikit-learn: SplineTransformer + PLSRegression(10)": sklearn_pls,
}
ARX = {"scikit-learn: lag matrix + LinearRegression": sklearn_arx, "LaggedLinearRegressor": our_arx}


def memory(key):
    """A line of /proc/self/status in MiB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(key))


def child(name, n):
    """One fit: seconds, peak above the inputs, error to the truth."""
    fit = {**SPLINE, **ARX}[name]
    data = arx_data if name in ARX else spline_data
    fit(*data(2000)[:2])  # imports and first calls
    X, y, truth = data(n)
    Path("/proc/self/clear_refs").write_text("5")
    before = memory("VmRSS")
    started = time.process_time()
    model = fit(X, y)
    seconds = time.process_time() - started
    peak = memory("VmHWM") - before
    if truth is None:
        error = float(np.abs(model.coef_[[1, 51, 52]] - [1.0, 1.5, -0.7]).max())
    else:
        error = float(np.sqrt(np.mean((model(X[:20000]) - truth[:20000]) ** 2)))
    print(json.dumps([seconds, peak, error]))


def table(fits, n, repeats=3):
    """Medians of interleaved runs."""
    results = {name: [] for name in fits}
    for _ in range(repeats):
        for name in fits:
            out = subprocess.run([sys.executable, __file__, "--child", name, str(n)], capture_output=True, text=True)
            if out.returncode:
                sys.exit(out.stderr)
            results[name].append(json.loads(out.stdout))
    print("| fit | processor s | MiB above the inputs | error | time ratio |\n| --- | --- | --- | --- | --- |")
    reference = 1.0
    for name, values in results.items():
        seconds, peak, error = (statistics.median(column) for column in zip(*values))
        reference = seconds if name.startswith("scikit") else reference
        print(f"| {name} | {seconds:.2f} | {peak:.0f} | {error:.4f} | {seconds / reference:.3f} |", flush=True)


def main():
    """Both tables."""
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    print(f"Cubic splines, 4 inputs, 20 knots (88 features), {n} rows; error: RMSE to the truth\n")
    table(SPLINE, n)
    print(f"\nARX with 50 lags of u and y, {n} rows; error: largest of the three coefficients\n")
    table(ARX, n)


if __name__ == "__main__":
    if "--child" in sys.argv:
        child(sys.argv[2], int(sys.argv[3]))
    else:
        main()
