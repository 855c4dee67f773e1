"""
A surrogate for control
=======================

A controller needs a model that predicts many steps ahead, and whose slopes are right. This notebook learns such a model from
recorded runs, checks both, and closes the loop.
"""

# %%
# Experiments
# -----------
# The plant is the reactor of the paper, Eq. (9): input u, output y, sample time 0.02. Twelve runs with steps of u; the last four
# judge the models.
import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import solve_discrete_are
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from sksurrogate.compose import RecursivePredictor
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.export import state_space, to_graph

X, y, runs = make_reactor_runs(12, 200, u_range=(0.08, 0.2), noise=0.02, random_state=0)
train, test = runs < 8, runs >= 8

# %%
# Compare models in free run
# --------------------------
# One step ahead every model looks perfect. The free run starts from two measured rows and then uses its own predictions, as a
# controller does.
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
# An optimiser follows the slope of the model. ``state_space`` gives A, B, C, D exactly. The gain at rest must be that of the plant.
# The fit one step ahead is as good in free run, but its gain at u = 0.1 is wrong; the fit through the free run (``"shooting"``) has it.
plant = make_reactor()


def steady_gain(model, u, x0=None):
    at = state_space(model, [u], x0)
    return (at.C @ np.linalg.solve(np.eye(len(at.A)) - at.A, at.B) + at.D)[0, 0]


for u in (0.1, 0.12):
    gains = {name: steady_gain(one, u) for name, one in (("plant", plant), *candidates.items())}
    print(f"u = {u}:", ", ".join(f"{name} {gain:.1f}" for name, gain in gains.items()))

# %%
# Close the loop
# --------------
# A linear-quadratic regulator at u = 0.12. The state of the surrogate is its past outputs and inputs, so it is known without an
# observer.
local = state_space(model, [0.12])
Q, R = local.C.T @ local.C + 1e-6 * np.eye(len(local.A)), np.array([[1e3]])
P = solve_discrete_are(local.A, local.B, Q, R)
K = np.linalg.solve(R + local.B.T @ P @ local.B, local.B.T @ P @ local.A)

step = to_graph(model)
level, x = 12.0, local.x0.copy()
x[:2] = level
outputs, inputs = [], []
for _ in range(150):
    u = np.clip(0.12 - K @ (x - local.x0), 0.05, 0.25)
    outputs.append(level)
    inputs.append(u[0])
    x = step(x=x, u=u)["x_next"].copy()
    x[0] = level  # the measured output in the place of the predicted one
    level = plant.simulate([u, u], x0=[level])[-1, 0]

# %%
# The same start without control, for comparison:
free = plant.simulate(np.full((150, 1), 0.12), x0=[12.0])[:, 0]
figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 4.5), sharex=True, layout="constrained")
top.plot(free, "C1--", label="u constant")
top.plot(outputs, "k", label="with the regulator")
top.axhline(local.y0[0], color="0.7", zorder=0, label="target")
top.set(ylabel="y")
top.legend()
bottom.step(range(150), inputs, "k", where="post")
bottom.set(xlabel="sample", ylabel="u")
print(
    f"after 20 samples: {abs(outputs[20] - local.y0[0]):.2f} off the target, without control {abs(free[20] - local.y0[0]):.2f}"
)
