"""
Dead time: is the plant slow, or does the valve react late?
===========================================================

The valve of a heat exchanger reacts 0.7 s late. A first-order model can hide a delay behind another time constant.
The diagnosis compares both explanations and names the delay. Effects that these data cannot tell from it are
printed with it.
"""

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator


def exchanger(t, x, u, p):
    """Outlet temperature above ambient: heat in with the steam valve, heat out with the flow of water."""
    return ((p["gain"] * u[0] - (p["loss"] + u[1]) * x[0]) / p["capacity"],)


simulator = ODESimulator(
    exchanger, states=["outlet"], inputs=["valve", "flow"], outputs=["outlet"],
    params={"gain": 40.0, "loss": 0.3, "capacity": 2.0}, dt=0.1, x0=[20.0],
)  # fmt: skip

# The plant: the same equation, its valve 7 samples late. No effect of the package makes these data.
rng = np.random.default_rng(2)
n, late = 240, 7
U = np.empty((7, n + late, 2))
U[..., 0] = np.repeat(rng.uniform(0.2, 0.9, (7, 13)), 20, axis=1)[:, : n + late]
U[..., 1] = np.repeat(rng.uniform(0.6, 1.2, (7, 5)), 55, axis=1)[:, : n + late]
acting = np.stack([U[:, :n, 0], U[:, late:, 1]], axis=2)
Y = np.stack([simulator.simulate(u, x0=[20.0]) for u in acting]) + 0.1 * rng.normal(size=(7, n, 1))
U = U[:, late:]

diagnoser = GapDiagnoser(simulator, free_params=["capacity"], random_state=0)
diagnoser.fit(U[:6].reshape(-1, 2), Y[:6].reshape(-1), groups=np.repeat(np.arange(6), n))
print(diagnoser.report_)

# %%
# The seventh run took no part in the fit.
plt = require("matplotlib.pyplot", "plot")
t = 0.1 * np.arange(n)
figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 4.6), sharex=True, height_ratios=(2, 1), constrained_layout=True)
top.plot(t, Y[6, :, 0], color="#8a8a8a", lw=3.5, label="measured")
top.plot(t, simulator.simulate(U[6], x0=[20.0])[:, 0], color="#d55e00", ls="--", label="simulator")
top.plot(t, diagnoser.augmented_.simulate(U[6], x0=[20.0])[:, 0], color="black", lw=1.2, label="with the named effect")
top.set(ylabel="outlet / K above ambient", title="A run that took no part in the fit")
top.legend(frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.02))
bottom.step(t, U[6, :, 0], where="post", color="#0072b2")
bottom.set(xlabel="time / s", ylabel="valve")
bottom.margins(x=0)
