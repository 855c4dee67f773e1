"""How fast is a lag matrix, and a linear model that does without? 1e6 rows, 2 channels; peers numpy, pandas, scikit-learn.

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_lags.py``
"""

import time

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import lfilter
from sklearn.linear_model import LinearRegression

from sksurrogate.compose import RecursivePredictor
from sksurrogate.features import LagEmbedding


def seconds(function, repeats=3):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        out = function()
        times.append(time.perf_counter() - start)
        del out
    return min(times)


def by_pandas(X, lags):
    frame = pd.DataFrame(X, columns=["a", "b"])
    return pd.concat([frame.shift(k) for k in range(lags)], axis=1)


def by_windows(X, lags):
    return np.ascontiguousarray(sliding_window_view(X, lags, axis=0).reshape(len(X) - lags + 1, -1))


def main():
    X, groups = np.random.default_rng(0).normal(size=(1_000_000, 2)), np.repeat(np.arange(1000), 1000)
    print("| lags | LagEmbedding, s | / writing the bytes | 1000 runs / writing | pandas / ours | windows / ours |")
    print("|---|---|---|---|---|---|")
    for lags in (5, 20, 50):
        embedding = LagEmbedding(list(range(lags))).fit(X)
        write = seconds(lambda lags=lags: np.full((len(X), 2 * lags), 1.0))
        ours = seconds(lambda embedding=embedding: embedding.transform(X))
        runs = seconds(lambda embedding=embedding: embedding.transform(X, groups=groups))
        pandas, windows = (seconds(lambda f=f, lags=lags: f(X, lags), 2) for f in (by_pandas, by_windows))
        print(
            f"| {lags} | {ours:.3f} | {ours / write:.2f} | {runs / write:.2f} | {pandas / ours:.1f} | {windows / ours:.1f} |"
        )
    print(
        "\n| linear model | RecursivePredictor.fit, s | its training free run, s | LinearRegression on the lag matrix / fit |"
    )
    print("|---|---|---|---|")
    rng = np.random.default_rng(0)
    u = rng.normal(size=1_000_000)
    y = lfilter([0, 1, 0.3], [1, -1.2, 0.5], u) + 0.1 * rng.normal(size=len(u))
    for lags in (5, 50):
        model = RecursivePredictor(LinearRegression(), lags, lags)
        ours = seconds(lambda model=model: model.fit(u[:, None], y))
        free = seconds(lambda model=model: model.predict(u[:200_000, None]))
        Phi, target = model.embed(u[:, None], y)
        peer = seconds(lambda Phi=Phi, target=target: LinearRegression().fit(Phi, target), 1)
        np.testing.assert_allclose(model.estimator_.coef_, LinearRegression().fit(Phi, target).coef_, atol=1e-8)
        print(f"| ARX({lags}, {lags}), 1e6 rows | {ours:.3f} | {free:.3f} | {peer / ours:.0f} |")


if __name__ == "__main__":
    main()
