"""How fast is a lag matrix? LagEmbedding against writing the bytes, pandas and sliding_window_view; 1e6 rows, 2 channels.

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_lags.py``
"""

import time

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view

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


if __name__ == "__main__":
    main()
