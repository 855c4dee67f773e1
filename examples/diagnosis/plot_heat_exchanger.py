"""
Fouling: does the heat exchanger change, or does the sensor drift?
==================================================================

Steam heats water through a wall. Scale grows on the wall, and the heat transfer falls by a tenth a day. Each run
starts with a clean wall. In the records this looks like a drifting sensor. Two facts separate the two: fouling acts
in proportion to the temperature difference, and a drifting sensor does not change the dynamics.
"""

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator


def exchanger(t, x, u, p):
    """Outlet temperature in degC; inputs: steam temperature in degC, flow of water in kg/s; time in hours."""
    return ((p["transfer"] * (u[0] - x[0]) - p["heat"] * u[1] * (x[0] - p["inlet"])) / p["capacity"],)


def fouling_exchanger(t, x, u, p):
    """The plant: scale grows from the start of the run."""
    return exchanger(t, x, u, {**p, "transfer": p["transfer"] * (1 - 0.1 * t / 24)})


signals = {"states": ["outlet"], "inputs": ["steam", "flow"], "outputs": ["outlet"], "dt": 0.5, "x0": [50.0]}
params = {"transfer": 12.0, "heat": 10.0, "inlet": 15.0, "capacity": 20.0}
plant = ODESimulator(fouling_exchanger, params=params, **signals)
simulator = ODESimulator(exchanger, params=params, **signals)

rng = np.random.default_rng(0)
n = 200  # four days
U = np.empty((6, n, 2))
U[..., 0] = np.repeat(rng.uniform(105, 135, (6, 20)), 10, axis=1)
U[..., 1] = np.repeat(rng.uniform(0.6, 1.6, (6, 25)), 8, axis=1)
Y = np.stack([plant.simulate(u) for u in U]) + 0.2 * rng.normal(size=(6, n, 1))

diagnoser = GapDiagnoser(simulator, random_state=0)
diagnoser.fit(U[:5].reshape(-1, 2), Y[:5].reshape(-1), groups=np.repeat(np.arange(5), n))
print(diagnoser.report_)

# %%
# The error over the four days of a run that took no part in the fit. The error of the simulator grows. With the named effect only
# noise is left.
plt = require("matplotlib.pyplot", "plot")
days = 0.5 * np.arange(n) / 24
figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 4.8), sharex=True, constrained_layout=True)
augmented = diagnoser.augmented_
top.plot(days, Y[5, :, 0], color="#8a8a8a", lw=3.5, label="measured")
top.plot(days, simulator.simulate(U[5])[:, 0], color="#d55e00", ls="--", label="simulator")
top.plot(days, augmented.simulate(U[5])[:, 0], color="black", lw=1.2, label="with the named effect")
top.set(ylabel="outlet / °C", title="A run that took no part in the fit")
top.legend(ncols=3, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.02))
bottom.plot(days, simulator.simulate(U[5])[:, 0] - Y[5, :, 0], color="#d55e00", ls="--")
bottom.plot(days, augmented.simulate(U[5])[:, 0] - Y[5, :, 0], color="black", lw=1.0)
bottom.axhline(0, color="#8a8a8a", lw=0.8)
bottom.set(xlabel="time / d", ylabel="error / K")
bottom.margins(x=0)
