"""Starts, times and phases as recordings have them: steps from rest, runs cut out of longer ones, causes that differ from run to run."""

import numpy as np
from physical_plants import case, record, run, sines, steps

from sksurrogate.physics import ODESimulator

DT, N, RUNS = 0.05, 240, 5


def spring(outputs=("y",)):
    """A spring that hardens, with a driven input."""
    return ODESimulator(
        lambda t, x, u, p: (x[1], (2 * u[0] - p["k"] * x[0] - p["c"] * x[1] - 0.5 * x[0] ** 3) / p["m"]),
        states=["y", "v"], inputs=["u"], outputs=list(outputs), params={"k": 2.0, "c": 0.5, "m": 1.0}, dt=DT,
    )  # fmt: skip


def motion(x, u, pushed=0.0, k=2.0, m=1.0):
    """Its right-hand side."""
    return x[1], (2 * u - k * x[0] - 0.5 * x[1] - 0.5 * x[0] ** 3 + pushed) / m


def recorded(rng, rhs_of, inputs, acting=None, ahead=0, noise=0.01):
    """Runs of the spring; ``rhs_of(k)`` of run k, ``acting(u)`` what reaches it, the first ``ahead`` rows are not recorded."""
    pairs = []
    for k in range(RUNS):
        u = inputs(N + ahead)
        X = run(rhs_of(k), [0.0] * 3, (u if acting is None else acting(u))[:, None], DT)
        pairs.append((u[ahead:, None], X[ahead:]))
    return record(rng, pairs, lambda X, U: X[:, :1], noise)


def swinging(rng):
    """Inputs that swing."""
    return lambda n: sines(rng, n, DT, 1.5, 0.05, 1.2)


def stepping(rng):
    """Inputs that step, not from zero."""

    def inputs(n):
        u = steps(rng, n, -1, 1, 60)
        return u + 0.2 * np.sign(u)

    return inputs


@case
def lag_from_rest(rng):
    def rhs(t, x, u):
        return *motion(x, x[2]), (u[0] - x[2]) / 0.3

    return spring(), *recorded(rng, lambda k: rhs, stepping(rng)), "input_lag@u 0.3, from rest"


@case
def ramp_from_rest(rng):
    def rhs(t, x, u):
        return *motion(x, x[2]), np.clip((u[0] - x[2]) / 0.02, -1.5, 1.5)

    return spring(), *recorded(rng, lambda k: rhs, stepping(rng)), "rate_limit@u 1.5, from rest"


@case
def delay_from_rest(rng):
    def late(u):
        return np.r_[np.zeros(5), u[:-5]]

    data = recorded(rng, lambda k: lambda t, x, u: (*motion(x, u[0]), 0.0), stepping(rng), late)
    return spring(), *data, "input_delay@u 0.25, from rest"


@case
def delay_cut_out(rng):
    def late(u):
        return np.r_[np.full(6, u[0]), u[:-6]]

    data = recorded(rng, lambda k: lambda t, x, u: (*motion(x, u[0]), 0.0), swinging(rng), late, ahead=60)
    return spring(), *data, "input_delay@u 0.3, runs cut out of longer ones"


@case
def play_cut_out(rng):
    def moved(u):
        w = [u[0]]
        for value in u[1:]:
            w.append(np.clip(w[-1], value - 0.35, value + 0.35))
        return np.array(w)

    data = recorded(rng, lambda k: lambda t, x, u: (*motion(x, u[0]), 0.0), swinging(rng), moved, ahead=60)
    return spring(), *data, "input_backlash@u 0.35, runs cut out of longer ones"


@case
def wave_of_any_phase(rng):
    phases = rng.uniform(0, 6.28, RUNS)
    data = recorded(
        rng, lambda k: lambda t, x, u: (*motion(x, u[0], 0.4 * np.sin(2.3 * t + phases[k])), 0.0), swinging(rng)
    )
    return spring(), *data, "a periodic force of another phase in each run: no name of the catalogue has that"


@case
def wear_goes_on(rng):
    def rhs(k):
        return lambda t, x, u: (*motion(x, u[0], k=2 * (1 - 0.004 * (t + k * N * DT))), 0.0)

    return (
        spring(),
        *recorded(rng, rhs, swinging(rng)),
        "k falls by 0.4 % a second, on from run to run: no name has that",
    )


@case
def load_of_each_run(rng):
    loads = rng.uniform(-0.6, 0.6, RUNS)
    data = recorded(rng, lambda k: lambda t, x, u: (*motion(x, u[0], loads[k]), 0.0), swinging(rng))
    return spring(), *data, "a constant load of another size in each run: no name has that"


@case
def payload_of_each_run(rng):
    more = rng.uniform(-0.1, 0.3, RUNS)
    data = recorded(rng, lambda k: lambda t, x, u: (*motion(x, u[0], m=1 + more[k]), 0.0), swinging(rng))
    return spring(), *data, "another payload in each run: no name has that"
