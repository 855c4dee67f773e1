"""
What is missing in a linear model of the Silverbox?
===================================================

The Silverbox is an electronic oscillator with a hardening spring; the simulator is a linear resonator whose parameters
are all re-tuned with every rival.
"""

import os
import time

import numpy as np

from sksurrogate.datasets import fetch_silverbox
from sksurrogate.exceptions import SurrogateError
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
train = slice(data.train.start, data.train.start + 6000)
begun = time.perf_counter()
diagnoser = GapDiagnoser(simulator, free_params="all", random_state=0).fit(u[train, None], y[train, None])
print(diagnoser.report_)
print(f"{time.perf_counter() - begun:.0f} s")

arrow = data.test_arrow
start = [y[arrow.start], (y[arrow.start + 1] - y[arrow.start - 1]) * data.fs / 2]
tuned = diagnoser.augmented_
for label, model in (("linear, as given", simulator), ("with the effects", tuned)):
    error = model.simulate(u[arrow, None], x0=start)[50:, 0] - y[arrow][50:]
    print(f"arrow-head test, {label}: {1e3 * np.sqrt(np.mean(error**2)):.3f} mV")
