"""Physical plants of eighteen other fields: flight, hydraulics, power electronics, ships, medicine, process and vehicles."""

import numpy as np
from physical_plants import KW, case, record, sines, steps
from physical_plants_imperfect import recorded
from scipy.integrate import solve_ivp

from sksurrogate.physics import ODESimulator


def looped(rhs, x0, refs, control, acting, dt):
    """Commands and states of a loop; ``control(x, r, sum)`` gives command and error, ``acting(commands)`` what reaches the plant."""
    x, total, U, X = np.asarray(x0, float), 0.0, [], []
    for k, r in enumerate(refs):
        u, e = control(x, r, total)
        total += dt * e
        U.append(u)
        X.append(x)
        held = acting(U) if acting else u
        s = solve_ivp(
            lambda t, y, w=held, r=r: rhs(t, y, w, r), (k * dt, (k + 1) * dt), x, method="LSODA", rtol=1e-8, atol=1e-10
        )
        x = s.y[:, -1]
    return np.array(U), np.array(X)


def soft(e, width):
    """A kink at 0 that is ``width`` wide."""
    return width * np.logaddexp(0, e / width)


@case
def quadrotor_yaw(rng):
    """Speed controllers of the motors ignore small commands; air drag of the rotors and arms."""
    dt, p = 0.02, {"K": 4.0, "d": 0.3, "T": 0.06}

    def rhs(t, x, u):
        m, r, _psi = x
        e = soft(u[0] - 0.14, 0.015) - soft(-u[0] - 0.14, 0.015)
        return (e - m) / 0.06, 4.0 * m - 0.3 * r - 0.2 * np.sign(r) * abs(r) ** 1.8, r

    sim = ODESimulator(
        lambda t, x, u, p: ((u[0] - x[0]) / p["T"], p["K"] * x[0] - p["d"] * x[1], x[1]),
        states=["m", "r", "psi"], inputs=["cmd"], outputs=["psi", "r"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(
        rng, rhs, [0, 0, 0], lambda: sines(rng, 260, dt, 1.0, 0.15, 1.5), dt, lambda X, U: X[:, [2, 1]], noise=0.01
    )
    return sim, *data, "input_dead_zone@cmd 0.14 (soft) + quadratic_drag or power_law@r (exponent 1.8)"


@case
def servo_valve(rng):
    """Spool with a slew limit; turbulent leakage across the piston."""
    dt, p = 0.01, {"A": 10.0, "b": 8.0, "k": 30.0, "beta": 40.0, "kq": 1.2, "c": 0.6}

    def nom(t, x, u, p):
        y, v, pl = x
        return v, (p["A"] * pl - p["b"] * v - p["k"] * y) / 2, p["beta"] * (p["kq"] * u[0] - 0.5 * v) - p["c"] * pl

    def rhs(t, x, u):
        s = x[3]
        d = list(nom(t, x[:3], [s], p))
        d[2] -= 3.0 * np.sign(x[2]) * abs(x[2]) ** 0.6
        return [*d, 4.0 * np.tanh((u[0] - s) / 0.01 / 4.0)]

    sim = ODESimulator(nom, states=["y", "v", "pL"], inputs=["spool"], outputs=["y", "pL"], params=p, dt=dt)
    data = recorded(
        rng, rhs, [0] * 4, lambda: steps(rng, 240, -1, 1, 24), dt, lambda X, U: X[:, [0, 2]], runs=5, noise=0.01
    )
    return sim, *data, "rate_limit@spool 4 (soft) + sqrt_leak, linear_loss or power_law@pL (exponent 0.6, odd)"


@case
def buck_converter(rng):
    """Averaged step-down converter; the diode carries the current for the rest of each period."""
    dt, p = 2e-5, {"L": 2e-4, "C": 2e-4, "R": 0.1, "Rl": 2.0}

    def nom(t, x, u, p):
        return (12 * u[0] - p["R"] * x[0] - x[1]) / p["L"], (x[0] - x[1] / p["Rl"]) / p["C"]

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        d[0] -= (1 - u[0]) * (0.3 + 0.09 * np.log1p(max(x[0], 0) / 0.1)) / 2e-4
        return d

    sim = ODESimulator(
        nom, states=["i", "v"], inputs=["duty"], outputs=["i", "v"], params=dict(p, R=0.115), dt=dt, x0=[3.0, 6.0]
    )
    data = recorded(
        rng, rhs, [3.0, 6.0], lambda: steps(rng, 300, 0.35, 0.75, 40), dt, lambda X, U: X, runs=4, noise=0.01
    )
    return sim, *data, "constant_bias@i, input_bias@duty, or that with a gain ((1 - duty) * diode); R free, 15 % off"


KW["buck_converter"] = {"free_params": ["R"]}


@case
def electrolyser_stack(rng):
    """Stack temperature; water evaporates into the gas, the more the hotter (vapour pressure)."""
    dt, p = 20.0, {"e": 0.02, "h": 0.02, "C": 60.0}

    def nom(t, x, u, p):
        T, s = x
        return (p["e"] * u[0] - p["h"] * (T - 25) - 4.18 * u[1] * (T - 20)) / p["C"], (T - s) / 200

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        d[0] -= 0.4 * np.exp(0.055 * (x[0] - 60)) / 60
        return d

    sim = ODESimulator(
        nom, states=["T", "S"], inputs=["amps", "coolant"], outputs=["T", "S"], params=p, dt=dt, x0=[45.0, 45.0]
    )
    data = recorded(
        rng, rhs, lambda: [rng.uniform(35, 60)] * 2,
        lambda: np.c_[steps(rng, 260, 40, 280, 30), steps(rng, 260, 0, 0.02, 40)], dt, lambda X, U: X, noise=0.008,
    )  # fmt: skip
    return sim, *data, "loss exp(0.055 T)@T of T: quadratic_loss, power_law, radiation, end_stop or a law of T"


@case
def wind_drivetrain(rng):
    """Rotor, shaft with play in the coupling, generator."""
    dt, p = 0.02, {"J1": 4.0, "J2": 1.0, "k": 30.0, "c": 0.6, "b": 0.8}

    def nom(t, x, u, p):
        w1, th, w2 = x
        m = p["k"] * th + p["c"] * (w1 - w2)
        return (u[0] - p["b"] * w1 - m) / p["J1"], w1 - w2, (m - u[1]) / p["J2"]

    def rhs(t, x, u):
        w1, th, w2 = x
        m = 30 * (soft(th - 0.09, 0.004) - soft(-th - 0.09, 0.004)) + 0.6 * (w1 - w2)
        return (u[0] - 0.8 * w1 - m) / 4, w1 - w2, m - u[1]

    sim = ODESimulator(nom, states=["w1", "twist", "w2"], inputs=["aero", "gen"], outputs=["w1", "w2"], params=p, dt=dt)
    data = recorded(
        rng, rhs, [0, 0, 0], lambda: np.c_[steps(rng, 260, -7, 9, 30), sines(rng, 260, dt, 4, 0.2, 2.0)], dt,
        lambda X, U: X[:, [0, 2]], noise=0.01,
    )  # fmt: skip
    return (
        sim,
        *data,
        "play in the shaft (dead zone of the twist at w1 and w2): no name; LAW of twist, partial or unknown",
    )


@case
def ship_roll(rng):
    """Roll in waves; bilge keels damp with a power of the roll rate."""
    dt, p = 0.25, {"w2": 0.616, "d": 0.04}

    def rhs(t, x, u):
        return x[1], u[0] - 0.616 * x[0] - 0.04 * x[1] - 0.35 * np.sign(x[1]) * abs(x[1]) ** 1.85

    sim = ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["w2"] * x[0] - p["d"] * x[1]),
        states=["roll", "p"], inputs=["wave"], outputs=["roll"], params=dict(p, w2=0.68), dt=dt,
    )  # fmt: skip
    data = recorded(
        rng, rhs, lambda: [rng.uniform(-0.1, 0.1), 0], lambda: sines(rng, 300, dt, 0.05, 0.06, 0.2), dt,
        lambda X, U: X[:, :1], runs=4, noise=0.015,
    )  # fmt: skip
    return sim, *data, "quadratic_drag@p or power_law@p (exponent 1.85); w2 free, 10 % off"


KW["ship_roll"] = {"free_params": ["w2"]}


@case
def battery_pack(rng):
    """Traction battery with a coolant; its resistance falls when it is warm (Arrhenius)."""
    dt, p = 10.0, {"R": 0.1, "h": 0.05, "m": 0.08, "Cb": 30.0}

    def nom(t, x, u, p):
        b, c = x
        return (p["R"] * u[0] ** 2 - p["h"] * (b - c)) / p["Cb"], (p["h"] * (b - c) - p["m"] * (c - u[1])) / 5

    def rhs(t, x, u):
        return nom(t, x, u, dict(p, R=0.1 * np.exp(2800 * (1 / (x[0] + 273) - 1 / 298))))

    sim = ODESimulator(
        nom, states=["Tb", "Tc"], inputs=["amps", "inlet"], outputs=["Tb", "Tc"], params=dict(p, h=0.057), dt=dt,
        x0=[20.0, 20.0],
    )  # fmt: skip
    data = recorded(
        rng, rhs, lambda: [rng.uniform(5, 25)] * 2,
        lambda: np.c_[steps(rng, 280, -3, 3.5, 12), steps(rng, 280, 5, 25, 60)], dt, lambda X, U: X, noise=0.01,
    )  # fmt: skip
    return sim, *data, "parameter_dependence@R on Tb (exponential), or a law with amps and Tb@Tb; h free, 14 % off"


KW["battery_pack"] = {"free_params": ["h"]}


@case
def insulin_glucose(rng):
    """Minimal model of a patient; the kidney lets glucose pass above a threshold. Remote insulin is not measured."""
    dt, p = 5.0, {"p1": 0.02, "p2": 0.03, "p3": 1.5e-5, "n": 0.1}

    def nom(t, x, u, p):
        G, X, I = x
        return -p["p1"] * (G - 5) - X * G + u[0], -p["p2"] * X + p["p3"] * (I - 10), -p["n"] * (I - 10) + u[1]

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        d[0] -= 0.035 * soft(x[0] - 9.5, 0.4)
        return d

    sim = ODESimulator(
        nom,
        states=["G", "X", "I"],
        inputs=["meal", "insulin"],
        outputs=["G", "I"],
        params=p,
        dt=dt,
        x0=[5.0, 0.0, 10.0],
    )
    data = recorded(
        rng, rhs, [5.0, 0.0, 10.0],
        lambda: np.c_[np.maximum(steps(rng, 200, -0.15, 0.4, 10), 0), steps(rng, 200, 0, 3, 14)], dt,
        lambda X, U: X[:, [0, 2]], noise=0.015,
    )  # fmt: skip
    return sim, *data, "end_stop@G of G (kidney: opens softly at 9.5)"


@case
def crane_wind(rng):
    """Sway of a load below a trolley in one long run; a wind rises within two seconds and stays, gusty."""
    dt, p, n = 0.1, {"l": 8.0, "d": 0.05}, 700
    gust = np.zeros(n)
    for k in range(1, n):
        gust[k] = 0.9 * gust[k - 1] + 0.02 * rng.normal()

    def nom(t, x, u, p):
        return x[1], -9.81 / p["l"] * np.sin(x[0]) - p["d"] * x[1] - u[0] * np.cos(x[0]) / p["l"]

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        air = np.clip((t - 31.0) / 2.0, 0, 1) * (1 + u[1]) - 0.5 * x[1]
        d[1] += (0.09 * air * abs(air) + 0.0225 * x[1] * abs(x[1])) * np.cos(x[0])
        return d

    sim = ODESimulator(nom, states=["sway", "w"], inputs=["a"], outputs=["sway"], params=p, dt=dt)
    U, Y, g = recorded(
        rng,
        rhs,
        [0, 0],
        lambda: np.c_[steps(rng, n, -0.5, 0.5, 30), gust],
        dt,
        lambda X, U: X[:, :1],
        runs=1,
        noise=0.01,
    )
    return sim, U[:, :1], Y, g, "step_disturbance@w 0.09 from 31 to 33 s"


@case
def belt_conveyor(rng):
    """Belt in a speed loop, also slow and back; the command of the torque is on record, the torque is not."""
    dt, p = 0.02, {"M": 2.0, "b": 0.4, "T": 0.1}

    def rhs(t, x, u, r):
        tau, v = x
        lost = (1.0 + 0.9 * np.exp(-(abs(v / 0.25) ** 1.4))) * np.tanh(v / 0.02)
        return (u - tau) / 0.1, (tau - 0.4 * v - lost) / 2

    def control(x, r, total):
        e = r - x[1] + 0.005 * rng.normal()
        return 6 * e + 8 * total, e

    pairs = []
    for _ in range(5):
        refs = steps(rng, 260, -1.2, 1.2, 26)
        U, X = looped(rhs, [0, 0], np.where(abs(refs) < 0.3, 0.3 * refs, refs), control, None, dt)
        pairs.append((U[:, None], X))
    sim = ODESimulator(
        lambda t, x, u, p: ((u[0] - x[0]) / p["T"], (x[0] - p["b"] * x[1]) / p["M"]),
        states=["tau", "v"], inputs=["torque"], outputs=["v"], params=p, dt=dt,
    )  # fmt: skip
    return (
        sim,
        *record(rng, pairs, lambda X, U: X[:, 1:], 0.01),
        "stribeck_friction@v (coulomb_friction, lugre_friction near)",
    )


@case
def pneumatic_cylinder(rng):
    """Cylinder whose rod seal holds harder on the way out."""
    dt, p = 0.01, {"A": 10.0, "b": 6.0, "k": 20.0, "c": 3.0}

    def nom(t, x, u, p):
        y, v, q = x
        return v, p["A"] * q - p["b"] * v - p["k"] * y, 20 * (u[0] - 0.3 * v) - p["c"] * q

    def rhs(t, x, u):
        d = list(nom(t, x, u, p))
        d[1] -= (3.4 if x[1] > 0 else 1.6) * np.tanh(x[1] / 0.04)
        return d

    sim = ODESimulator(nom, states=["y", "v", "q"], inputs=["valve"], outputs=["y", "v"], params=dict(p, b=5.1), dt=dt)
    data = recorded(
        rng, rhs, [0, 0, 0], lambda: sines(rng, 300, dt, 0.6, 0.3, 2.5), dt, lambda X, U: X[:, :2], runs=4, noise=0.01
    )
    return sim, *data, "asymmetric_friction@v (2.5, 0.9), or coulomb_friction + constant_bias@v; b free, 15 % off"


KW["pneumatic_cylinder"] = {"free_params": ["b"]}


@case
def telerobot(rng):
    """A joint in a position loop over a network that sends every fourth command, two samples late."""
    dt, p = 0.02, {"K": 8.0, "c": 2.0}

    def control(x, r, total):
        return 1.2 * (r - x[0] + 0.003 * rng.normal()) - 0.15 * x[1], 0.0

    def acting(U):
        sent = (len(U) - 1) // 4 * 4 - 2
        return U[sent] if sent >= 0 else 0.0

    pairs = []
    for _ in range(5):
        refs = steps(rng, 260, -1, 1, 26)
        U, X = looped(lambda t, x, u, r: (x[1], 8 * u - 2 * x[1]), [0, 0], refs, control, acting, dt)
        pairs.append((U[:, None], X))
    sim = ODESimulator(
        lambda t, x, u, p: (x[1], p["K"] * u[0] - p["c"] * x[1]),
        states=["q", "v"], inputs=["u"], outputs=["q", "v"], params=p, dt=dt,
    )  # fmt: skip
    return (
        sim,
        *record(rng, pairs, lambda X, U: X, 0.01),
        "input_delay@u 0.06 to 0.1 (held for four samples: 0.04 to 0.1)",
    )


@case
def neutral_tank(rng):
    """Neutralisation; the glass electrode creeps after each calibration, ever more slowly."""
    dt, p = 4.0, {"tau": 60.0, "K": 1.0, "s": 1.4}

    def rhs(t, x, u):
        return ((u[0] - u[1]) - x[0]) / 60, (x[0] - x[1]) / 12

    sim = ODESimulator(
        lambda t, x, u, p: ((p["K"] * (u[0] - u[1]) - x[0]) / p["tau"], (x[0] - x[1]) / 12),
        states=["mix", "out"], inputs=["base", "acid"], outputs=["pH"], params=p, dt=dt,
        output=lambda t, x, u, p: [7 + p["s"] * np.arcsinh(2 * x[1])],
    )  # fmt: skip
    creep = 0.9 * (1 - np.exp(-np.arange(240) / 200))[:, None]
    data = recorded(
        rng, rhs, [0, 0], lambda: np.c_[steps(rng, 240, 0, 2, 25), steps(rng, 240, 0, 2, 40)], dt,
        lambda X, U: 7 + 1.4 * np.arcsinh(2 * X[:, 1:]) + creep, noise=0.015,
    )  # fmt: skip
    return sim, *data, "sensor_drift@pH (0.9 (1 - exp(-t / 800)))"


@case
def wire_rope(rng):
    """Isolator with wire ropes: Bouc and Wen with an exponent of 1.6."""
    dt, p = 0.01, {"k": 100.0, "c": 1.5, "m": 1.0}

    def rhs(t, x, u):
        y, v, z = x
        return (
            v, u[0] - 1.5 * v - 100 * y - 70 * z,
            v * (1 - abs(z / 0.06) ** 1.6 * (0.55 + 0.45 * np.sign(v * z))),
        )  # fmt: skip

    sim = ODESimulator(
        lambda t, x, u, p: (x[1], (u[0] - p["c"] * x[1] - p["k"] * x[0]) / p["m"]),
        states=["y", "v"], inputs=["force"], outputs=["y"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(
        rng, rhs, [0] * 3, lambda: sines(rng, 300, dt, 20, 0.3, 3.5), dt, lambda X, U: X[:, :1], runs=4, noise=0.01
    )
    return sim, *data, "hysteresis@v of y (70, 0.06); lugre_friction@v near"


@case
def none_canal(rng):
    """Three reaches of a canal; nothing is missing, waves make coloured noise."""
    dt, p = 30.0, {"a": 0.8, "b": 0.7, "c": 0.6}

    def nom(t, x, u, p):
        q = [p[k] * np.maximum(h, 0 * h + 1e-6) ** 1.5 for k, h in zip("abc", x)]
        return (u[0] - q[0]) / 300, (q[0] - q[1] + u[1]) / 400, (q[1] - q[2]) / 500

    sim = ODESimulator(
        nom, states=["h1", "h2", "h3"], inputs=["gate", "side"], outputs=["h1", "h3"], params=p, dt=dt, x0=[1.0] * 3
    )
    U, Y, g = recorded(
        rng, lambda t, x, u: nom(t, x, u, p), lambda: [rng.uniform(0.8, 1.2), 1.0, rng.uniform(0.8, 1.2)],
        lambda: np.c_[steps(rng, 240, 0.3, 1.6, 20), steps(rng, 240, 0, 0.3, 40)], dt, lambda X, U: X[:, [0, 2]], noise=0,
    )  # fmt: skip
    e = np.zeros_like(Y)
    for k in range(1, len(Y)):
        e[k] = 0.85 * e[k - 1] + rng.normal(size=2) * np.sqrt(1 - 0.85**2)
    return sim, U, Y + 0.02 * Y.std(0) * e, g, "none (AR(1) noise of 2 %; h2 not measured)"


@case
def none_hot_tank(rng):
    """Hot-water store with two layers; the room wanders by a degree, which no record shows."""
    dt, p = 60.0, {"C": 400.0, "ua": 0.02, "mix": 0.15}

    def nom(t, x, u, p, room=20.0):
        a, b = x
        return (
            (60 * u[0] + u[1] * 4.18 * (b - a) - p["ua"] * (a - room) - p["mix"] * (a - b)) / p["C"],
            (u[1] * 4.18 * (12 - b) - p["ua"] * (b - room) + p["mix"] * (a - b)) / p["C"],
        )

    def rhs(t, x, u):
        return nom(t, x, u, p, 20 + u[2])

    def inputs():
        return np.c_[
            np.maximum(steps(rng, 250, -0.1, 0.15, 16), 0), np.maximum(steps(rng, 250, -0.04, 0.04, 10), 0),
            sines(rng, 250, dt, 0.8, 1e-5, 2e-4, 3),
        ]  # fmt: skip

    sim = ODESimulator(
        lambda t, x, u, p: nom(t, x, u, p), states=["top", "low"], inputs=["power", "draw"], outputs=["top", "low"],
        params=p, dt=dt, x0=[50.0, 40.0],
    )  # fmt: skip
    U, Y, g = recorded(
        rng, rhs, lambda: [rng.uniform(45, 60), rng.uniform(30, 42)], inputs, dt, lambda X, U: X, noise=0.01
    )
    return sim, U[:, :2], Y, g, "none (the room wanders: less than the noise)"


@case
def flash_drum(rng):
    """Level loop with a valve that sticks and jumps; the span of the pressure transmitter is wrong."""
    dt, p = 2.0, {"kv": 1.5, "kf": 1.2, "kp": 0.5}

    def nom(t, x, u, p):
        h, P = x
        return (u[1] - p["kv"] * u[0] * np.sqrt(np.maximum(h, 1e-6))) / 20, (p["kf"] * u[1] - p["kp"] * (P - 1)) / 12

    def stuck(U):
        stem = U[0]
        for u in U[1:]:
            if abs(u - stem) > 0.05:
                stem = u - 0.035 * np.sign(u - stem)
        return stem

    def control(x, r, total):
        e = x[0] - r[0] + 0.005 * rng.normal()
        return np.clip(0.5 + 0.5 * e + 0.02 * total, 0, 1), e

    pairs = []
    for _ in range(4):
        refs = np.c_[steps(rng, 260, 0.8, 1.6, 50), steps(rng, 260, 0.4, 1.2, 22)]
        u, X = looped(lambda t, x, u, r: nom(t, x, [u, r[1]], p), [1.2, 2.5], refs, control, stuck, dt)
        pairs.append((np.c_[u, refs[:, 1]], X * [1.0, 0.9]))
    sim = ODESimulator(
        nom, states=["h", "P"], inputs=["valve", "feed"], outputs=["h", "P"], params=p, dt=dt, x0=[1.2, 2.5]
    )
    truth = "input_backlash@valve 0.035 (stiction: band 0.05, jump 0.015) + sensor_gain@P -0.1"
    return sim, *record(rng, pairs, lambda X, U: X, 0.01), truth


@case
def ventilator(rng):
    """Lung on a ventilator: turbulent tube (Blasius), chest wall that stiffens at full volume. Volume is not measured."""
    dt, p = 0.02, {"R": 5.0, "C": 0.06, "I": 0.6}

    def rhs(t, x, u):
        V, q = x
        lost = 5 * q + 5 * abs(q) ** 0.75 * q + V / 0.06 + 1.2 * np.exp(np.minimum((V - 0.9) / 0.09, 20))
        return q, (u[0] - lost) / 0.6

    sim = ODESimulator(
        lambda t, x, u, p: (x[1], (u[0] - p["R"] * x[1] - x[0] / p["C"]) / p["I"]),
        states=["V", "q"], inputs=["pressure"], outputs=["q"], params=p, dt=dt,
    )  # fmt: skip
    data = recorded(rng, rhs, [0, 0], lambda: steps(rng, 280, 0, 28, 22), dt, lambda X, U: X[:, 1:], runs=6, noise=0.01)
    truth = "quadratic_drag or power_law@q of q (1.75) + end_stop, cubic_stiffness or quadratic_loss@q of V"
    return sim, *data, truth
