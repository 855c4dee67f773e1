"""How fast is a lag matrix, and a linear model that does without? 1e6 rows, 2 channels; peers numpy, pandas, scikit-learn.

Medians of the ratios of a round, processor time. Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_lags.py``
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


def by_turns(functions, rounds=9):
    """Processor seconds, each in its turn, round by round."""
    taken = {name: [] for name in functions}
    for _ in range(rounds):
        for name, function in functions.items():
            start = time.process_time()
            out = function()
            taken[name].append(time.process_time() - start)
            del out
    return {name: np.array(values) for name, values in taken.items()}


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
        taken = by_turns(
            {
                "writing": lambda lags=lags: np.full((len(X), 2 * lags), 1.0),
                "ours": lambda embedding=embedding: embedding.transform(X),
                "runs": lambda embedding=embedding: embedding.transform(X, groups=groups),
                "pandas": lambda lags=lags: by_pandas(X, lags),
                "windows": lambda lags=lags: by_windows(X, lags),
            }
        )
        ratios = [np.median(taken[a] / taken[b]) for a, b in (("ours", "writing"), ("runs", "writing"))]
        ratios += [np.median(taken[a] / taken["ours"]) for a in ("pandas", "windows")]
        print(f"| {lags} | {np.median(taken['ours']):.3f} | " + " | ".join(f"{ratio:.2f}" for ratio in ratios) + " |")
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
