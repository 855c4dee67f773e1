"""What does a diagnosis say about plants whose effects have the form that nature gives them?

    python tests/benchmarks/bench_physical_plants.py [NAME ...] [--seed 1]

One line a case: the truth, the answer, the error of the free run before and after on held-out runs and on another draw of the
case (over the deviation of the outputs), processor seconds. Whether an answer is right is for a reader to say.
"""

from __future__ import annotations

import argparse
import time
import warnings
import zlib

import numpy as np
import physical_plants_access  # noqa: F401
import physical_plants_coast  # noqa: F401
import physical_plants_fields  # noqa: F401
import physical_plants_imperfect  # noqa: F401
import physical_plants_labs  # noqa: F401
import physical_plants_mechatronics  # noqa: F401
import physical_plants_messy  # noqa: F401
import physical_plants_mills  # noqa: F401
import physical_plants_one  # noqa: F401
import physical_plants_other  # noqa: F401
import physical_plants_rigs  # noqa: F401
import physical_plants_robots  # noqa: F401
import physical_plants_service  # noqa: F401
import physical_plants_si  # noqa: F401
import physical_plants_starts  # noqa: F401
import physical_plants_trades  # noqa: F401
import physical_plants_utilities  # noqa: F401
import physical_plants_vehicles  # noqa: F401
import physical_plants_workshop  # noqa: F401
from physical_plants import CASES, KW

from sksurrogate.gap import GapDiagnoser


def drawn(name, seed):
    """A case of a seed."""
    return CASES[name](np.random.default_rng([seed, zlib.crc32(name.encode())]))


def begun(nominal, reading):
    """Where a free run begins: measured states at their first readings, the others where the simulator begins them."""
    states = list(getattr(nominal, "states", None) or [])
    own = getattr(nominal, "x0", None)
    start = np.zeros(len(states)) if own is None else np.array(own, dtype=float)
    for name, value in zip(nominal.outputs, reading):
        if name in states and np.isfinite(value):
            start[states.index(name)] = value
    return {"x0": start} if states else {}


def error(simulator, nominal, U, Y, groups):
    """RMSE of the free run from the first readings, over the deviation of the outputs; ``nominal``: the simulator that was given."""
    rows = [groups == k for k in np.unique(groups)]
    runs = [np.reshape(simulator.simulate(U[k], **begun(nominal, Y[k][0])), (np.sum(k), -1)) for k in rows]
    return float(np.sqrt(np.nanmean(((Y - np.vstack(runs)) / np.nanstd(Y, axis=0)) ** 2)))


def main():
    """Run the cases that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(CASES))
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    for name in options.names:
        simulator, U, Y, groups, truth = drawn(name, options.seed)
        started = time.process_time()
        diagnoser = GapDiagnoser(simulator, random_state=0, n_jobs=1, **KW.get(name, {})).fit(U, Y, groups=groups)
        seconds, report = time.process_time() - started, diagnoser.report_
        law = report.missing_term.law if report.missing_term is not None else None
        said = [f"{e.name}@{e.location}/{e.variable} {e.probability:.3f} {e.params}" for e in report.effects]
        unseen = drawn(name, options.seed + 500)[1:4]
        errors = [error(one, simulator, *unseen) for one in (simulator, diagnoser.augmented_)]
        print(
            f"{name} [{truth}] {report.verdict} ({report.reasons.rule}): {'; '.join(said) or '-'}; law {law}; held out "
            f"{report.shrink.before:.3f} -> {report.shrink.after:.3f}, unseen {errors[0]:.3f} -> {errors[1]:.3f}; {seconds:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
