"""
Coverage: how much of the vector field do experiments show? (Figure 4)
======================================================================

Runs from many y(0) cover the surface dy/dt = f(y, u) of Eq. (9). A plant whose initial state cannot be chosen shows
a small part of it.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import SymLogNorm

from sksurrogate.compose import coverage_report
from sksurrogate.datasets import make_reactor, make_reactor_experiments, reactor_rhs, simulate_experiments

X, y, groups, dydt = make_reactor_experiments()
u_axis, y_axis = np.linspace(0.05, 0.25, 40), np.linspace(0.4, 15.0, 40)
U, Y = np.meshgrid(u_axis, y_axis)
surface = reactor_rhs(0.0, [Y], [U], make_reactor().params)[0]

figure = plt.figure(figsize=(11, 5), constrained_layout=True)
ax = figure.add_subplot(1, 2, 1, projection="3d")
ax.plot_surface(U, Y, surface, cmap="viridis", alpha=0.5, linewidth=0)
for r in np.unique(groups):
    run = groups == r
    ax.plot(X[run, 0], y[run], dydt[run], ".", ms=4, color="#d55e00", zorder=5)
ax.set(
    xlabel="u",
    ylabel="y",
    zlabel="dy/dt",
    title="Surface of Eq. (9) and eight runs",
    xticks=[0.05, 0.15, 0.25],
    yticks=[0, 5, 10, 15],
    zticks=[-150, -100, -50, 0],
)
ax.computed_zorder = False
ax.zaxis.labelpad = 10
ax.set_box_aspect(None, zoom=0.85)
ax.view_init(elev=25, azim=-120)

normal = groups == 4
design = simulate_experiments(
    make_reactor(), {"y": (0.5, 15)}, {"u": (0.05, 0.25)}, n_runs=64, n_samples=100, hold=(5, 10), random_state=0
)
reports = {
    "one run, y(0) = 5": (X[normal], y[normal]),
    "eight runs": (X, y),
    "64 runs of a Latin hypercube": (design.X, design.y),
}
ax = figure.add_subplot(1, 2, 2)
levels = [-200, -100, -50, -20, -10, -5, -2, 0, 2, 5, 10, 20, 50]
filled = ax.contourf(U, Y, surface, levels, norm=SymLogNorm(2.0), cmap="cividis", alpha=0.75)
figure.colorbar(filled, ax=ax, label="dy/dt", ticks=levels)
ax.plot(design.X[:, 0], design.y, ".", ms=1, color="#ffffff", alpha=0.6, label="64 runs of a Latin hypercube")
ax.plot(X[:, 0], y, ".", ms=3, color="#d55e00", label="eight runs")
ax.plot(X[normal, 0], y[normal], ".", ms=4, color="#000000", label="one run")
steady = [
    next(v for v in np.linspace(0, 15, 3001) if reactor_rhs(0, [v], [w], make_reactor().params)[0] <= 0) for w in u_axis
]
ax.plot(u_axis, steady, color="#ffffff", lw=2, label="dy/dt = 0")
ax.set(xlabel="u", ylabel="y", title="The same from above")
ax.legend(
    loc="upper center",
    bbox_to_anchor=(0.5, -0.12),
    ncols=2,
    fontsize=8,
    facecolor="#7a7a7a",
    labelcolor="w",
    markerscale=3,
)

# %%
# The share of the (y, u) box that each data set covers.

shares = {}
for name, (inputs, outputs) in reports.items():
    report = coverage_report(inputs, outputs, box=[(0.4, 15.0), (0.05, 0.25)])
    shares[name] = report.share
    print(f"{name}: {100 * report.share:.0f} % of (y, u)")
assert shares["one run, y(0) = 5"] < 0.6 * shares["eight runs"]
assert shares["64 runs of a Latin hypercube"] > 2 * shares["eight runs"]
plt.show()
