"""
Hybrid model: how much data does it need? (Figure 8)
====================================================

The plant is Eq. (9) of the paper. The simulator is its linearisation at u = 0.15. The hybrid adds a correction that
is learned from five past deviations and inputs. The figure compares three models on new runs while the training
data shrink: (a) the simulator alone, (b) a surrogate alone, (c) the hybrid.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

from sksurrogate.compose import HybridRegressor
from sksurrogate.datasets import linear_reactor, make_reactor_runs

N_SAMPLES, NOISE, N_NEW = 150, 0.02, 12
SIZES, DRAWS = (1, 2, 4, 8), 3
simulator = linear_reactor(u0=0.15)
plt.style.use("tableau-colorblind10")


def first_rows(y, groups, n):
    """The first n outputs of every run, (n_runs, n, 1)."""
    return np.stack([y[groups == label][:n] for label in np.unique(groups)])[:, :, None]


def rmse(predicted, truth):
    """Root mean square error above the noise."""
    return np.sqrt(max(np.mean((predicted - truth) ** 2) - NOISE**2, 0.0))


new_X, new_y, new = make_reactor_runs(N_NEW, N_SAMPLES, noise=NOISE, random_state=99)
alone = np.concatenate([simulator.simulate(new_X[new == k], x0=new_y[new == k][:1])[:, 0] for k in range(N_NEW)])
gap = rmse(alone, new_y)

errors = {"(b) surrogate alone": [], "(c) hybrid": []}
print("runs | (a) simulator | (b) surrogate | (c) hybrid | gap closed by (c)")
print("---: | ---: | ---: | ---: | ---:")
for n_runs in SIZES:
    found = {name: [] for name in errors}
    for draw in range(DRAWS):
        X, y, groups = make_reactor_runs(n_runs, N_SAMPLES, noise=NOISE, random_state=draw)
        for name, base in (("(b) surrogate alone", None), ("(c) hybrid", simulator)):
            begun = time.perf_counter()
            model = HybridRegressor(base).fit(X, y, groups=groups)
            seconds = time.perf_counter() - begun
            predicted = model.predict(new_X, y0=first_rows(new_y, new, model.n_initial_), groups=new)
            found[name].append(rmse(predicted, new_y))
    for name in errors:
        errors[name].append(np.median(found[name]))
    b, c = (errors[name][-1] for name in errors)
    print(f"{n_runs} | {gap:.3f} | {b:.3f} | {c:.3f} | {100 * (1 - c / gap):.1f} %")
print(f"medians of {DRAWS} draws; the last fit took {seconds:.1f} s")

# %%
# Left: an unseen run with a large error of the simulator, as in the paper's figure.
# Right: the errors of the table. The simulator does not learn. From two runs on, the errors of hybrid and surrogate are both far
# smaller, and on this plant of one state both need about the same number of runs.
run = int(np.argmax([np.std((alone - new_y)[new == k]) for k in range(N_NEW)]))
rows = new == run
t = simulator.dt * np.arange(N_SAMPLES)
mean, std = model.predict(new_X[rows], y0=new_y[rows][: model.n_initial_], return_std=True)

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
left.plot(t, new_y[rows], color="0.6", lw=4, label="plant, Eq. (9)")
left.plot(t, alone[rows], "--", color="C1", label="(a) simulator alone")
left.plot(t, mean, color="C0", lw=1.2, label="(c) hybrid, 8 runs")
left.fill_between(t, mean - 2 * std, mean + 2 * std, color="C0", alpha=0.25, lw=0)
left.set(xlabel="time", ylabel="concentration y", title=f"An unseen run (number {run})")
left.legend(frameon=False)
right.axhline(gap, color="C1", ls="--", label="(a) simulator alone")
right.plot(SIZES, errors["(b) surrogate alone"], "s-", color="#000000", label="(b) surrogate alone")
right.plot(SIZES, errors["(c) hybrid"], "o-", color="C0", label="(c) hybrid")
right.set(xscale="log", yscale="log", xlabel="training runs of 150 samples", ylabel="RMSE above noise, unseen runs")
right.set_xticks(SIZES, [str(size) for size in SIZES])
right.minorticks_off()
right.legend(frameon=False)
plt.show()
