"""
Which effect is a simulator missing?
====================================

The README's figure: a run left out of the fit, measured, from the simulator, and from the simulator with the effect that
the diagnosis named. The plant is Eq. (9) of the paper behind a slow actuator; the simulator does not know the actuator.
"""

import sys
from pathlib import Path

from sksurrogate.demo import story_actuator_and_sensor
from sksurrogate.exceptions import require

plt = require("matplotlib.pyplot", "plot")
story = story_actuator_and_sensor(noise=0.05, lag=0.12, offset=0.8)
print(story.report)

trace = story.report.traces[0]
figure, ax = plt.subplots(figsize=(8, 3), constrained_layout=True)
ax.plot(trace.t, trace.measured[:, 0], color="#8a8a8a", lw=3.5, label="measured")
ax.plot(trace.t, trace.before[:, 0], color="#d55e00", ls="--", label="simulator")
named = " + ".join(effect.name.replace("_", " ") for effect in story.report.effects)
ax.plot(trace.t, trace.after[:, 0], color="black", lw=1.2, label=f"with {named}")
ax.set(xlabel="time", ylabel="concentration y", title="A run left out of the fit", ylim=(0, 14))
ax.legend(ncols=3, frameon=False, loc="upper right")
if len(sys.argv) > 1:
    figure.savefig(Path(sys.argv[1]), dpi=130)
