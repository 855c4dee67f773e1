"""Plants with one main effect, and several imperfections of 1 to 3 % that no parameter of the diagnosis is told of."""

import numpy as np
from physical_plants import case, record, run, sines, steps

from sksurrogate.physics import ODESimulator


def recorded(rng, rhs, x0, make_u, dt, out, runs=5, noise=0.005):
    """Runs of a plant: inputs (n_samples, n_inputs) from ``make_u()``, ``out(X, U)`` read with noise."""
    pairs = []
    for _ in range(runs):
        U = np.atleast_2d(make_u())
        U = U if U.shape[0] > 1 else U.T
        start = x0() if callable(x0) else x0
        pairs.append((U, run(rhs, start, U, dt)))
    return record(rng, pairs, out, noise)


@case
def motor_brush(rng):
    dt, p = 0.01, {"R": 2.0, "k": 0.05, "b": 2e-4, "J": 5e-4, "L": 0.02}

    def nom(t, x, u, p):
        i, w = x
        return (u[0] - p["R"] * i - p["k"] * w) / p["L"], (p["k"] * i - p["b"] * w) / p["J"]

    def rhs(t, x, u):
        i, w, angle = x
        lost = 2e-4 * w + 0.01 * np.tanh(w / 1.5) + 3e-7 * w * abs(w) + 3e-4 * np.sin(3 * angle)
        return (0.985 * u[0] - 2.04 * i - 0.05 * w) / 0.02, (0.05 * i - lost) / 5e-4, w

    sim = ODESimulator(nom, states=["i", "w"], inputs=["v"], outputs=["i", "w"], params=p, dt=dt)
    data = recorded(rng, rhs, [0, 0, 0], lambda: steps(rng, 250, -10, 10, 12), dt, lambda X, U: X[:, :2])
    return sim, *data, "coulomb_friction@w; R +2 %, amplifier -1.5 %, small drag and ripple"


@case
def pendulum_bearing(rng):
    dt, p = 0.02, {"ml": 0.5, "b": 0.03, "J": 0.255}

    def nom(t, x, u, p):
        q, w = x
        return w, (u[0] - 9.81 * p["ml"] * np.sin(q) - p["b"] * w) / p["J"]

    def rhs(t, x, u):
        q, w = x
        return w, (u[0] - 9.81 * 0.51 * np.sin(q) - 0.03 * w - 0.12 * np.tanh(w / 0.02)) / 0.26

    sim = ODESimulator(nom, states=["q", "w"], inputs=["torque"], outputs=["q"], params=p, dt=dt)
    data = recorded(
        rng, rhs, lambda: [rng.uniform(-0.4, 0.4), 0], lambda: sines(rng, 250, dt, 1.0, 0.1, 1.2), dt,
        lambda X, U: X[:, :1] + 0.006,
    )  # fmt: skip
    return sim, *data, "coulomb_friction@w; ml and J +2 %, sensor offset 0.006"


@case
def heave(rng):
    dt, p = 0.02, {"kt": 0.981, "w": 0.981}

    def rhs(t, x, u):
        _z, v = x
        return v, 0.991 * u[0] - 0.981 - 0.12 * v * abs(v) - 0.01 * v - 0.02

    sim = ODESimulator(
        lambda t, x, u, p: (x[1], p["kt"] * u[0] - p["w"]),
        states=["z", "vz"], inputs=["thrust"], outputs=["z", "vz"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(rng, rhs, [0, 0], lambda: 1 + sines(rng, 220, dt, 1.1, 0.1, 1.5), dt, lambda X, U: X, runs=6)
    return sim, *data, "quadratic_drag@vz; thrust +1 %, bias -0.02, small linear drag"


@case
def car_rolling(rng):
    dt, p = 0.2, {"F": 3000.0, "ca": 0.4, "m": 1200.0}

    def rhs(t, x, u):
        v, s = x
        lost = 180 * np.tanh(v / 0.3) + 0.42 * v * abs(v) + 3 * v + 25 * np.sin(0.05 * s)
        return (2970 * u[0] - lost) / 1230, v

    sim = ODESimulator(
        lambda t, x, u, p: ((p["F"] * u[0] - p["ca"] * x[0] * abs(x[0])) / p["m"],),
        states=["v"], inputs=["pedal"], outputs=["v"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(
        rng, rhs, lambda: [rng.uniform(2, 8), 0], lambda: steps(rng, 250, -0.15, 0.5, 15), dt, lambda X, U: X[:, :1]
    )
    return sim, *data, "rolling resistance (coulomb_friction or constant)@v; m +2.5 %, drag +5 %, a wavy road"


@case
def heated_vessel(rng):
    dt, p = 10.0, {"P": 2.0, "C": 100.0}

    def rhs(t, x, u):
        T, wall, shown = x
        return (
            (1.96 * u[0] - 0.012 * np.sign(T - 20) * abs(T - 20) ** 1.15 - 0.01 * (T - wall)) / 100,
            0.01 * (T - wall) / 12,
            (T - shown) / 6,
        )

    sim = ODESimulator(
        lambda t, x, u, p: (p["P"] * u[0] / p["C"],), states=["T"], inputs=["heater"], outputs=["T"], params=p, dt=dt
    )
    data = recorded(rng, rhs, [20, 20, 20], lambda: steps(rng, 300, 0, 1, 25), dt, lambda X, U: X[:, 2:], runs=4)
    return sim, *data, "loss to surroundings of 20 degrees@T; heater -2 %, mass of the wall, sensor lag 6 s"


@case
def hard_spring(rng):
    dt, p = 0.01, {"c": 1.0, "k": 100.0, "m": 1.0}

    def rhs(t, x, u):
        y, v = x
        return v, u[0] - 1.01 * v - 101 * y - 60 * y**3 * (1 + 0.1 * y) - 0.08 * np.tanh(v / 0.02)

    sim = ODESimulator(
        lambda t, x, u, p: (x[1], (u[0] - p["c"] * x[1] - p["k"] * x[0]) / p["m"]),
        states=["y", "v"], inputs=["force"], outputs=["y"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(rng, rhs, [0, 0], lambda: sines(rng, 350, dt, 55, 0.3, 4), dt, lambda X, U: X[:, :1], runs=4)
    return sim, *data, "cubic_stiffness@y; k +1 %, small friction, small asymmetry"


@case
def servo_delay(rng):
    dt, p, late = 0.02, {"b": 2.0, "k": 2.0, "c": 0.6}, 3

    def rhs(t, x, u):
        return x[1], 2.03 * u[1] - 2 * x[0] - 0.6 * x[1] - 0.02 * x[1] * abs(x[1])

    def inputs():
        u = steps(rng, 280, -1, 1, 14)
        return np.stack([u, np.r_[np.zeros(late), u[:-late]]], axis=1)

    sim = ODESimulator(
        lambda t, x, u, p: (x[1], p["b"] * u[0] - p["k"] * x[0] - p["c"] * x[1]),
        states=["y", "v"], inputs=["u"], outputs=["y"], params=p, dt=dt,
    )  # fmt: skip
    U, Y, g = recorded(rng, rhs, [0, 0], inputs, dt, lambda X, U: X[:, :1])
    return sim, U[:, :1], Y, g, "input_delay 0.06 from rest; gain +1.5 %, small drag"


@case
def ship_yaw(rng):
    dt, p = 0.5, {"K": 0.2, "T": 8.0}

    def rhs(t, x, u):
        _psi, r, rudder = x
        return r, (0.204 * rudder - r - 9 * r * abs(r)) / 8, np.clip((u[0] - rudder) / 0.4, -0.12, 0.12)

    sim = ODESimulator(
        lambda t, x, u, p: (x[1], (p["K"] * u[0] - x[1]) / p["T"]),
        states=["psi", "r"], inputs=["rudder"], outputs=["psi", "r"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(
        rng, rhs, [0, 0, 0], lambda: steps(rng, 300, -0.5, 0.5, 30), dt, lambda X, U: X[:, :2] + [0, 4e-4], runs=4
    )
    return sim, *data, "quadratic_drag@r and rate_limit@rudder 0.12 (with a lag of 0.4 s); gain +2 %, gyro offset"


def two_links(q2, w1, w2, t1, t2, m2):
    """Accelerations of an arm of two links in the plane."""
    a = 0.06 + m2 * (0.1825 + 0.12 * np.cos(q2))
    b, d, h = m2 * (0.0225 + 0.06 * np.cos(q2)) + 0.005, m2 * 0.0225 + 0.005, 0.06 * m2 * np.sin(q2)
    r1, r2 = t1 + h * (2 * w1 * w2 + w2 * w2), t2 - h * w1 * w1
    return (d * r1 - b * r2) / (a * d - b * b), (a * r2 - b * r1) / (a * d - b * b)


@case
def arm_shoulder(rng):
    dt, p = 0.01, {"b1": 0.2, "b2": 0.1, "m2": 0.8}

    def rhs(t, x, u):
        _, q2, w1, w2 = x
        t1 = u[0] - 0.3 * np.tanh(w1 / 0.03) - 0.2 * w1
        return w1, w2, *two_links(q2, w1, w2, t1, 0.985 * u[1] - 0.1 * w2 - 0.01 * np.tanh(w2 / 0.03), 0.816)

    sim = ODESimulator(
        lambda t, x, u, p: (x[2], x[3], *two_links(x[1], x[2], x[3], u[0] - p["b1"] * x[2], u[1] - p["b2"] * x[3], p["m2"])),
        states=["q1", "q2", "w1", "w2"], inputs=["tau1", "tau2"], outputs=["q1", "q2"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(
        rng, rhs, [0, 0, 0, 0],
        lambda: np.stack([sines(rng, 250, dt, 1.7, 0.5, 3), sines(rng, 250, dt, 0.7, 0.5, 3)], axis=1),
        dt, lambda X, U: X[:, :2], noise=0.003,
    )  # fmt: skip
    return sim, *data, "coulomb_friction@tau1/w1 0.3; m2 +2 %, tau2 -1.5 %, friction 0.01 at tau2"


@case
def choke_saturates(rng):
    dt, p = 1e-4, {"R": 2.0, "L": 4e-3, "Rl": 10.0, "C": 4e-4}

    def rhs(t, x, u):
        i, vc = x
        return (u[0] - 2.04 * i - vc) / (4e-3 * (0.25 + 0.75 / (1 + (i / 2.5) ** 4))), (i - vc / 10.2) / 4.1e-4

    sim = ODESimulator(
        lambda t, x, u, p: ((u[0] - p["R"] * x[0] - x[1]) / p["L"], (x[0] - x[1] / p["Rl"]) / p["C"]),
        states=["i", "vc"], inputs=["v"], outputs=["i", "vc"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(rng, rhs, [0, 0], lambda: sines(rng, 350, dt, 17, 20, 400), dt, lambda X, U: X, runs=4)
    return sim, *data, "LAW: L falls with the size of i; R, C, Rl +2 %"


@case
def bioreactor_inhibited(rng):
    dt, p = 0.25, {"mu": 0.5}

    def rhs(t, x, u):
        X, S = x
        mu = 0.5 * S / (0.2 + S + S * S / 2.2)
        return (mu - 0.01 - u[0]) * X, u[0] * (5.1 - S) - mu * X / 0.51

    sim = ODESimulator(
        lambda t, x, u, p: (
            (p["mu"] * x[1] / (0.2 + x[1]) - u[0]) * x[0],
            u[0] * (5 - x[1]) - p["mu"] * x[1] / (0.2 + x[1]) * x[0] / 0.5,
        ),
        states=["X", "S"], inputs=["D"], outputs=["X", "S"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(
        rng, rhs, lambda: [rng.uniform(1, 2), rng.uniform(0.3, 1.5)], lambda: steps(rng, 160, 0.05, 0.28, 16), dt,
        lambda X, U: X, noise=0.01,
    )  # fmt: skip
    return sim, *data, "LAW: mu falls with S (inhibition), in both balances; death 0.01, feed and yield +2 %"


@case
def tanks_leak(rng):
    dt, p = 4.0, {"k": 10.0, "a1": 2.0, "a2": 2.0}

    def root(h):
        return np.sqrt(np.maximum(h, 1e-9))

    def rhs(t, x, u):
        return (9.85 * u[0] - 2.9 * root(x[0])) / 25, (2 * root(x[0]) - 2.03 * root(x[1])) / 25.4

    sim = ODESimulator(
        lambda t, x, u, p: (
            (p["k"] * u[0] - p["a1"] * root(x[0])) / 25,
            (p["a1"] * root(x[0]) - p["a2"] * root(x[1])) / 25,
        ),
        states=["h1", "h2"], inputs=["pump"], outputs=["h1", "h2"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(rng, rhs, [4, 4], lambda: steps(rng, 250, 0.4, 1.2, 20), dt, lambda X, U: X, runs=4)
    return sim, *data, "sqrt_leak@h1; pump -1.5 %, a2 +1.5 %, area 2 +1.6 %"


@case
def valve_sticks(rng):
    dt, p, width = 0.5, {"K": 1.0, "T": 4.0}, 0.05

    def inputs():
        u = steps(rng, 300, 0.2, 0.8, 10)
        moved = [u[0]]
        for value in u[1:]:
            moved.append(moved[-1] if abs(value - moved[-1]) < width else value - width * np.sign(value - moved[-1]))
        return np.stack([u, moved], axis=1)

    sim = ODESimulator(
        lambda t, x, u, p: ((p["K"] * u[0] - x[0]) / p["T"], x[0] - x[1]),
        states=["a", "b"], inputs=["valve"], outputs=["b"], params=p, dt=dt,
    )  # fmt: skip
    U, Y, g = recorded(
        rng, lambda t, x, u: ((1.02 * u[1] - x[0]) / 4.1, (x[0] - x[1]) / 1.03), [0.5, 0.5], inputs, dt,
        lambda X, U: X[:, 1:], runs=4,
    )  # fmt: skip
    return sim, U[:, :1], Y, g, "input_backlash@valve 0.05; gain +2 %, both times +3 %"


@case
def motor_only_imperfect(rng):
    dt, p = 0.01, {"R": 2.0, "k": 0.05, "b": 2e-4, "J": 5e-4, "L": 0.02}

    def rhs(t, x, u):
        i, w = x
        return (0.99 * u[0] - 2.02 * i - 0.0505 * w) / 0.0202, (0.0505 * i - 2.05e-4 * w) / 5.05e-4

    sim = ODESimulator(
        lambda t, x, u, p: ((u[0] - p["R"] * x[0] - p["k"] * x[1]) / p["L"], (p["k"] * x[0] - p["b"] * x[1]) / p["J"]),
        states=["i", "w"], inputs=["v"], outputs=["i", "w"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(rng, rhs, [0, 0], lambda: steps(rng, 250, -10, 10, 12), dt, lambda X, U: X)
    return sim, *data, "every parameter 1 to 2.5 % off, amplifier -1 %: together an input_gain of -0.02"
