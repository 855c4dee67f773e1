"""Figure 8 of the paper, many draws: how much data does a hybrid need, and how much a surrogate?

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_figure_8.py [--sizes 1 2 4 8] [--draws FIRST LAST] [--forms auto]``. The
plant is that of Eq. (9), its linearisation the simulator; runs of 150 samples with a noise of 0.02 to learn from, 12 unseen
runs. One line a draw: RMSE above the noise of surrogate and hybrids, the form that was chosen, its reach, the largest error on
one unseen run, processor seconds; then medians.
"""

import argparse
import time
import warnings

import numpy as np

from sksurrogate.compose import HybridRegressor
from sksurrogate.datasets import linear_reactor, make_reactor_runs

N_SAMPLES, NOISE, N_NEW = 150, 0.02, 12


def above_noise(error):
    """Root mean square without the noise."""
    return float(np.sqrt(max(np.mean(error**2) - NOISE**2, 0.0)))


def errors(model, X, y, groups):
    """On all unseen runs, and on the one of the largest error."""
    first = np.stack([y[groups == k][: model.n_initial_] for k in range(N_NEW)])[:, :, None]
    error = model.predict(X, y0=first, groups=groups) - y
    return above_noise(error), max(above_noise(error[groups == k]) for k in range(N_NEW))


def main():
    """Print a table for each number of runs."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 2, 4, 8])
    parser.add_argument("--draws", type=int, nargs=2, default=[0, 20])
    parser.add_argument("--forms", nargs="+", default=["auto"])
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    simulator = linear_reactor(u0=0.15)
    new = make_reactor_runs(N_NEW, N_SAMPLES, noise=NOISE, random_state=99)
    for n_runs in options.sizes:
        rows = []
        print(
            f"\n{n_runs} runs\n\n| draw | surrogate | {' | '.join(options.forms)} |\n|---|---|{'---|' * len(options.forms)}"
        )
        for draw in range(*options.draws):
            X, y, groups = make_reactor_runs(n_runs, N_SAMPLES, noise=NOISE, random_state=draw)
            found, text = [], []
            for base, form in [(None, "output"), *((simulator, form) for form in options.forms)]:
                begun = time.process_time()
                model = HybridRegressor(base, form=form).fit(X, y, groups=groups)
                seconds = time.process_time() - begun
                error, worst = errors(model, *new)
                found.append(error)
                said = (
                    "" if base is None else f", {model.form_} {model.shrinkage_[0]:.2g}, reach {model.report_.fade:.2g}"
                )
                text.append(f"{error:.4f} (largest {worst:.3f}{said}; {seconds:.1f} s)")
            rows.append(found)
            print(f"| {draw} | {' | '.join(text)} |", flush=True)
        table = np.array(rows)
        ratios = table[:, 1:] / table[:, :1]
        print(
            f"medians: {np.round(np.median(table, axis=0), 4)}, median of ratios {np.round(np.median(ratios, axis=0), 3)}, "
        )
        print(f"no worse than the surrogate: {np.sum(ratios <= 1.0, axis=0)} of {len(rows)}", flush=True)


if __name__ == "__main__":
    main()
