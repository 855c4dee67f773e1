"""
Which effect is a simulator missing?
====================================

The README's twelve lines: a run that took no part in the fit, measured, from the simulator, and from the simulator with what the
diagnosis named.
"""

import matplotlib.pyplot as plt

from sksurrogate import GapDiagnoser, datasets

plt.rcParams.update({"figure.figsize": (8, 3.2), "figure.constrained_layout.use": True})
X, y, runs = datasets.make_reactor_runs(7, 200, noise=0.05, random_state=3)  # the real plant ...
simulator = datasets.make_reactor(second=60.0)  # ... and a simulator that is wrong
new = runs == 6
diagnoser = GapDiagnoser(simulator, random_state=0).fit(X[~new], y[~new], groups=runs[~new])
print(diagnoser.report_)
plt.plot(y[new], "0.6", lw=4, label="real plant, unseen run")
for model, style, label in (simulator, "C1--", "simulator"), (diagnoser.augmented_, "k-", "with the named effect"):
    plt.plot(model.simulate(X[new], x0=y[new][:1]), style, label=label)
plt.gca().set(xlabel="sample", ylabel="concentration y", ylim=(4, 17))
plt.legend(ncols=3, frameon=False).figure.savefig("gap.png")
