"""Robots, mechatronics and machines: one to three effects in nature's form, one without a name, two rigs in order."""

import numpy as np
from physical_plants import KW, case, record, run, sines

from sksurrogate.physics import ODESimulator


def off(rng, low=0.05, high=0.15):
    """A factor that is off by 5-15 % to either side."""
    return 1 + rng.choice([-1, 1]) * rng.uniform(low, high)


def moves(rng, n, dt, low, high, speed, accel, dwell, start=0.0):
    """Trapezoidal moves (n,) between levels, with dwells of about ``dwell`` samples."""
    r, v, goal, wait, out = start, 0.0, start, 0, []
    for _ in range(n):
        out.append(r)
        if abs(goal - r) < speed * dt * 0.05 and abs(v) < 2 * accel * dt:
            wait -= 1
            if wait <= 0:
                goal, wait = rng.uniform(low, high), int(rng.integers(dwell // 2, 2 * dwell))
        want = np.sign(goal - r) * min(speed, np.sqrt(1.6 * accel * abs(goal - r)), abs(goal - r) / dt)
        v += np.clip(want - v, -accel * dt, accel * dt)
        r += v * dt
    return np.array(out)


def chirp(rng, n, dt, amp, f0, f1):
    """A sweep (n,) from f0 to f1 in Hz, geometric, of any phase."""
    t = np.arange(n) * dt
    rate = np.log(f1 / f0) / t[-1]
    return faded(amp * np.sin(2 * np.pi * f0 * (np.exp(rate * t) - 1) / rate + rng.uniform(0, 6.28)), dt)


def faded(r, dt):
    """A reference that comes in within 0.6 s, as the rig stands at first."""
    return r * np.minimum(1, np.arange(len(r)) * dt / 0.6)


def pd(ref, dt, kp, kd, pick=0, ki=0.0, limit=np.inf, feed=None):
    """A sampled PID controller of state ``pick`` whose output is the recorded input; ``feed(k, r)`` is added."""
    last, total = [None], [0.0]

    def control(k, x):
        e = ref[k] - x[pick]
        de = 0.0 if last[0] is None else (e - last[0]) / dt
        last[0] = e
        total[0] = np.clip(total[0] + ki * e * dt, -limit, limit)
        return np.clip(kp * e + kd * de + total[0] + (feed(k, ref[k]) if feed else 0.0), -limit, limit)

    return control


def given(u):
    """An input that does not look at the plant."""
    return lambda k, x: u[k]


def loop(rhs, x0, dt, n, control, late=0.0, extra=None):
    """Inputs and states of a run sample by sample; the plant gets the input ``late`` seconds late, ``extra`` (n,) beside it."""
    whole, part = int(late // dt), late % dt
    X, U = [np.asarray(x0, float)], []
    for k in range(n):
        U.append(np.atleast_1d(control(k, X[-1])).astype(float))
        if k == n - 1:
            break
        more = [] if extra is None else [extra[k]]
        x = X[-1]
        if part > 1e-9:
            x = run(rhs, x, [np.r_[U[max(k - whole - 1, 0)], more]] * 2, part)[-1]
        X.append(run(rhs, x, [np.r_[U[max(k - whole, 0)], more]] * 2, dt - part)[-1])
    return np.array(U), np.array(X)


def campaign(rng, dt, truth, on, starts, controls, out, noise, n, extras=None):
    """Inputs, readings and runs of a rig; ``truth(on)`` gives right-hand side and dead time, ``out(X, U, on)`` readings."""
    rhs, late = truth(on)
    pairs = []
    for i, (x0, control) in enumerate(zip(starts, controls)):
        pairs.append(loop(rhs, x0, dt, n, control, late, None if extras is None else extras[i]))
    return record(rng, pairs, lambda X, U: out(X, U, on), noise)


# ---------------------------------------------------------------------------------------------------------- one effect


@case
def exo_elbow(rng):
    """Elbow of an exoskeleton: the foam pad of the flexion stop is not in the simulator."""
    p = {"J": 0.09, "b": 0.4, "mgl": 2.2, "ks": 1.8, "kt": 1.6}
    q = dict(p, b=p["b"] * off(rng))
    dt, n, runs = 0.02, 350, 4

    def nominal(t, x, u, p):
        return x[1], (p["kt"] * u[0] - p["b"] * x[1] - p["mgl"] * np.sin(x[0]) - p["ks"] * x[0]) / p["J"]

    def truth(on):
        def rhs(t, x, u):
            a, w = x
            deep = 0.015 * np.logaddexp(0, (a - 0.95) / 0.015)
            pad = 4.0 * deep**1.3 * (1 + 0.15 * np.tanh(w)) if on[0] else 0.0
            return w, nominal(t, x, u, q)[1] - pad / q["J"]

        return rhs, 0.0

    controls = []
    for i in range(runs):
        r = moves(rng, n, dt, 0.1, 1.4, 2.0, 9.0, 25, 0.2) if i % 2 else 0.7 + chirp(rng, n, dt, 0.55, 0.2, 1.5)
        controls.append(pd(r, dt, 2.5, 0.3, feed=lambda k, r: (2.2 * np.sin(r) + 1.8 * r) / 1.6))
    starts = [[0.2, 0.0] if i % 2 else [0.7, 0.0] for i in range(runs)]
    data = campaign(rng, dt, truth, [1], starts, controls, lambda X, U, on: X[:, :1], 0.008, n)
    sim = ODESimulator(
        nominal, states=["angle", "rate"], inputs=["current"], outputs=["angle"], params=p, dt=dt,
        units={"angle": "rad", "rate": "rad/s", "current": "A", "time": "s"},
    )  # fmt: skip
    return sim, *data, "end_stop@rate by angle from 0.95 rad: a foam pad, 4 Nm/rad^1.3, a little damped; b is off"


KW["exo_elbow"] = {"free_params": ["b"]}


@case
def harmonic_wrist(rng):
    """Wrist with a harmonic drive: friction of the wave generator with a static peak, of finite width."""
    p = {"Jm": 0.05, "Jl": 0.12, "k": 60.0, "d": 0.35, "bm": 0.5, "mgl": 3.0, "kt": 2.4}
    q = dict(p, k=p["k"] * off(rng), bm=p["bm"] * off(rng, 0.05, 0.1))
    dt, n, runs = 0.02, 400, 4

    def nominal(t, x, u, p):
        a, w, c, v = x
        twist = p["k"] * (a - c) + p["d"] * (w - v)
        return (
            w, (p["kt"] * u[0] - p["bm"] * w - twist) / p["Jm"],
            v, (twist - p["mgl"] * np.sin(c)) / p["Jl"],
        )  # fmt: skip

    def truth(on):
        def rhs(t, x, u):
            d = nominal(t, x, u, q)
            w = x[1]
            rub = (0.16 + 0.14 * np.exp(-((w / 0.25) ** 2))) * np.tanh(w / 0.03) if on[0] else 0.0
            return d[0], d[1] - rub / q["Jm"], d[2], d[3]

        return rhs, 0.0

    controls = []
    for i in range(runs):
        r = moves(rng, n, dt, -1.1, 1.1, 2.0, 10.0, 20) if i % 2 else faded(sines(rng, n, dt, 0.5, 0.1, 1.2, 5), dt)
        controls.append(pd(r, dt, 7.0, 0.5, limit=6.0))
    data = campaign(rng, dt, truth, [1], [[0.0] * 4] * runs, controls, lambda X, U, on: X[:, [0, 2]], 0.008, n)
    sim = ODESimulator(
        nominal, states=["motor", "motor_rate", "link", "link_rate"], inputs=["current"], outputs=["motor", "link"],
        params=p, dt=dt,
    )  # fmt: skip
    return (
        sim,
        *data,
        "stribeck_friction@motor_rate (0.30 falls to 0.16 Nm within 0.25 rad/s, tanh 0.03); k, bm are off",
    )


KW["harmonic_wrist"] = {"free_params": ["k", "bm"]}


@case
def dish_rotator(rng):
    """Dish on a worm gear: the motor's angle is the input, and the worn gear has play in its spring."""
    p = {"J": 4.0, "k": 900.0, "b": 90.0}
    q = dict(p, b=p["b"] * off(rng, 0.06, 0.12))
    dt, n, runs = 0.04, 400, 4

    def nominal(t, x, u, p):
        return x[1], (p["k"] * (u[0] - x[0]) - p["b"] * x[1]) / p["J"]

    def truth(on):
        h, s = 0.035, 0.0015

        def rhs(t, x, u):
            z = u[0] - x[0]
            if on[0]:
                z = s * (np.logaddexp(0, (z - h) / s) - np.logaddexp(0, (-z - h) / s))
            return x[1], (q["k"] * z - q["b"] * x[1]) / q["J"]

        return rhs, 0.0

    controls = []
    for i in range(runs):
        r = moves(rng, n, dt, -0.6, 0.6, 0.5, 1.5, 25) if i % 2 else sines(rng, n, dt, 0.3, 0.06, 0.9, 5)
        controls.append(given(r))
    starts = [[c(0, None), 0.0] for c in controls]
    data = campaign(rng, dt, truth, [1], starts, controls, lambda X, U, on: X[:, :1], 0.007, n)
    sim = ODESimulator(
        nominal, states=["azimuth", "rate"], inputs=["motor_angle"], outputs=["azimuth"], params=p, dt=dt,
        units={"azimuth": "rad", "rate": "rad/s", "motor_angle": "rad", "time": "s"},
    )  # fmt: skip
    return sim, *data, "input_backlash@motor_angle 0.035 rad, as a spring with play and soft flanks; b is off"


KW["dish_rotator"] = {"free_params": ["b"]}


@case
def cable_camera(rng):
    """Camera trolley on a cable with a hanging head: the radio link to the drive takes 3.5 samples."""
    p = {"M": 12.0, "m": 4.0, "L": 1.4, "c": 16.0, "d": 0.8, "kf": 20.0}
    q = dict(p, c=p["c"] * off(rng), L=p["L"] * off(rng, 0.05, 0.08))
    dt, n, runs = 0.05, 350, 4

    def nominal(t, x, u, p):
        _, v, a, w = x
        f = p["kf"] * u[0] - p["c"] * v
        acc = (f + p["m"] * np.sin(a) * (p["L"] * w**2 + 9.81 * np.cos(a))) / (p["M"] + p["m"] * np.sin(a) ** 2)
        return v, acc, w, (-acc * np.cos(a) - 9.81 * np.sin(a)) / p["L"] - p["d"] * w

    def truth(on):
        return (lambda t, x, u: nominal(t, x, u, q)), 0.176 if on[0] else 0.0

    controls = []
    for i in range(runs):
        r = moves(rng, n, dt, -2.0, 2.0, 1.2, 1.2, 12) if i % 2 else faded(sines(rng, n, dt, 0.9, 0.04, 0.25, 5), dt)
        buzz = sines(rng, n, dt, 0.4, 0.2, 2.0, 6)
        controls.append(pd(r, dt, 1.6, 1.6, limit=6.0, feed=lambda k, r, buzz=buzz: buzz[k]))
    data = campaign(rng, dt, truth, [1], [[0.0] * 4] * runs, controls, lambda X, U, on: X[:, [0, 2]], 0.012, n)
    sim = ODESimulator(
        nominal, states=["trolley", "speed", "sway", "sway_rate"], inputs=["command"], outputs=["trolley", "sway"],
        params=p, dt=dt,
    )  # fmt: skip
    return sim, *data, "input_delay@command 0.176 s = 3.52 samples; c, L are off"


KW["cable_camera"] = {"free_params": ["c", "L"]}


@case
def quadruped_hip(rng):
    """Hip of a quadruped on a stand, leg in the air: the amplifier bends over softly at its current limit."""
    p = {"J": 0.045, "b": 0.18, "mgl": 1.6, "kt": 0.75, "te": 0.03}
    q = dict(p, mgl=p["mgl"] * off(rng), b=p["b"] * off(rng, 0.05, 0.1))
    dt, n, runs = 0.02, 350, 4

    def nominal(t, x, u, p):
        return (
            x[1], (p["kt"] * x[2] - p["b"] * x[1] - p["mgl"] * np.sin(x[0])) / p["J"],
            (u[0] - x[2]) / p["te"],
        )  # fmt: skip

    def truth(on):
        return (lambda t, x, u: nominal(t, x, [4.8 * np.tanh(u[0] / 4.8)] if on[0] else u, q)), 0.0

    controls = []
    for i in range(runs):
        r = moves(rng, n, dt, -1.0, 1.0, 5.0, 60.0, 14) if i % 2 else chirp(rng, n, dt, 0.6, 0.4, 2.5)
        controls.append(pd(r, dt, 7.0, 0.5, limit=9.0))
    data = campaign(rng, dt, truth, [1], [[0.0] * 3] * runs, controls, lambda X, U, on: X[:, :1], 0.006, n)
    sim = ODESimulator(
        nominal, states=["hip", "hip_rate", "current"], inputs=["command"], outputs=["hip"], params=p, dt=dt,
        units={"hip": "rad", "hip_rate": "rad/s", "current": "A", "command": "A", "time": "s"},
    )  # fmt: skip
    return sim, *data, "input_saturation@command 4.8 A as 4.8 tanh(u / 4.8); mgl, b are off"


KW["quadruped_hip"] = {"free_params": ["mgl", "b"]}


# --------------------------------------------------------------------------------------------------------- two effects


@case
def reaction_wheel_table(rng):
    """Air-bearing table turned by a reaction wheel: the wheel's bearing rubs, the table is not level."""
    p = {"I": 0.6, "Jw": 0.003, "b": 1.2e-4, "bt": 0.03, "kt": 0.04}
    q = dict(p, b=p["b"] * off(rng))
    dt, n, runs = 0.1, 260, 5

    def internal(x, u, p):
        return p["kt"] * u[0] - p["b"] * x[2]

    def rates(x, T, more, p):
        acc = (-T - p["bt"] * x[1] - more) / p["I"]
        return x[1], acc, T / p["Jw"] - acc

    def nominal(t, x, u, p):
        return rates(x, internal(x, u, p), 0.0, p)

    def truth(on):
        def rhs(t, x, u):
            rub = 3.0e-3 * np.tanh(x[2] / 2.0) if on[0] else 0.0
            return rates(x, internal(x, u, q) - rub, 0.0045 * np.sin(x[0]) if on[1] else 0.0, q)

        return rhs, 0.0

    controls, starts = [], []
    for i in range(runs):
        start = rng.uniform(-0.5, 0.5)
        r = moves(rng, n, dt, -1.2, 1.2, 0.35, 0.1, 20, start)
        buzz = sines(rng, n, dt, 0.15, 0.04, 0.5, 5)
        controls.append(pd(r, dt, -2.2, -3.2, limit=1.5, feed=lambda k, r, buzz=buzz: buzz[k]))
        starts.append([start, 0.0, 0.0])
    data = campaign(rng, dt, truth, [1, 1], starts, controls, lambda X, U, on: X[:, [0, 2]], 0.01, n)
    sim = ODESimulator(
        nominal, states=["heading", "rate", "wheel"], inputs=["current"], outputs=["heading", "wheel"], params=p, dt=dt
    )
    return sim, *data, (
        "coulomb_friction of the wheel (3e-3 Nm, tanh 2 rad/s; acts at the port current or @wheel) + gravity_tilt@rate by "
        "heading 0.0045 Nm / 0.6; b is off"
    )  # fmt: skip


KW["reaction_wheel_table"] = {"free_params": ["b"]}


@case
def muscle_lever(rng):
    """Lever pulled by two pneumatic muscles: the braid rubs before it slides, the valve has overlap."""
    p = {"J": 0.06, "A": 2.0, "k": 6.0, "b": 0.35, "kv": 1.0, "tau": 0.15}
    q = dict(p, k=p["k"] * off(rng, 0.05, 0.1))
    dt, n, runs = 0.03, 350, 4
    limits, share = [0.05, 0.15, 0.35], [5.0, 3.0, 1.5]

    def nominal(t, x, u, p):
        return (
            x[1], (p["A"] * x[2] - p["k"] * x[0] - p["b"] * x[1]) / p["J"],
            (p["kv"] * u[0] - x[2]) / p["tau"],
        )  # fmt: skip

    def truth(on):
        h, s = 0.4, 0.04

        def rhs(t, x, u):
            z, w = x[3:], x[1]
            if on[1]:
                u = [s * (np.logaddexp(0, (u[0] - h) / s) - np.logaddexp(0, (-u[0] - h) / s))]
            d = nominal(t, x[:3], u, q)
            pull = sum(c * a for c, a in zip(share, z)) if on[0] else 0.0
            dz = [w - abs(w) * a * abs(a) / f**2 for a, f in zip(z, limits)]
            return d[0], d[1] - pull / q["J"], d[2], *dz

        return rhs, 0.0

    controls = []
    for i in range(runs):
        r = moves(rng, n, dt, -0.8, 0.8, 1.2, 6.0, 18) if i % 2 else faded(sines(rng, n, dt, 0.45, 0.08, 0.8, 5), dt)
        controls.append(pd(r, dt, 3.0, 0.25, limit=5.0, feed=lambda k, r: 3.0 * r))
    data = campaign(rng, dt, truth, [1, 1], [[0.0] * 6] * runs, controls, lambda X, U, on: X[:, [0, 2]], 0.01, n)
    sim = ODESimulator(
        nominal, states=["lever", "rate", "pressure"], inputs=["valve"], outputs=["lever", "pressure"], params=p, dt=dt,
        units={"lever": "rad", "rate": "rad/s", "pressure": "bar", "valve": "V", "time": "s"},
    )  # fmt: skip
    return sim, *data, (
        "hysteresis@rate by lever (three friction elements with springs: 5, 3, 1.5 Nm/rad that slip at 0.05, 0.15, 0.35 rad) + "
        "input_dead_zone@valve 0.4 V; k is off"
    )  # fmt: skip


KW["muscle_lever"] = {"free_params": ["k"]}


@case
def thrust_seesaw(rng):
    """Drone's motor on a seesaw: the cable loom stiffens when it is drawn out, the speed controller filters its command."""
    p = {"J": 0.05, "c": 0.22, "mgl": 2.2, "ct": 0.055, "hang": 0.7, "kq": 1.0, "tau": 0.08}
    q = dict(p, c=p["c"] * off(rng), mgl=p["mgl"] * off(rng, 0.05, 0.08))
    dt, n, runs = 0.04, 350, 4

    def nominal(t, x, u, p):
        a, w, s = x
        torque = p["ct"] * s * abs(s) - p["hang"] * np.cos(a) - p["mgl"] * np.sin(a) - p["c"] * w
        return w, torque / p["J"], (p["kq"] * u[0] - s) / p["tau"]

    def truth(on):
        def rhs(t, x, u):
            d = nominal(t, x[:3], [x[3]] if on[1] else u, q)
            loom = 1.0 * x[0] * (1 - 1 / np.sqrt(1 + (x[0] / 0.4) ** 2)) if on[0] else 0.0
            return d[0], d[1] - loom / q["J"], d[2], (u[0] - x[3]) / 0.11

        return rhs, 0.0

    trim = float(np.sqrt(p["hang"] / p["ct"]))
    controls = []
    for i in range(runs):
        r = moves(rng, n, dt, -0.25, 0.5, 1.2, 4.0, 16) if i % 2 else 0.1 + chirp(rng, n, dt, 0.35, 0.1, 0.9)
        buzz = sines(rng, n, dt, 0.35, 0.2, 2.0, 6)

        inner = pd(r, dt, 0.8, 0.1)

        def control(k, x, inner=inner, buzz=buzz, r=r):
            level = np.sqrt(max(0.7 * np.cos(r[k]) + 2.2 * np.sin(r[k]), 0.1) / 0.055)
            return np.clip(level + inner(k, x) + buzz[k], 0.5, 8.0)

        controls.append(control)
    starts = [[0.0, 0.0, trim, c(0, [0.0, 0.0, trim, trim])] for c in controls]
    data = campaign(rng, dt, truth, [1, 1], starts, controls, lambda X, U, on: X[:, [0, 2]], 0.01, n)
    sim = ODESimulator(
        nominal, states=["tilt", "rate", "speed"], inputs=["throttle"], outputs=["tilt", "speed"], params=p, dt=dt,
        units={"tilt": "rad", "rate": "rad/s", "speed": "krpm", "throttle": "krpm", "time": "s"},
    )  # fmt: skip
    return (
        sim,
        *data,
        (
            "cubic_stiffness@rate by tilt (a loom: 1.0 a (1 - 1/sqrt(1 + (a/0.4)^2)) Nm) + input_lag@throttle 0.11 s; c, mgl are off"
        ),
    )


KW["thrust_seesaw"] = {"free_params": ["c", "mgl"]}


# ------------------------------------------------------------------------------------------------------- three effects


@case
def stacker_crane(rng):
    """Stacker crane: a heavier pallet, rubbing guide rollers of the truck, and a laser that averages its distance."""
    p = {"m1": 60.0, "M": 40.0, "k": 2500.0, "d": 90.0, "c1": 110.0, "kf": 60.0}
    q = dict(p, c1=p["c1"] * off(rng, 0.05, 0.08))
    dt, n, runs = 0.05, 300, 5

    def nominal(t, x, u, p):
        s, v, y, w = x
        f = p["k"] * (s - y) + p["d"] * (v - w)
        return v, (p["kf"] * u[0] - p["c1"] * v - f) / p["m1"], w, f / p["M"]

    def truth(on):
        heavy = dict(q, M=q["M"] * 1.3) if on[0] else q

        def rhs(t, x, u):
            d = nominal(t, x[:4], u, heavy)
            rub = 14.0 * np.tanh(x[1] / 0.02) if on[1] else 0.0
            return d[0], d[1] - rub / q["m1"], d[2], d[3], (x[2] - x[4]) / 0.16

        return rhs, 0.0

    controls = []
    for i in range(runs):
        r = moves(rng, n, dt, -2.0, 2.0, 1.6, 2.5, 14) if i % 2 else faded(sines(rng, n, dt, 0.8, 0.08, 0.5, 5), dt)
        buzz = sines(rng, n, dt, 1.2, 0.2, 1.6, 6)
        controls.append(pd(r, dt, 9.0, 5.0, limit=9.0, feed=lambda k, r, buzz=buzz: buzz[k]))
    data = campaign(
        rng, dt, truth, [1, 1, 1], [[0.0] * 5] * runs, controls,
        lambda X, U, on: np.c_[X[:, 0], X[:, 4] if on[2] else X[:, 2]], 0.007, n,
    )  # fmt: skip
    sim = ODESimulator(
        nominal, states=["truck", "truck_speed", "head", "head_speed"], inputs=["torque"], outputs=["truck", "head"],
        params=p, dt=dt,
    )  # fmt: skip
    return (
        sim,
        *data,
        ("parameter_error@M +0.3 + coulomb_friction@truck_speed 14 N (tanh 0.02) + sensor_lag@head 0.16 s; c1 is off"),
    )


KW["stacker_crane"] = {"free_params": ["c1"]}


# ------------------------------------------------------------------------------------------------------------- no name


@case
def drum_unbalance(rng):
    """Washer extractor on springs: wet cloth on one side of the drum, whose angle nobody measures."""
    p = {"M": 45.0, "k": 15000.0, "c": 260.0, "pull": 55.0, "J": 0.8, "b": 0.5, "kt": 2.6}
    q = dict(p, b=p["b"] * off(rng, 0.05, 0.1))
    dt, n, runs = 0.02, 500, 4

    def nominal(t, x, u, p):
        y, v, w = x
        return (
            v, (p["pull"] * u[0] - p["k"] * y - p["c"] * v) / p["M"],
            (p["kt"] * u[0] - p["b"] * w) / p["J"],
        )  # fmt: skip

    def truth(on):
        def rhs(t, x, u):
            d = nominal(t, x[:3], u, q)
            push = 0.11 * (x[2] ** 2 * np.cos(x[3]) + d[2] * np.sin(x[3])) if on[0] else 0.0
            return d[0], d[1] + push / q["M"], d[2], x[2]

        return rhs, 0.0

    controls, starts = [], []
    for i in range(runs):
        r = moves(rng, n, dt, 6.0, 27.0, 9.0, 30.0, 40, 10.0)
        buzz = sines(rng, n, dt, 0.8, 0.3, 4.0, 6)
        controls.append(pd(r, dt, 0.7, 0.0, 2, ki=0.5, limit=12.0, feed=lambda k, r, buzz=buzz: 0.19 * r + buzz[k]))
        starts.append([0.0, 0.0, 10.0, rng.uniform(-3.1, 3.1)])
    data = campaign(rng, dt, truth, [1], starts, controls, lambda X, U, on: X[:, [0, 2]], 0.015, n)
    sim = ODESimulator(
        nominal, states=["tub", "tub_speed", "drum"], inputs=["current"], outputs=["tub", "drum"], params=p, dt=dt,
        units={"tub": "m", "tub_speed": "m/s", "drum": "rad/s", "current": "A", "time": "s"},
    )  # fmt: skip
    return (
        sim,
        *data,
        "an unbalance turns with the drum, 0.11 kg m w^2 cos(integral of w) on the tub: no name has that; b is off",
    )


KW["drum_unbalance"] = {"free_params": ["b"]}


# ----------------------------------------------------------------------------------------------------------- no effect


@case
def none_rope_winch(rng):
    """Winch that pays out a buoy's rope: gusts on the load, readings that jump, a friction that is off."""
    p = {"m": 30.0, "b": 45.0, "ke": 3.0, "L": 0.12, "R": 1.1}
    q = dict(p, b=p["b"] * off(rng, 0.09, 0.12))
    dt, n, runs = 0.05, 350, 4

    def nominal(t, x, u, p):
        return (
            x[1], (p["ke"] * x[2] - p["b"] * x[1]) / p["m"],
            (u[0] - p["R"] * x[2] - p["ke"] * x[1]) / p["L"],
        )  # fmt: skip

    def truth(on):
        def rhs(t, x, u):
            d = nominal(t, x, u, q)
            return d[0], d[1] + u[1] / q["m"], d[2]

        return rhs, 0.0

    controls, extras = [], []
    for i in range(runs):
        r = moves(rng, n, dt, -1.5, 1.5, 0.9, 1.5, 20) if i % 2 else faded(sines(rng, n, dt, 0.8, 0.05, 0.5, 5), dt)
        controls.append(pd(r, dt, 22.0, 7.0, limit=24.0))
        gust = np.zeros(n)
        for k in range(1, n):
            gust[k] = gust[k - 1] * np.exp(-dt / 0.5) + rng.normal(0, 0.15)
        extras.append(gust)
    U, Y, g = campaign(
        rng, dt, truth, [], [[0.0] * 3] * runs, controls, lambda X, U, on: X[:, [0, 2]], 0.008, n, extras
    )
    jumps = rng.random(Y.shape) < 0.006
    Y = Y + jumps * rng.normal(0, 0.15, Y.shape) * Y.std(0)
    sim = ODESimulator(
        nominal, states=["rope", "speed", "current"], inputs=["volt"], outputs=["rope", "current"], params=p, dt=dt
    )
    return sim, U, Y, g, "no effect: coloured gusts (AR(1), 0.5 s), 0.6 % of readings jump; b is off by 10 %"


KW["none_rope_winch"] = {"free_params": ["b"]}


@case
def none_vane_actuator(rng):
    """Rotary vane actuator of a loading arm with a servo valve: the pressure gauge was zeroed anew before each run."""
    p = {"J": 1.8, "D": 1.2, "b": 3.0, "ks": 9.0, "Kq": 4.0, "Ct": 0.5, "C": 0.06}
    q = dict(p, b=p["b"] * off(rng, 0.08, 0.12), Ct=p["Ct"] * off(rng, 0.08, 0.12))
    dt, n, runs = 0.03, 350, 5

    def nominal(t, x, u, p):
        return (
            x[1], (p["D"] * x[2] - p["b"] * x[1] - p["ks"] * np.sin(x[0])) / p["J"],
            (p["Kq"] * u[0] - p["Ct"] * x[2] - p["D"] * x[1]) / p["C"],
        )  # fmt: skip

    def truth(on):
        return (lambda t, x, u: nominal(t, x, u, q)), 0.0

    controls = []
    for i in range(runs):
        r = moves(rng, n, dt, -0.9, 0.9, 1.2, 5.0, 16) if i % 2 else chirp(rng, n, dt, 0.6, 0.1, 1.2)
        controls.append(pd(r, dt, 2.5, 0.1, limit=4.0, feed=lambda k, r: 0.9 * np.sin(r)))
    U, Y, g = campaign(rng, dt, truth, [], [[0.0] * 3] * runs, controls, lambda X, U, on: X[:, [0, 2]], 0.01, n)
    zero = rng.uniform(-0.03, 0.03, runs)
    Y[:, 1] += zero[g] * Y[:, 1].std()
    sim = ODESimulator(
        nominal, states=["vane", "rate", "pressure"], inputs=["valve"], outputs=["vane", "pressure"], params=p, dt=dt
    )
    return (
        sim,
        U,
        Y,
        g,
        "no effect: the zero of the pressure gauge differs from run to run (up to 3 noises); b, Ct are off",
    )


KW["none_vane_actuator"] = {"free_params": ["b", "Ct"]}
