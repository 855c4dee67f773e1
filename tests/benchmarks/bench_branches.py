"""What does a right-hand side that is written for one point cost? Called point by point, by branches, and written for arrays.

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_branches.py``. Medians of nine rounds with all ways in turn, processor time.
"""

from __future__ import annotations

import math
import time
import warnings

import numpy as np

from sksurrogate.physics._branches import Branches
from sksurrogate.physics._rhs import PointwiseFunction

PARAMS = {"c": 0.5, "A": 2.0}


def tank(t, x, u, p):
    return ((u[0] - p["c"] * math.sqrt(max(x[0], 1e-6))) / p["A"],)


def tank_arrays(t, x, u, p):
    return ((u[0] - p["c"] * np.sqrt(np.maximum(x[0], 1e-6))) / p["A"],)


def joint(t, x, u, p):
    return x[1], u[0] - math.copysign(p["c"], x[1]) - p["A"] * math.sin(x[0])


def joint_arrays(t, x, u, p):
    return x[1], u[0] - np.copysign(p["c"], x[1]) - p["A"] * np.sin(x[0])


def eight_branches(t, x, u, p):
    flow = math.sqrt(x[0]) if x[0] > 0 else -math.sqrt(-x[0])
    if 0 < x[1] < 1 or x[0] > 2:
        flow += math.exp(-x[1])
    return x[1] - flow, max(0, min(float(u[0]), 1)) - 9.81 * abs(x[0])


def eight_branches_arrays(t, x, u, p):
    flow = np.copysign(np.sqrt(np.abs(x[0])), x[0])
    flow = flow + np.where(((x[1] > 0) & (x[1] < 1)) | (x[0] > 2), np.exp(-x[1]), 0.0)
    return x[1] - flow, np.clip(u[0], 0, 1) - 9.81 * np.abs(x[0])


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore")
    rng = np.random.default_rng(0)
    print(
        "| function | points | point by point, us | / by branches | by branches / for arrays |\n|---|---|---|---|---|"
    )
    for scalar, arrays, n in (
        (tank, tank_arrays, 1),
        (joint, joint_arrays, 2),
        (eight_branches, eight_branches_arrays, 2),
    ):
        ways = [PointwiseFunction(f, n, "rhs", ["a", "b"][:n]) for f in (scalar, Branches(scalar, n), arrays)]
        for way, vectorised in zip(ways, (False, True, True)):
            way.vectorised = vectorised
        for m in (10, 100, 1000, 10000):
            x, u, calls = rng.normal(size=(n, m)), 2 * rng.normal(size=(1, m)), max(1, 3000 // m)
            for way in ways[1:]:
                np.testing.assert_allclose(way(0.0, x, u, PARAMS), ways[0](0.0, x, u, PARAMS), rtol=1e-12, atol=1e-13)
            seconds = np.empty((9, 3))
            for k in range(len(seconds)):
                for j, way in enumerate(ways):
                    before = time.process_time()
                    for _ in range(calls):
                        way(0.0, x, u, PARAMS)
                    seconds[k, j] = (time.process_time() - before) / calls
            each, by_branch, whole = seconds.T
            ratios = np.median(each / by_branch), np.median(by_branch / whole)
            print(f"| {scalar.__name__} | {m} | {1e6 * np.median(each):.0f} | {ratios[0]:.1f} | {ratios[1]:.1f} |")


if __name__ == "__main__":
    main()
