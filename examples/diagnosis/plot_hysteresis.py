"""
Hysteresis: can a model without memory follow a piezo stage?
============================================================

In a piezo stage the voltage acts through a Bouc-Wen hysteresis. The simulator is a second-order system without
memory. The loop of position over voltage shows the difference at once: it is open for the stage and nearly a line
for the simulator.
"""

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator


def stage(t, x, u, p):
    """Position and speed under a voltage."""
    return x[1], p["stiffness"] * (p["gain"] * u[0] - x[0]) - p["damping"] * x[1]


def real_stage(t, x, u, p):
    """With a hidden force: dz/dt = v - 2 abs(v) z - 1.5 v abs(z)."""
    q, v, z = x
    dz = v - 2.0 * np.abs(v) * z - 1.5 * v * np.abs(z)
    return v, p["stiffness"] * (p["gain"] * u[0] - q) - p["damping"] * v - 12.0 * z, dz


params = {"stiffness": 30.0, "gain": 1.0, "damping": 2.0}
plant = ODESimulator(
    real_stage,
    states=["position", "speed", "z"],
    inputs=["voltage"],
    outputs=["position"],
    params=params,
    dt=0.1,
    hold="foh",
)
simulator = ODESimulator(
    stage, states=["position", "speed"], inputs=["voltage"], outputs=["position"], params=params, dt=0.1, hold="foh"
)

rng = np.random.default_rng(1)
t = 0.1 * np.arange(300)
sizes, slow = rng.uniform(0.5, 1.5, (6, 2)), rng.uniform(0.05, 0.15, (6, 2))
U = np.stack([a[0] * np.sin(2 * np.pi * f[0] * t) + a[1] * np.sin(2 * np.pi * f[1] * t) for a, f in zip(sizes, slow)])[
    ..., None
]
Y = np.stack([plant.simulate(u) for u in U]) + 0.003 * rng.normal(size=(6, 300, 1))

diagnoser = GapDiagnoser(simulator, random_state=0)
diagnoser.fit(U[:5].reshape(-1, 1), Y[:5].reshape(-1), groups=np.repeat(np.arange(5), 300))
print(diagnoser.report_)

# %%
# The sixth run took no part in the fit.
plt = require("matplotlib.pyplot", "plot")
figure, ax = plt.subplots(figsize=(6.5, 4.5), constrained_layout=True)
ax.plot(U[5, :, 0], Y[5, :, 0], color="#8a8a8a", lw=3.5, label="measured")
ax.plot(U[5, :, 0], simulator.simulate(U[5])[:, 0], color="#d55e00", ls="--", label="simulator")
ax.plot(U[5, :, 0], diagnoser.augmented_.simulate(U[5])[:, 0], color="black", lw=1.2, label="with the named effect")
ax.set(xlabel="voltage / V", ylabel="position / µm", title="A run that took no part in the fit")
ax.legend(frameon=False)
