"""
Penalties: what does each addition to least squares do?
=======================================================

Section 2.3 of the paper on one data set: a rising curve, few noisy data with a hole, and more splines than the data
can determine. Each panel adds one term to the squared error.
"""

import matplotlib.pyplot as plt
import numpy as np

from sksurrogate.features import SplineFeatures
from sksurrogate.linear import (
    CloseTo,
    Curvature,
    Monotone,
    OutputBounds,
    PCRRegressor,
    PenalizedRegressor,
    Ridge,
    Slope,
)


def truth(x):
    """A smooth step."""
    return np.tanh(4 * (x - 0.5))


rng = np.random.default_rng(3)
x = np.sort(np.r_[rng.uniform(0, 0.55, 30), rng.uniform(0.75, 1, 15)])
y = truth(x) + 0.2 * rng.normal(size=len(x))
X, line = x[:, None], np.linspace(0, 1, 401)[:, None]
splines = SplineFeatures(18, degree=3, knots=np.linspace(0, 1, 18))


def fit(penalties=None, constraints=None, alpha="gcv"):
    """Splines with what is added; lambda by generalised cross-validation."""
    return PenalizedRegressor(penalties, constraints, alpha, features=splines).fit(X, y)


a_little = Ridge(1e-4)
models = {
    "nothing: the slash operator": fit(alpha=0.0),
    "principal components": PCRRegressor("gcv", features=splines).fit(X, y),
    "ridge": fit([Ridge()]),
    "slope": fit([Slope(line), a_little]),
    "curvature": fit([Curvature(line), a_little]),
    "close to a straight line": fit([CloseTo(line, lambda p: 2 * p[:, 0] - 1)]),
    "rising": fit([a_little], [Monotone(line)], alpha=1.0),
    "within -1 and 1": fit([a_little], [OutputBounds(line, -1.0, 1.0)], alpha=1.0),
    "rising, within, little curvature": fit([Curvature(line), a_little], [Monotone(line), OutputBounds(line, -1, 1)]),
}
figure, panels = plt.subplots(3, 3, figsize=(10, 8), sharex=True, sharey=True, layout="constrained")
errors = {}
for axes, (name, model) in zip(panels.flat, models.items()):
    errors[name] = float(np.sqrt(np.mean((model.predict(line) - truth(line[:, 0])) ** 2)))
    axes.plot(x, y, ".", color="0.6", label="data")
    axes.plot(line, truth(line), "k--", lw=1, label="truth")
    axes.plot(line, model.predict(line), color="#0072b2", label="fit")
    axes.set(title=name, ylim=(-1.8, 1.8), xlabel="x", ylabel="y")
    axes.text(0.97, 0.05, f"error {errors[name]:.2f}", ha="right", transform=axes.transAxes)
    axes.label_outer()
    print(f"{name:35} root mean squared distance from the truth {errors[name]:.3f}")
figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
plt.show()
