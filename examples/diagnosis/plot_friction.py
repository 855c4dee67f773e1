"""
Dry friction: where does a pendulum model go wrong?
===================================================

A pendulum turns in a bearing with dry friction. The simulator has viscous damping only. Its damping is not well
known, so it is re-tuned together with every candidate. The report names the friction. The corrected simulator
follows a run that took no part in the fit.
"""

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator


def pendulum(t, x, u, p):
    """Angle and speed, torque on the axis."""
    return x[1], u[0] - p["g_over_l"] * np.sin(x[0]) - p["damping"] * x[1]


def with_friction(t, x, u, p):
    """The plant: the same with dry friction."""
    return x[1], u[0] - p["g_over_l"] * np.sin(x[0]) - p["damping"] * x[1] - 0.4 * np.tanh(x[1] / 0.002)


signals = {"states": ["angle", "speed"], "inputs": ["torque"], "outputs": ["angle"], "dt": 0.05}
plant = ODESimulator(with_friction, params={"g_over_l": 4.0, "damping": 0.2}, **signals)
simulator = ODESimulator(pendulum, params={"g_over_l": 4.0, "damping": 0.35}, **signals)

rng = np.random.default_rng(0)
U = np.repeat(1.5 * rng.normal(size=(7, 20, 1)), 10, axis=1)
Y = np.stack([plant.simulate(u) for u in U]) + 0.01 * rng.normal(size=(7, 200, 1))

diagnoser = GapDiagnoser(simulator, free_params=["damping"], random_state=0)
diagnoser.fit(U[:6].reshape(-1, 1), Y[:6].reshape(-1), groups=np.repeat(np.arange(6), 200))
print(diagnoser.report_)

# %%
# The seventh run: dry friction stops the pendulum; viscous damping alone does not.
plt = require("matplotlib.pyplot", "plot")
t = 0.05 * np.arange(200)
figure, ax = plt.subplots(figsize=(8, 3.2), constrained_layout=True)
ax.plot(t, Y[6, :, 0], color="#8a8a8a", lw=3.5, label="measured")
ax.plot(t, simulator.simulate(U[6])[:, 0], color="#d55e00", ls="--", label="simulator")
ax.plot(t, diagnoser.augmented_.simulate(U[6])[:, 0], color="black", lw=1.2, label="with the named effect")
ax.set(xlabel="time / s", ylabel="angle / rad", title="A run that took no part in the fit")
ax.margins(x=0)
ax.legend(ncols=3, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.22))
