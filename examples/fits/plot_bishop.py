"""
Networks: how well do five tanh nodes fit a parabola, a corner, a wave and a step?
==================================================================================

Bishop's experiment (section 3.5 of Lie, *Surrogate and Hybrid Models for Control*, SIMS 2019): one hidden layer of
five tanh nodes, a linear output, and 50 points in [-1, 1]. Adam, as in the paper, leaves visible errors.
Quasi-Newton is far better, as Bishop says. Levenberg-Marquardt with an eliminated output layer is better still, in
a small part of Adam's time.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

from sksurrogate.neural import FNNRegressor

x = np.linspace(-1, 1, 50)[:, None]
fine = np.linspace(-1, 1, 401)[:, None]
functions = {
    "$x^2$": x[:, 0] ** 2,
    "$|x|$": np.abs(x[:, 0]),
    r"$\sin 2\pi x$": np.sin(2 * np.pi * x[:, 0]),
    "$2H_0(x) - 1$": 2.0 * (x[:, 0] >= 0) - 1.0,
}
solvers = {
    "Adam, 1000 epochs": FNNRegressor(
        solver="adam", learning_rate=0.01, net_params={"optimizer__betas": (0.99, 0.999)}, random_state=0
    ),
    "L-BFGS": FNNRegressor(solver="lbfgs", random_state=0),
    "least squares": FNNRegressor(random_state=0),
}
colors = {"Adam, 1000 epochs": "#8a8a8a", "L-BFGS": "#0072b2", "least squares": "#d55e00"}
styles = {"Adam, 1000 epochs": "-", "L-BFGS": "--", "least squares": ":"}

figure, axes = plt.subplots(2, 4, figsize=(13, 6), sharex=True, constrained_layout=True)
for (title, y), above, below in zip(functions.items(), *axes):
    above.plot(x, y, "o", color="#56b4e9", markersize=4, label="data")
    for name, model in solvers.items():
        begun = time.perf_counter()
        model.fit(x, y)
        seconds = time.perf_counter() - begun
        error = np.mean((model.predict(x) - y) ** 2)
        print(f"{title:16} {name:18} {1e3 * seconds:7.1f} ms   mean squared error {error:.1e}")
        above.plot(fine, model.predict(fine), styles[name], color=colors[name], linewidth=1.6, label=name)
        below.semilogy(x, np.abs(model.predict(x) - y) + 1e-17, ".-", color=colors[name], linewidth=0.8)
    above.set_title(title)
    below.set_ylim(1e-17, 10)
    below.set_xlabel("x")
axes[0, 0].set_ylabel("y")
axes[1, 0].set_ylabel("absolute error at the data")
figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
plt.show()
