"""
FMU: what can be said about a model that comes as a binary?
===========================================================

A unit for co-simulation without a copy of its state gives trajectories and nothing else. It has no equation and no
state to which a term could be added. Effects on inputs, sensors and parameters can still be found, and the report says
what could not be tested. The script builds the unit from Eq. (9) of the paper. The plant is the same reactor with an
analyser that reads half a unit high.
"""

import tempfile
import warnings
from pathlib import Path

from sksurrogate.datasets import make_reactor_runs
from sksurrogate.exceptions import SurrogateError, require
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import FMUSimulator

SOURCE = """
from math import exp
from pythonfmu import Fmi2Causality, Fmi2Initial, Fmi2Slave, Fmi2Variability, Real


class Reactor(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.y, self.feed = 0.15, 4.0, 4.0
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output, initial=Fmi2Initial.exact))
        self.register_variable(Real("feed", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, current_time, step_size):
        n = 8
        for _ in range(n):
            rate = exp(-1 / self.u)
            half = self.y + step_size / n / 2 * (2 * (self.feed - self.y) - 100 * rate * self.y**2 + 1000 * rate * self.y)
            self.y += step_size / n * (2 * (self.feed - half) - 100 * rate * half**2 + 1000 * rate * half)
        return True
"""

try:
    builder = require("pythonfmu.builder", "fmu")
    require("fmpy", "fmu")
except SurrogateError as error:
    print(f"Skipped: {error}")
    raise SystemExit(0) from None

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    folder = Path(tempfile.mkdtemp())
    (folder / "reactor.py").write_text(SOURCE)
    builder.FmuBuilder.build_FMU(folder / "reactor.py", dest=folder)

simulator = FMUSimulator(
    folder / "Reactor.fmu", inputs=["u"], outputs=["y"], initial=["y"], params={"feed": 4.0}, dt=0.02
)
X, y, runs = make_reactor_runs(4, 100, u_range=(0.1, 0.2), y0_range=(4.0, 4.0), noise=0.02, random_state=0)
y = y + 0.5

diagnoser = GapDiagnoser(simulator, effects=["sensor_bias", "sensor_gain", "input_bias", "input_delay"], random_state=0)
diagnoser.fit(X, y, groups=runs)
print(diagnoser.report_)

# %%
# Measured, the unit alone, and the unit with the named effect.
plt = require("matplotlib.pyplot", "plot")
trace = diagnoser.report_.traces[0]
figure, ax = plt.subplots(figsize=(8, 3.2), constrained_layout=True)
ax.plot(trace.t, trace.measured[:, 0], color="#8a8a8a", lw=3.5, label="measured")
ax.plot(trace.t, trace.before[:, 0], color="#d55e00", ls="--", label="unit")
ax.plot(trace.t, trace.after[:, 0], color="black", lw=1.2, label="unit with the named effect")
ax.set(xlabel="time", ylabel="concentration y", title="A run left out of the fit")
ax.margins(x=0)
ax.legend(frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.22))
