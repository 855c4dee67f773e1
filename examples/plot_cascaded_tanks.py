"""
What is missing in a model of two tanks that overflow?
======================================================

Toricelli's law for both tanks, no overflow; no parameter is known, so all are re-tuned with every rival.
"""

import os
import time

import numpy as np

from sksurrogate.datasets import fetch_cascaded_tanks
from sksurrogate.exceptions import SurrogateError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator


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
same_start = diagnoser.initial_states_[0]
error = diagnoser.augmented_.simulate(data.uVal[:, None], x0=same_start)[:, 0] - data.yVal
print(f"test record, with the effects: {np.sqrt(np.mean(error**2)):.3f} V")
