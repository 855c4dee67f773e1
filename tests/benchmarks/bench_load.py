"""Does a diagnosis bear many runs, states and parameters, threads, spawned workers, two workers of loky, a memory limit?

    python tests/benchmarks/bench_load.py [runs states parameters threads spawn loky memory]

Each load runs in a process of its own and says wall and processor seconds, the largest resident memory, the most processes and
threads at one time, and what came out.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

#: Effects that are asked for: every load is about its own size, not about the catalogue's.
ASKED = ["sensor_bias", "input_bias", "input_gain", "linear_loss"]


def said(diagnoser: GapDiagnoser) -> str:
    """Verdict and names."""
    report = diagnoser.report_
    return f"{report.verdict} {[f'{e.name}@{e.location}' for e in report.effects]}"


def reactor(seed: int = 0, n_runs: int = 3, n_rows: int = 60, n_jobs: int | None = 1) -> str:
    """A reactor whose sensor has an offset."""
    X, y, groups = make_reactor_runs(n_runs, n_rows, noise=0.02, random_state=seed)
    diagnoser = GapDiagnoser(make_reactor(), effects=ASKED, random_state=seed, n_jobs=n_jobs)
    return said(diagnoser.fit(X, y + 0.3, groups=groups))


class Chain:
    """Right-hand side of a rod of ``n`` cells, heated at one end, each with its own conductance and loss."""

    def __init__(self, n: int):
        self.n = n

    def __call__(self, t: Any, x: Any, u: Any, p: Any) -> list[Any]:
        """Heat to the neighbours and to the room."""
        flow = [p[f"k{i}"] * (x[i] - x[i + 1]) for i in range(self.n - 1)]
        left, right = [u[0], *flow], [*flow, 0.0 * x[0]]
        return [a - b - p[f"h{i}"] * x[i] for i, (a, b) in enumerate(zip(left, right))]

    def simulator(self, **changed: float) -> ODESimulator:
        """Its cells are measured at every fifth place and at the end."""
        params = {f"k{i}": 1.0 + 0.02 * i for i in range(self.n - 1)} | {f"h{i}": 0.05 for i in range(self.n)}
        cells = [f"cell{i}" for i in range(self.n)]
        return ODESimulator(
            self,
            states=cells,
            inputs=["heat"],
            outputs=list(dict.fromkeys([*cells[::5], cells[-1]])),
            params=params | changed,
            dt=0.2,
        )


def rod(n: int, free: int) -> str:
    """A rod one of whose cells loses more than the simulator says, or some of whose parameters are off and free."""
    names = [f"h{i}" for i in range(n)][: (free + 1) // 2] + [f"k{i}" for i in range(n - 1)][: free // 2]
    rng, plain = np.random.default_rng(0), Chain(n).simulator()
    off = {name: plain.params[name] * rng.uniform(0.9, 1.1) for name in names}
    plant = Chain(n).simulator(**(off or {"h5": 0.15}))
    U = [np.repeat(rng.uniform(0, 2, 15), 10)[:, None] for _ in range(4)]
    Y = np.concatenate([plant.simulate(u) for u in U])
    Y += 0.005 * Y.std(axis=0) * rng.normal(size=Y.shape)
    diagnoser = GapDiagnoser(plain, effects=ASKED, free_params=names, random_state=0, n_jobs=1)
    return said(diagnoser.fit(np.concatenate(U), Y, groups=np.repeat(np.arange(4), 150)))


def in_threads() -> str:
    """Two at once say what they say alone."""
    found: dict[int, str] = {}
    both = [threading.Thread(target=lambda k=k: found.update({k: reactor(k)})) for k in (1, 2)]
    for one in both:
        one.start()
    for one in both:
        one.join()
    return f"{found[1]}; as alone: {[found[k] for k in (1, 2)] == [reactor(k) for k in (1, 2)]}"


def spawned() -> str:
    """Two fresh processes say what this one says."""
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        found = pool.map(reactor, [1, 2])
    return f"{found[0]}; as here: {found == [reactor(1), reactor(2)]}"


def with_loky() -> str:
    """Candidates in two workers."""
    return f"{reactor(1, 6, 200, n_jobs=2)}; as with one: {reactor(1, 6, 200) == reactor(1, 6, 200, n_jobs=2)}"


def limited() -> str:
    """Address space for this process alone: 400 MiB more than it has."""
    has = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (has + 400 * 2**20,) * 2)
    try:
        return reactor(1, 6, 200)
    except MemoryError as error:
        return f"MemoryError: {error}"


LOADS = {
    "runs": lambda: reactor(0, 1000, 20), "states": lambda: rod(20, 0), "parameters": lambda: rod(16, 30),
    "threads": in_threads, "spawn": spawned, "loky": with_loky, "memory": limited,
}  # fmt: skip


def family(pid: int) -> list[int]:
    """A process and all that it started."""
    out = [pid]
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            out += [one for child in path.read_text().split() for one in family(int(child))]
        except OSError:
            continue
    return out


def watched(name: str) -> str:
    """A load in its own process, and the most that it took."""
    started, most = time.perf_counter(), {"processes": 0, "threads": 0, "MiB": 0.0}
    process = subprocess.Popen([sys.executable, __file__, "--here", name], stdout=subprocess.PIPE, text=True)
    while process.poll() is None:
        resident, count, pids = 0, 0, family(process.pid)
        for pid in pids:
            try:
                status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
            except OSError:
                continue
            resident += int(status.get("VmRSS", "0").split()[0])
            count += int(status["Threads"])
        now = {"processes": len(pids), "threads": count, "MiB": round(resident / 1024)}
        most = {key: max(most[key], now[key]) for key in most}
        time.sleep(0.2)
    assert process.stdout is not None
    busy = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (
        f"{name}: {process.stdout.read().strip()} | {time.perf_counter() - started:.0f} s, processor "
        f"{busy.ru_utime + busy.ru_stime:.0f} s so far, {most}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("loads", nargs="*", default=[])
    parser.add_argument("--here", help=argparse.SUPPRESS)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.here:
        print(LOADS[given.here]())
    else:
        for name in given.loads or LOADS:
            print(watched(name), flush=True)
