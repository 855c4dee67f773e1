"""How fast and how good is a fit on the free run? RecursivePredictor, torch (BPTT, L-BFGS) and jax-sysid.

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_shooting.py [n_sets] [--jax PYTHON]``. jax-sysid pins old versions and
runs in the interpreter of an environment of its own. All minimise one objective, ``sum e^2 + alpha * sum w^2`` in scaled
numbers from the same first rows; alpha is chosen by RecursivePredictor on runs left out, before anybody fits.

With ``--settings``: each with its own settings, ours with the penalty by the evidence, jax-sysid with the penalty and the steps of its
documentation (once with the measured first rows, once with starts that it fits). Noise of 0, 0.03 and 0.12 of their spread in turn on the outputs; the
test is against the outputs without noise, from noisy first rows. Processor seconds, one thread.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

LAGS, NODES, STEPS = 5, 3, 200
#: Of the outputs, in units of their spread (near 0.05 and 0.2 in units of the plant), and the ways of jax-sysid to start, for fits with settings of their own.
NOISES, JAX_STARTS = (0.0, 0.03, 0.12), ("starts measured", "starts fitted")


def data(seed, n_train=8):
    """Scaled training and test runs, (n_runs, n_steps) each."""
    from sksurrogate.datasets import make_reactor_runs

    sets = []
    for n_runs, key in ((n_train, seed), (20, seed + 5000)):
        X, y, _ = make_reactor_runs(n_runs, STEPS, random_state=key)
        sets += [X.reshape(n_runs, STEPS), y.reshape(n_runs, STEPS)]
    U, Y, Ut, Yt = sets
    return (U - U.mean()) / U.std(), (Y - Y.mean()) / Y.std(), (Ut - U.mean()) / U.std(), (Yt - Y.mean()) / Y.std()


def free_run(weights, U, first):
    """Free run of (w0, b0, w1, b1), whoever fitted it; past outputs then inputs, newest first."""
    w0, b0, w1, b1 = weights
    y = np.empty(U.shape)
    y[:, :LAGS] = first
    for t in range(LAGS, U.shape[1]):
        phi = np.concatenate([y[:, t - LAGS : t][:, ::-1], U[:, t - LAGS : t + 1][:, ::-1]], axis=1)
        y[:, t] = (np.tanh(phi @ w0 + b0) @ w1 + b1)[:, 0]
    return y


def judged(weights, alpha, U, Y, Ut, Yt):
    """Objective, and the free run's RMSE on training and test runs."""
    error, test = (free_run(weights, V, Z[:, :LAGS])[:, LAGS:] - Z[:, LAGS:] for V, Z in ((U, Y), (Ut, Yt)))
    objective = (error**2).sum() + alpha * ((weights[0] ** 2).sum() + (weights[2] ** 2).sum())
    return float(objective), float(np.sqrt(np.mean(error**2))), float(np.sqrt(np.mean(test**2)))


def ours(U, Y, alpha, seed, clock="perf_counter", **more):
    """Seconds and weights; the whole fit of the estimator counts."""
    from sklearn.neural_network import MLPRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    from sksurrogate.compose import RecursivePredictor

    net = MLPRegressor(hidden_layer_sizes=(NODES,), activation="tanh", solver="lbfgs", max_iter=2000, random_state=seed)
    model = RecursivePredictor(
        make_pipeline(StandardScaler(), net), LAGS, LAGS, loss="shooting", alpha=alpha, random_state=seed, **more
    )
    groups = np.repeat(np.arange(len(U)), STEPS)
    start = getattr(time, clock)()
    model.fit(U.reshape(-1, 1), Y.ravel(), groups=groups)
    seconds = getattr(time, clock)() - start
    net = model._lag_net().net.folded()
    return seconds, (net.weights[0], net.biases[0], net.weights[1], net.biases[1])


def chosen_alpha(U, Y, seed):
    """The penalty that ``alpha="auto"`` takes: by free runs left out, and by what is forgotten."""
    from sklearn.neural_network import MLPRegressor

    from sksurrogate.compose import RecursivePredictor

    net = MLPRegressor(hidden_layer_sizes=(NODES,), activation="tanh", solver="lbfgs", max_iter=2000)
    model = RecursivePredictor(net, LAGS, LAGS, loss="shooting", alpha="auto", random_state=seed)
    return model.fit(U.reshape(-1, 1), Y.ravel(), groups=np.repeat(np.arange(len(U)), STEPS)).alpha_


def torch_fit(U, Y, alpha, seed):
    """Backpropagation through time with L-BFGS."""
    import torch

    torch.manual_seed(seed)
    u, y = torch.tensor(U), torch.tensor(Y)
    shapes = [(2 * LAGS + 1, NODES), (NODES,), (NODES, 1), (1,)]
    weights = [(0.1 * torch.randn(shape, dtype=torch.float64)).requires_grad_() for shape in shapes]
    start = time.perf_counter()
    past_u = u.unfold(1, LAGS + 1, 1).flip(2)

    def objective():
        w0, b0, w1, b1 = weights
        shares = past_u @ w0[LAGS:] + b0
        window, out = y[:, :LAGS].flip(1), []
        for t in range(U.shape[1] - LAGS):
            new = torch.tanh(window @ w0[:LAGS] + shares[:, t]) @ w1 + b1
            out.append(new)
            window = torch.cat([new, window[:, :-1]], dim=1)
        error = torch.cat(out, dim=1) - y[:, LAGS:]
        return (error**2).sum() + alpha * ((w0**2).sum() + (w1**2).sum())

    solver = torch.optim.LBFGS(
        weights, max_iter=300, history_size=20, line_search_fn="strong_wolfe", tolerance_change=1e-12
    )

    def closure():
        solver.zero_grad()
        value = objective()
        value.backward()
        return value

    solver.step(closure)
    return time.perf_counter() - start, tuple(w.detach().numpy() for w in weights)


def jax_fit(path):
    """Run in the environment of jax-sysid: data from a file, weights and seconds to another."""
    import jax
    import jax.numpy as jnp
    from jax_sysid.models import Model

    jax.config.update("jax_enable_x64", True)
    given = np.load(path)
    U, Y, alpha, seed, how = given["U"], given["Y"], float(given["alpha"]), int(given["seed"]), str(given["how"])
    start, busy = time.perf_counter(), time.process_time()

    def state_fcn(x, u, p):  # state: past outputs, past inputs, newest first
        phi = jnp.concatenate([x[:LAGS], u, x[LAGS:]])
        new = jnp.tanh(phi @ p[0] + p[1]) @ p[2] + p[3]
        return jnp.concatenate([new, x[: LAGS - 1], u, x[LAGS : 2 * LAGS - 1]])

    model = Model(2 * LAGS, 1, 1, state_fcn=state_fcn, y_in_x=True)
    rng = np.random.default_rng(seed)
    shapes = [(2 * LAGS + 1, NODES), (NODES,), (NODES, 1), (1,)]
    x0 = [np.concatenate([y[:LAGS][::-1], u[:LAGS][::-1]]) for u, y in zip(U, Y)]
    model.init(params=[0.1 * rng.normal(size=shape) for shape in shapes], x0=x0)
    if how == "one objective":
        model.loss(
            output_loss=lambda found, wanted: jnp.sum((found - wanted) ** 2),
            rho_th=0.0,
            train_x0=False,
            custom_regularization=lambda p, x0: alpha * (jnp.sum(p[0] ** 2) + jnp.sum(p[2] ** 2)),
        )
        model.optimization(adam_eta=0.01, adam_epochs=500, lbfgs_epochs=1000, iprint=-1)
    else:  # as in its documentation
        model.loss(rho_x0=1e-4, rho_th=1e-4, train_x0=how == "starts fitted")
        model.optimization(adam_epochs=1000, lbfgs_epochs=1000, iprint=-1)
    rows = [np.concatenate([u[LAGS:], u[-1:]])[:, None] for u in U]
    model.fit([y[LAGS - 1 :, None] for y in Y], rows)
    weights = [np.asarray(part).tolist() for part in model.params]
    spent = {"seconds": time.perf_counter() - start, "processor": time.process_time() - busy}
    Path(path).with_suffix(".json").write_text(json.dumps({**spent, "weights": weights}))


def by_jax(python, U, Y, alpha, seed, how="one objective", clock="seconds"):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.npz"
        np.savez(path, U=U, Y=Y, alpha=alpha, seed=seed, how=how)
        one_thread = {**os.environ, "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"}
        subprocess.run([python, __file__, "--fit", str(path)], check=True, capture_output=True, env=one_thread)
        found = json.loads(path.with_suffix(".json").read_text())
    return found[clock], tuple(np.asarray(part) for part in found["weights"])


def main(n_sets, python):
    peers = {"RecursivePredictor": ours, "torch L-BFGS": torch_fit}
    if python:
        peers["jax-sysid"] = lambda *args: by_jax(python, *args)
    print("| data set | alpha | fit | s | objective | train | test |\n|---|---|---|---|---|---|---|")
    for seed in range(n_sets):
        sets = data(8200 + seed)
        alpha = chosen_alpha(*sets[:2], seed)
        for name, fit in peers.items():
            seconds, weights = fit(*sets[:2], alpha, seed)
            objective, train, test = judged(weights, alpha, *sets)
            print(
                f"| {seed} | {alpha} | {name} | {seconds:.2f} | {objective:.4f} | {train:.4f} | {test:.4f} |",
                flush=True,
            )


def own_settings(n_sets, python):
    """Each with its own settings: test error and processor seconds."""
    print("| data set | noise | " + " | ".join(f"{name}, test | s" for name in ("evidence", *JAX_STARTS)) + " |")
    rows = []
    for k in range(n_sets):
        noise, rng = NOISES[k % len(NOISES)], np.random.default_rng(k)
        U, Y, Ut, Yt = data(8400 + k)
        start, Y = (part + noise * rng.normal(size=part.shape) for part in (Yt, Y))
        fits = [ours(U, Y, "evidence", k, clock="process_time")]
        fits += [by_jax(python, U, Y, 0.0, k, how, "processor") for how in JAX_STARTS]
        found = []
        for seconds, weights in fits:
            error = free_run(weights, Ut, start[:, :LAGS])[:, LAGS:] - Yt[:, LAGS:]
            found.append((float(np.sqrt(np.mean(error**2))), seconds))
        rows.append(found)
        print(f"| {k} | {noise} | " + " | ".join(f"{test:.4f} | {s:.1f}" for test, s in found) + " |", flush=True)
    table = np.array(rows)
    for j, how in enumerate(JAX_STARTS, 1):
        test, times = table[:, 0, 0] / table[:, j, 0], table[:, j, 1] / table[:, 0, 1]
        print(
            f"{how}: ours no worse in {np.sum(test <= 1)} of {len(rows)}, ratio of test errors {np.median(test):.2f} "
            f"(largest {test.max():.2f}); jax-sysid takes {np.median(times):.0f} times as long (least {times.min():.1f})"
        )


if __name__ == "__main__":
    if "--fit" in sys.argv:
        jax_fit(sys.argv[-1])
    else:
        where = sys.argv.index("--jax") if "--jax" in sys.argv else None
        count = next((int(a) for a in sys.argv[1:2] if a.isdigit()), 8)
        (own_settings if "--settings" in sys.argv else main)(count, sys.argv[where + 1] if where else None)
