"""Physical plants with one effect."""

import numpy as np
from physical_plants import KW, case, record, run, sines, steps
from scipy.integrate import solve_ivp

from sksurrogate.physics import ODESimulator


@case
def cylinder_seal(rng):
    dt = 0.01
    p = {"A": 12.0, "b": 6.0, "m": 2.0, "beta": 30.0, "kq": 1.0, "leak": 1.0}

    def nom(t, x, u, p):
        _s, v, pl = x
        return v, (p["A"] * pl - p["b"] * v) / p["m"], p["beta"] * (p["kq"] * u[0] - 0.5 * v) - p["leak"] * pl

    sim = ODESimulator(nom, states=["stroke", "v", "pL"], inputs=["spool"], outputs=["stroke", "pL"], params=p, dt=dt)

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        d[1] -= 9.0 * np.tanh(x[1] / 0.12)
        return d

    runs = []
    for n in (260, 200, 240, 180):
        U = (sines(rng, n, dt, 1.0, 0.4, 3.0) + 0.0)[:, None]
        runs.append((U, run(rhs, [0, 0, 0], U, dt)))
    return (sim, *record(rng, runs, lambda X, U: X[:, [0, 2]], 0.01), "coulomb_friction@v (tanh of a width)")


@case
def amplifier_soft(rng):
    dt = 0.002
    p = {"R": 1.2, "L": 0.01, "k": 0.05, "J": 2e-4, "b": 1e-4}

    def nom(t, x, u, p):
        i, w = x
        return (u[0] - p["R"] * i - p["k"] * w) / p["L"], (p["k"] * i - p["b"] * w) / p["J"]

    sim = ODESimulator(
        nom, states=["current", "speed"], inputs=["voltage"], outputs=["speed"], params=dict(p, J=2.3e-4), dt=dt
    )

    def rhs(t, x, u):
        e = u[0] / (1 + (abs(u[0]) / 14.0) ** 6) ** (1 / 6)
        return nom(t, x, [e], p)

    runs = []
    for n in (300, 300, 300):
        U = steps(rng, n, -24, 24, 25)[:, None]
        runs.append((U, run(rhs, [0, 0], U, dt)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X[:, [1]], 0.01),
        "input_saturation@voltage (knee of 6th order), J free and 15 % off",
    )


KW["amplifier_soft"] = {"free_params": ["J", "b"]}


@case
def oven_convection(rng):
    dt = 30.0
    p = {"C": 5000.0, "Cw": 20000.0, "h": 25.0, "U": 6.0}

    def nom(t, x, u, p):
        a, w = x
        return (u[0] - p["h"] * (a - w)) / p["C"], (p["h"] * (a - w) - p["U"] * (w - u[1])) / p["Cw"]

    sim = ODESimulator(
        nom,
        states=["air", "wall"],
        inputs=["power", "outdoor"],
        outputs=["air", "wall"],
        params=p,
        dt=dt,
        x0=[20.0, 20.0],
    )

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        dT = x[1] - 20.0
        d[1] -= 2.2 * np.sign(dT) * abs(dT) ** 1.25 / p["Cw"]
        return d

    runs = []
    for n in (200, 260, 220):
        U = np.c_[steps(rng, n, 0, 2500, 25), 20 + sines(rng, n, dt, 3.0, 1e-4, 1e-3, 3)]
        runs.append((U, run(rhs, [20, 20], U, dt)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X, 0.005),
        "loss at wall ~ (wall-20)^1.25: linear_loss/power_law@wall, or exchange; constant",
    )


@case
def ship_surge(rng):
    dt = 5.0
    p = {"m": 60.0, "d": 1.5, "T": 25.0}  # speed in knots

    def nom(t, x, u, p):
        th, v = x
        return (u[0] - th) / p["T"], (th - p["d"] * v) / p["m"]

    sim = ODESimulator(nom, states=["thrust", "v"], inputs=["order"], outputs=["v"], params=p, dt=dt)

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        d[1] -= 0.16 * x[1] * abs(x[1]) ** 0.9 / p["m"]
        return d

    runs = []
    for n in (180, 150, 210, 170):
        U = steps(rng, n, -15, 40, 14)[:, None]
        runs.append((U, run(rhs, [0, 0], U, dt)))
    U, Y, g = record(rng, runs, lambda X, U: X[:, [1]], 0.015)
    Y[rng.random(len(Y)) < 0.3] = np.nan
    return sim, U, Y, g, "quadratic_drag/power_law(1.9)@v, thrust unmeasured, 30 % of readings missing"


@case
def tanks_pinhole(rng):
    dt = 2.0
    p = {"A1": 30.0, "A2": 25.0, "k1": 1.4, "k2": 1.6, "kp": 1.0}

    def nom(t, x, u, p):
        h1, h2 = np.maximum(x[0], 0 * x[0]), np.maximum(x[1], 0 * x[1])
        q = p["k1"] * np.sqrt(h1 + 1e-3)
        return (p["kp"] * u[0] - q) / p["A1"], (q - p["k2"] * np.sqrt(h2 + 1e-3)) / p["A2"]

    sim = ODESimulator(nom, states=["h1", "h2"], inputs=["pump"], outputs=["h1", "h2"], params=p, dt=dt, x0=[8.0, 8.0])

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        h = max(x[0], 0)
        d[0] -= 0.45 * h / np.sqrt(h + 0.8) / p["A1"]  # laminar at small heads, turbulent above
        return d

    runs = []
    for n in (240, 240, 200):
        U = steps(rng, n, 1.0, 9.0, 25)[:, None]
        runs.append((U, run(rhs, [8, 8], U, dt)))
    return (sim, *record(rng, runs, lambda X, U: X, 0.02), "sqrt_leak@h1 (orifice with laminar transition)")


@case
def chemostat_maintenance(rng):
    dt = 0.25
    p = {"mu": 0.45, "Ks": 0.6, "Y": 0.5, "Sin": 10.0}

    def nom(t, x, u, p):
        X, S = x
        S = np.maximum(S, 0 * S)
        mu = p["mu"] * S / (p["Ks"] + S)
        return (mu - u[0]) * X, u[0] * (p["Sin"] - S) - mu * X / p["Y"]

    sim = ODESimulator(nom, states=["X", "S"], inputs=["dilution"], outputs=["X", "S"], params=p, dt=dt, x0=[4.0, 1.0])

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        d[1] -= 0.12 * x[0] * x[1] / (x[1] + 0.05)
        return d

    runs = []
    for n in (220, 220, 220):
        U = steps(rng, n, 0.05, 0.40, 24)[:, None]
        runs.append((U, run(rhs, [4, 1], U, dt)))
    return (sim, *record(rng, runs, lambda X, U: X, 0.015), "linear_loss@S driven by X (maintenance, fades at S -> 0)")


@case
def inverter_dead_time(rng):
    dt = 5e-4
    p = {"R": 0.8, "L": 6e-3, "C": 0.004, "G": 0.3}

    def nom(t, x, u, p):
        i, v = x
        return (48.0 * u[0] - p["R"] * i - v) / p["L"], (i - p["G"] * v - u[1]) / p["C"]

    sim = ODESimulator(nom, states=["i", "v"], inputs=["duty", "load"], outputs=["i", "v"], params=p, dt=dt)

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        d[0] -= 3.0 * np.tanh(x[0] / 0.8) / p["L"]
        return d

    runs = []
    for n in (300, 260, 320):
        U = np.c_[np.clip(sines(rng, n, dt, 0.3, 10, 90), -0.95, 0.95), steps(rng, n, -3, 3, 30)]
        runs.append((U, run(rhs, [0, 0], U, dt)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X, 0.01),
        "coulomb_friction@i (voltage of the dead time, with a width)",
    )


@case
def elevator_servo(rng):
    dt = 0.05
    p = {"Za": -1.2, "Zd": -0.1, "Ma": -6.0, "Mq": -1.8, "Md": -9.0}

    def nom(t, x, u, p):
        a, q = x
        return q + p["Za"] * a + p["Zd"] * u[0], p["Ma"] * a + p["Mq"] * q + p["Md"] * u[0]

    sim = ODESimulator(nom, states=["alpha", "q"], inputs=["elevator"], outputs=["q"], params=p, dt=dt)

    def rhs(t, x, u):
        a, q, w = x
        d = nom(t, [a, q], [w], p)
        return [*d, 0.35 * np.tanh((u[0] - w) / 0.02 / 0.35)]  # slew 0.35 rad/s

    runs = []
    for n in (240, 240, 240):
        U = steps(rng, n, -0.3, 0.3, 16)[:, None]
        runs.append((U, run(rhs, [0, 0, U[0, 0]], U, dt)))
    return (sim, *record(rng, runs, lambda X, U: X[:, [1]], 0.02), "rate_limit@elevator (second lag of 20 ms, tanh)")


@case
def speaker_creep(rng):
    dt = 1e-4
    p = {"m": 0.012, "k": 2600.0, "r": 1.6, "Bl": 5.0}  # displacement in mm

    def nom(t, x, u, p):
        s, v = x
        return v, (1e3 * p["Bl"] * u[0] - p["k"] * s - p["r"] * v) / p["m"]

    sim = ODESimulator(nom, states=["x", "v"], inputs=["current"], outputs=["x"], params=p, dt=dt)

    def rhs(t, x, u):
        s, v, z = x
        d = nom(t, [s, v], u, p)
        return [d[0], d[1] - 900.0 * (s - z) / p["m"], (s - z) / 4e-3]

    runs = []
    for n in (400, 350, 300):
        U = (steps(rng, n, -1.0, 1.0, 40) + sines(rng, n, dt, 0.4, 30, 300))[:, None]
        runs.append((U, run(rhs, [0, 0, 0], U, dt)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X[:, [0]], 0.01),
        "hidden_relaxation@v driven by x (creep of the suspension)",
    )


@case
def steering_play(rng):
    dt = 0.05
    p = {"m": 1400.0, "I": 2200.0, "a": 1.2, "b": 1.5, "Cf": 70000.0, "Cr": 80000.0, "ratio": 16.0}
    V = 18.0

    def nom(t, x, u, p):
        vy, r = x
        de = u[0] / p["ratio"] * np.pi / 180
        Ff = p["Cf"] * (de - (vy + p["a"] * r) / V)
        Fr = -p["Cr"] * (vy - p["b"] * r) / V
        return (Ff + Fr) / p["m"] - V * r, (p["a"] * Ff - p["b"] * Fr) / p["I"]

    sim = ODESimulator(
        nom,
        states=["vy", "r"],
        inputs=["wheel_deg"],
        outputs=["r", "ay"],
        params=p,
        dt=dt,
        output=lambda t, x, u, p: (x[1], nom(t, x, u, p)[0] + V * x[1]),
    )
    runs = []
    for n in (260, 240, 220):
        U = sines(rng, n, dt, 14.0, 0.1, 0.9)[:, None]
        w = np.empty(n)
        w[0] = U[0, 0]
        for k in range(1, n):  # play of +- 3 degrees whose flanks give a little
            e = U[k, 0] - w[k - 1]
            w[k] = w[k - 1] + 0.93 * np.sign(e) * max(abs(e) - 3.0, 0)
        X = run(lambda t, x, u: nom(t, x, u, p), [0, 0], w[:, None], dt)
        ay = np.array([nom(0, x, [ww], p)[0] + V * x[1] for x, ww in zip(X, w)])
        runs.append((U, np.c_[X[:, 1], ay]))
    return (sim, *record(rng, runs, lambda X, U: X, 0.02), "input_backlash@wheel_deg (soft flanks)")


@case
def thermowell(rng):
    dt = 0.2
    p = {"k0": 2.0, "E": 1.5, "H": 40.0, "q": 1.0, "Ua": 1.2}

    def nom(t, x, u, p):
        c, T = x
        r = p["k0"] * np.exp(p["E"] * (T - 350.0) / 50.0) * c
        return p["q"] * (1.0 - c) - r, p["q"] * (340.0 - T) + p["H"] * r - p["Ua"] * (T - u[0])

    sim = ODESimulator(nom, states=["c", "T"], inputs=["coolant"], outputs=["c", "T"], params=p, dt=dt, x0=[0.4, 345.0])

    def rhs(t, x, u):
        c, T, s1, s2 = x
        return [*nom(t, [c, T], u, p), (T - s1) / 0.7, (s1 - s2) / 0.1]

    runs = []
    for n in (200, 200, 200):
        U = steps(rng, n, 320, 355, 14)[:, None]
        runs.append((U, run(rhs, [0.4, 345, 345, 345], U, dt)))
    return (sim, *record(rng, runs, lambda X, U: X[:, [0, 3]], 0.01), "sensor_lag@T (well and element: 0.7 and 0.1)")


@case
def arm_bumper(rng):
    dt = 0.02
    p = {"J": 0.4, "b": 0.5, "g": 6.0}

    def nom(t, x, u, p):
        q, v = x
        return v, (u[0] - p["b"] * v - p["g"] * np.sin(q)) / p["J"]

    sim = ODESimulator(nom, states=["q", "v"], inputs=["torque"], outputs=["q"], params=p, dt=dt)

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        d[1] -= 80.0 * 0.03 * np.logaddexp(0, (x[0] - 0.7) / 0.03) / p["J"]
        return d

    runs = []
    for n in (220, 260, 200, 180):
        U = steps(rng, n, -5, 6.5, 20)[:, None]
        runs.append((U, run(rhs, [0, 0], U, dt)))
    return (sim, *record(rng, runs, lambda X, U: X[:, [0]], 0.01), "end_stop@v driven by q (soft bumper)")


@case
def fouling(rng):
    dt = 60.0
    p = {"Ch": 4e5, "Cc": 3e5, "mh": 300.0, "UA": 800.0, "mc": 250.0}

    def nom(t, x, u, p):
        h, c = x
        q = p["UA"] * (h - c)
        return (p["mh"] * (u[0] - h) - q) / p["Ch"], (p["mc"] * (u[1] - c) + q) / p["Cc"]

    sim = ODESimulator(
        nom,
        states=["hot", "cold"],
        inputs=["hot_in", "cold_in"],
        outputs=["hot", "cold"],
        params=p,
        dt=dt,
        x0=[60.0, 40.0],
    )

    def rhs(t, x, u):
        return nom(t, x, u, dict(p, UA=p["UA"] / (1 + 0.5 * (1 - np.exp(-t / 30000.0)))))

    n = 700
    U = np.c_[steps(rng, n, 60, 95, 30), steps(rng, n, 10, 30, 45)]
    runs = [(U, run(rhs, [60, 40], U, dt))]
    return (sim, *record(rng, runs, lambda X, U: X, 0.01), "parameter_drift@UA (fouling that levels off), one long run")


@case
def encoder_coarse(rng):
    dt = 0.01
    p = {"m": 1.0, "c": 1.5, "k": 30.0}

    def nom(t, x, u, p):
        q, v = x
        return v, (u[0] - p["c"] * v - p["k"] * q) / p["m"]

    sim = ODESimulator(nom, states=["q", "v"], inputs=["f"], outputs=["q"], params=p, dt=dt)
    runs = []
    for n in (300, 250, 350):
        U = sines(rng, n, dt, 6.0, 0.3, 2.5)[:, None]
        runs.append((U, run(lambda t, x, u: nom(t, x, u, p), [0, 0], U, dt)))
    step = 0.06

    def enc(X, U):  # floor of the encoder, edges a little uneven
        z = X[:, [0]] / step
        return step * (np.floor(z + 0.05 * np.sin(7 * np.floor(z))) + 0.5)

    return (sim, *record(rng, runs, enc, 0.002), "sensor_quantization@q (floor + half, uneven edges)")


@case
def loop_ball_cavity(rng):
    """Speed loop of a pump drive (PI): torque recorded in closed loop; impeller drag v^1.8."""
    dt = 0.05
    p = {"J": 0.3, "b": 0.05}

    def nom(t, x, u, p):
        return ((u[0] - p["b"] * x[0]) / p["J"],)

    sim = ODESimulator(nom, states=["w"], inputs=["torque"], outputs=["w"], params=dict(p, J=0.26), dt=dt)
    runs = []
    for n in (200, 240, 220, 180):
        ref = steps(rng, n, -10, 25, 20)
        w, z, U, W = 0.0, 0.0, [], []
        for r in ref:
            y = w + 0.1 * rng.normal()
            z += dt * (r - y)
            u = float(np.clip(0.8 * (r - y) + 0.6 * z, -12, 12))
            U.append(u), W.append(w)
            s = solve_ivp(
                lambda t, x, u=u: [nom(t, x, [u], p)[0] - 0.02 * np.sign(x[0]) * abs(x[0]) ** 1.8 / p["J"]],
                (0, dt),
                [w],
                rtol=1e-9,
                atol=1e-10,
            )
            w = s.y[0, -1]
        runs.append((np.array(U)[:, None], np.array(W)[:, None]))
    return (
        sim,
        *record(rng, runs, lambda X, U: X, 0.01),
        "quadratic_drag/power_law(1.8)@w, closed loop, J free and 13 % off",
    )


KW["loop_ball_cavity"] = {"free_params": ["J", "b"]}


@case
def pressure_vessel_relief(rng):
    """Relief valve that opens in a band: end_stop like loss in the balance of p."""
    dt = 0.5
    p = {"V": 20.0, "cv": 0.9, "kin": 1.0}

    def nom(t, x, u, p):
        P = x[0]
        return ((p["kin"] * u[0] - p["cv"] * np.sqrt(np.maximum(P - 1.0, 0 * P) + 1e-4)) / p["V"] * 10,)

    sim = ODESimulator(nom, states=["P"], inputs=["feed"], outputs=["P"], params=p, dt=dt, x0=[3.0])

    def rhs(t, x, u):
        d = nom(t, x, u, p)[0]
        lift = 0.15 * np.logaddexp(0, (x[0] - 5.0) / 0.15)
        return [d - 0.8 * lift * np.sqrt(max(x[0], 0) / 5.0) / p["V"] * 10]

    runs = []
    for n in (180, 150, 160, 200):
        U = steps(rng, n, 0.3, 3.4, 14)[:, None]
        runs.append((U, run(rhs, [3], U, dt)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X, 0.01),
        "end_stop@P (relief valve: opens softly at 5, flow ~ lift*sqrt(P))",
    )


@case
def gantry_hidden_mode(rng):
    """Trolley with a hanging load that nobody modelled."""
    dt = 0.05
    p = {"M": 100.0, "b": 40.0}

    def nom(t, x, u, p):
        return x[1], (u[0] - p["b"] * x[1]) / p["M"]

    sim = ODESimulator(nom, states=["x", "v"], inputs=["F"], outputs=["x", "v"], params=p, dt=dt)

    def rhs(t, x, u):  # load 30 kg at 2.5 m, exact pendulum
        _q, v, th, om = x
        m, l, g = 30.0, 2.5, 9.81
        s, c = np.sin(th), np.cos(th)
        a = (u[0] - p["b"] * v + m * s * (l * om**2 + g * c)) / (p["M"] + m * s**2)
        return [v, a, om, (-a * c - g * s) / l - 0.05 * om]

    runs = []
    for n in (260, 300, 240):
        U = steps(rng, n, -120, 120, 18)[:, None]
        runs.append((U, run(rhs, [0] * 4, U, dt)))
    return (sim, *record(rng, runs, lambda X, U: X[:, :2], 0.01), "hidden_mode@v driven by x (pendulum load)")


@case
def amplifier_two_rates(rng):
    """Hydraulic accumulator: gas law stiffens; slow thermometer; input_gain at one of two pumps 8 % worn."""
    dt = 0.1
    p = {"a": 0.6, "b": 0.25, "c": 1.2, "g": 0.5}

    def nom(t, x, u, p):
        q, P, T = x
        return (
            u[0] + 0.7 * u[1] - p["a"] * q - 0.3 * P,
            p["c"] * q - p["b"] * P,
            0.02 * P * q + 0.3 * (p["g"] * u[1] - T),
        )

    sim = ODESimulator(nom, states=["q", "P", "T"], inputs=["pumpA", "pumpB"], outputs=["q", "P", "T"], params=p, dt=dt)
    runs = []
    for n in (220, 150, 300):
        U = np.c_[steps(rng, n, 0, 2, 14), steps(rng, n, 0, 2, 18)]
        worn = U * [1.0, 1.0]
        worn[:, 0] = U[:, 0] * 0.88
        runs.append((U, run(lambda t, x, u: nom(t, x, u, p), [0, 0, 0], worn, dt)))
    U, Y, g = record(rng, runs, lambda X, U: X, 0.02)
    Y[np.arange(len(Y)) % 7 != 0, 2] = np.nan
    return sim, U, Y, g, "input_gain@pumpA -0.12, T at one seventh of the rate"
