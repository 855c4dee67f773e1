"""Sixteen simulated twins of plants from trades: fire service, anaesthesia, dialysis, tidal energy, plastics, railways.

Six plants have one effect in the form of nature, three have two at different places, four have one of no entry of the
catalogue, two have none, and one has a parameter that is 15 % off beside an effect. ``ACCEPTED`` and ``NEAR`` are as in
``physical_plants_si``, and ``WRONG`` holds names that a confident answer must not give; all were fixed by engineering
judgement before any diagnosis. ``NOISE`` is the noise of each output as a share of its deviation. Parameters are those
of one plant; starts, inputs, disturbances and noise are drawn.

``CHECK[name]()``, after the case is built, returns what the nominal simulator, the plant, and the plant with its
effects switched off do without noise, and sizes over the noise: of the gap, of all effects, and of each of two effects.

    python tests/benchmarks/physical_plants_trades.py [NAME ...] [--seed 61]

prints these sizes.
"""

import numpy as np
from physical_plants import CASES, KW, case, sines, steps
from physical_plants_messy import settled
from physical_plants_si import coloured, kink
from scipy.integrate import odeint

from sksurrogate.physics import CallableSimulator, ODESimulator, StepSimulator

ACCEPTED, NEAR, WRONG, NOISE, CHECK = {}, {}, {}, {}, {}
FINE = 4  # parts of a sample after which a switch or a stepper of the plant acts


def play(rhs, x, U, D, dt, scale, tick=None):
    """States (n, n_states) at the samples, inputs held; ``tick(x, u)``: what switches and steppers make of them."""
    X, size = [np.array(x, float)], 1e-9 * np.asarray(scale, float)
    parts = FINE if tick else 1
    for k in range(len(U) - 1):
        x = X[-1]
        for j in range(parts):
            if tick:
                x = tick(x, U[k])
            span = [(k + j / parts) * dt, (k + (j + 1) / parts) * dt]
            x = odeint(rhs, x, span, (U[k], D[k]), tfirst=True, rtol=1e-8, atol=size, mxstep=5000)[-1]
        X.append(x)
    return np.array(X)


def rk4(rhs, parts):
    """A step function (t, x, u, p, dt) of ``parts`` steps of Runge and Kutta."""

    def step(t, x, u, p, dt):
        x, h = np.stack([*x]), dt / parts
        for _ in range(parts):
            a = np.stack(rhs(t, x, u, p))
            b = np.stack(rhs(t, x + h / 2 * a, u, p))
            c = np.stack(rhs(t, x + h / 2 * b, u, p))
            x = x + h / 6 * (a + 2 * b + 2 * c + np.stack(rhs(t, x + h * c, u, p)))
        return x

    return step


def size(A, sd):
    """The root of the mean square over the noise, each output by its own."""
    return float(np.sqrt(np.mean((A / sd) ** 2)))


def twin(
    name, rng, sim, true, plan, start, *, see, noise, runs, scale=1.0, grid=0.0, hum=None, tick=None, every=None,
    parts=(),
):  # fmt: skip
    """Inputs, readings and runs of a plant.

    ``true(t, x, u, d, on)`` is the plant, ``on`` a pair of switches of its effects; ``tick(x, u, on)`` is as in
    ``play``. ``see(X, on)`` gives the outputs (n, n_outputs), ``plan(r)`` inputs and hidden disturbances of run r,
    ``start(r, u)`` its first state, ``hum`` the correlation of the noise from row to row, ``every`` for each output how
    many rows lie between its readings.
    """
    made = [[np.asarray(a, float) for a in plan(r)] for r in range(runs)]
    made = [[a if a.ndim == 2 else a[:, None] for a in pair] for pair in made]
    begins = [np.asarray(start(r, U[0]), float) for r, (U, _) in enumerate(made)]

    def campaign(*on):
        switch = tick and (lambda x, u: tick(x, u, on))
        return np.vstack(
            [
                see(play(lambda t, x, u, d: true(t, x, u, d, on), x, U, D, sim.dt, scale, switch), on)
                for (U, D), x in zip(made, begins)
            ]
        )

    clean = campaign(1, 1)
    sd = np.broadcast_to(noise, clean.shape[1]) * clean.std(0)
    e = rng.normal(size=clean.shape) if hum is None else np.array([coloured(rng, len(clean), hum) for _ in sd]).T
    step = np.broadcast_to(grid, clean.shape[1])
    Y = np.where(step > 0, np.round((clean + sd * e) / np.where(step > 0, step, 1)) * step, clean + sd * e)
    rows = np.concatenate([np.arange(len(U)) for U, _ in made])
    for j, gap in enumerate(every or []):
        Y[rows % gap > 0, j] = np.nan

    def check():
        states = getattr(sim, "states", None)
        free = [sim.simulate(U, **({"x0": x[: len(states)]} if states else {})) for (U, _), x in zip(made, begins)]
        out = {"nominal": np.vstack([np.reshape(y, (len(U), -1)) for y, (U, _) in zip(free, made)]), "clean": clean}
        out["off"] = campaign(0, 0)
        out["gaps"] = {
            "gap": size(out["nominal"] - clean, sd),
            "effects": size(out["off"] - clean, sd),
            "rest": size(out["off"] - out["nominal"], sd),
        }
        for j, on in enumerate([(0, 1), (1, 0)][: len(parts)]):
            out["gaps"][parts[j]] = size(campaign(*on) - clean, sd)
        out["by output"] = np.sqrt(np.mean(((out["nominal"] - clean) / sd) ** 2, axis=0)).round(1)
        return out

    NOISE[name], CHECK[name] = noise, check
    return np.vstack([U for U, _ in made]), Y, np.repeat(np.arange(runs), [len(U) for U, _ in made])


def quiet(n):
    """No hidden disturbance."""
    return np.zeros((n, 1))


def led_in(u, rows=6):
    """Inputs that stay at their first values for some rows."""
    u = np.array(u, float)
    u[:rows] = u[0]
    return u


# ------------------------------------------------------------------------------------------ one effect


@case
def supply_vessel_sway(rng):
    """Sway and yaw of a supply vessel on thruster trials, log and gyro, samples of 2 s.

    The hull shed eddies when it moves sideways: a drag of power 1.8 of the sway speed (m/s2), beside the known linear
    one. The simulator has a right-hand side.
    """
    p = {"m": 9000.0, "I": 4.4e6, "d": 0.009, "e": 0.03, "c": 0.25, "b": 2.0e-4}

    def nom(t, x, u, p, eddies=0.0):  # m/s, rad/s, kN (bow, stern, wind)
        v, r = x
        return (
            (u[0] + u[1] + u[2]) / p["m"] - p["d"] * v - p["c"] * r - eddies,
            (28 * u[0] - 31 * u[1] + 4 * u[2]) / p["I"] - p["e"] * r - p["b"] * v,
        )

    def true(t, x, u, d, on):
        return nom(t, x, u, p, on[0] * 0.021 * x[0] * (x[0] ** 2 + 1e-6) ** 0.4)

    def plan(r):
        n = 350
        bow, stern = (led_in(steps(rng, n, -90, 90, 35)) for _ in range(2))
        return np.c_[bow, stern, 25 * coloured(rng, n, 0.97)], quiet(n)

    sim = ODESimulator(nom, states=["v", "r"], inputs=["bow", "stern", "wind"], outputs=["v", "r"], params=p, dt=2.0)
    data = twin(
        "supply_vessel_sway", rng, sim, true, plan, lambda r, u: [rng.uniform(-0.2, 0.2), 0], see=lambda X, on: X,
        noise=0.03, runs=4, scale=[1, 1e-2],
    )  # fmt: skip
    return sim, *data, "quadratic_drag@v 0.021 (power 1.8)"


ACCEPTED["supply_vessel_sway"] = [["quadratic_drag@v of v", "power_law@v of v (exponent 1.4 to 2.5)"]]
NEAR["supply_vessel_sway"] = ["cubic_stiffness@v of v", "linear_loss@v or parameter_error@d (+), said to be partial"]
WRONG["supply_vessel_sway"] = ["any friction with a level", "any name at r, or at a thruster"]


@case
def pantograph_bench(rng):
    """Railway pantograph below a shaker that plays contact wire heights back, samples of 10 ms, two heights.

    The joints of the frame rub: 9 N, 15 N at creep, Stribeck width 0.04 m/s, smooth within 4 mm/s. The simulator has a
    right-hand side.
    """
    p = {"m1": 9.0, "m2": 17.0, "k1": 5200.0, "c1": 60.0, "c2": 40.0, "kc": 30000.0, "cc": 80.0}

    def nom(t, x, u, p, rub=0.0):  # m, m/s; wire height in m, lift in N
        a, va, b, vb = x
        head = p["k1"] * (a - b) + p["c1"] * (va - vb)
        return (
            va,
            (p["kc"] * (u[0] - a) - p["cc"] * va - head) / p["m1"],
            vb,
            (u[1] + head - p["c2"] * vb - rub) / p["m2"],
        )

    def true(t, x, u, d, on):
        v = x[3]
        return nom(t, x, u, p, on[0] * (9 + 6 * np.exp(-((v / 0.04) ** 2))) * np.tanh(v / 0.004))

    def plan(r):
        n = 500
        wire = sines(rng, n, 0.01, 0.012, 0.25, 2.2, 7) + steps(rng, n, -0.006, 0.006, 90)
        return np.c_[led_in(wire * np.minimum(1, np.arange(n) / 50)), steps(rng, n, 0, 25, 120)], quiet(n)

    sim = ODESimulator(
        nom, states=["head", "vh", "frame", "vf"], inputs=["wire", "lift"], outputs=["head", "frame"], params=p, dt=0.01
    )
    data = twin(
        "pantograph_bench", rng, sim, true, plan, lambda r, u: [0, 0, 0, 0], see=lambda X, on: X[:, [0, 2]],
        noise=0.012, runs=3, scale=[1e-2, 0.1, 1e-2, 0.1],
    )  # fmt: skip
    return sim, *data, "stribeck_friction@vf 0.53 to 0.88 m/s2 (9 to 15 N)"


ACCEPTED["pantograph_bench"] = [
    [f"{a}@vf of vf" for a in ("stribeck_friction", "coulomb_friction", "asymmetric_friction", "lugre_friction")]
]
NEAR["pantograph_bench"] = [
    "hysteresis@vf of frame",
    "linear_loss@vf of vf or parameter_error@c2 (+), said to be partial",
]
WRONG["pantograph_bench"] = ["a friction at vh", "quadratic_drag@vf said to be all", "a name at the inputs or sensors"]


@case
def wind_turbine_pitch(rng):
    """Rotor and tower of a wind turbine of 2 MW above rated wind, samples of 0.25 s; speeds of rotor and tower top.

    The hydraulic pitch drive follows its command as a system of second order (4 rad/s, damping 1); the simulator, a
    right-hand side, takes the command for the angle.
    """
    p = {"J": 6.2e6, "R": 40.0, "D": 6e5, "T0": 1.0e6, "mt": 2.6e5, "w0": 2.1, "z": 0.06, "wr": 1.8}

    def thrust(x, u, p):
        wind = u[0] - x[2]
        lam = p["R"] * x[0] / wind
        inv = 1 / (lam + 0.08 * u[1]) - 0.035 / (u[1] ** 3 + 1)
        cp = 0.22 * (116 * inv - 0.4 * u[1] - 5) * np.exp(-12.5 * inv)
        area = 0.5 * 1.225 * np.pi * p["R"] ** 2
        return area * cp * wind**3 / x[0], area * (0.62 - 0.035 * u[1]) * wind**2

    def nom(t, x, u, p):  # rad/s, m, m/s; wind in m/s, pitch in degrees, extra torque in MN m
        torque, push = thrust(x, u, p)
        sway = (push - 2.2e5) / p["mt"] - 2 * p["z"] * p["w0"] * x[2] - p["w0"] ** 2 * x[1]
        return (torque - p["T0"] - 1e6 * u[2] - p["D"] * (x[0] - p["wr"])) / p["J"], x[2], sway

    def true(t, x, u, d, on):
        angle, rate = x[3:]
        move = 4.0**2 * (u[1] - angle) - 2 * 4.0 * rate
        return *nom(t, x[:3], [u[0], angle if on[0] else u[1], u[2]], p), rate, move

    def plan(r):
        n = 400
        pitch = 9.5 + r + np.round(steps(rng, n, -3.0, 3.0, 16), 1)
        pitch[:6] = 11.0
        wind = 14.5 + np.minimum(1, np.arange(n) / 60) * (r - 1.5 + 0.4 * coloured(rng, n, 0.95))
        return np.c_[wind, pitch, steps(rng, n, -0.08, 0.08, 60) * (np.arange(n) > 5)], quiet(n)

    rest = settled(lambda x: nom(0, x, [14.5, 11.0, 0.0], p), [1.8, 0.0, 0.0], 600)
    sim = ODESimulator(
        nom, states=["W", "x", "vx"], inputs=["wind", "pitch", "torque"], outputs=["W", "vx"], params=p, dt=0.25,
        x0=rest,
    )  # fmt: skip
    data = twin(
        "wind_turbine_pitch", rng, sim, true, plan, lambda r, u: [*rest, u[1], 0.0], see=lambda X, on: X[:, [0, 2]],
        noise=[0.02, 0.03], runs=4, scale=[1, 0.1, 0.1, 1, 1],
    )  # fmt: skip
    return sim, *data, "input_lag@pitch 0.5 s (second order, 4 rad/s)"


ACCEPTED["wind_turbine_pitch"] = [["input_lag@pitch", "input_delay@pitch with input_lag@pitch"]]
NEAR["wind_turbine_pitch"] = ["input_delay or rate_limit@pitch, said to be partial"]
WRONG["wind_turbine_pitch"] = [
    "sensor_lag or sensor_delay@W or vx",
    "hidden_mode@vx said to be all",
    "input_lag@wind or torque",
]


@case
def gas_turbine_fuel(rng):
    """Gas turbine on test: speed and exhaust temperature, samples of 0.1 s; a tool that gives trajectories alone.

    The stepping motor of the fuel valve makes at most one step of 0.4 % each 25 ms (0.16 1/s), and rests within half a
    step.
    """
    p = {"T": 3.5, "a": 42.0, "b": 0.55, "load": 9.0, "Te": 2.2, "h": 380.0}

    def nom(t, x, u):  # %, K; fuel and load 0 to 1
        N, E = x
        hot = 420 + p["h"] * u[0] * 100 / (N + 15) - 0.8 * (N - 60)
        over = N - 70
        power = p["a"] * (u[0] - 0.5) - p["b"] * over - 0.006 * over**2 - p["load"] * u[1]
        return power / p["T"], (hot - E) / p["Te"]

    begin = settled(lambda x: nom(0, x, [0.5, 0.2]), [70.0, 600.0], 200)

    def table(U):
        U = np.asarray(U, float)
        return play(lambda t, x, u, d: nom(t, x, u), begin, U, U, 0.1, [10, 100])

    def true(t, x, u, d, on):
        return *nom(t, x[:2], [x[2] if on[0] else u[0], u[1]]), 0.0

    def tick(x, u, on):
        move = np.sign(u[0] - x[2]) * 0.004 * (abs(u[0] - x[2]) > 0.002)
        return np.r_[x[:2], x[2] + move]

    def plan(r):
        n = 400
        fuel = np.r_[np.full(6, 0.5), np.round(steps(rng, n - 6, 0.25, 0.85, 40), 3)]
        return np.c_[fuel, np.r_[np.full(6, 0.2), steps(rng, n - 6, 0.0, 0.5, 70)]], quiet(n)

    sim = CallableSimulator(table, inputs=["fuel", "load"], outputs=["N", "E"], dt=0.1)
    data = twin(
        "gas_turbine_fuel", rng, sim, true, plan, lambda r, u: [*begin, 0.5], see=lambda X, on: X[:, :2], noise=0.012,
        runs=4, grid=[0.01, 0.1], scale=[10, 100, 1], tick=tick,
    )  # fmt: skip
    return sim, *data, "rate_limit@fuel 0.16 1/s (stepper), simulate only"


ACCEPTED["gas_turbine_fuel"] = [["rate_limit@fuel"]]
NEAR["gas_turbine_fuel"] = ["input_lag@fuel, said to be partial", "input_quantization@fuel beside rate_limit@fuel"]
WRONG["gas_turbine_fuel"] = ["a sensor effect", "input_lag or input_delay@fuel said to be all", "a name at load"]


@case
def telecom_cabinet(rng):
    """Air and batteries of an outdoor telecom cabinet, degrees C, samples of 2 minutes, two logs of two days.

    A thermosyphon takes heat out to the air outside; its condensate chokes it (7 W/K, halved at 40 K). The simulator, a
    right-hand side, knows the walls, which the sun heats, and no thermosyphon.
    """
    p = {"Ca": 26000.0, "Cb": 140000.0, "h": 22.0, "UA": 9.0, "sun": 0.012}

    def nom(t, x, u, p, loop=0.0):  # K, W; power in W, outside in degrees C, sun in W/m2
        a, b = x
        wall = p["UA"] * (u[1] + p["sun"] * u[2] - a)
        return (u[0] + wall - p["h"] * (a - b) - loop) / p["Ca"], p["h"] * (a - b) / p["Cb"]

    def true(t, x, u, d, on):
        e = x[0] - u[1]
        return nom(t, x, u, p, on[0] * 7 * e / (1 + abs(e) / 40))

    def plan(r):
        n = 720
        t = np.arange(n) * 120 / 86400
        day = np.sin(2 * np.pi * (t - 0.3))
        out = 14 + 8 * day + 2.5 * coloured(rng, n, 0.99) + rng.uniform(-3, 3)
        sun = np.maximum(0, 650 * day * (0.75 + 0.2 * coloured(rng, n, 0.97)))
        power = np.clip(steps(rng, n, -90, 420, 70), 0, None)
        return np.c_[np.round(power), np.round(out, 1), np.round(sun)], quiet(n)

    sim = ODESimulator(
        nom, states=["air", "battery"], inputs=["power", "outside", "sun"], outputs=["air", "battery"], params=p,
        dt=120.0, x0=[18.0, 18.0],
    )  # fmt: skip
    data = twin(
        "telecom_cabinet", rng, sim, true, plan, lambda r, u: [18 + rng.uniform(-2, 2), 18 + rng.uniform(-2, 2)],
        see=lambda X, on: X, noise=0.03, runs=2, grid=0.1, scale=10,
    )  # fmt: skip
    return sim, *data, "exchange@air of outside 7/26000 1/s (halved at 40 K)"


ACCEPTED["telecom_cabinet"] = [["exchange@air of outside", "parameter_error@UA (+)"]]
NEAR["telecom_cabinet"] = [
    "linear_loss@air of air, said to be partial",
    "exchange@air of another signal, said to be partial",
]
WRONG["telecom_cabinet"] = ["input_gain@power", "radiation@air", "parameter_error@h", "a name at battery"]


@case
def fuel_cell_air(rng):
    """Air supply of a fuel cell: compressor speed and manifold pressure, samples of 20 ms, a step function.

    The drive of the compressor saturates softly above 0.62 (of 1) of its command.
    """
    p = {"k": 60.0, "a": 1.1, "b": 5.0, "w": 0.42, "v": 5.2, "p0": 1.0}

    def nom(t, x, u, p):  # krpm, bar; command and valve 0 to 1
        w, m = x
        return (
            p["k"] * u[0] - p["a"] * w - p["b"] * (m - p["p0"]) - 0.002 * w * w,
            p["w"] * w * (1 - 0.12 * (m - p["p0"])) / 4 - p["v"] * (0.3 + u[1]) * (m - p["p0"]) / (0.6 + 0.4 * m),
        )

    def true(t, x, u, d, on):
        return nom(t, x, [u[0] - on[0] * 0.75 * (kink(u[0] - 0.62, 0.025) - kink(-0.62, 0.025)), u[1]], p)

    def plan(r):
        n = 450
        u = 0.42 + 0.12 * r + sines(rng, n, 0.02, 0.11, 0.1, 1.5, 5) + steps(rng, n, -0.18, 0.18, 60)
        return np.c_[led_in(np.round(np.clip(u, 0.1, 0.95), 3)), led_in(steps(rng, n, 0.2, 0.8, 80))], quiet(n)

    rest = settled(lambda x: nom(0, x, [0.5, 0.5], p), [20.0, 1.5], 100)
    sim = StepSimulator(
        rk4(nom, 4), states=["w", "m"], inputs=["command", "valve"], outputs=["w", "m"], params=p, dt=0.02, x0=rest
    )
    data = twin(
        "fuel_cell_air", rng, sim, true, plan, lambda r, u: settled(lambda x: true(0, x, u, 0, (1, 1)), rest, 100),
        see=lambda X, on: X, noise=0.015, runs=3, scale=[10, 1],
    )  # fmt: skip
    return sim, *data, "input_saturation@command (soft, bends at 0.62)"


ACCEPTED["fuel_cell_air"] = [["input_saturation@command", "end_stop@w of command"]]
NEAR["fuel_cell_air"] = [
    "input_curve (c < 0), input_gain (-) or quadratic_loss@command or w of command, said to be partial"
]
WRONG["fuel_cell_air"] = [
    "quadratic_drag, power_law or state_saturation@w of w said to be all",
    "rate_limit@command",
    "a name at m",
]


# ------------------------------------------------------------------------------------------ two effects


@case
def crane_hoist(rng):
    """Workshop crane: trolley, sway and rope length, samples of 50 ms; no speeds are measured.

    The wheels of the trolley rub (136 N, smooth within 2 cm/s), and the hoist drive follows its command
    with lags of 0.35 and 0.12 s, where the simulator, a right-hand side, has its speed at once.
    """
    p = {"M": 420.0, "m": 260.0, "c": 350.0, "g": 9.81, "d": 0.01}

    def nom(t, x, u, p, rub=0.0):  # m, rad; force in N, hoist command in m/s
        _, v, th, w, L = x
        s, c = np.sin(th), np.cos(th)
        pull = p["m"] * (p["g"] * c + L * w * w)
        a = (u[0] - p["c"] * v + pull * s - rub) / (p["M"] + p["m"] * s * s + 1)
        return v, a, w, (-a * c - p["g"] * s - 2 * u[1] * w) / L - p["d"] * w, u[1]

    def true(t, x, u, d, on):
        rope = x[6] if on[1] else u[1]
        return (
            *nom(t, x[:5], [u[0], rope], p, on[0] * 136 * np.tanh(x[1] / 0.02)),
            (u[1] - x[5]) / 0.12,
            (x[5] - x[6]) / 0.35,
        )

    def plan(r):
        n = 500
        push = (500 + 80 * r) * np.where(np.cumsum(rng.random(n) < 0.04) % 2, 1.0, -1.0)
        push = np.round(push + steps(rng, n, -60, 60, 40))
        rope, L, speed = np.zeros(n), 4.0, 0.0
        for k in range(6, n):
            if rng.random() < 0.04:
                speed = rng.choice([0.35, 0.0, -0.35])
            speed = 0.0 if (L < 2.2 and speed < 0) or (L > 6 and speed > 0) else speed
            rope[k], L = speed, L + 0.05 * speed
        push[:6] = 0
        return np.c_[push, rope], quiet(n)

    sim = ODESimulator(
        nom, states=["q", "v", "th", "w", "L"], inputs=["force", "hoist"], outputs=["q", "th", "L"], params=p, dt=0.05,
        x0=[0, 0, 0, 0, 4.0],
    )  # fmt: skip
    data = twin(
        "crane_hoist", rng, sim, true, plan, lambda r, u: [0, 0, 0, 0, 4.0 + rng.uniform(-0.3, 0.3), 0, 0],
        see=lambda X, on: X[:, [0, 2, 4]], noise=[0.02, 0.02, 0.006], runs=3, parts=["friction", "lag"],
    )  # fmt: skip
    return sim, *data, "coulomb_friction@force of v 136 N + input_lag@hoist 0.47 s (0.35 and 0.12)"


ACCEPTED["crane_hoist"] = [
    [f"{a}_friction@force of v" for a in ("coulomb", "asymmetric", "stribeck", "lugre")],
    ["input_lag@hoist", "input_delay@hoist with input_lag@hoist"],
]
NEAR["crane_hoist"] = [
    "one of both alone, said to be partial",
    "input_delay or rate_limit@hoist, said to be partial",
    "a friction@v, said to be partial (the trolley shakes the load, so a term at v alone is not all)",
    "linear_loss@v or parameter_error@c for the friction, said to be partial",
    "input_dead_zone@force for the friction, said to be partial",
    "sensor_lag@L for the hoist",
]
WRONG["crane_hoist"] = ["friction at w", "a name at th"]


@case
def propofol_infusion(rng):
    """Propofol in a patient, three compartments and an effect site, samples of 15 s, blood drawn each 3 minutes.

    Deep sedation opens a second path of elimination (0.05 1/min, half of it gone at 9 mg/l), and the BIS monitor
    smooths over the last minute (lags of 0.6 and 0.3 min). The simulator, a right-hand side with outputs, knows
    neither.
    """
    p = {
        "V": 12.0,
        "k10": 0.12,
        "k12": 0.11,
        "k21": 0.055,
        "k13": 0.042,
        "k31": 0.0033,
        "ke": 0.46,
        "E50": 3.4,
        "g": 2.1,
    }

    def depth(c, p):
        part = np.maximum(c, 0 * c + 1e-9) ** p["g"]
        return 93 * (1 - part / (part + p["E50"] ** p["g"]))

    def nom(t, x, u, p, more=0.0):  # mg/l, 1/min; rate in mg/min
        a, b, c, e = x
        return (
            u[0] / p["V"] - (p["k10"] + p["k12"] + p["k13"]) * a + p["k21"] * b + p["k31"] * c - more,
            p["k12"] * a - p["k21"] * b,
            p["k13"] * a - p["k31"] * c,
            p["ke"] * (a - e),
        )

    def true(t, x, u, d, on):
        more = on[0] * 0.05 * x[0] / (1 + x[0] / 9)
        return *nom(t, x[:4], u, p, more), (depth(x[3], p) - x[4]) / 0.6, (x[4] - x[5]) / 0.3

    def see(X, on):
        return np.c_[X[:, 5] if on[1] else depth(X[:, 3], p), X[:, 0]]

    def plan(r):
        n = 300
        rate = np.clip(np.round(steps(rng, n, -6, 20, 22), 1), 0, None)
        rate[:4], rate[4:8] = 0, 95 + 10 * r
        return rate, quiet(n)

    sim = ODESimulator(
        nom, states=["C1", "C2", "C3", "Ce"], inputs=["rate"], outputs=["bis", "blood"], params=p, dt=0.25,
        x0=[0, 0, 0, 0.0], output=lambda t, x, u, p: [depth(x[3], p), x[0]],
    )  # fmt: skip
    data = twin(
        "propofol_infusion", rng, sim, true, plan, lambda r, u: [0, 0, 0, 0, 93, 93], see=see, noise=[0.02, 0.03],
        runs=4, scale=[1, 1, 1, 1, 10, 10], every=[1, 12], parts=["elimination", "smoothing"],
    )  # fmt: skip
    return sim, *data, "linear_loss@C1 (0.05, saturates at 9 mg/l) + sensor_lag@bis 0.9 min (0.6 and 0.3)"


ACCEPTED["propofol_infusion"] = [
    ["linear_loss@C1 of C1", "parameter_error@k10 (+)", "power_law@C1 of C1 (exponent 0.6 to 1.2)"],
    ["sensor_lag@bis", "sensor_delay@bis with sensor_lag@bis"],
]
NEAR["propofol_infusion"] = [
    "one of both alone, said to be partial",
    "sensor_delay@bis for the monitor",
    "parameter_error@ke (-) for the monitor (the twin of a lag, were there no second)",
    "input_gain@rate or parameter_error@V for the elimination, said to be partial",
    "sqrt_leak@C1",
]
WRONG["propofol_infusion"] = ["sensor_gain or sensor_nonlinearity@bis", "a lag of the rate, said to be all"]


@case
def irrigation_pool(rng):
    """Pool of an irrigation canal between a sluice gate and a weir, levels at both ends, a step function of a minute.

    The spindle of the gate has play (2.6 cm to each side) and yields within 40 s, and a flap of an offtake leaks as an
    orifice that also widens with the level (about 0.13 m3/s). Levels are shown in mm.
    """
    p = {"A1": 2600.0, "A2": 2100.0, "kg": 6.5, "kc": 5.2, "kw": 8.6, "crest": 0.9}

    def nom(t, x, u, p, leak=0.0):  # m, m3/s; gate opening and level of the main canal in m
        a, b = x
        fall = np.sqrt(np.maximum(u[1] - a, 0 * a + 1e-3))
        head = np.maximum(b - p["crest"], 0 * b)
        inflow, along = p["kg"] * u[0] * fall, p["kc"] * (a - b) / (0.08 + np.sqrt((a - b) ** 2 + 1e-4))
        return (inflow - along) / p["A1"], (along - p["kw"] * head**1.5 - leak) / p["A2"]

    def true(t, x, u, d, on):
        e = u[0] - x[2]
        moved = (e - np.clip(e, -0.026, 0.026)) / 40
        leak = on[1] * 0.15 * np.sqrt(max(x[1] - 0.45, 0)) * (1 + 0.3 * (x[1] - 1.2))
        return *nom(t, x[:2], [x[2] if on[0] else u[0], u[1]], p, leak), moved

    def plan(r):
        n = 480
        gate = np.round(0.3 + 0.05 * r + steps(rng, n, -0.12, 0.12, 25), 2)
        return np.c_[led_in(gate), led_in(1.95 + 0.04 * coloured(rng, n, 0.99))], quiet(n)

    rest = settled(lambda x: nom(0, x, [0.3, 1.95], p), [1.4, 1.3], 60000)
    sim = StepSimulator(
        rk4(nom, 12), states=["h1", "h2"], inputs=["gate", "canal"], outputs=["h1", "h2"], params=p, dt=60.0, x0=rest
    )

    def start(r, u):
        return [*settled(lambda x: true(0, [*x, u[0]], u, 0, (1, 1))[:2], rest, 60000), u[0]]

    data = twin(
        "irrigation_pool", rng, sim, true, plan, start, see=lambda X, on: X[:, :2], noise=0.03, runs=3, grid=0.001,
        parts=["play", "leak"],
    )  # fmt: skip
    return sim, *data, "input_backlash@gate 0.026 (yields) + sqrt_leak@h2 (0.15/2100, orifice above 0.45 m), a step"


ACCEPTED["irrigation_pool"] = [
    ["input_backlash@gate"],
    ["sqrt_leak@h2 of h2", "linear_loss@h2 of h2", "power_law@h2 of h2", "constant_bias@h2 (-)", "end_stop@h2 of h2"],
]
NEAR["irrigation_pool"] = [
    "one of both alone, said to be partial",
    "input_lag, input_delay or input_dead_zone@gate for the play, said to be partial",
    "parameter_error@kw or crest, quadratic_loss@h2 for the leak, said to be partial",
    "a loss at h1 for the leak, said to be partial",
]
WRONG["irrigation_pool"] = ["sensor_bias or sensor_gain@h2 said to be all", "a name at canal"]


# ------------------------------------------------------------------------------------------ an effect of no entry


@case
def fire_hose(rng):
    """Pump of a fire engine with a hose of 60 m: speed and outlet pressure, samples of 50 ms.

    The simulator, a right-hand side, has a nozzle right behind the pump. The hose has inertia and a wall that stiffens
    with its pressure, and its friction goes with the square of the flow: a resonance of 2.5 to 4.5 rad/s that moves
    with the pressure and is damped by the flow.
    """
    p = {"J": 1.0, "k": 12.0, "d": 0.9, "C": 1.2, "kl": 1.1, "kq": 6.0, "ki": 0.35, "kn": 2.0}

    def nom(t, x, u, p, flow=None):  # 100 rad/s, bar; throttle and nozzle 0 to 1
        n, P = x
        flow = p["kn"] * u[1] * np.sqrt(np.maximum(P, 0 * P + 1e-3)) if flow is None else flow
        return (p["k"] * u[0] - p["d"] * n - p["ki"] * P) / p["J"], (p["kq"] * n - p["kl"] * P - flow) / p["C"]

    def true(t, x, u, d, on):
        n, P, Q, Ph = x
        out = p["kn"] * u[1] * np.sqrt(max(Ph, 1e-3))
        rates = nom(t, [n, P], u, p, Q if on[0] else None)
        soft = 0.55 / (1 + (max(Ph, 0) / 7) ** 2) + 0.06
        return *rates, (P - Ph - 0.02 * Q * abs(Q)) / 0.4, (Q - out) / soft

    def plan(r):
        n = 500
        throttle = 0.45 + 0.1 * r + steps(rng, n, -0.2, 0.2, 60)
        nozzle = np.where(np.cumsum(rng.random(n) < 0.03) % 2, 0.9, 0.25) + steps(rng, n, -0.1, 0.1, 30)
        return np.c_[led_in(np.round(throttle, 2)), led_in(np.round(nozzle, 2))], quiet(n)

    rest = settled(lambda x: nom(0, x, [0.5, 0.5], p), [3.0, 6.0], 100)
    sim = ODESimulator(
        nom, states=["n", "P"], inputs=["throttle", "nozzle"], outputs=["n", "P"], params=p, dt=0.05, x0=rest
    )
    data = twin(
        "fire_hose", rng, sim, true, plan,
        lambda r, u: settled(lambda x: true(0, x, u, 0, (1, 1)), [*rest, 3.0, 6.0], 100), see=lambda X, on: X[:, :2],
        noise=0.01, runs=3,
    )  # fmt: skip
    return sim, *data, "unknown at P (resonance of the hose, coupled to flow and pressure)"


ACCEPTED["fire_hose"] = [["unknown"]]
NEAR["fire_hose"] = [
    "hidden_mode@P of P (or of nozzle), said to be partial",
    "hidden_relaxation@P or input_lag@nozzle, said to be partial",
    "parameter_error@kn (-) or a loss of flow at P, said to be partial (friction of the hose)",
]
WRONG["fire_hose"] = ["any name at n or throttle", "a sensor effect at P", "parameter_error@C or kn said to be all"]


@case
def traction_transformer(rng):
    """Oil and winding of a traction transformer, degrees C, samples of a minute, a log of three days of 10 hours.

    A relay, which no one has told of, starts a second oil pump above 62 and stops it below 51 degrees C: the cooler
    then takes 25 W/K more. The simulator, a right-hand side, has the cooler with one pump.
    """
    p = {"Co": 240000.0, "Cw": 60000.0, "h": 160.0, "UA": 60.0, "r": 1700.0, "iron": 700.0}

    def nom(t, x, u, p, more=0.0):  # K, W; load current in parts of the rated, outside in degrees C
        oil, w = x
        heat = p["h"] * (w - oil)
        cooler, copper = p["UA"] * (oil - u[1]), p["r"] * (1 + 0.0039 * (w - 75)) * u[0] ** 2
        return (heat + p["iron"] - cooler - more) / p["Co"], (copper - heat) / p["Cw"]

    def true(t, x, u, d, on):
        return *nom(t, x[:2], u, p, on[0] * 25 * x[2] * (x[0] - u[1])), 0.0

    def tick(x, u, on):
        return np.r_[x[:2], 1.0 if x[0] > 62 else 0.0 if x[0] < 51 else x[2]]

    def plan(r):
        n = 600
        load = np.clip(steps(rng, n, 0.3, 1.75, 20), 0.4, None)
        outside = 18 + 5 * np.sin(np.arange(n) / 190 - 1) + coloured(rng, n, 0.99)
        return np.c_[np.round(load, 2), np.round(outside, 1)], quiet(n)

    sim = ODESimulator(
        nom, states=["oil", "winding"], inputs=["load", "outside"], outputs=["oil", "winding"], params=p, dt=60.0,
        x0=[45.0, 50.0],
    )  # fmt: skip
    data = twin(
        "traction_transformer", rng, sim, true, plan,
        lambda r, u: [45 + rng.uniform(-2, 2), 50 + rng.uniform(-2, 2), 0], see=lambda X, on: X[:, :2], noise=0.03,
        runs=3, grid=0.1, scale=[10, 10, 1], tick=tick,
    )  # fmt: skip
    return sim, *data, "unknown at oil (second pump, switched at 62 and 51 degrees)"


ACCEPTED["traction_transformer"] = [["unknown"]]
NEAR["traction_transformer"] = [
    "exchange@oil of outside or parameter_error@UA (+), said to be partial",
    "end_stop, power_law or quadratic_loss@oil of oil (more cooling when hot), said to be partial",
    "linear_loss@oil of oil, said to be partial",
]
WRONG["traction_transformer"] = [
    "hysteresis@oil",
    "radiation or end_stop@oil said to be all",
    "any name at winding or load",
]


@case
def sewage_basin(rng):
    """Aerated basin of a sewage works: dissolved oxygen and organic load, hours, samples of 3 minutes.

    Nitrifying bacteria, fed by the ammonia that comes and goes with the organic load, wake up after hours of load and
    oxygen (induction of 1.5 h, decay in 4 h) and then take oxygen at a rate that saturates in both. The simulator, a
    right-hand side, knows the organic part alone. Ammonia is not measured.
    """
    p = {"kla": 0.055, "sat": 9.0, "q": 55.0, "Ks": 25.0, "Ko": 0.4, "y": 0.5, "V": 1200.0}

    def nom(t, x, u, p, more=0.0):  # mg/l, 1/h; air in m3/h, inflow in m3/h, load of the inflow in mg/l
        o, s = x
        eat = p["q"] * s / (p["Ks"] + s) * o / (p["Ko"] + o)
        thin, blown = u[1] / p["V"], p["kla"] * u[0] * (p["sat"] - o)
        return blown - (1 - p["y"]) * eat - thin * o - more, thin * (u[2] - s) - eat

    def true(t, x, u, d, on):
        o, s, e = x
        wake = (s / (12 + s)) ** 2 * o / (1 + o)
        taken = on[0] * 34 * e * o / (0.8 + o) * s / (9 + s)
        return *nom(t, [o, s], u, p, taken), (wake - e) / (1.5 if wake > e else 4.0)

    def plan(r):
        n = 480
        t = np.arange(n) * 0.05
        load = 210 + 90 * np.sin(2 * np.pi * (t - 6 * r) / 24) + steps(rng, n, -70, 70, 40)
        return np.round(np.c_[steps(rng, n, 90, 240, 30), steps(rng, n, 120, 220, 50), load]), quiet(n)

    sim = ODESimulator(
        nom, states=["O2", "S"], inputs=["air", "inflow", "load"], outputs=["O2", "S"], params=p, dt=0.05,
        x0=[5.0, 15.0],
    )  # fmt: skip
    data = twin(
        "sewage_basin", rng, sim, true, plan, lambda r, u: [5 + rng.uniform(-0.5, 0.5), 15 + rng.uniform(-2, 2), 0],
        see=lambda X, on: X[:, :2], noise=0.03, runs=3,
    )  # fmt: skip
    return sim, *data, "unknown at O2 (nitrification with induction)"


ACCEPTED["sewage_basin"] = [["unknown"]]
NEAR["sewage_basin"] = [
    "bilinear@O2 of O2*S (c < 0) or linear_loss@O2 of S or of O2, said to be partial",
    "hidden_relaxation@O2 of S or of O2, said to be partial",
    "parameter_error@y, @kla (-) or input_gain@air (-), said to be partial",
]
WRONG["sewage_basin"] = [
    "sensor_gain, sensor_lag or sensor_bias@O2",
    "a name at S said to be all",
    "any of NEAR said to be all",
]


@case
def tidal_row(rng):
    """Two tidal rotors behind one another in a channel: speeds of both, samples of 4 s; large eddies turn the current.

    The wake of the first slows the stream at the second: by up to 30 % as it loads its rotor, within 9 degrees of the
    axis of the row (5 degrees), and after the way of 150 m. The simulator, a right-hand side, has two rotors without a
    wake.
    """
    p = {"a": 0.07, "b": 0.063, "c": 0.167}

    def rotor(V, w, u, p):
        return p["a"] * V * V - p["b"] * V * w - p["c"] * u

    def nom(t, x, u, p, slow=0.0):  # rad/s; stream in m/s, direction in degrees, torques in 100 kN m
        return rotor(u[0], x[0], u[2], p), rotor(u[0] * (1 - slow), x[1], u[3], p)

    def true(t, x, u, d, on):
        lost = 0.3 * np.clip(1.4 - 0.62 * x[0] / u[0], 0, 1) * np.exp(-(((u[1] - 5) / 9) ** 2))
        rate = 3 * u[0] / 150  # a way of three mixed cells
        return *nom(t, x[:2], u, p, on[0] * x[4]), rate * (lost - x[2]), rate * (x[2] - x[3]), rate * (x[3] - x[4])

    def plan(r):
        n = 500
        stream = np.clip(2.2 + 0.25 * coloured(rng, n, 0.985) + steps(rng, n, -0.3, 0.3, 120), 1.3, None)
        wave = np.sin(2 * np.pi * np.arange(n) / rng.uniform(180, 400) + rng.uniform(0, 6.28))
        turn = 5 + 16 * wave + 2 * coloured(rng, n, 0.97)
        return np.c_[stream, turn, steps(rng, n, 0.3, 1.0, 25), steps(rng, n, 0.2, 0.7, 25)], quiet(n)

    sim = ODESimulator(
        nom, states=["w1", "w2"], inputs=["stream", "turn", "torque1", "torque2"], outputs=["w1", "w2"], params=p,
        dt=4.0, x0=[1.8, 1.8],
    )  # fmt: skip
    data = twin(
        "tidal_row", rng, sim, true, plan,
        lambda r, u: [1.8 + rng.uniform(-0.2, 0.2), 1.6 + rng.uniform(-0.2, 0.2), 0, 0, 0], see=lambda X, on: X[:, :2],
        noise=0.03, runs=3,
    )  # fmt: skip
    return sim, *data, "unknown at w2 (wake that depends on direction and load, and comes late)"


ACCEPTED["tidal_row"] = [["unknown"]]
NEAR["tidal_row"] = [
    "linear_loss, quadratic_loss or bilinear@w2 of stream (less drive), said to be partial",
    "constant_bias@w2 (-), said to be partial",
    "linear_loss@w2 of w1 or of torque1, said to be partial",
]
WRONG["tidal_row"] = [
    "any name at w1, stream or torque1",
    "any friction or input_gain@torque2 said to be all",
    "periodic_disturbance@w2",
]


# ------------------------------------------------------------------------------------------ no effect


@case
def none_magnetic_bearing(rng):
    """Rotor in a magnetic bearing with its PID controller, micrometres, samples of 1 ms; nothing is missing.

    The eddy-current probe has coloured noise (0.9 from row to row), and a load on the shaft wanders. The whole loop is
    the simulator, a right-hand side.
    """
    p = {"ki": 4e5, "ks": 4e4, "kp": 0.28, "kd": 9e-4, "kI": 8.0, "T": 4e-4}

    def nom(t, x, u, p, load=0.0):  # um, um/s, A, A
        y, v, i, s = x
        asked = p["kp"] * (u[0] - y) - p["kd"] * v + s
        return v, p["ki"] * i + p["ks"] * y + load, (asked - i) / p["T"], p["kI"] * (u[0] - y)

    def true(t, x, u, d, on):
        return nom(t, x, u, p, d[0])

    def plan(r):
        n = 600
        aim = np.round(steps(rng, n, -25, 25, 50) + sines(rng, n, 1e-3, 3.0, 5, 60, 8), 1)
        aim[:6] = 0
        return aim, 1.2e5 * coloured(rng, n, 0.97)

    sim = ODESimulator(nom, states=["y", "v", "i", "s"], inputs=["aim"], outputs=["y"], params=p, dt=1e-3)
    data = twin(
        "none_magnetic_bearing", rng, sim, true, plan, lambda r, u: [0, 0, 0, 0], see=lambda X, on: X[:, :1],
        noise=0.03, runs=3, scale=[10, 1e3, 1, 1], hum=0.9,
    )  # fmt: skip
    return sim, *data, "none (coloured noise, a load that wanders)"


ACCEPTED["none_magnetic_bearing"] = [[]]
NEAR["none_magnetic_bearing"] = ["unknown or partial with a disturbance at v and no name"]
WRONG["none_magnetic_bearing"] = ["any name"]


@case
def none_dialysis(rng):
    """Urea in blood and cells over dialysis sessions, mmol/l, a step function of a minute; nothing is missing.

    Parameters that are free: the mass transfer of the dialyser KoA 12 % high, the exchange between blood and cells Kc
    10 % low.
    """
    p = {"V1": 13000.0, "V2": 26000.0, "Kc": 600.0, "KoA": 750.0, "G": 0.16}

    def nom(t, x, u, p):  # mmol/l, ml/min; flows of blood and dialysate
        b, c = x
        Qb, Qd = u[0] + 1e-6, u[1] * 1.0
        z = np.exp(-p["KoA"] * (1 / Qb - 1 / Qd))
        K = Qb * (1 - z) / (1 - z * Qb / Qd)
        cross = p["Kc"] * (c - b)
        return (cross - K * b + 1000 * p["G"]) / p["V1"], -cross / p["V2"]

    def true(t, x, u, d, on):
        return nom(t, x, u, p)

    def plan(r):
        n = 330
        blood = np.round(steps(rng, n, 150, 380, 30), -1)
        blood[:5], blood[rng.integers(225, 260) :] = 0, 0  # before the start, and the rebound
        return np.c_[blood, np.where(np.arange(n) < 140, 500.0, rng.choice([500.0, 700.0, 800.0]))], quiet(n)

    begin = [28.0, 28.0]
    sim = StepSimulator(
        rk4(nom, 2), states=["blood", "cells"], inputs=["Qb", "Qd"], outputs=["blood"],
        params=dict(p, KoA=840.0, Kc=540.0), dt=1.0, x0=begin,
    )  # fmt: skip
    data = twin(
        "none_dialysis", rng, sim, true, plan, lambda r, u: begin, see=lambda X, on: X[:, :1], noise=0.012, runs=5,
        scale=10, grid=0.05,
    )  # fmt: skip
    return sim, *data, "none (KoA and Kc free, 12 % high and 10 % low), a step"


KW["none_dialysis"] = {"free_params": ["KoA", "Kc"]}
ACCEPTED["none_dialysis"] = [["parameter_error@KoA (-)", "(not needed)"], ["parameter_error@Kc (+)", "(not needed)"]]
NEAR["none_dialysis"] = []
WRONG["none_dialysis"] = ["any name but parameter_error@KoA and @Kc"]


# ------------------------------------------------------------------------------------------ a parameter and an effect


@case
def extruder_barrel(rng):
    """Barrel and melt of a plastics extruder, degrees C, samples of 5 s.

    The insulation is worn: 15 % more loss (UA, not free), and the melt thermometer sits in a sleeve (lags of 28 and 8
    s). The simulator has a right-hand side.
    """
    p = {"k": 1.0, "Cb": 16.0, "Cm": 3.2, "h": 0.12, "UA": 0.0085, "Ta": 25.0, "cp": 0.00115, "s": 0.00011}

    def nom(t, x, u, p, worn=1.0):  # kW, kJ/K; heat in kW, screw in rpm, feed in degrees C
        b, m = x
        over = p["h"] * (b - m)
        return (
            (p["k"] * u[0] - over - worn * p["UA"] * (b - p["Ta"])) / p["Cb"],
            (over + p["s"] * np.maximum(u[1], 0 * u[1]) ** 1.4 * 25 - p["cp"] * u[1] * (m - u[2])) / p["Cm"],
        )

    def true(t, x, u, d, on):
        return *nom(t, x[:2], u, p, 1.15 if on[0] else 1.0), (x[1] - x[2]) / 28, (x[2] - x[3]) / 8

    def plan(r):
        n = 420
        heat, screw = np.round(steps(rng, n, 6.5, 13.0, 45), 1), np.round(steps(rng, n, 40, 80, 24))
        heat[:6], screw[:6] = 9.8, 60
        return np.c_[heat, screw, 40 + 3 * coloured(rng, n, 0.98)], quiet(n)

    rest = settled(lambda x: true(0, [*x, 0, 0], [9.8, 60, 40.0], 0, (1, 1))[:2], [190.0, 170.0], 40000)
    sim = ODESimulator(
        nom, states=["barrel", "melt"], inputs=["heat", "screw", "feed"], outputs=["barrel", "melt"], params=p, dt=5.0,
        x0=rest,
    )  # fmt: skip
    data = twin(
        "extruder_barrel", rng, sim, true, plan, lambda r, u: [*rest, rest[1], rest[1]],
        see=lambda X, on: X[:, [0, 3 if on[1] else 1]], noise=[0.03, 0.015], runs=3, grid=0.1, scale=10,
        parts=["loss", "sleeve"],
    )  # fmt: skip
    return sim, *data, "parameter_error@UA 0.15 + sensor_lag@melt 36 s (28 and 8)"


ACCEPTED["extruder_barrel"] = [
    ["parameter_error@UA (+)", "linear_loss@barrel of barrel (c > 0) with constant_bias@barrel or without"],
    ["sensor_lag@melt", "sensor_delay@melt with sensor_lag@melt"],
]
NEAR["extruder_barrel"] = [
    "one of both alone, said to be partial",
    "sensor_delay@melt for the sleeve",
    "constant_bias@barrel (-), input_bias or input_gain@heat (-) or parameter_error@k (-) for the loss",
    "parameter_error@Cm (+) for the sleeve, said to be partial",
]
WRONG["extruder_barrel"] = ["input_lag@heat or screw", "a law at melt said to be all"]


def main():
    """Print the checks of the cases that were asked for."""
    import argparse
    import time
    import zlib

    parser = argparse.ArgumentParser(description="Sizes of the gaps, over the noise.")
    parser.add_argument("names", nargs="*", default=list(ACCEPTED))
    parser.add_argument("--seed", type=int, default=61)
    options = parser.parse_args()
    for name in options.names:
        started = time.process_time()
        sim, U, Y, groups, truth = CASES[name](np.random.default_rng([options.seed, zlib.crc32(name.encode())]))
        built, out = time.process_time() - started, CHECK[name]()
        finite = all(np.all(np.isfinite(a)) for a in (U, out["nominal"], out["off"], out["clean"]))
        gaps = ", ".join(f"{k} {v:.1f}" for k, v in out["gaps"].items())
        print(
            f"{name} {type(sim).__name__} rows {len(Y)} runs {groups[-1] + 1} inputs {U.shape[1]} "
            f"sd {np.nanstd(Y, axis=0).round(4)} finite {finite}; {gaps}; by output {out['by output']}; "
            f"{built:.1f} s [{truth}]",
            flush=True,
        )


if __name__ == "__main__":
    main()
