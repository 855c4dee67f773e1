"""
A surrogate for control
=======================

A controller needs a model that predicts many steps ahead and has the right slopes. This notebook learns such a model from
recorded runs, checks both, and closes the loop. It compares the controller with those of a wrong and of a corrected simulator.
"""

# %%
# Experiments
# -----------
# The plant is the reactor of the paper, Eq. (9): input u, output y, sample time 0.02. There are twelve runs with steps of u. The
# last four are for tests.
import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import solve_discrete_are
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from sksurrogate import GapDiagnoser
from sksurrogate.compose import RecursivePredictor
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.export import state_space, to_graph

X, y, runs = make_reactor_runs(12, 200, u_range=(0.08, 0.2), noise=0.02, random_state=0)
train, test = runs < 8, runs >= 8

# %%
# Compare models in free run
# --------------------------
# One step ahead every model looks perfect. The free run starts from two measured rows and then uses its own predictions, like a
# controller.
candidates = {}
for degree, loss in (1, "one_step"), (3, "one_step"), (3, "shooting"):
    learner = make_pipeline(StandardScaler(), PolynomialFeatures(degree), Ridge(1e-6))
    model = RecursivePredictor(learner, input_lags=2, output_lags=2, loss=loss)
    model.fit(X[train], y[train], groups=runs[train])
    ahead = model.predict_one_step(X[test], y[test], groups=runs[test])
    known = np.isfinite(ahead)
    one_step = 1 - np.mean((y[test] - ahead)[known] ** 2) / np.var(y[test])
    candidates[degree, loss] = model
    print(
        f"degree {degree}, {loss}: R2 one step {one_step:.4f}, free run {model.score(X[test], y[test], groups=runs[test]):.4f}"
    )

one = runs == 9
figure, ax = plt.subplots(figsize=(8, 3), layout="constrained")
ax.plot(y[one], "0.6", lw=4, label="plant, unseen run")
ax.plot(candidates[1, "one_step"].predict(X[one], y0=y[one][:2]), "C1--", label="degree 1, free run")
ax.plot(model.predict(X[one], y0=y[one][:2]), "k", lw=1, label="degree 3, free run")
ax.set(xlabel="sample", ylabel="y")
ax.legend()

# %%
# Are the slopes right?
# ---------------------
# A controller follows the slope of the model. ``state_space`` gives A, B, C, D exactly. The gain at rest must be that of the plant.
# The one-step fit of degree 3 has a good free run, but its gain at u = 0.1 is wrong. The fit through the free run (``"shooting"``)
# has the right gain.
plant = make_reactor()


def steady_gain(model, u):
    at = state_space(model, [u])
    return (at.C @ np.linalg.solve(np.eye(len(at.A)) - at.A, at.B) + at.D)[0, 0]


for u in (0.1, 0.12):
    gains = {name: steady_gain(one, u) for name, one in (("plant", plant), *candidates.items())}
    print(f"u = {u}:", ", ".join(f"{name} {gain:.1f}" for name, gain in gains.items()))

# %%
# Design a controller
# -------------------
# The output must follow a target: 5, then 7, then 6. Three models design the controller: a simulator with a wrong constant (60; the
# plant has 100), the same simulator corrected by a diagnosis of the training runs, and the surrogate.
nominal = make_reactor(second=60.0)
diagnoser = GapDiagnoser(nominal, random_state=0).fit(X[train], y[train], groups=runs[train])
print(diagnoser.report_.sentence)
models = {"nominal simulator": nominal, "corrected simulator": diagnoser.augmented_, "surrogate": model}

# %%
# For each target, Newton's method finds the input at which the model rests there. A linear-quadratic regulator acts around this
# point. Its weights follow Bryson's rule: an error of 0.2 in y counts as much as a move of 0.02 in u.
weight = (0.2 / 0.02) ** 2


def design(model, target):
    u = 0.14
    for _ in range(4):
        at = state_space(model, [u])
        u += (target - at.y0[0]) / (at.C @ np.linalg.solve(np.eye(len(at.A)) - at.A, at.B) + at.D)[0, 0]
    P = solve_discrete_are(at.A, at.B, at.C.T @ at.C + 1e-9 * np.eye(len(at.A)), np.array([[weight]]))
    return u, at.x0, np.linalg.solve(weight + at.B.T @ P @ at.B, at.B.T @ P @ at.A)[0]


# %%
# Close the loop
# --------------
# All controllers act on the same plant, with a noise of 0.02 on the measured output. The state of a simulator is the output. The
# state of the surrogate holds past outputs and inputs, so no observer is needed.
targets = np.repeat([5.0, 7.0, 6.0], 60)


def close_the_loop(model):
    designs, step = {target: design(model, target) for target in np.unique(targets)}, to_graph(model)
    noise, level = np.random.default_rng(1), 4.3
    x = designs[5.0][1].copy()
    x[: min(2, len(x))] = level
    outputs, inputs = [], []
    for target in targets:
        u0, x0, K = designs[target]
        u = np.clip(u0 - K @ (x - x0), 0.05, 0.25)
        outputs.append(level)
        inputs.append(u)
        past, level = level, plant.simulate([[u], [u]], x0=[level])[-1, 0]
        x = step(x=x, u=[u])["x_next"].copy()
        x[0] = (
            level if len(x) == 1 else past
        ) + 0.02 * noise.normal()  # the measured output replaces the predicted one
    return np.array(outputs), np.array(inputs)


loops = {name: close_the_loop(model) for name, model in models.items()}
figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
top.plot(targets, "0.7", lw=4, label="target")
for (name, (outputs, inputs)), style in zip(loops.items(), ("C1--", "k", "C0:")):
    top.plot(outputs, style, label=name)
    bottom.plot(inputs, style, drawstyle="steps-post")
    error = outputs - targets
    print(
        f"{name:20s} RMS error {np.sqrt(np.mean(error**2)):.3f}, at the ends of the steps {np.abs(error[59::60]).mean():.3f}"
    )
top.set(ylabel="y")
bottom.set(xlabel="sample", ylabel="u")
figure.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)

# %%
# The nominal simulator misses every target, because its input at rest is wrong. The corrected simulator and the surrogate reach the
# targets.
