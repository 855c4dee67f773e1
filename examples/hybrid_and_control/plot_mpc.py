"""
Predictive control: can a surrogate control the plant?
======================================================

The plant is Eq. (9) of the paper. The surrogate is a hybrid: the linearisation at u = 0.15 plus a correction
learned from eight runs. It is exported as a CasADi function and used in a nonlinear model predictive controller.
IPOPT solves the problem at every sample, in milliseconds.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

from sksurrogate.compose import HybridRegressor
from sksurrogate.datasets import linear_reactor, make_reactor, make_reactor_runs
from sksurrogate.exceptions import MissingExtraError, require
from sksurrogate.export import state_space, to_casadi

try:
    ca = require("casadi", "casadi")
except MissingExtraError as error:
    print(f"Skipped: {error}")
    raise SystemExit(0) from None

plt.style.use("tableau-colorblind10")
HORIZON, N_STEPS, LOW, HIGH = 20, 150, 0.05, 0.25
X, y, groups = make_reactor_runs(8, 150, noise=0.02, random_state=0)
hybrid = HybridRegressor(linear_reactor(), n_lags=2, fade=float("inf")).fit(X, y, groups=groups)
graph = hybrid.to_graph(n_sub=1)
step = to_casadi(graph)
n = step.size1_in(0)

# %%
# A good fit is not enough for control: the slopes must be right too. Gain of the surrogate and of the plant:
for u in (0.1, 0.15, 0.2):
    gains = []
    for model in (graph, make_reactor()):
        at = state_space(model, [u], x0=None if model is graph else make_reactor().simulate(np.full((400, 1), u))[-1])
        gains.append((at.C @ np.linalg.solve(np.eye(len(at.x0)) - at.A, at.B) + at.D)[0, 0])
    print(f"u = {u}: dy/du at steady state {gains[0]:.1f} (surrogate), {gains[1]:.1f} (plant)")

# %%
# The controller: states and inputs over the horizon are unknowns, joined by the surrogate's step.
states, inputs = ca.MX.sym("x", n, HORIZON + 1), ca.MX.sym("u", 1, HORIZON)
start, target, last, shift = ca.MX.sym("start", n), ca.MX.sym("target"), ca.MX.sym("last"), ca.MX.sym("shift")
following, outputs = step.map(HORIZON)(states[:, :-1], inputs)
moves = inputs - ca.horzcat(last, inputs[:, :-1])
cost = ca.sumsqr(outputs[:, 1:] + shift - target) + 50.0 * ca.sumsqr(moves)
problem = {
    "x": ca.vertcat(ca.vec(states), ca.vec(inputs)),
    "p": ca.vertcat(start, target, last, shift),
    "f": cost,
    "g": ca.vertcat(states[:, 0] - start, ca.vec(states[:, 1:] - following)),
}
quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "expand": True, "ipopt.tol": 1e-6}
solver = ca.nlpsol("controller", "ipopt", problem, quiet)
low = np.r_[np.full(n * (HORIZON + 1), -np.inf), np.full(HORIZON, LOW)]
high = np.r_[np.full(n * (HORIZON + 1), np.inf), np.full(HORIZON, HIGH)]

# %%
# The loop: plant, measurement with noise, surrogate's state, offset of the surrogate, next input.
plant, rng = make_reactor(), np.random.default_rng(0)
targets = np.repeat([6.0, 8.5, 5.0], N_STEPS // 3)
level, u = np.array([5.57]), 0.15
state = hybrid.graph_state(np.array([[u]]))
guess = np.r_[np.tile(state, HORIZON + 1), np.full(HORIZON, u)]
levels, moves_made, seconds, offset = [], [], [], 0.0
for k in range(N_STEPS):
    measured = level[0] + 0.02 * rng.normal()
    offset += 0.2 * (measured - offset - graph(x=state, u=[u])["y"][0])  # what the surrogate does not know
    begun = time.perf_counter()
    solution = solver(x0=guess, p=np.r_[state, targets[k], u, offset], lbx=low, ubx=high, lbg=0.0, ubg=0.0)
    seconds.append(time.perf_counter() - begun)
    guess = np.array(solution["x"])[:, 0]
    u = float(guess[n * (HORIZON + 1)])
    levels.append(level[0])
    moves_made.append(u)
    state = graph(x=state, u=[u])["x_next"]
    level = plant.simulate(np.full((2, 1), u), x0=level)[1]

levels, settled = np.array(levels), np.arange(N_STEPS) % (N_STEPS // 3) >= 30
print(
    f"{N_STEPS} steps, horizon {HORIZON}: median {1e3 * np.median(seconds):.1f} ms a step, worst {1e3 * max(seconds):.1f} ms"
)
print(f"RMS distance from the target once settled: {np.sqrt(np.mean((levels - targets)[settled] ** 2)):.3f}")

# %%
t = plant.dt * np.arange(N_STEPS)
figure, (top, bottom) = plt.subplots(2, 1, sharex=True, figsize=(8, 4.5), layout="constrained")
top.step(t, targets, "--", color="0.5", where="post", label="target")
top.plot(t, levels, color="C0", label="plant")
top.set(ylabel="concentration y", title="The paper's plant under a controller that knows a hybrid surrogate")
top.legend(frameon=False)
bottom.step(t, moves_made, color="C1", where="post")
bottom.set(xlabel="time", ylabel="temperature u", ylim=(LOW - 0.01, HIGH + 0.01))
plt.show()
