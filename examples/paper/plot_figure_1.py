"""
Splines: how do pulses and triangles pass through ten points? (Figure 1)
========================================================================

Figure 1 of Lie, *Surrogate and Hybrid Models for Control* (SIMS 2019). Above: splines of order zero and one,
centred at ten regularly spaced data. Below: the least-squares fits with them. Ten splines interpolate ten data.
Noisy data need fewer splines: the last panel has 200 noisy points and eight cubic splines.
"""

import matplotlib.pyplot as plt
import numpy as np
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline

from sksurrogate.features import HeavisideFeatures, SplineFeatures

rng = np.random.default_rng(4)
x = np.arange(1.0, 11.0)[:, None]
y = rng.uniform(0.2, 1.0, size=10)
fine = np.linspace(0.5, 10.5, 2001)[:, None]


def regression(features):
    """Least squares on features, without an intercept: y = theta phi(x)."""
    return make_pipeline(features, LinearRegression(fit_intercept=False))


pulses = SplineFeatures(degree=0, knots="data", extrapolation="zero").fit(x)
teeth = SplineFeatures(degree=1, knots="data").fit(x)
f0, f1 = (regression(features).fit(x, y) for features in (pulses, teeth))

# Remark 1: each pulse is the difference of two neighbouring unit steps
steps = HeavisideFeatures("data").fit(x).transform(fine)
inside = fine[:, 0] < 10.5
assert np.array_equal((steps[:, :-1] - steps[:, 1:])[inside], pulses.transform(fine)[inside])
assert np.allclose(f0.predict(x), y) and np.allclose(f1.predict(x), y)

figure, (above, below, noisy) = plt.subplots(3, 1, figsize=(8, 9), constrained_layout=True)
for j, (pulse, tooth) in enumerate(zip(pulses.transform(fine).T, teeth.transform(fine).T)):
    style = "-" if j % 2 == 0 else ":"
    above.plot(fine, pulse, style, color="#d55e00", linewidth=1.2, label=r"$\phi^{(0)}_j$" if j == 0 else None)
    above.plot(fine, tooth, style, color="#0072b2", linewidth=1.2, label=r"$\phi^{(1)}_j$" if j == 0 else None)
below.plot(fine, f0.predict(fine), color="#d55e00", label="$f_0(x)$, pulses")
below.plot(fine, f1.predict(fine), color="#0072b2", label="$f_1(x)$, saw teeth")
for axes in (above, below):
    axes.plot(x, y, "o", color="#000000", label="data", zorder=1)
    axes.set_ylim(-0.05, 1.1)
above.set_title("Splines centred at the data")
below.set_title("Interpolation: as many splines as data")

many = np.sort(rng.uniform(1, 10, 200))[:, None]
truth = 0.6 + 0.35 * np.sin(fine[:, 0])
measured = 0.6 + 0.35 * np.sin(many[:, 0]) + 0.15 * rng.normal(size=200)
curve = regression(SplineFeatures(n_knots=6, degree=3, extrapolation="linear")).fit(many, measured)
noisy.plot(many, measured, ".", color="#8a8a8a", markersize=4, label="data with noise")
noisy.plot(fine, truth, "--", color="#000000", label="truth")
noisy.plot(fine, curve.predict(fine), color="#009e73", label="least squares, 8 cubic splines")
noisy.set_title("Smoothing: fewer splines than data")
for axes in (above, below, noisy):
    axes.set(xlim=(0.3, 10.7), xlabel="x", ylabel="y")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
plt.show()
