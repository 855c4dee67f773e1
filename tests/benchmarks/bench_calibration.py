"""How fast are five parameters of a forced Duffing oscillator fitted, and a thousand runs simulated?

Run: ``python tests/benchmarks/bench_calibration.py``; prints two markdown tables. jax is measured where it is installed.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from sksurrogate.physics import CalibratedSimulator, ODESimulator

TRUE = {"d": 0.3, "a": 1.0, "b": 0.5, "g": 1.2, "w": 0.1}
START = {"d": 0.5, "a": 1.5, "b": 0.3, "g": 1.0, "w": 0.0}
DT, N_RUNS, N = 0.05, 4, 500


def duffing(t, x, u, p):
    """q'' = g u - d q' - a q - b q^3 + w."""
    q, v = x
    return v, p["g"] * u[0] - p["d"] * v - p["a"] * q - p["b"] * q**3 + p["w"]


def plant(params):
    return ODESimulator(duffing, states=["q", "v"], inputs=["f"], outputs=["q"], params=params, dt=DT)


def data():
    """(U, Y, X0): 4 runs of 500 samples, held inputs, 1 % noise."""
    rng = np.random.default_rng(0)
    X0 = rng.normal(scale=0.5, size=(N_RUNS, 2))
    U = np.repeat(rng.normal(size=(N_RUNS, N // 20)), 20, axis=1)[:, :, None]
    clean = plant(TRUE).simulate_batch(U, X0)[:, :, 0]
    return U, clean + 0.01 * clean.std() * rng.normal(size=clean.shape), X0


def scalar_rhs(t, z, push, d, a, b):
    """The same for one point, in plain floats."""
    return [z[1], push - d * z[1] - a * z[0] - b * z[0] ** 3]


def solve(theta, u, x0, rtol, method="RK45"):
    """One run by solve_ivp, one call a stretch of constant input."""
    out, x = np.empty(len(u)), np.asarray(x0)
    for a in range(0, len(u), 20):
        b = min(a + 20, len(u) - 1)
        if b <= a:
            out[a] = x[0]
            break
        found = solve_ivp(
            scalar_rhs,
            (0, (b - a) * DT),
            x,
            args=(theta[3] * u[a] + theta[4], *theta[:3]),
            t_eval=DT * np.arange(b - a + 1),
            rtol=rtol,
            atol=rtol,
            method=method,
        )
        out[a : b + 1] = found.y[0]
        x = found.y[:, -1]
    return out


def ours(U, Y, X0, known):
    X, y, groups = U.reshape(-1, 1), Y.ravel(), np.repeat(np.arange(N_RUNS), N)
    model = CalibratedSimulator(plant(START), fit_x0=not known)
    model.fit(X, y, groups=groups, x0=X0 if known else None)
    return np.array([model.params_[k] for k in TRUE])


def scipy_rk45(U, Y, X0):
    def residual(theta):
        return np.concatenate([solve(theta, U[r, :, 0], X0[r], 1e-6) - Y[r] for r in range(N_RUNS)])

    return least_squares(residual, list(START.values()), method="lm", diff_step=1e-4).x


def batched_rk4(theta, U, X0):
    """theta (5, n): n parameter vectors, all runs at once; outputs (n_runs, N, n)."""
    d, a, b, g, w = theta
    q = np.repeat(X0[:, :1], theta.shape[1], axis=1)
    v = np.repeat(X0[:, 1:], theta.shape[1], axis=1)
    out = np.empty((len(U), U.shape[1], theta.shape[1]))
    for k in range(U.shape[1]):
        out[:, k] = q
        push = g * U[:, k] + w

        def acc(q, v, push=push):
            return push - d * v - a * q - b * q * q * q

        k1q, k1v = v, acc(q, v)
        k2q, k2v = v + DT / 2 * k1v, acc(q + DT / 2 * k1q, v + DT / 2 * k1v)
        k3q, k3v = v + DT / 2 * k2v, acc(q + DT / 2 * k2q, v + DT / 2 * k2v)
        k4q, k4v = v + DT * k3v, acc(q + DT * k3q, v + DT * k3v)
        q = q + DT / 6 * (k1q + 2 * k2q + 2 * k3q + k4q)
        v = v + DT / 6 * (k1v + 2 * k2v + 2 * k3v + k4v)
    return out


def numpy_batch(U, Y, X0):
    """Single shooting, all finite-difference columns in one batch, by scipy's Levenberg-Marquardt."""
    h = 1e-6

    def residual(theta):
        return (batched_rk4(theta[:, None], U, X0)[:, :, 0] - Y).ravel()

    def jacobian(theta):
        columns = theta[:, None] + h * np.eye(5, 6, 1)
        y = batched_rk4(columns, U, X0)
        return ((y[:, :, 1:] - y[:, :, :1]) / h).reshape(-1, 5)

    return least_squares(residual, list(START.values()), jac=jacobian, method="lm").x


def jax_scan(U, Y, X0):
    """(compile seconds, run seconds, theta): jitted RK4 scan, forward sensitivities, Gauss-Newton with damping."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    Us, Ys = jnp.asarray(U[:, :, 0]), jnp.asarray(Y)

    def residual(theta):
        d, a, b, g, w = theta

        def rate(x, u):
            q, v = x
            return jnp.stack([v, g * u - d * v - a * q - b * q**3 + w])

        def step(x, u):
            k1 = rate(x, u)
            k2 = rate(x + DT / 2 * k1, u)
            k3 = rate(x + DT / 2 * k2, u)
            k4 = rate(x + DT * k3, u)
            return x + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4), x[0]

        run = jax.vmap(lambda x0, u: jax.lax.scan(step, x0, u)[1])
        return (run(jnp.asarray(X0), Us) - Ys).ravel()

    both = jax.jit(lambda theta: (residual(theta), jax.jacfwd(residual)(theta)))
    started = time.process_time()
    both(jnp.asarray(list(START.values())))[1].block_until_ready()
    compiled = time.process_time() - started
    started, theta, damping, last = time.process_time(), np.array(list(START.values())), 1e-3, np.inf
    r, J = map(np.asarray, both(jnp.asarray(theta)))
    for _ in range(40):
        H = J.T @ J
        trial = theta - np.linalg.solve(H + damping * np.diag(np.diag(H)), J.T @ r)
        new_r, new_J = map(np.asarray, both(jnp.asarray(trial)))
        if new_r @ new_r < r @ r:
            last, theta, r, J, damping = r @ r, trial, new_r, new_J, damping / 5
            if last - r @ r < 1e-9 * last:
                break
        else:
            damping *= 4
    return compiled, time.process_time() - started, theta


def timed(function: Any, repeats: int) -> tuple[float, Any]:
    """Least processor time of a few runs (other jobs do not count), and the result."""
    best, found = np.inf, None
    for _ in range(repeats):
        started = time.process_time()
        found = function()
        best = min(best, time.process_time() - started)
    return best, found


def main() -> None:
    U, Y, X0 = data()
    true = np.array(list(TRUE.values()))
    rows = [
        ("CalibratedSimulator, initial states known", *timed(lambda: ours(U, Y, X0, True), 10)),
        ("CalibratedSimulator, initial states unknown", *timed(lambda: ours(U, Y, X0, False), 10)),
        ("numpy RK4, differences in one batch, known", *timed(lambda: numpy_batch(U, Y, X0), 3)),
        ("scipy least_squares + solve_ivp RK45 1e-6, known", *timed(lambda: scipy_rk45(U, Y, X0), 1)),
    ]
    try:
        compiled, seconds, theta = jax_scan(U, Y, X0)
        rows.insert(3, (f"jitted jax, RK4 scan + jacfwd (compile {compiled:.2f} s apart), known", seconds, theta))
    except ImportError:
        pass
    base = rows[0][1]
    print(
        "| fit of 5 parameters, 4 x 500, 1 % noise | processor ms | times ours | largest error |\n|---|---:|---:|---:|"
    )
    for name, seconds, theta in rows:
        print(f"| {name} | {1e3 * seconds:.1f} | {seconds / base:.1f} | {np.max(np.abs(theta - true)):.4f} |")

    n_runs = 1000
    rng = np.random.default_rng(1)
    many = np.repeat(rng.normal(size=(n_runs, N // 20)), 20, axis=1)[:, :, None]
    starts = rng.normal(scale=0.5, size=(n_runs, 2))
    batch, found = timed(lambda: plant(TRUE).simulate_batch(many, starts)[:, :, 0], 2)
    few = 20
    exact = np.stack([solve(true, many[r, :, 0], starts[r], 1e-12, "DOP853") for r in range(few)])
    error = np.abs(found[:few] - exact).max()
    print("\n| 1000 runs of 500 samples | processor s | times ours | largest error |\n|---|---:|---:|---:|")
    print(f"| simulate_batch | {batch:.2f} | 1.0 | {error:.1e} |")
    for method, rtol in (("RK45", 1e-6), ("RK45", 1e-8), ("DOP853", 1e-8)):
        seconds, runs = timed(
            lambda m=method, e=rtol: np.stack([solve(true, many[r, :, 0], starts[r], e, m) for r in range(few)]), 1
        )
        seconds *= n_runs / few
        off = np.abs(runs - exact).max()
        print(
            f"| solve_ivp {method} {rtol:g}, run by run ({few} runs timed) | {seconds:.1f} | {seconds / batch:.0f} | {off:.1e} |"
        )


if __name__ == "__main__":
    main()
