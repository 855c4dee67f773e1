"""Spline features: time and peak memory against scikit-learn and scipy.

Run: ``OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_features.py [n_rows]``. It prints the tables
of docs/benchmarks/features.md.
"""

import json
import platform
import resource
import statistics
import subprocess
import sys
import time
import tracemalloc
from itertools import product

import numpy as np
import scipy
import sklearn

N_KNOTS = 20
REPEATS = 5
PEERS = ("ours, sparse", "ours, dense", "scikit-learn, sparse", "scikit-learn, dense", "scipy design_matrix, sparse")


def inputs(n_rows: int) -> np.ndarray:
    """Four inputs."""
    return np.random.default_rng(0).uniform(size=(n_rows, 4))


def work(peer: str, degree: int, X: np.ndarray):
    """The basis that a peer makes of X."""
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
        pitch = breaks[1] - breaks[0]
        outer = pitch * np.arange(1, degree + 1)
        knots = np.r_[breaks[0] - outer[::-1], breaks, breaks[-1] + outer]
        blocks.append(BSpline.design_matrix(x, knots, degree))
    return hstack(blocks, format="csr")


def peak(peer: str, degree: int, n_rows: int) -> dict[str, float]:
    """Peak MiB above the inputs: what Python and numpy asked for, and what the process held."""
    X = inputs(n_rows)
    work(peer, degree, X[:1000])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    work(peer, degree, X)
    resident = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    tracemalloc.start()
    work(peer, degree, X)
    return {"traced": tracemalloc.get_traced_memory()[1] / 2**20, "resident": resident}


def times(degree: int, n_rows: int) -> dict[str, list[float]]:
    """Processor seconds of every peer (one thread), one after the other in each round: other load on the machine then meets all alike."""
    X = inputs(n_rows)
    found: dict[str, list[float]] = {peer: [] for peer in PEERS}
    for _ in range(REPEATS + 1):  # the first round warms up
        for peer in PEERS:
            start = time.process_time()
            work(peer, degree, X)
            found[peer].append(time.process_time() - start)
    return {peer: seconds[1:] for peer, seconds in found.items()}


def main() -> None:
    """Print the tables."""
    if len(sys.argv) == 4:
        print(json.dumps(peak(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))))
        return
    n_rows = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    print(
        f"{n_rows} rows, 4 inputs, {N_KNOTS} knots; Python {platform.python_version()}, numpy {np.__version__}, ",
        end="",
    )
    print(f"scipy {scipy.__version__}, scikit-learn {sklearn.__version__}; medians of {REPEATS} rounds.\n")
    memory = {}  # first: a child's greatest resident size counts what its parent held when it was born
    for degree, peer in product((0, 1, 3), PEERS):
        call = [sys.executable, __file__, peer, str(degree), str(n_rows)]
        answer = subprocess.run(call, check=True, capture_output=True, text=True).stdout
        memory[degree, peer] = json.loads(answer)
    for degree in (0, 1, 3):
        seconds = times(degree, n_rows)
        print(f"## Degree {degree}\n")
        print("| basis | processor s | MiB traced | MiB resident | time, times ours | memory, times ours |")
        print("|---|---|---|---|---|---|")
        for peer in PEERS:
            ours = "ours, sparse" if peer.endswith("sparse") else "ours, dense"
            slower = statistics.median(a / b for a, b in zip(seconds[peer], seconds[ours]))
            larger = memory[degree, peer]["traced"] / memory[degree, ours]["traced"]
            held = f"{memory[degree, peer]['traced']:.0f} | {memory[degree, peer]['resident']:.0f}"
            print(f"| {peer} | {statistics.median(seconds[peer]):.3f} | {held} | {slower:.1f} | {larger:.1f} |")
        print()


if __name__ == "__main__":
    main()
