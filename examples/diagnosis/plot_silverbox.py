"""
Hardening spring: what is missing in a linear model of the Silverbox?
=====================================================================

The Silverbox is an electronic oscillator with a hardening spring. The simulator is a linear resonator. All its
parameters are re-tuned with every candidate.
"""

import os
import time

import numpy as np

from sksurrogate.datasets import fetch_silverbox
from sksurrogate.exceptions import SurrogateError, require
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator


def resonator(t, x, u, p):
    """y'' = b u - c y' - w2 y."""
    return x[1], p["b"] * u[0] - p["c"] * x[1] - p["w2"] * x[0]


try:
    data = fetch_silverbox(os.environ.get("SKSURROGATE_DATA"))
except SurrogateError as error:
    print(f"Skipped, the recording is not at hand: {error}")
    raise SystemExit(0) from None

u, y = data.V1, data.V2
simulator = ODESimulator(
    resonator, states=["y", "dy"], inputs=["u"], outputs=["y"],
    params={"b": 1.97e5, "c": 43.5, "w2": 1.914e5}, dt=1 / data.fs, hold="foh",
)  # fmt: skip
train = slice(data.train.start, data.train.start + 2000)
begun = time.perf_counter()
diagnoser = GapDiagnoser(simulator, free_params="all", random_state=0).fit(u[train, None], y[train, None])
print(diagnoser.report_)
print(f"{time.perf_counter() - begun:.0f} s")

arrow = data.test_arrow
start = [y[arrow.start], (y[arrow.start + 1] - y[arrow.start - 1]) * data.fs / 2]
errors = {}
for label, model in (("linear, as given", simulator), ("with the named effects", diagnoser.augmented_)):
    errors[label] = 1e3 * (model.simulate(u[arrow, None], x0=start)[:, 0] - y[arrow])
    print(f"arrow-head test, {label}: RMSE {np.sqrt(np.mean(errors[label][50:] ** 2)):.3f} mV")

# %%
# The arrow head is larger at its end than anything in the 2000 samples of the fit.
plt = require("matplotlib.pyplot", "plot")
t = np.arange(len(y[arrow])) / data.fs
figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
top.plot(t, 1e3 * y[arrow], color="#8a8a8a", lw=0.5)
top.set(ylabel="output / mV", title="Arrow-head test: measured (above), error of the free run (below)")
for (label, error), colour in zip(errors.items(), ("#d55e00", "black")):
    bottom.plot(t, error, color=colour, lw=0.5, label=label)
bottom.set(xlabel="time / s", ylabel="error / mV")
bottom.margins(x=0)
for line in bottom.legend(frameon=False, loc="upper left").get_lines():
    line.set_linewidth(2)
