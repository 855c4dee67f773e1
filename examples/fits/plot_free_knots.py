"""
Free knots: where should a few knots be?
========================================

Section 2.5 of Lie, *Surrogate and Hybrid Models for Control* (SIMS 2019): in theta Phi(x; omega) the places and
widths omega are fitted too. A curve with one steep front is fitted with six equidistant knots, with six free knots,
and with three free Gaussians. There are local minima: the last panel shows the result of each of twelve starts.
"""

import matplotlib.pyplot as plt
import numpy as np
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline

from sksurrogate.features import SplineFeatures
from sksurrogate.linear import NonlinearBasisRegressor

rng = np.random.default_rng(0)
x = np.sort(rng.uniform(0, 10, 150))[:, None]
fine = np.linspace(0, 10, 801)[:, None]


def front(x):
    """A slow wave and a front at 6.3."""
    return 0.5 * np.sin(0.6 * x[:, 0]) + np.tanh(6 * (x[:, 0] - 6.3))


y = front(x) + 0.05 * rng.normal(size=150)
models = {
    "6 equidistant knots": make_pipeline(SplineFeatures(n_knots=8, degree=3), LinearRegression(fit_intercept=False)),
    "6 free knots": NonlinearBasisRegressor("knots", n_basis=6, degree=3, n_starts=12, random_state=0),
    "3 free Gaussians": NonlinearBasisRegressor("gaussian", n_basis=3, n_starts=12, random_state=0),
}
figure, (curves, errors, starts) = plt.subplots(3, 1, figsize=(8, 9), constrained_layout=True)
curves.plot(x, y, ".", color="#56b4e9", markersize=4, label="data")
for color, (name, model) in zip(("#8a8a8a", "#d55e00", "#0072b2"), models.items()):
    miss = model.fit(x, y).predict(fine) - front(fine)
    print(f"{name:20} root mean squared distance from the truth {np.sqrt(np.mean(miss**2)):.3f}")
    curves.plot(fine, model.predict(fine), color=color, linewidth=1.2, label=name)
    errors.plot(fine, miss, color=color, linewidth=1.0)
    if isinstance(model, NonlinearBasisRegressor):
        starts.semilogy(np.sort(model.start_losses_), "o-", color=color, label=name)
for knot in models["6 free knots"].knots_[0]:
    errors.axvline(knot, color="#d55e00", linewidth=0.6, linestyle=":")
curves.set_ylabel("y")
curves.legend(frameon=False)
errors.set_ylabel("distance from the truth")
errors.set_xlabel("x (dotted: free knots)")
starts.set_ylabel("mean squared error")
starts.set_xlabel("start, best first (after 60 steps)")
starts.legend(frameon=False)
plt.show()
