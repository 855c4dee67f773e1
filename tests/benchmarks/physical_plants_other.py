"""Physical plants with two effects, three, none, or one that has no name."""

import numpy as np
from physical_plants import KW, case, record, run, sines, steps

from sksurrogate.physics import ODESimulator


@case
def pump_dead_and_leak(rng):
    dt = 1.0
    p = {"A": 12.0, "k": 1.1, "kp": 0.8, "tau": 3.0}

    def nom(t, x, u, p):
        f, h = x
        return (p["kp"] * u[0] - f) / p["tau"], (f - p["k"] * np.sqrt(np.maximum(h, 0 * h) + 1e-3)) / p["A"]

    sim = ODESimulator(nom, states=["flow", "h"], inputs=["rpm"], outputs=["flow", "h"], params=p, dt=dt, x0=[3.0, 8.0])

    def rhs(t, x, u):
        e = u[0] - 1.5
        d = list(nom(t, x, [0.1 * np.logaddexp(0, e / 0.1)], p))
        d[1] -= 0.05 * max(x[1], 0) ** 0.55 / p["A"] * 4
        return d

    runs = []
    for n in (220, 220, 200):
        U = np.maximum(steps(rng, n, -2.0, 9.0, 16), 0)[:, None]
        runs.append((U, run(rhs, [2, 6], U, dt)))
    return (sim, *record(rng, runs, lambda X, U: X, 0.01), "input_dead_zone@rpm (soft) + sqrt_leak@h (0.55)")


@case
def motor_stribeck_tacho(rng):
    dt = 0.01
    p = {"L": 0.02, "R": 1.0, "k": 0.4, "J": 0.02, "b": 0.01}

    def nom(t, x, u, p):
        i, w = x
        return (u[0] - p["R"] * i - p["k"] * w) / p["L"], (p["k"] * i - p["b"] * w) / p["J"]

    sim = ODESimulator(nom, states=["i", "w"], inputs=["u"], outputs=["i", "w"], params=p, dt=dt)

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        w = x[1]
        d[1] -= (0.25 + 0.2 * np.exp(-abs(w / 1.2))) * np.tanh(w / 0.15) / p["J"]
        return d

    runs = []
    for n in (300, 300, 260):
        U = sines(rng, n, dt, 4.0, 0.3, 4.0)[:, None]
        runs.append((U, run(rhs, [0, 0], U, dt)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X * [1.0, 1.07], 0.01),
        "stribeck/coulomb_friction@w + sensor_gain@w 0.07",
    )


@case
def exchanger_pipe_loss(rng):
    dt = 5.0
    p = {"C1": 200.0, "C2": 400.0, "UA": 9.0, "m": 8.0}

    def nom(t, x, u, p):
        a, b = x
        return (p["m"] * (u[0] - a) - p["UA"] * (a - b)) / p["C1"], (p["UA"] * (a - b) - 3.0 * (b - u[1])) / p["C2"]

    sim = ODESimulator(
        nom,
        states=["prim", "sec"],
        inputs=["T_in", "T_cold"],
        outputs=["prim", "sec"],
        params=p,
        dt=dt,
        x0=[40.0, 30.0],
    )
    runs = []
    for n in (240, 260, 240):
        U = np.c_[steps(rng, n, 30, 80, 16), steps(rng, n, 8, 20, 30)]
        fine = 5
        Ud = U[np.maximum(np.floor((np.arange(n * fine) * dt / fine - 17.0) / dt).astype(int), 0)]
        Ud[:, 1] = np.repeat(U[:, 1], fine)

        def rhs(t, x, u):
            d = list(nom(t, x, u, p))
            dT = x[1] - 18.0
            d[1] -= 1.3 * np.sign(dT) * abs(dT) ** 1.25 / p["C2"]
            return d

        runs.append((U, run(rhs, [40, 30], Ud, dt / fine)[::fine]))
    return (
        sim,
        *record(rng, runs, lambda X, U: X, 0.01),
        "input_delay@T_in 17 s + loss at sec (sec-18)^1.25: linear_loss/exchange + constant/power_law",
    )


@case
def wheel_and_gyro(rng):
    dt = 0.5
    p = {"J": 40.0, "Jw": 0.05, "bw": 2e-4}  # rates in deg/s, wheel in rpm-like units

    def nom(t, x, u, p):
        _r, w = x
        T = u[0] - p["bw"] * w
        return -T / p["J"] * 57.3, T / p["Jw"] * 9.55

    sim = ODESimulator(nom, states=["rate", "wheel"], inputs=["torque"], outputs=["rate", "wheel"], params=p, dt=dt)

    def rhs(t, x, u):
        T = u[0] - p["bw"] * x[1] - 0.012 * np.tanh(x[1] / 3.0)
        return [-T / p["J"] * 57.3, T / p["Jw"] * 9.55]

    runs = []
    for n in (200, 240, 200, 220):
        s = sines(rng, n, dt, 0.06, 0.008, 0.08)
        U = (s - s.mean())[:, None]
        X = run(rhs, [0, 0], U, dt)
        X[:, 0] += 0.02 + 4e-4 * np.arange(n) * dt
        runs.append((U, X))
    return (
        sim,
        *record(rng, runs, lambda X, U: X, 0.01),
        "coulomb_friction@torque port (driven by wheel), + sensor_drift/bias@rate",
    )


@case
def car_coast(rng):
    dt = 0.2
    p = {"m": 1.3, "tau": 0.4, "F": 4.0}  # speed in km/h, mass in t

    def nom(t, x, u, p):
        f, _v = x
        return (p["F"] * u[0] - f) / p["tau"], 3.6 * f / p["m"]

    sim = ODESimulator(
        nom, states=["f", "v"], inputs=["pedal"], outputs=["v"], params=dict(p, tau=0.45), dt=dt, x0=[0.0, 60.0]
    )

    def rhs(t, x, u):
        _f, v = x
        d = list(nom(t, x, u, p))
        d[1] -= 3.6 * (0.16 * np.tanh(v / 2.0) + 0.4e-3 * (v / 3.6) ** 2 * 1.0 * np.sign(v)) / p["m"]
        return d

    runs = []
    for k, n in enumerate((220, 260, 200, 240)):
        U = steps(rng, n, -0.55, 0.70, 14)[:, None]
        runs.append((U, run(rhs, [0, 60], U, dt)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X[:, [1]], 0.005),
        "rolling (constant or coulomb)@v + quadratic_drag@v; tau free and 12 % off",
    )


KW["car_coast"] = {"free_params": ["tau"]}


@case
def joint_three(rng):
    dt = 0.01
    p = {"J": 0.15, "b": 0.3, "k": 1.0}

    def nom(t, x, u, p):
        _q, v = x
        return v, (p["k"] * u[0] - p["b"] * v) / p["J"]

    sim = ODESimulator(nom, states=["q", "v"], inputs=["torque"], outputs=["q"], params=p, dt=dt)

    def rhs(t, x, u):
        q, v, w = x
        d = list(nom(t, [q, v], [w], p))
        d[1] -= (0.25 * np.tanh(v / 0.05) + 2.5 * np.sin(q)) / p["J"]
        return [*d, (u[0] - w) / 0.03]

    runs = []
    for n in (400, 350, 350):
        U = sines(rng, n, dt, 2.6, 0.3, 3.0)[:, None]
        runs.append((U, run(rhs, [0, 0, 0], U, dt)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X[:, [0]], 0.005),
        "coulomb_friction@v + gravity_tilt@v/q + input_lag@torque 30 ms",
    )


def _quarter_car():
    p = {"ms": 300.0, "mu": 40.0, "ks": 18000.0, "kt": 180000.0, "c": 1300.0}

    def nom(t, x, u, p):
        s, vs, w, vw = x
        f = p["ks"] * (w - s) + p["c"] * (vw - vs)
        return vs, f / p["ms"], vw, (p["kt"] * (u[0] - w) - f) / p["mu"]

    return nom, p


@case
def none_coloured(rng):
    dt = 0.01
    nom, p = _quarter_car()
    sim = ODESimulator(nom, states=["s", "vs", "w", "vw"], inputs=["road"], outputs=["s", "w"], params=p, dt=dt)
    runs = []
    for n in (300, 300, 300):
        U = (0.02 * sines(rng, n, dt, 1.0, 0.5, 12.0, 8))[:, None]
        runs.append((U, run(lambda t, x, u: nom(t, x, u, p), [0] * 4, U, dt)))
    U, Y, g = record(rng, runs, lambda X, U: X[:, [0, 2]], 0.0)
    e = np.zeros_like(Y)
    for k in range(1, len(Y)):
        e[k] = 0.93 * e[k - 1] + rng.normal(size=2) * np.sqrt(1 - 0.93**2)
    return sim, U, Y + 0.03 * Y.std(0) * e, g, "none (AR(1) noise of 3 %)"


@case
def none_wander(rng):
    dt = 20.0
    p = {"C": 3000.0, "Cw": 15000.0, "h": 30.0, "U": 8.0}

    def nom(t, x, u, p):
        a, w = x
        return (u[0] - p["h"] * (a - w)) / p["C"], (p["h"] * (a - w) - p["U"] * (w - u[1])) / p["Cw"]

    sim = ODESimulator(
        nom, states=["air", "wall"], inputs=["power", "out"], outputs=["air"], params=p, dt=dt, x0=[20.0, 18.0]
    )
    n = 800
    U = np.c_[steps(rng, n, 0, 600, 30), 10 + sines(rng, n, dt, 4.0, 5e-5, 5e-4, 3)]
    runs = [(U, run(lambda t, x, u: nom(t, x, u, p), [20, 18], U, dt))]
    U, Y, g = record(rng, runs, lambda X, U: X[:, [0]], 0.01)
    Y[:, 0] += 0.05 * Y.std() * np.cumsum(rng.normal(size=n)) / np.sqrt(n) * 2
    return sim, U, Y, g, "none or sensor_drift@air (the sensor wanders by a random walk)"


@case
def none_free_off(rng):
    dt = 0.1
    p = {"K": 2.0, "w": 1.3, "z": 0.25, "b": 0.4}

    def nom(t, x, u, p):
        h, v, a = x
        return v, p["K"] * a - 2 * p["z"] * p["w"] * v - p["w"] ** 2 * h, (u[0] - a) / p["b"]

    sim = ODESimulator(
        nom,
        states=["roll", "p", "fin"],
        inputs=["cmd"],
        outputs=["roll", "p"],
        params={"K": 2.2, "w": 1.2, "z": 0.28, "b": 0.36},
        dt=dt,
    )
    runs = []
    for n in (200, 160, 240, 180):
        U = steps(rng, n, -1, 1, 15)[:, None]
        runs.append((U, run(lambda t, x, u: nom(t, x, u, p), [0, 0, 0], U, dt)))
    return (sim, *record(rng, runs, lambda X, U: X[:, :2], 0.02), "none (4 free parameters 8 to 12 % off)")


KW["none_free_off"] = {"free_params": "all"}


@case
def cogging(rng):
    dt = 0.01
    p = {"J": 0.01, "b": 0.02, "k": 0.12}

    def nom(t, x, u, p):
        _q, v = x
        return v, (p["k"] * u[0] - p["b"] * v) / p["J"]

    sim = ODESimulator(nom, states=["q", "v"], inputs=["i"], outputs=["q", "v"], params=p, dt=dt)

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        d[1] -= 0.03 * (np.sin(6 * x[0]) + 0.25 * np.sin(12 * x[0] + 0.5)) / p["J"]
        return d

    runs = []
    for n in (260, 260, 260):
        U = sines(rng, n, dt, 0.9, 0.2, 2.5)[:, None]
        runs.append((U, run(rhs, [0, 0], U, dt)))
    return (sim, *record(rng, runs, lambda X, U: X, 0.01), "LAW at v of q: sin(6q)+sin(12q+..) (cogging)")


@case
def enzyme_inhibition(rng):
    dt = 0.5
    p = {"V": 1.2, "K": 0.5}

    def nom(t, x, u, p):
        s, q = x
        r = p["V"] * s / (p["K"] + s)
        return u[0] * (6.0 - s) - r, r - u[0] * q

    sim = ODESimulator(nom, states=["s", "prod"], inputs=["D"], outputs=["s", "prod"], params=p, dt=dt, x0=[1.0, 4.0])

    def rhs(t, x, u):
        s, q = x
        r = p["V"] * s / (p["K"] + s + s**3 / 8.0)
        return u[0] * (6.0 - s) - r, r - u[0] * q

    runs = []
    for n in (220, 220, 200):
        U = steps(rng, n, 0.02, 0.6, 18)[:, None]
        runs.append((U, run(rhs, [1, 4], U, dt)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X, 0.015),
        "LAW: V (or rate) falls with s^3 (substrate inhibition, enters both balances); imitation parameter_dependence of V or K on s",
    )


@case
def resolver(rng):
    dt = 0.02
    p = {"J": 0.5, "b": 0.8, "k": 2.0}

    def nom(t, x, u, p):
        q, v = x
        return v, (u[0] - p["b"] * v - p["k"] * q) / p["J"]

    sim = ODESimulator(nom, states=["q", "v"], inputs=["torque"], outputs=["q"], params=p, dt=dt)
    runs = []
    for n in (300, 300, 300):
        U = steps(rng, n, -4, 4, 30)[:, None]
        runs.append((U, run(lambda t, x, u: nom(t, x, u, p), [0, 0], U, dt)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X[:, [0]] + 0.12 * np.sin(4 * X[:, [0]]), 0.01),
        "LAW at sensor q: 0.12 sin(4q) (resolver)",
    )
