"""
A two-link arm: which friction, and which motor is late?
========================================================

The model of an arm (MuJoCo) knows masses, lengths and damping. The real arm has dry friction in its elbow, and the drive
of its shoulder acts 30 ms late. Both are found from recorded angles. The friction goes into a patched model file; the
corrected simulator follows runs that took no part in the fit.
"""

import os
import tempfile

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import MuJoCoSimulator

MODEL = """
<mujoco model="arm">
  <option timestep="0.005" gravity="0 0 -9.81"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.3"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.35" mass="1.2"/>
      <body name="lower" pos="0 0 -0.35">
        <joint name="elbow" axis="0 1 0" damping="0.08" armature="0.01"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.6"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="shoulder_drive" joint="shoulder"/>
    <motor name="elbow_drive" joint="elbow"/>
  </actuator>
</mujoco>
"""
arm = MuJoCoSimulator(MODEL, outputs=["shoulder.pos", "elbow.pos"], dt=0.01)

# %%
# The recordings. The real arm is simulated too, so that the answer is known.

real = MuJoCoSimulator(MODEL, outputs=["shoulder.pos", "elbow.pos"], dt=0.01)
real = real.set_params(**{"params__elbow.frictionloss": 0.12})
rng = np.random.default_rng(0)
n_runs, n = 7, 160
torque = np.repeat(rng.uniform(-1, 1, size=(n_runs, n // 20, 2)), 20, axis=1) * [4.0, 1.0]
late = torque.copy()
late[:, 3:, 0], late[:, :3, 0] = torque[:, :-3, 0], torque[:, :1, 0]  # 30 ms
start = 0.3 * rng.normal(size=(n_runs, 4))
angle = np.stack([real.simulate(U, x0=x0) for U, x0 in zip(late, start)])
measured = angle + 2e-3 * rng.normal(size=angle.shape)
recorded, unseen = slice(0, 5), slice(5, 7)

# %%
# The diagnosis. ``effects=`` keeps the example short; without it the whole catalogue competes.

names = [
    "coulomb_friction",
    "stribeck_friction",
    "linear_loss",
    "parameter_error",
    "input_gain",
    "input_delay",
    "input_lag",
]
diagnoser = GapDiagnoser(arm, effects=names, random_state=0)
runs = np.repeat(np.arange(5), n)
report = diagnoser.fit(torque[recorded].reshape(-1, 2), measured[recorded].reshape(-1, 2), groups=runs).report_
print(report.sentence)
for effect in report.effects:
    print(effect)

# %%
# Effects that MJCF can express go into a model file. ``augmented_`` is the simulator with all effects.

patched, left = arm.as_parameters(diagnoser.augmented_.effects, diagnoser.augmented_.values)
with tempfile.TemporaryDirectory() as folder:
    text = patched.to_mjcf(os.path.join(folder, "patched.xml"))
print([line.strip() for line in text.splitlines() if 'name="elbow"' in line])
print("left to the simulator with effects:", [diagnoser.augmented_.effects[k].name for k in left])

# %%
# Runs that took no part in the fit, before and after.

before = np.stack([arm.simulate(U, x0=x0) for U, x0 in zip(torque[unseen], start[unseen])])
after = np.stack([diagnoser.augmented_.simulate(U, x0=x0) for U, x0 in zip(torque[unseen], start[unseen])])
for name, values in (("the model as it was", before), ("with both effects", after)):
    print(f"{name}: error of the angles {np.sqrt(np.mean((values - angle[unseen]) ** 2)):.4f} rad")

plt = require("matplotlib.pyplot", "plot")
figure, axes = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
t = 0.01 * np.arange(n)
for axis, joint, k in zip(axes, ("shoulder", "elbow"), range(2)):
    axis.plot(t, angle[5, :, k], color="#999999", linewidth=4, label="real arm")
    axis.plot(t, before[0, :, k], color="#d55e00", linestyle="--", label="model as it was")
    axis.plot(t, after[0, :, k], color="#0072b2", label="with both effects")
    axis.set(ylabel=f"{joint} / rad")
axes[-1].set(xlabel="time / s")
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", frameon=False, ncols=3)
