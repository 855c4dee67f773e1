"""
What does the detailed simulator have that the fast one lacks?
==============================================================

A fast model of a swinging arm has viscous friction only; a detailed one has air drag too.
:func:`~sksurrogate.gap.compare_simulators` excites both within the limits of the torque and names the difference.
"""

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.gap import compare_simulators
from sksurrogate.physics import ODESimulator


def fast(t, x, u, p):
    angle, speed = x
    return speed, u[0] - p["stiffness"] * angle - p["friction"] * speed


def detailed(t, x, u, p):
    angle, speed = x
    return speed, u[0] - p["stiffness"] * angle - p["friction"] * speed - 0.15 * speed * np.abs(speed)


names = {"states": ["angle", "speed"], "inputs": ["torque"], "outputs": ["angle"], "dt": 0.05}
parameters = {"stiffness": 9.0, "friction": 0.2}
a = ODESimulator(fast, params=parameters, **names)
b = ODESimulator(detailed, params=parameters, **names)

# %%
# Runs of 15 time units within the limits of the torque: steps and multisines, large and small.
report, data = compare_simulators(a, b, limits={"torque": (-6, 6)}, duration=15.0, random_state=0, return_data=True)
print(report.sentence)

# %%
# The fast model with the missing term is a simulator again.
better = data.diagnoser.augmented_
first = data.groups == 0
time = names["dt"] * np.arange(first.sum())
plt = require("matplotlib.pyplot", "plot")
figure, ax = plt.subplots(figsize=(8, 3), layout="constrained")
ax.plot(time, data.y[first], "0.7", linewidth=4, label="detailed simulator")
for name, simulator, style in (("fast", a, "C1--"), ("fast with the named term", better, "k")):
    angle = simulator.simulate(data.X[first])
    ax.plot(time, angle, style, linewidth=1, label=name)
    print(f"{name}: RMS error {np.sqrt(np.mean((angle - data.y[first]) ** 2)):.4f}")
ax.set(xlabel="time / s", ylabel="angle / rad")
figure.legend(loc="outside upper center", frameon=False, ncols=3)
