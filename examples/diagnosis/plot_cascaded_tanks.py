"""
Overflow: what is missing in a model of two tanks?
==================================================

The simulator knows Torricelli's law for both tanks, but no overflow. No parameter is known, so all are re-tuned
with every candidate. In the plant, water flows over the rim of the upper tank, and a part of it falls into the
lower tank. The level sensor of the lower tank ends at ten volts.
"""

import os
import time

import numpy as np

from sksurrogate.datasets import fetch_cascaded_tanks
from sksurrogate.exceptions import SurrogateError, require
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import CalibratedSimulator, ODESimulator


def tanks(t, x, u, p):
    """Upper and lower level."""
    upper, lower = np.sqrt(np.maximum(x[0], 0)), np.sqrt(np.maximum(x[1], 0))
    return p["k4"] * u[0] - p["k1"] * upper, p["k2"] * upper - p["k3"] * lower


try:
    data = fetch_cascaded_tanks(os.environ.get("SKSURROGATE_DATA"))
except SurrogateError as error:
    print(f"Skipped, the recording is not at hand: {error}")
    raise SystemExit(0) from None

simulator = ODESimulator(
    tanks, states=["upper", "lower"], inputs=["pump"], outputs=["lower"],
    params={"k1": 0.05, "k2": 0.05, "k3": 0.05, "k4": 0.05}, dt=data.Ts, x0=[5.0, 5.0],
)  # fmt: skip
begun = time.perf_counter()
diagnoser = GapDiagnoser(simulator, free_params="all", random_state=0)
diagnoser.fit(data.uEst[:, None], data.yEst[:, None])
print(diagnoser.report_)
print(f"{time.perf_counter() - begun:.0f} s")
start = diagnoser.initial_states_[0]  # both records begin at the same levels
bounds = dict.fromkeys(simulator.params, (0.001, 1.0))
tuned = CalibratedSimulator(simulator, list(bounds), bounds=bounds).fit(data.uEst[:, None], data.yEst)
runs = {
    "simulator, parameters re-tuned": tuned.simulator_.simulate(data.uVal[:, None], x0=tuned.x0_[0])[:, 0],
    "with the named effects": diagnoser.augmented_.simulate(data.uVal[:, None], x0=start)[:, 0],
}
for label, run in runs.items():
    print(f"test record, {label}: RMSE {np.sqrt(np.mean((run - data.yVal) ** 2)):.3f} V")

# %%
# The test record, which took no part in the fit.
plt = require("matplotlib.pyplot", "plot")
t = data.Ts * np.arange(len(data.yVal))
figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 5.4), sharex=True, height_ratios=(2, 1), layout="constrained")
top.plot(t, data.yVal, color="#8a8a8a", lw=3.5, label="measured")
for (label, run), style in zip(runs.items(), ({"color": "#d55e00", "ls": "--"}, {"color": "black", "lw": 1.2})):
    top.plot(t, run, **style, label=label)
    bottom.plot(t, run - data.yVal, **style)
top.set(ylabel="lower level / V", title="The test record")
top.legend(frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.02))
bottom.axhline(0, color="#8a8a8a", lw=0.8)
bottom.set(xlabel="time / s", ylabel="error / V")
bottom.margins(x=0)
