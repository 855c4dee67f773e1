"""
The first diagnosis: which effect is a simulator missing?
=========================================================

The twelve lines of the README. One constant of a reactor model is wrong. The figure shows a run that took no part
in the diagnosis: measured, simulated, and simulated with the effect that the diagnosis named.
"""

import matplotlib.pyplot as plt

from sksurrogate import GapDiagnoser, datasets

X, y, runs = datasets.make_reactor_runs(7, 200, noise=0.05, random_state=3)  # the real plant
simulator = datasets.make_reactor(second=60.0)  # a simulator with a wrong constant
new = runs == 6  # a run that takes no part in the diagnosis
diagnoser = GapDiagnoser(simulator, random_state=0).fit(X[~new], y[~new], groups=runs[~new])
print(diagnoser.report_)
fig, ax = plt.subplots(figsize=(8, 3), layout="constrained", subplot_kw={"xlabel": "sample", "ylabel": "concentration"})
ax.plot(y[new], "0.7", lw=5, label="real plant, unseen run")
for model, style, label in (simulator, "C1--", "simulator"), (diagnoser.augmented_, "k-", "with the named effect"):
    ax.plot(model.simulate(X[new], x0=y[new][:1]), style, label=label)
fig.legend(ncols=3, frameon=False, loc="outside upper center").figure.savefig("gap.png")
