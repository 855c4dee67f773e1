"""Does a process that diagnoses again and again stay as it is: memory, open files, child processes, threads?

    python tests/benchmarks/bench_soak.py [--diagnoses 200] [--runs 3]

Every diagnosis is of another record; the first tenth is left out of the comparison, for caches fill there.
"""

from __future__ import annotations

import argparse
import gc
import os
import threading
import time
import warnings
from pathlib import Path

from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.gap import GapDiagnoser


def state() -> dict[str, float]:
    """Resident memory (MiB), open files, children that run, threads."""
    gc.collect()
    status = Path("/proc/self/status").read_text()
    resident = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
    children = sum(
        len(path.read_text().split()) for path in Path("/proc/self/task").glob("*/children") if path.exists()
    )
    files = len(os.listdir("/proc/self/fd"))
    return {"MiB": resident / 1024, "files": files, "children": children, "threads": threading.active_count()}


def main() -> None:
    """Diagnose, and compare the states."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--diagnoses", type=int, default=200)
    parser.add_argument("--runs", type=int, default=3)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    started, warm = time.perf_counter(), max(given.diagnoses // 10, 1)
    for k in range(given.diagnoses):
        X, y, groups = make_reactor_runs(given.runs, 60, noise=0.02, random_state=k)
        effects = ["sensor_bias", "input_bias", "input_gain"]
        GapDiagnoser(make_reactor(), effects=effects, random_state=k).fit(X, y + 0.3, groups=groups)
        if k + 1 in (warm, given.diagnoses):
            print(f"after {k + 1:4d}: {state()}, {time.perf_counter() - started:.0f} s", flush=True)


if __name__ == "__main__":
    main()
