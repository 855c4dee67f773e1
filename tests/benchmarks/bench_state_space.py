"""How fast and how good is a state-space fit with unknown initial states? StateSpaceRegressor and jax-sysid.

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_state_space.py [n_sets] --jax PYTHON``. jax-sysid pins old versions
and runs in the interpreter of an environment of its own. Both fit the same model, affine or affine plus one tanh layer
in f and in g, with the same penalty on the network's weights; whoever fitted it, the free run is judged from initial
states by least squares over the whole run (training) or the first 20 rows (test).
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

CASES = {
    "linear, 3 states, 2 x 2": (3, 0),
    "reactor, 1 state, 6 nodes": (1, 6),
    "oscillator, 2 states, 6 nodes": (2, 6),
}
ALPHA = 1e-5


def data(case, seed):
    """Scaled training and test runs, lists of (n_samples, n)."""
    from sksurrogate.datasets import make_reactor_runs, simulate_experiments
    from sksurrogate.physics import ODESimulator

    rng = np.random.default_rng(seed)
    if case.startswith("linear"):
        A = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag([0.95, 0.85, 0.7])
        B, C = rng.normal(size=(3, 2)), rng.normal(size=(2, 3))
        U, Y = rng.normal(size=(8, 250, 2)), np.empty((8, 250, 2))
        for r in range(8):
            x = 2 * rng.normal(size=3)
            for t in range(250):
                Y[r, t] = C @ x
                x = A @ x + B @ U[r, t]
        Y += 0.1 * Y.std() * rng.normal(size=Y.shape)
    elif case.startswith("reactor"):
        X, y, _ = make_reactor_runs(16, 150, noise=0.05, random_state=seed)
        U, Y = X.reshape(16, 150, 1), y.reshape(16, 150, 1)
    else:

        def rhs(t, x, u, p):
            return [x[1], -4 * x[0] - 2 * x[0] ** 3 - 0.8 * x[1] + 4 * u[0]]

        plant = ODESimulator(rhs, states=["q", "v"], inputs=["u"], outputs=["q"], params={}, dt=0.1)
        found = simulate_experiments(
            plant, {"q": (-1, 1), "v": (-1, 1)}, {"u": (-2, 2)}, n_runs=12, n_samples=200, noise=0.02, random_state=seed
        )
        U, Y = found.X.reshape(12, 200, 1), found.y.reshape(12, 200, 1)
    half = len(U) // 2
    U = (U - U[:half].mean(axis=(0, 1))) / U[:half].std(axis=(0, 1))
    Y = (Y - Y[:half].mean(axis=(0, 1))) / Y[:half].std(axis=(0, 1))
    return U[:half], Y[:half], U[half:], Y[half:]


def judged(theta, shape, U, Y, Ut, Yt):
    """RMSE of free runs on training and test runs."""
    from sksurrogate.kernels.state_model import StateModel
    from sksurrogate.kernels.state_space import simulate, start_states

    n, nodes, m, o = shape
    model = StateModel(n, m, o, (nodes,) if nodes else ())
    out = []
    for u, y, rows in ((U, Y, U.shape[1]), (Ut, Yt, 20)):
        x0 = start_states(model, theta, u[:, :rows], y[:, :rows], np.zeros(n), 1e-6 * np.eye(n), n_steps=30)
        starts, flat = np.arange(len(u)) * u.shape[1], u.reshape(-1, m)
        found = model.output(theta, simulate(model, theta, x0, flat, starts), flat).reshape(y.shape)
        skip = 0 if rows == U.shape[1] and u is U else rows
        out.append(float(np.sqrt(np.mean((found - y)[:, skip:] ** 2))))
    return out


def ours(shape, U, Y, seed):
    """Seconds and parameters; the whole fit of the estimator counts."""
    from sksurrogate.compose import StateSpaceRegressor

    n, nodes, m, o = shape
    hidden = (nodes,) if nodes else ()
    model = StateSpaceRegressor(n, hidden_layer_sizes=hidden, alpha=ALPHA, max_iter=200, random_state=seed)
    groups = np.repeat(np.arange(len(U)), U.shape[1])
    start = time.perf_counter()
    model.fit(U.reshape(-1, m), Y.reshape(-1, o), groups=groups)
    return time.perf_counter() - start, model.theta_


def jax_fit(path):
    """Run in the environment of jax-sysid: data from a file, parameters and seconds to another."""
    import jax
    import jax.numpy as jnp
    from jax_sysid.models import LinearModel, Model

    jax.config.update("jax_enable_x64", True)
    given = np.load(path)
    U, Y, seed, (n, nodes, m, o) = given["U"], given["Y"], int(given["seed"]), given["shape"].tolist()
    rng = np.random.default_rng(seed)
    start = time.perf_counter()
    if not nodes:
        model = LinearModel(n, o, m, feedthrough=False)
        model.loss(rho_x0=1e-4, rho_th=1e-6)
        model.optimization(adam_epochs=500, lbfgs_epochs=1000, iprint=-1)
        model.fit(list(Y), list(U))
        A, B, C, _ = model.ssdata()
        parts = [np.concatenate([A, B], axis=1).T, np.zeros(n), np.asarray(C).T, np.zeros(o)]
    else:
        sizes = [(n + m, n), (n,), (n + m, nodes), (nodes,), (nodes, n), (n,)]
        sizes += [(n, o), (o,), (n, nodes), (nodes,), (nodes, o), (o,)]

        def state_fcn(x, u, p):
            z = jnp.concatenate([x, u])
            return z @ p[0] + p[1] + jnp.tanh(z @ p[2] + p[3]) @ p[4] + p[5]

        def output_fcn(x, u, p):
            return x @ p[6] + p[7] + jnp.tanh(x @ p[8] + p[9]) @ p[10] + p[11]

        model = Model(n, o, m, state_fcn=state_fcn, output_fcn=output_fcn)
        first = [0.3 * rng.normal(size=size) for size in sizes]
        first[0][:n] = 0.5 * np.eye(n)
        model.init(params=first)
        model.loss(
            rho_x0=1e-6, rho_th=0.0,
            custom_regularization=lambda p, x0: ALPHA * sum(jnp.sum(p[k] ** 2) for k in (2, 4, 8, 10)),
        )  # fmt: skip
        model.optimization(adam_eta=0.01, adam_epochs=500, lbfgs_epochs=2000, iprint=-1)
        model.fit(list(Y), list(U))
        parts = model.params
    theta = np.concatenate([np.asarray(part).ravel() for part in parts]).tolist()
    Path(path).with_suffix(".json").write_text(json.dumps({"seconds": time.perf_counter() - start, "theta": theta}))


def by_jax(python, shape, U, Y, seed):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.npz"
        np.savez(path, U=U, Y=Y, seed=seed, shape=shape)
        subprocess.run([python, __file__, "--fit", str(path)], check=True, capture_output=True)
        found = json.loads(path.with_suffix(".json").read_text())
    return found["seconds"], np.asarray(found["theta"])


def main(n_sets, python):
    peers = {"StateSpaceRegressor": ours}
    if python:
        peers["jax-sysid"] = lambda *args: by_jax(python, *args)
    print("| case | data set | fit | s | train | test |\n|---|---|---|---|---|---|")
    for case, (n, nodes) in CASES.items():
        for seed in range(n_sets):
            sets = data(case, 9000 + seed)
            shape = (n, nodes, sets[0].shape[2], sets[1].shape[2])
            for name, fit in peers.items():
                seconds, theta = fit(shape, *sets[:2], seed)
                train, test = judged(theta, shape, *sets)
                print(f"| {case} | {seed} | {name} | {seconds:.2f} | {train:.4f} | {test:.4f} |", flush=True)


if __name__ == "__main__":
    if "--fit" in sys.argv:
        jax_fit(sys.argv[-1])
    else:
        where = sys.argv.index("--jax") if "--jax" in sys.argv else None
        count = next((int(a) for a in sys.argv[1:2] if a.isdigit()), 4)
        main(count, sys.argv[where + 1] if where else None)
