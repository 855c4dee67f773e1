"""
Withheld effects: would the diagnosis have found them?
======================================================

A diagnosis can be tested where the truth is known. The check draws plants with an effect that their simulator lacks
and seals the truth. Another process makes the diagnosis. Then the truth is opened.
"""

import os

from sksurrogate.blind import run_blind_check
from sksurrogate.exceptions import require

cases = int(os.environ.get("SKSURROGATE_EXAMPLE_CASES", "4"))
result = run_blind_check(cases, ["effect", "none"], seed=7)
for row in result.rows:
    truths = [f"{t['name']} at {t['location']}" for t in row["truths"]] or ["nothing"]
    named = [f"{e['name']} at {e['location']}" for e in row["effects"]] or ["nothing"]
    print(
        f"{row['plant']}, {row['excitation']}: {truths[0]} is missing; {row['verdict']}, named: {' and '.join(named)}"
    )
print(result.to_markdown())

# %%
# The share of the free-run error that is gone on held-out runs, compared with the true effect refitted (the oracle).

plt = require("matplotlib.pyplot", "plot")
found = [row for row in result.rows if row.get("shrink") is not None]
figure, axes = plt.subplots(figsize=(7, 1.4 + 0.6 * len(found)), layout="constrained")
labels = [f"{row['plant']}\n{row['truths'][0]['name']}" for row in found]
axes.barh(
    [k - 0.2 for k in range(len(found))],
    [row["shrink"] for row in found],
    height=0.35,
    color="#0072b2",
    label="diagnosis",
)
axes.barh(
    [k + 0.2 for k in range(len(found))],
    [row["oracle"] or 0 for row in found],
    height=0.35,
    color="#e69f00",
    label="true effect, refitted (oracle)",
)
axes.set(yticks=range(len(found)), yticklabels=labels, xlim=(0, 1.02), xlabel="share of the error that is gone")
figure.legend(loc="outside lower center", ncols=2, frameon=False)
