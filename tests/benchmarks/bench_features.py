"""Spline features and lags: time and peak memory against scikit-learn, scipy and pandas.

Run: ``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_features.py [0 1 3 lags5 lags50]``: splines of
these degrees and lag matrices of so many lags. It prints the tables of docs/benchmarks/features.md.
"""

import json
import platform
import resource
import statistics
import subprocess
import sys
import time
import tracemalloc

import numpy as np
import scipy
import sklearn

N_ROWS = 1_000_000
N_KNOTS = 20
REPEATS = 3
SPLINES = ("ours, sparse", "ours, dense", "scikit-learn, sparse", "scikit-learn, dense", "scipy design_matrix, sparse")
LAGS = ("ours", "numpy windows, copied", "pandas shift + concat", "writing the numbers alone")


def inputs(topic: str) -> np.ndarray:
    """Four inputs for splines, two for lags."""
    return np.random.default_rng(0).uniform(size=(N_ROWS, 2 if topic.startswith("lags") else 4))


def peers(topic: str) -> list[str]:
    """Who takes part."""
    return list(LAGS if topic.startswith("lags") else SPLINES)


def splines(peer: str, degree: int, X: np.ndarray):
    """The spline basis that a peer makes of X."""
    sparse = peer.endswith("sparse")
    if peer.startswith("ours"):
        from sksurrogate.features import SplineFeatures

        return SplineFeatures(N_KNOTS, degree, sparse_output=sparse).fit_transform(X)
    if peer.startswith("scikit-learn"):
        from sklearn.preprocessing import SplineTransformer

        return SplineTransformer(N_KNOTS, degree=degree, sparse_output=sparse).fit_transform(X)
    from scipy.interpolate import BSpline
    from scipy.sparse import hstack

    blocks = []
    for x in X.T:
        breaks = np.linspace(x.min(), x.max(), N_KNOTS)
        outer = (breaks[1] - breaks[0]) * np.arange(1, degree + 1)
        knots = np.r_[breaks[0] - outer[::-1], breaks, breaks[-1] + outer]
        blocks.append(BSpline.design_matrix(x, knots, degree))
    return hstack(blocks, format="csr")


def lags(peer: str, n_lags: int, X: np.ndarray):
    """The matrix of lags 0..n_lags of both columns that a peer makes of X."""
    if peer == "ours":
        from sksurrogate.features import LagEmbedding

        return LagEmbedding(n_lags).fit_transform(X)
    if peer.startswith("numpy"):
        windows = np.lib.stride_tricks.sliding_window_view(X, n_lags + 1, axis=0)
        return windows.copy().reshape(len(windows), -1)
    if peer.startswith("pandas"):
        import pandas as pd

        frame = pd.DataFrame(X)
        return pd.concat([frame.shift(k) for k in range(n_lags + 1)], axis=1)
    return np.ones((len(X), 2 * (n_lags + 1)))


def work(peer: str, topic: str, X: np.ndarray):
    """One job."""
    return lags(peer, int(topic[4:]), X) if topic.startswith("lags") else splines(peer, int(topic), X)


def peak(peer: str, topic: str) -> dict[str, float]:
    """Peak MiB above the inputs: what Python and numpy asked for, and what the process held."""
    X = inputs(topic)
    work(peer, topic, X[:1000])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    work(peer, topic, X)
    resident = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    tracemalloc.start()
    work(peer, topic, X)
    return {"traced": tracemalloc.get_traced_memory()[1] / 2**20, "resident": resident}


def times(topic: str) -> dict[str, list[float]]:
    """Processor seconds of every peer (one thread), one after the other in each round: other load meets all alike."""
    X = inputs(topic)
    found: dict[str, list[float]] = {peer: [] for peer in peers(topic)}
    for peer in found:
        work(peer, topic, X[:1000])
    for _ in range(REPEATS):
        for peer, seconds in found.items():
            start = time.process_time()
            work(peer, topic, X)
            seconds.append(time.process_time() - start)
    return found


def table(topic: str) -> None:
    """Measure one topic and print it."""
    memory = {}  # first: a child's greatest resident size counts what its parent held when it was born
    for peer in peers(topic):
        call = [sys.executable, __file__, "peak", peer, topic]
        memory[peer] = json.loads(subprocess.run(call, check=True, capture_output=True, text=True).stdout)
    seconds = times(topic)
    n_lags = topic.removeprefix("lags")
    print(f"## {n_lags} lags\n" if topic.startswith("lags") else f"## Splines of degree {topic}\n")
    print("| | processor s | MiB traced | MiB resident | time, times ours | memory, times ours |")
    print("|---|---|---|---|---|---|")
    for peer in seconds:
        ours = "ours" if topic.startswith("lags") else ("ours, sparse" if peer.endswith("sparse") else "ours, dense")
        slower = statistics.median(a / b for a, b in zip(seconds[peer], seconds[ours]))
        larger = memory[peer]["traced"] / memory[ours]["traced"]
        held = f"{memory[peer]['traced']:.0f} | {memory[peer]['resident']:.0f}"
        print(f"| {peer} | {statistics.median(seconds[peer]):.3f} | {held} | {slower:.1f} | {larger:.1f} |")
    print(flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["peak"]:
        print(json.dumps(peak(*sys.argv[2:])))
        raise SystemExit
    print(f"{N_ROWS} rows; {N_KNOTS} knots; Python {platform.python_version()}, numpy {np.__version__}, ", end="")
    print(f"scipy {scipy.__version__}, scikit-learn {sklearn.__version__}; medians of {REPEATS} rounds.\n")
    for name in sys.argv[1:] or ["0", "1", "3", "lags5", "lags50"]:
        table(name)
