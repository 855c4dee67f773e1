"""
Where does my simulator go wrong?
=================================

A heated tank has a simulator, and the simulator does not follow the measured temperature. This notebook finds out what it lacks,
checks the answer on a run that was kept back, and saves the corrected simulator.
"""

# %%
# The simulator
# -------------
# The tank is stirred. Water flows in at 20 °C, and a heater warms it. Units are optional. With them every number of the
# report has its unit.
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from sksurrogate import GapDiagnoser, load_augmented, save_augmented
from sksurrogate.physics import ODESimulator


def tank(t, x, u, p):
    heater, flow = u  # kW, kg/s
    return [(heater / 4.19 + flow * (20.0 - x[0])) / p["mass"]]


signals = {"states": ["T"], "inputs": ["heater", "flow"], "outputs": ["T"], "dt": 5.0, "x0": [30.0]}
units = {"T": "degC", "heater": "kW", "flow": "kg/s", "mass": "kg", "time": "s"}
simulator = ODESimulator(tank, params={"mass": 50.0}, units=units, **signals)

# %%
# The recording
# -------------
# We simulate the real tank. It is outdoors at 0 °C and loses heat through its wall, and its heater needs 40 s to warm up. The
# simulator knows neither. There are five runs with steps of both inputs. The sensor has a noise of 0.05 K.


def real_tank(t, x, u, p):
    temperature, power = x
    _, flow = u
    loss = 0.3 * temperature  # kW
    return [((power - loss) / 4.19 + flow * (20.0 - temperature)) / 50.0, (u[0] - power) / 40.0]


plant = ODESimulator(real_tank, params={}, **{**signals, "states": ["T", "power"], "x0": [30.0, 10.0]})
rng = np.random.default_rng(0)
n_runs, n = 5, 240
X = np.stack([rng.uniform(0, 20, (n_runs, 8)), rng.uniform(0.05, 0.3, (n_runs, 8))], axis=-1).repeat(n // 8, axis=1)
X[:, :30, 0] = 10.0  # every run begins with a warm heater
y = np.stack([plant.simulate(U)[:, 0] for U in X]) + 0.05 * rng.normal(size=(n_runs, n))
X, y, runs = X.reshape(-1, 2), y.reshape(-1), np.repeat(np.arange(n_runs), n)

# %%
# One run is kept back. The simulator reads too high on it:
unseen = runs == 4
time = np.arange(n) * 5.0
figure, ax = plt.subplots(figsize=(8, 3), layout="constrained")
ax.plot(time, y[unseen], "0.6", lw=4, label="measured")
ax.plot(time, simulator.simulate(X[unseen], x0=y[unseen][:1]), "C1--", label="simulator")
ax.set(xlabel="time / s", ylabel="T / °C")
ax.legend()

# %%
# Diagnose
# --------
# All effects of the catalogue compete: losses, delays, wrong parameters, faults of the sensor.
diagnoser = GapDiagnoser(simulator, random_state=0)
diagnoser.fit(X[~unseen], y[~unseen], groups=runs[~unseen])
report = diagnoser.report_
print(report)

# %%
# The sentence at the top gives the missing effects. Before you rely on a name, look at its probability, and at other effects that
# explain the data as well:
for effect in report.effects:
    print(
        effect.name,
        "at",
        effect.location,
        "| probability",
        round(effect.probability, 3),
        "| as good:",
        effect.equivalents[:3],
    )

# %%
# Check
# -----
# The corrected simulator on the run that was kept back:
better = diagnoser.augmented_
figure, ax = plt.subplots(figsize=(8, 3), layout="constrained")
ax.plot(time, y[unseen], "0.6", lw=4, label="measured")
ax.plot(time, better.simulate(X[unseen], x0=y[unseen][:1]), "k", lw=1, label="with the named effects")
ax.set(xlabel="time / s", ylabel="T / °C")
ax.legend()
for name, model in ("simulator", simulator), ("corrected", better):
    error = y[unseen] - model.simulate(X[unseen], x0=y[unseen][:1])[:, 0]
    print(f"{name:10s} RMSE {np.sqrt(np.mean(error**2)):.3f} K")

# %%
# Save the result
# ---------------
# ``save_augmented`` writes names and numbers as text; ``load_augmented`` builds the corrected simulator again. The other
# notebook uses a corrected simulator in a controller.
file = Path(tempfile.mkdtemp()) / "tank.json"
save_augmented(better, file)
again = load_augmented(simulator, file)
print(np.array_equal(again.simulate(X[unseen]), better.simulate(X[unseen])))
