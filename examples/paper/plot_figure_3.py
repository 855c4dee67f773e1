"""
Experiments: what do runs of the paper's plant look like? (Figure 3)
====================================================================

One input with ten levels, and runs from eight initial states. Only a simulator lets the user choose y(0).
"""

import matplotlib.pyplot as plt
import numpy as np

from sksurrogate.datasets import make_reactor, make_reactor_experiments
from sksurrogate.runs import unstack_runs

X, y, groups, dydt = make_reactor_experiments()
t = 0.02 * np.arange(100)
runs, slopes = unstack_runs(y, groups), unstack_runs(dydt, groups)

colours = plt.cm.viridis(np.linspace(0.0, 0.9, 8))  # in the order of y(0)
figure, axes = plt.subplots(3, 1, figsize=(8, 8), sharex=True, constrained_layout=True)
axes[0].step(t, X[:100, 0], where="post", color="#000000")
axes[0].set(ylabel="temperature u", title="One input, eight initial states")
for run, slope, colour in zip(runs, slopes, colours):
    axes[1].plot(t, run, lw=1.5, color=colour, label=f"y(0) = {run[0]:g}")
    axes[2].step(t, slope, where="post", lw=1, color=colour)
axes[1].set(ylabel="concentration y")
axes[1].legend(ncols=4, fontsize=8, frameon=False)
axes[2].set(ylabel="dy/dt", xlabel="time", yscale="symlog")

# %%
# All runs come together before the end, so the initial state has no influence there.

plant = make_reactor(dt=1e-4)
fine = plant.simulate(np.full((2, 1), X[0, 0]), x0=[15.0])[:, 0]
assert abs((fine[1] - fine[0]) / 1e-4 / dydt[0] - 1) < 1e-2
spread = np.ptp(np.stack(runs), axis=0)
print(f"spread of the runs at the start {spread[0]:.2f}, at the end {spread[-1]:.1e}")
assert spread[-1] < 1e-3 * spread[0]
plt.show()
