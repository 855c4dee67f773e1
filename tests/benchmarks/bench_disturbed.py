"""A spring with one missing effect that a force nobody measures pushes: how large may the disturbance be?

Run: ``python tests/benchmarks/bench_disturbed.py [--effects cubic drag] [--levels 0.1 0.3] [--seeds 0 1] [--noise 0.01]``. Six runs of
300 samples; the input is held at levels between -2 and 2, the force is an Ornstein-Uhlenbeck process with a correlation time of one second
and a deviation of ``level``. One line a case.
"""

import argparse
import time
import warnings

import numpy as np

from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, RUNS, SAMPLES, PARTS = 0.05, 6, 300, 10
EFFECTS = {
    "cubic": ("cubic_stiffness 1.5 at v of q", lambda x: -1.5 * x[0] ** 3),
    "drag": ("quadratic_drag 0.3 at v", lambda x: -0.3 * x[1] * abs(x[1])),
    "friction": ("coulomb_friction 0.4 at v", lambda x: -0.4 * np.tanh(x[1] / 0.02)),
    "none": ("none", lambda x: 0.0),
}


def spring():
    """The nominal simulator."""
    return ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["k"] * x[0] - p["c"] * x[1]),
        states=["q", "v"], inputs=["u"], outputs=["q", "v"], params={"k": 2.0, "c": 0.4}, dt=DT, x0=[0, 0],
    )  # fmt: skip


def pushed(rng, level):
    """The force (SAMPLES,) that nobody measures."""
    w, keep = np.zeros(SAMPLES), np.exp(-DT)
    for k in range(1, SAMPLES):
        w[k] = keep * w[k - 1] + np.sqrt(1 - keep**2) * level * rng.standard_normal()
    return w


def free_run(x, u, w, force):
    """States (SAMPLES, 2) with steps of Runge and Kutta."""

    def rate(x, enters):
        return np.array([x[1], enters - 2.0 * x[0] - 0.4 * x[1] + force(x)])

    out, h = [x], DT / PARTS
    for enters in (u + w)[:-1]:
        for _ in range(PARTS):
            a = rate(x, enters)
            b = rate(x + h / 2 * a, enters)
            c = rate(x + h / 2 * b, enters)
            x = x + h / 6 * (a + 2 * b + 2 * c + rate(x + h * c, enters))
        out.append(x)
    return np.array(out)


def recorded(force, level, noise, seed):
    """Inputs, readings and runs."""
    rng, U, Y = np.random.default_rng(seed), [], []
    for _ in range(RUNS):
        u = np.repeat(rng.uniform(-2, 2, SAMPLES // 16 + 1), 16)[:SAMPLES]
        Y.append(free_run(rng.uniform(-1, 1, 2), u, pushed(rng, level), force))
        U.append(u[:, None])
    Y = np.concatenate(Y)
    return (
        np.concatenate(U),
        Y + noise * Y.std(axis=0) * rng.standard_normal(Y.shape),
        np.repeat(np.arange(RUNS), SAMPLES),
    )


def main():
    """Print a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--effects", nargs="+", default=list(EFFECTS), choices=list(EFFECTS))
    parser.add_argument("--levels", type=float, nargs="+", default=[0.1, 0.3, 0.6])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--noise", type=float, default=0.01)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    print(
        "| planted | level | seed | verdict | names (probability) or law | held out | s |\n|---|---|---|---|---|---|---|"
    )
    for name in options.effects:
        planted, force = EFFECTS[name]
        for level in options.levels:
            for seed in options.seeds:
                U, y, groups = recorded(force, level, options.noise, seed)
                begun = time.process_time()
                report = GapDiagnoser(spring(), random_state=0, n_jobs=1).fit(U, y, groups=groups).report_
                seconds = time.process_time() - begun
                names = "; ".join(
                    f"{e.name} at {e.location} {', '.join(f'{v:.3g}' for v in e.params.values())} ({e.probability:.3f})"
                    for e in report.effects
                )
                term = report.missing_term
                law = f"law `{term.law}`" if term is not None and term.law is not None else "-"
                print(
                    f"| {planted} | {level:g} | {seed} | {report.verdict} | {names or law} | "
                    f"{report.shrink.before:.3f} -> {report.shrink.after:.3f} | {seconds:.0f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
