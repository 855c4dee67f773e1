"""Eighteen simulated twins of published identification benchmarks and teaching rigs, each with the model of its textbook.

Excitation, sampling, length and sensors are those of the published records. ``ACCEPTED``, ``NEAR`` and ``NOISE`` are as in
``physical_plants_si``; the names were fixed by engineering judgement before any diagnosis. ``MAIN`` holds the main effects in the form
of the catalogue with the values that fit the plant, ``REST`` the names of small things that are true beside them. ``CLOSED`` are
recorded in closed loop, ``ONE_RUN`` in one run, ``FREE`` are decays without an input, ``COARSE`` are read from a coarse display.

``CHECK[name]()``, after the case is built, returns what the nominal simulator, the nominal model with the main effects alone (in
nature's form, and in the catalogue's), and the plant without noise do, and the size of each gap over the noise.

    python tests/benchmarks/physical_plants_rigs.py [NAME ...] [--seed 1]

prints these sizes.
"""

import numpy as np
from physical_plants import CASES, KW, case, sines, steps
from physical_plants_messy import pi, play, settled, straight
from physical_plants_si import coloured, kink
from scipy.linalg import expm

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.physics import CallableSimulator, ControlSimulator, MuJoCoSimulator, ODESimulator, StepSimulator

ACCEPTED, NEAR, NOISE, CHECK, MAIN, REST = {}, {}, {}, {}, {}, {}
CLOSED = ["throttle_body", "steam_generator", "cd_arm", "none_flexible_joint"]
ONE_RUN = ["glass_furnace", "halogen_plate", "steam_generator", "hair_dryer", "wall_heat", "cd_arm"]
ONE_RUN += ["hydraulic_arm", "none_gas_furnace"]
FREE = ["flywheel_rundown", "pohl_wheel"]
COARSE = ["flywheel_rundown", "pohl_wheel", "halogen_plate", "throttle_body", "wall_heat"]


def size(A, sd):
    """The root of the mean square over the noise, each output by its own."""
    return float(np.sqrt(np.mean((A / sd) ** 2)))


def hand_in(name, rng, sim, made, clean, sd, noise, main, grid=0.0, starts=None, hum=None):
    """Inputs, readings and runs; registers the check. ``made`` are the inputs of the runs, ``main()`` the plant of the main effects."""
    e = rng.normal(size=clean.shape) if hum is None else hum
    Y = clean + sd * e
    step = np.broadcast_to(grid, clean.shape[1])
    Y = np.where(step > 0, np.round(Y / np.where(step > 0, step, 1)) * step, Y)

    def free(simulator):
        begins = [None] * len(made) if starts is None else starts
        runs = [simulator.simulate(U, **({} if x is None else {"x0": x})) for U, x in zip(made, begins)]
        return np.vstack([np.reshape(y, (len(U), -1)) for U, y in zip(made, runs)])

    def check():
        out = {"nominal": free(sim), "main": main(), "clean": clean, "sd": sd, "readings": Y}
        if MAIN.get(name):
            laws = [CATALOGUE[n](*place) for n, place, _ in MAIN[name]]
            out["catalogue"] = free(AugmentedSimulator(sim, laws, [v for _, _, v in MAIN[name]]))
        out["gaps"] = {k: size(out[k] - clean, sd) for k in ("nominal", "main", "catalogue") if k in out}
        return out

    NOISE[name], CHECK[name] = noise, check
    return np.vstack(made), Y, np.repeat(np.arange(len(made)), [len(U) for U in made])


def twin(
    name, rng, sim, main, true, plan, start, *, see, seen=None, noise, runs=1, control=None, pipe=straight, late=0, grid=0.0, scale=1.0,
    order=None,
):  # fmt: skip
    """A plant with a right-hand side: ``main(t, x, u)`` and ``true(t, x, u, d)``, read by ``see(X)`` (n_rows, n_outputs).

    ``seen`` reads the plant of the main effects alone (its states are the first ``order``); ``plan(r)`` gives inputs and hidden
    disturbances of run r, ``control(y, row, memo)`` makes each row of them in closed loop, from a reading with its noise.
    """
    made, hidden = zip(*[plan(r) for r in range(runs)])
    made = [np.array(U if U.ndim == 2 else U[:, None], float) for U in made]
    hidden = [D if D.ndim == 2 else D[:, None] for D in hidden]
    begins = [np.asarray(start(r, U[0]), float) for r, U in enumerate(made)]
    wish, outputs = [U.copy() for U in made], np.shape(see(begins[0][None]))[1]
    e = [rng.normal(size=(len(U), outputs)) for U in made]

    def campaign(sd):
        out = []
        for U, D, x, w, b in zip(made, hidden, begins, wish, e):
            U[:] = w

            def reading(x, k, b=b):
                return see(x[None])[0] + sd * b[k]

            out.append(see(play(true, x, U, D, sim.dt, scale, pipe, late, control, reading)))
        return np.vstack(out)

    clean = campaign(0.0)
    if control:
        clean = campaign(noise * clean.std(0))

    def alone():
        n = order or len(begins[0])
        each = np.broadcast_to(scale, len(begins[0]))[:n]
        runs = zip(made, hidden, begins)
        part = [
            play(lambda t, x, u, d: main(t, x, u), x[:n], U.copy(), D, sim.dt, each, pipe, late) for U, D, x in runs
        ]
        return np.vstack([(seen or see)(X) for X in part])

    states = getattr(sim, "states", None)
    starts = [x[: len(states)] for x in begins] if states else None
    return hand_in(name, rng, sim, made, clean, noise * clean.std(0), noise, alone, grid, starts, np.vstack(e))


def nothing(n):
    """No hidden disturbance."""
    return np.zeros((n, 1))


# ------------------------------------------------------------------------------------------------ one main effect


@case
def ce8_drives(rng):
    """Coupled electric drives CE8: pulley on a belt between two motors, 500 samples of 20 ms.

    The pulse counter shows no direction; it rounds off near rest and smooths over 4 ms.
    """
    p = {"K": 1.0, "T": 0.24, "w0": 9.0, "d": 0.22}

    def nom(t, x, u, p):
        m, w, a = x
        return (p["K"] * u[0] - m) / p["T"], a, p["w0"] ** 2 * (m - w) - 2 * p["d"] * p["w0"] * a

    def true(t, x, u, d):
        return *nom(t, x[:3], u, p), (np.hypot(x[1], 0.03) - x[3]) / 0.004

    def plan(r):
        u = steps(rng, 500, -1.6, 2.6, 14) if r else 0.35 + 1.15 * np.sign(steps(rng, 500, -1, 1, 25))
        return np.r_[np.full(4, 0.5), u[4:]], nothing(500)

    sim = ODESimulator(
        nom, states=["m", "w", "a"], inputs=["volts"], outputs=["w"], params=p, dt=0.02, x0=[0.5, 0.5, 0.0],
    )  # fmt: skip
    data = twin(
        "ce8_drives", rng, sim, lambda t, x, u: nom(t, x, u, p), true, plan, lambda r, u: [0.5, 0.5, 0, np.hypot(0.5, 0.03)],
        see=lambda X: X[:, 3:4], seen=lambda X: np.abs(X[:, 1:2]), order=3, noise=0.05, runs=3,
    )  # fmt: skip
    return sim, *data, "sensor_rectification@w (rounded within 0.03 V, lag of 4 ms)"


MAIN["ce8_drives"] = [("sensor_rectification", ("w",), {})]
ACCEPTED["ce8_drives"] = [["sensor_rectification@w"]]
NEAR["ce8_drives"] = ["sensor_nonlinearity@w (c > 0), said to be partial"]
REST["ce8_drives"] = ["sensor_lag or sensor_delay@w (4 ms)"]


@case
def glass_furnace(rng):
    """Glass furnace of three zones, 1247 samples, deviations from the operating point.

    The flame of the first burner also heats the second zone, through the flue gas (a lag of 1.5 samples). Rest: gas quality wanders
    by 0.5 %.
    """
    p = {"k1": 1.1, "k2": 0.9, "kc": 0.6, "g": 0.06, "l": 0.035}

    def nom(t, x, u, p, flame=0.0):
        a, b, c = x
        return (
            p["k1"] * u[0] - p["g"] * (a - b) - p["l"] * a,
            p["k2"] * (u[1] + flame) - p["g"] * (2 * b - a - c) - p["l"] * b,
            -p["kc"] * u[2] - p["g"] * (c - b) - p["l"] * c,
        )

    def main(t, x, u, gas=0.0):
        return *nom(t, x[:3], [u[0] * (1 + gas), u[1] * (1 + gas), u[2]], p, 0.2 * x[3]), (u[0] - x[3]) / 1.5

    def plan(r):
        n = 1247
        return np.c_[steps(rng, n, -1, 1, 24), steps(rng, n, -1, 1, 30), steps(rng, n, -1, 1, 36)], 0.005 * coloured(
            rng, n, 0.97
        )

    sim = ODESimulator(
        nom, states=["T1", "T2", "T3"], inputs=["heat1", "heat2", "cool"], outputs=["T1", "T2", "T3"], params=p, dt=1.0,
    )  # fmt: skip
    data = twin(
        "glass_furnace", rng, sim, main, lambda t, x, u, d: main(t, x, u, d[0]), plan, lambda r, u: [0, 0, 0, u[0]],
        see=lambda X: X[:, :3], noise=0.015,
    )  # fmt: skip
    return sim, *data, "input_coupling@heat2 of heat1 0.2 (lag of 1.5 samples)"


MAIN["glass_furnace"] = [("input_coupling", ("heat2", "heat1"), {"coefficient": 0.2})]
ACCEPTED["glass_furnace"] = [["input_coupling@heat2 of heat1", "linear_loss@T2 of heat1 (c < 0)"]]
NEAR["glass_furnace"] = [
    "exchange@T2 of heat1 or of T1",
    "linear_loss@T2 of T1 (c < 0)",
    "input_coupling@heat2 of another signal",
    "parameter_error@g or input_gain@heat2, said to be partial",
]
REST["glass_furnace"] = ["input_gain@heat1 or heat2", "input_lag (small)"]


@case
def flywheel_rundown(rng):
    """Flywheel that runs down, read from a hand tachometer in steps of 10 rpm; no input.

    Bearing model of the textbook (dry and viscous); the air takes power 1.85 of the speed. Rest: the grease warms (viscous part 1 %
    less within a run).
    """
    p = {"a": 2.0, "b": 0.004}

    def nom(t, x, u, p, air=0.0):
        return (-p["a"] - p["b"] * x[0] - air,)

    def main(t, x, u, b=0.004):
        return nom(t, x, u, dict(p, b=b), 2.2 * (x[0] / 3000) ** 1.85)

    sim = ODESimulator(nom, states=["n"], inputs=[], outputs=["n"], params=p, dt=1.0, x0=[2500.0])
    data = twin(
        "flywheel_rundown", rng, sim, main, lambda t, x, u, d: main(t, x, u, 0.004 * (1 - 0.01 * (1 - np.exp(-t / 80)))),
        lambda r: (np.zeros((200, 0)), nothing(200)), lambda r, u: [[3000, 1600, 2500, 2100][r] + rng.uniform(-60, 60)],
        see=lambda X: X, noise=0.006, runs=4, grid=10.0, scale=100.0,
    )  # fmt: skip
    return sim, *data, "quadratic_drag@n (power 1.85)"


MAIN["flywheel_rundown"] = [("power_law", ("n", "n"), {"coefficient": 2.2 / 3000**1.85, "exponent": 1.85})]
ACCEPTED["flywheel_rundown"] = [
    ["quadratic_drag@n", "quadratic_loss@n", "power_law@n (exponent 1.4 to 2.5)", "parameter_dependence@b on n (c > 0)"]
]
NEAR["flywheel_rundown"] = [
    "linear_loss@n or parameter_error@b, said to be partial",
    "cubic_stiffness@n or end_stop@n",
    "power_law@n of another exponent",
]
REST["flywheel_rundown"] = ["sensor_quantization@n (10 rpm)", "parameter_error or parameter_drift@b"]


@case
def pohl_wheel(rng):
    """Pohl's wheel released at four angles, read on its scale in steps of 0.02 rad; no input.

    An added mass makes it a pendulum as well, 0.04 rad off its rest. Rest: a little dry friction.
    """
    p = {"w0": 3.3, "d": 0.06}

    def nom(t, x, u, p):
        return x[1], -(p["w0"] ** 2) * x[0] - 2 * p["d"] * x[1]

    def main(t, x, u, dry=0.0):
        v, a = nom(t, x, u, p)
        return v, a - 0.8 * np.sin(x[0] - 0.04) - dry * np.tanh(x[1] / 0.02)

    sim = ODESimulator(nom, states=["phi", "w"], inputs=[], outputs=["phi"], params=p, dt=0.05, x0=[1.5, 0.0])
    data = twin(
        "pohl_wheel", rng, sim, main, lambda t, x, u, d: main(t, x, u, 0.012), lambda r: (np.zeros((220, 0)), nothing(220)),
        lambda r, u: [[2.4, -1.2, 1.7, -2.1][r] + rng.uniform(-0.1, 0.1), 0], see=lambda X: X[:, :1], noise=0.025, runs=4, grid=0.02,
    )  # fmt: skip
    return sim, *data, "gravity_tilt@w of phi 0.8 (0.04 rad off)"


MAIN["pohl_wheel"] = [("gravity_tilt", ("w", "phi"), {"level": 0.8})]
ACCEPTED["pohl_wheel"] = [["gravity_tilt@w of phi"], ["constant_bias@w", "asymmetric_friction@w", "(not needed)"]]
NEAR["pohl_wheel"] = [
    "linear_loss@w of phi with a law of phi that softens",
    "linear_loss@w of phi or parameter_error@w0, said to be partial",
    "power_law@w of phi (exponent below 1)",
]
REST["pohl_wheel"] = ["sensor_quantization@phi", "coulomb_friction@w", "linear_loss@w of w or parameter_error@d"]


@case
def halogen_plate(rng):
    """Thin steel plate under a halogen lamp, 801 samples of 2 s, display of 0.5 K.

    The hot plate radiates; its convection has power 1.02. Rest: the lamp gets less efficient when dimmed, room wanders by 0.3 K
    beyond its sensor.
    """
    p = {"k": 0.06, "tau": 4.0, "h": 0.0055}

    def nom(t, x, u, p, h=None):  # K, V, s
        q = (p["h"] if h is None else h) * (x[1] - u[1])
        return (p["k"] * u[0] ** 2 - x[0]) / p["tau"], x[0] - q

    def main(t, x, u):
        a, b = nom(t, x, u, p, 0.0055 * (max(x[1] - u[1], 1.0) / 250) ** 0.02)
        return a, b - 2.5e-12 * (x[1] ** 4 - u[1] ** 4)

    def plan(r):
        room = 295 + 1.5 * coloured(rng, 801, 0.995)
        return np.c_[np.r_[np.zeros(5), np.round(steps(rng, 796, 2.0, 6.5, 45), 1)], room], 0.3 * coloured(
            rng, 801, 0.98
        )

    sim = ODESimulator(
        nom, states=["lamp", "T"], inputs=["volts", "Ta"], outputs=["T"], params=p, dt=2.0, x0=[0.0, 295.0],
    )  # fmt: skip
    data = twin(
        "halogen_plate", rng, sim, main, lambda t, x, u, d: main(t, x, [u[0] * (1 - 0.003 * np.exp(-u[0] / 3)), u[1] + d[0]]), plan,
        lambda r, u: [0, u[1]], see=lambda X: X[:, 1:2], noise=0.01, grid=0.5, scale=[1, 100],
    )  # fmt: skip
    return sim, *data, "radiation@T of Ta (2.5e-12), convection of power 1.02"


MAIN["halogen_plate"] = [("radiation", ("T", "Ta"), {"coefficient": 2.5e-12})]
ACCEPTED["halogen_plate"] = [
    [
        "radiation@T of Ta",
        "power_law@T",
        "quadratic_loss@T",
        "quadratic_drag@T",
        "cubic_stiffness@T",
        "parameter_dependence@h on T or lamp",
    ],
    ["constant_bias@T", "(not needed)"],
]
NEAR["halogen_plate"] = [
    "exchange@T of Ta or parameter_error@h (a loss that is missing, not its law)",
    "linear_loss@T",
    "input_curve@volts (c < 0), bilinear@T",
    "end_stop@T",
]
REST["halogen_plate"] = ["sensor_quantization@T", "input_gain@volts", "parameter_error@k"]


@case
def throttle_body(rng):
    """Electronic throttle above its limp-home rest, with its position controller; potentiometer in steps of 0.1 degree.

    Bearings and gear have presliding and a Stribeck curve (LuGre). Rest: coil 0.1 % weak.
    """
    p = {"a": 12000.0, "ks": 450.0, "d": 45.0, "u0": 0.8}

    def nom(t, x, u, p, held=0.0):  # degrees, V
        return x[1], p["a"] * (u[0] - p["u0"]) - p["ks"] * x[0] - p["d"] * x[1] - held

    def main(t, x, u, a=12000.0):
        q, v, z = x
        g = 900 + 350 * np.exp(-((v / 40) ** 2))
        dz = v - 3200 * abs(v) / g * z
        return *nom(t, [q, v], u, dict(p, a=a), 3200 * z + 4 * dz), dz

    def plan(r):
        t = np.arange(420) * 0.005
        wave = steps(rng, 420, 20, 70, 70) if r != 1 else 45 + 25 * np.sin(2 * np.pi * (0.6 + 0.5 * t) * t)
        return np.r_[np.full(6, 40.0), wave[6:]], nothing(420)

    def control(y, row, memo):
        speed = memo["v"] = 0.6 * memo.get("v", 0.0) + 0.4 * (y[0] - memo.get("y", y[0])) / 0.005
        memo["y"] = y[0]
        memo.setdefault("I", 2.3 - 0.05 * (row[0] - y[0]))
        return [np.round(np.clip(pi(row[0] - y[0], memo, 0.05, 0.0012, -2, 6) - 0.0012 * speed, -2, 6), 2)]

    sim = ODESimulator(nom, states=["q", "v"], inputs=["volts"], outputs=["q"], params=p, dt=0.005, x0=[40.0, 0.0])
    data = twin(
        "throttle_body", rng, sim, main, lambda t, x, u, d: main(t, x, u, 11988.0), plan, lambda r, u: [40, 0, 0],
        see=lambda X: X[:, :1], noise=0.006, runs=3, grid=0.1, control=control, scale=[1, 10, 0.1],
    )  # fmt: skip
    return sim, *data, "lugre_friction@v (900 to 1250, presliding of 0.3 degree)"


MAIN["throttle_body"] = [
    ("lugre_friction", ("v", "v"), {"stiffness": 3200.0, "level": 900.0, "static_level": 1250.0, "velocity": 40.0})
]
ACCEPTED["throttle_body"] = [
    ["lugre_friction@v", "coulomb_friction@v", "stribeck_friction@v", "asymmetric_friction@v", "hysteresis@v of q"]
]
NEAR["throttle_body"] = [
    "input_backlash@volts (what dry friction against a spring looks like)",
    "input_dead_zone@volts",
    "power_law@v (exponent below 0.5)",
    "linear_loss@v or parameter_error@d, said to be partial",
]
REST["throttle_body"] = ["sensor_quantization@q", "parameter_error@a or input_gain@volts"]


@case
def steam_generator(rng):
    """Boiler drum with its level and pressure controllers, one run of samples of 3 s, deviations.

    The level is a pressure difference, so that the drum pressure shifts the reading (density). Rest: the meter of the steam is 0.04 %
    off, fuel quality wanders.
    """
    p = {"kf": 0.02, "ks": 0.018, "Tp": 220.0, "ka": 0.8, "kb": 0.55, "To": 14.0, "A": 60.0}

    def nom(t, x, u, p, fuel=0.0, load=1.0):
        P, o, _ = x
        burnt = u[0] * (1 + fuel)
        steam = load * u[3] + 0.05 * P
        return (
            p["kf"] * burnt - p["ks"] * steam - P / p["Tp"],
            (p["ka"] * u[1] - p["kb"] * burnt - o) / p["To"],
            (u[2] - steam) / p["A"],
        )

    def see(X):
        return np.c_[X[:, :2], X[:, 2] + 0.4 * X[:, 0] / (1 + 0.02 * X[:, 0])]

    def plan(r):
        n = 1300
        load = steps(rng, n, -4, 4, 60)
        return np.c_[np.zeros(n), steps(rng, n, -2, 2, 50), steps(rng, n, -1.5, 1.5, 45), load], 0.0015 * coloured(
            rng, n, 0.97
        )

    def control(y, row, memo):
        a, b = memo.setdefault("P", {}), memo.setdefault("L", {})
        aim = memo["aim"] = 0.98 * memo.get("aim", 0.0) + 0.02 * 2.5 * row[2]
        return [
            pi(-y[0], a, 0.9, 0.006, -8, 8) + 0.4 * row[3],
            row[1] + 0.6 * memo.get("f", 0.0),
            pi(aim - y[2], b, 1.5, 0.01, -9, 9) + row[2],
            row[3],
        ]

    sim = ODESimulator(
        nom, states=["P", "o2", "level"], inputs=["fuel", "air", "feed", "load"], outputs=["P", "o2", "level"], params=p, dt=3.0,
    )  # fmt: skip
    data = twin(
        "steam_generator", rng, sim, lambda t, x, u: nom(t, x, u, p), lambda t, x, u, d: nom(t, x, u, p, d[0], 1.0004), plan,
        lambda r, u: [0, 0, 0], see=see, noise=0.015, control=control,
    )  # fmt: skip
    return sim, *data, "sensor_coupling@level of P 0.4 (bent by 2 % per unit)"


MAIN["steam_generator"] = [("sensor_coupling", ("level", "P"), {"coefficient": 0.4})]
ACCEPTED["steam_generator"] = [["sensor_coupling@level of P"]]
NEAR["steam_generator"] = [
    "exchange or linear_loss@level of P, said to be partial",
    "sensor_nonlinearity or sensor_gain@level, said to be partial",
]
REST["steam_generator"] = ["input_gain@load", "parameter_error@ks", "input_gain@fuel"]


@case
def hair_dryer(rng):
    """Hair dryer PT326, binary heater voltage of 3.41 or 6.41 V, 1000 samples of 80 ms.

    The air needs 0.22 s through the tube, whose wall adds a lag of 12 ms. Rest: supply wanders by 0.3 %.
    """
    p = {"K": 0.95, "T1": 0.42, "T2": 0.16}

    def step(t, x, u, p, dt):  # exact for held inputs
        e1, e2, end = np.exp(-dt / p["T1"]), np.exp(-dt / p["T2"]), p["K"] * u[0]
        part = (x[0] - end) * p["T1"] / (p["T1"] - p["T2"])
        return [end + (x[0] - end) * e1, end + part * e1 + (x[1] - end - part) * e2]

    def main(t, x, u):
        return (p["K"] * u[0] - x[0]) / p["T1"], (x[0] - x[1]) / p["T2"]

    def true(t, x, u, d):
        return (p["K"] * x[2] * (1 + d[0]) - x[0]) / p["T1"], (x[0] - x[1]) / p["T2"], (u[0] - x[2]) / 0.012

    def plan(r):
        u = np.where(np.cumsum(rng.random(1000) < 0.16) % 2, 6.41, 3.41)
        return np.r_[np.full(6, 3.41), u[6:]], 0.003 * coloured(rng, 1000, 0.97)

    start = [0.95 * 3.41, 0.95 * 3.41]
    sim = StepSimulator(step, states=["heat", "T"], inputs=["heater"], outputs=["T"], params=p, dt=0.08, x0=start)
    data = twin(
        "hair_dryer", rng, sim, main, true, plan, lambda r, u: [*start, 3.41], see=lambda X: X[:, 1:2], order=2, noise=0.04, late=14,
    )  # fmt: skip
    return sim, *data, "input_delay@heater 0.224 s (and a lag of 12 ms)"


MAIN["hair_dryer"] = [("input_delay", ("heater",), {"delay": 0.235})]
ACCEPTED["hair_dryer"] = [["input_delay@heater", "sensor_delay@T"]]
NEAR["hair_dryer"] = [
    "input_lag@heater or sensor_lag@T, said to be partial",
    "parameter_error@T1 or @T2 (+), said to be partial",
    "hidden_relaxation@T",
]
REST["hair_dryer"] = ["input_lag@heater (12 ms)", "input_gain@heater"]


def balanced(P, U, dt):
    """Step matrices of x' = A x + B u, and where it rests at the first row of U."""
    A, B = P
    n, m = B.shape
    E = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * dt)
    return E[:n, :n], E[:n, n:], -np.linalg.solve(A, B @ U[0])


@case
def wall_heat(rng):
    """Heat flow into a wall, 1680 samples of 10 minutes, from a tool that gives trajectories alone; display of 0.2 W/m2.

    The heat-flow plate and its plaster have lags of 20 and 3 minutes. Rest: wind wanders by 0.4 K of the outer air.
    """
    p = {"R": 1.5, "C": 300.0, "film": 0.13}

    def wall(p):  # five layers, hours, kJ/m2
        n, c, g = 5, p["C"] / 3.6 / 5, 5 / p["R"]
        A, B = np.zeros((n, n)), np.zeros((n, 2))
        for k in range(n - 1):
            A[k : k + 2, k : k + 2] += g / c * np.array([[-1, 1], [1, -1]])
        inner, outer = 1 / (p["film"] + 0.5 / g), 1 / (0.04 + 0.5 / g)
        A[0, 0], A[-1, -1] = A[0, 0] - inner / c, A[-1, -1] - outer / c
        B[0, 0], B[-1, 1] = inner / c, outer / c
        return A, B, inner

    def tool(U, p):
        A, B, inner = wall(p)
        F, G, x = balanced((A, B), U, 1 / 6)
        q = np.empty((len(U), 1))
        for k, u in enumerate(U):
            q[k] = inner * (u[0] - x[0])
            x = F @ x + G @ u
        return q

    A, B, inner = wall(p)

    def plan(r):
        n = 1680
        t = np.arange(n) / 6
        room = steps(rng, n, 15, 23, 22)
        for k in range(1, n):  # the room follows its heating
            room[k] = room[k - 1] + 0.35 * (room[k] - room[k - 1])
        out = 4 + 5 * np.sin(2 * np.pi * t / 24) + 4 * coloured(rng, n, 0.995)
        return np.round(np.c_[room, out], 2), 0.4 * coloured(rng, n, 0.9)

    def main(t, x, u, wind=0.0):
        q = inner * (u[0] - x[0])
        return [*(A @ x[:5] + B @ np.array([u[0], u[1] + wind])), 3 * (q - x[5]), 20 * (x[5] - x[6])]

    def start(r, u):
        x = -np.linalg.solve(A, B @ u)
        return [*x, *[inner * (u[0] - x[0])] * 2]

    sim = CallableSimulator(tool, inputs=["Ti", "To"], outputs=["q"], params=p, dt=1 / 6)
    data = twin(
        "wall_heat", rng, sim, main, lambda t, x, u, d: main(t, x, u, d[0]), plan, start, see=lambda X: X[:, 6:7], noise=0.02,
        grid=0.2,
    )  # fmt: skip
    return sim, *data, "sensor_lag@q 0.38 h (0.33 and 0.05)"


MAIN["wall_heat"] = [("sensor_lag", ("q",), {"time_constant": 0.47})]
ACCEPTED["wall_heat"] = [["sensor_lag@q", "input_lag@Ti"]]
NEAR["wall_heat"] = [
    "sensor_delay@q or input_delay@Ti, said to be partial",
    "parameter_error@film or @C, said to be partial",
]
REST["wall_heat"] = ["sensor_quantization@q", "sensor_delay@q (small)"]


@case
def cd_arm(rng):
    """Arm of a CD player, 2048 samples of 0.4 ms in closed loop, two actuators and two axes, linear state space.

    The radial arm bends at 300 Hz, as an eighth of its mass on a spring. Rest: spindle (a force at 9 Hz of 0.5 %).
    """
    import control

    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[1, :2], A[3, 2:] = [-(283.0**2), -2 * 0.1 * 283.0], [-(240.0**2), -2 * 0.12 * 240.0]
    B = np.array([[0, 0], [1e5, 4e3], [0, 0], [-3e3, 8e4]])
    system = control.ss(
        A, B, np.eye(4)[[0, 2]], np.zeros((2, 2)), states=["y", "vy", "z", "vz"], inputs=["radial", "focus"], outputs=["y", "z"],
    )  # fmt: skip

    def main(t, x, u, spin=0.0):
        d = A @ x[:4] + B @ np.array([u[0] + spin, u[1]])
        bend = 1900.0**2 * (x[4] - x[0]) + 2 * 0.008 * 1900.0 * (x[5] - x[1])
        d[1] += 0.12 * bend
        return [*d, x[5], -bend]

    def plan(r):
        n = 2048
        return np.c_[steps(rng, n, -1.5, 1.5, 40), steps(rng, n, -1.5, 1.5, 55)], 0.005 * np.sin(
            2 * np.pi * 9 * 4e-4 * np.arange(n)
        )

    def control_(y, row, memo):
        v = (y - memo.get("y", y)) / 4e-4
        memo["y"] = y.copy()
        return np.clip(1.6 * (row - y) - 0.0022 * v + rng.normal(size=2) * 0.4, -6, 6)

    sim = ControlSimulator(system, dt=4e-4)
    data = twin(
        "cd_arm", rng, sim, main, lambda t, x, u, d: main(t, x, u, d[0]), plan, lambda r, u: np.zeros(6), see=lambda X: X[:, [0, 2]],
        noise=0.008, control=control_, scale=[1, 100, 1, 100, 1, 100],
    )  # fmt: skip
    return sim, *data, "hidden_mode@vy of y (4.3e5 1/s2, 1900 rad/s, with a damping between the two)"


MAIN["cd_arm"] = [
    ("hidden_mode", ("vy", "y"), {"gain": 0.12 * 1900.0**2, "angular_frequency": 1900.0, "damping": 0.008})
]
ACCEPTED["cd_arm"] = [["hidden_mode@vy of y", "hidden_mode@radial of y"]]
NEAR["cd_arm"] = [
    "hidden_mode@vy of another signal",
    "hidden_relaxation@vy",
    "input_gain@radial (c < 0, the slow part), said to be partial",
]
REST["cd_arm"] = ["periodic_disturbance@vy (57 rad/s)"]


@case
def f16_payload(rng):
    """Payload at the wing tip of an F-16 (benchmark of its ground vibration test), swept over its resonance at three levels.

    The model is a linear state space of the first mode. From 1 mm on the bolted flange closes, as a contact of power 1.3. Rest: the
    shaker's accelerometer reads 0.2 % low.
    """
    import control

    w0, d = 46.0, 0.05
    A, B = np.array([[0, 1], [-(w0**2), -2 * d * w0]]), np.array([[0.0], [-1000.0]])  # mm, m/s2
    system = control.ss(A, B, [[1, 0]], [[0]], states=["y", "v"], inputs=["base"], outputs=["y"])

    def main(t, x, u, gain=1.0):
        push = 1000 * kink(x[0] - 1.0, 0.01) ** 1.3
        return [x[1], -1000 * gain * u[0] - w0**2 * x[0] - 2 * d * w0 * x[1] - push]

    def plan(r):
        t = np.arange(600) * 0.01
        span = (13.0, -9.5 / 12) if r == 1 else (3.5, 9.5 / 12)
        wave = np.sin(2 * np.pi * (span[0] * t + span[1] * t**2) + rng.uniform(0, 6.28))
        return (0.35 + 0.2 * r) * wave * np.minimum(t / 0.2, 1), nothing(600)

    sim = ControlSimulator(system, dt=0.01)
    data = twin(
        "f16_payload", rng, sim, main, lambda t, x, u, e: main(t, x, u, 1.002), plan, lambda r, u: [0, 0], see=lambda X: X[:, :1],
        noise=0.02, runs=3,
    )  # fmt: skip
    return sim, *data, "end_stop@v of y from 1 mm (power 1.3)"


MAIN["f16_payload"] = [("end_stop", ("v", "y"), {"stiffness": 1050.0, "edge": 1.02})]
ACCEPTED["f16_payload"] = [["end_stop@v of y"]]
NEAR["f16_payload"] = [
    "quadratic_loss, cubic_stiffness or power_law@v of y, said to be partial",
    "end_stop@base of y",
    "state_saturation@y",
    "sensor_saturation@y",
]
REST["f16_payload"] = ["input_gain@base (0.2 %)"]


def moved(text, U, x0, dt, force, hidden=(), late=0.0, finer=1e-3):
    """States of a MuJoCo model at the samples; ``force(q, v, u, z)`` gives forces at the joints, inputs, rates of hidden states."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = finer
    data, z, X, n = mujoco.MjData(model), np.array(hidden, float), [], round(dt / finer)
    data.qpos[:], data.qvel[:] = x0[: model.nq], x0[model.nq :]
    for k in range(n * len(U)):
        if k % n == 0:
            X.append(np.r_[data.qpos, data.qvel])
        u = U[max(k - round(late / finer), 0) // n]
        data.qfrc_applied[:], data.ctrl[:], rate = force(data.qpos, data.qvel, u, z)
        mujoco.mj_step(model, data)
        z = z + finer * np.asarray(rate)
    return np.array(X)


def robot(name, rng, sim, text, made, starts, force, true, columns, noise, grid=0.0, hidden=None, late=0.0):
    """A plant of MuJoCo: ``force`` has the main effects, ``true`` the rest too, see ``moved``."""
    hidden = hidden or (lambda U: ())

    def play_all(f):
        return np.vstack([moved(text, U, x, sim.dt, f, hidden(U), late)[:, columns] for U, x in zip(made, starts)])

    clean = play_all(true)
    return hand_in(name, rng, sim, made, clean, noise * clean.std(0), noise, lambda: play_all(force), grid, starts)


AERO = """<mujoco><option timestep="0.005" integrator="RK4"/><worldbody><body name="fork" pos="0 0 0.3">
<joint name="yaw" axis="0 0 1" damping="0.022"/>
<geom type="cylinder" size="0.03 0.04" mass="0.3" contype="0" conaffinity="0"/>
<body name="beam"><joint name="pitch" axis="0 1 0" damping="0.0075"/>
<geom type="capsule" size="0.01" fromto="-0.18 0 0 0.18 0 0" mass="0.3" contype="0" conaffinity="0"/>
<geom type="sphere" size="0.03" pos="0.18 0 0" mass="0.25" contype="0" conaffinity="0"/>
<geom type="sphere" size="0.03" pos="-0.18 0 0" mass="0.25" contype="0" conaffinity="0"/>
<geom type="sphere" size="0.02" pos="0 0 -0.02" mass="0.2" contype="0" conaffinity="0"/></body></body></worldbody>
<tendon><fixed name="main"><joint joint="pitch" coef="0.002"/><joint joint="yaw" coef="-0.0009"/></fixed>
<fixed name="tail"><joint joint="yaw" coef="0.0022"/><joint joint="pitch" coef="0.0006"/></fixed></tendon>
<actuator><motor name="Vp" tendon="main"/><motor name="Vy" tendon="tail"/></actuator></mujoco>"""


@case
def aero_helicopter(rng):
    """Helicopter of two degrees of freedom (pitch and yaw) on its stand.

    The main rotor needs 0.3 s to spin up, a little less when it is fast. Rest: tail rotor of 10 ms, a draught at the yaw axis of 0.03
    mN m.
    """

    def force(q, v, u, z, tail=None, air=0.0):
        rate = (u[0] - z[0]) * (1 + 0.01 * abs(z[0])) / 0.32
        if tail:
            return [air, 0], [z[0], z[1]], (rate, (u[1] - z[1]) / tail)
        return [0, 0], [z[0], u[1]], (rate, 0.0)

    sim = MuJoCoSimulator(
        AERO, outputs=["pitch.pos", "yaw.pos"], params=["pitch.damping", "yaw.damping", "beam.mass"], dt=0.05,
    )  # fmt: skip
    made = []
    for _ in range(3):
        Vp, Vy = steps(rng, 300, -14, 14, 18), steps(rng, 300, -12, 12, 18)
        made.append(np.c_[np.r_[np.zeros(4), Vp[4:] - Vp[4:].mean()], np.r_[np.zeros(4), Vy[4:] - Vy[4:].mean()]])
    data = robot(
        "aero_helicopter", rng, sim, AERO, made, [np.zeros(4)] * 3, force, lambda q, v, u, z: force(q, v, u, z, 0.01, 3e-5), [1, 0],
        0.015, hidden=lambda U: U[0],
    )  # fmt: skip
    return sim, *data, "input_lag@Vp 0.3 s (0.32, less when fast)"


MAIN["aero_helicopter"] = [("input_lag", ("Vp",), {"time_constant": 0.3})]
ACCEPTED["aero_helicopter"] = [["input_lag@Vp"]]
NEAR["aero_helicopter"] = [
    "input_delay or rate_limit@Vp, said to be partial",
    "sensor_lag or sensor_delay@pitch.pos, said to be partial",
    "hidden_relaxation@pitch or Vp",
]
REST["aero_helicopter"] = ["input_lag or input_delay@Vy (10 ms)", "constant_bias@yaw", "input_bias@Vy"]


# ------------------------------------------------------------------------------------------------ two main effects


@case
def hydraulic_arm(rng):
    """Hydraulic robot arm, 1024 samples of 50 ms.

    The spool covers its ports (0.07, rounded by leakage), and oil leaks past the worn vane with power 1.6 of the pressure, beside the
    known laminar bypass. Rest: the gauge has a lag of 8 ms.
    """
    p = {"kq": 9.0, "kw": 1.6, "kl": 0.4, "w0": 6.0, "d": 1.4}

    def nom(t, x, u, p, leak=0.0):
        P, q, w = x
        return p["kq"] * u[0] - p["kw"] * w - p["kl"] * P - leak, w, p["w0"] ** 2 * (P - q) - p["d"] * w

    def main(t, x, u):
        e = kink(u[0] - 0.07, 0.005) - kink(-u[0] - 0.07, 0.005)
        P = x[0]
        return nom(t, x, [e], p, 0.2 * P * (P * P + 1e-3) ** 0.3)

    def plan(r):
        u = np.round(steps(rng, 1024, -0.65, 0.65, 16), 3)
        return np.r_[np.zeros(4), u[4:]], nothing(1024)

    sim = ODESimulator(nom, states=["P", "q", "w"], inputs=["valve"], outputs=["P"], params=p, dt=0.05)
    data = twin(
        "hydraulic_arm", rng, sim, main, lambda t, x, u, d: [*main(t, x[:3], u), (x[0] - x[3]) / 0.008], plan,
        lambda r, u: [0, 0, 0, 0], see=lambda X: X[:, 3:4], seen=lambda X: X[:, :1], order=3, noise=0.02,
    )  # fmt: skip
    return sim, *data, "input_dead_zone@valve 0.07 (rounded) + power_law@P 0.2 (exponent 1.6)"


MAIN["hydraulic_arm"] = [
    ("input_dead_zone", ("valve",), {"half_width": 0.07}),
    ("power_law", ("P", "P"), {"coefficient": 0.2, "exponent": 1.6}),
]
ACCEPTED["hydraulic_arm"] = [["input_dead_zone@valve"], ["power_law@P", "quadratic_drag@P", "cubic_stiffness@P"]]
NEAR["hydraulic_arm"] = [
    "one of both alone",
    "coulomb_friction@P of valve for the dead zone",
    "input_backlash@valve or input_gain@valve for the dead zone",
    "linear_loss@P, parameter_error@kl or parameter_dependence@kl for the leak",
]
REST["hydraulic_arm"] = ["sensor_lag or sensor_delay@P (8 ms)"]


@case
def fed_batch(rng):
    """Six fed batches of yeast on an exponential feed, optical density and weight every half hour.

    A film grows on the optical probe (0.07 g/l each hour at first), and the worn tube of the pump gives 7 % less. Rest: yield 0.5 %
    off, scale in 0.01 l.
    """
    p = {"mu": 0.28, "Ks": 0.3, "Y": 0.5, "Sf": 180.0}

    def nom(t, x, u, p):  # g/l, l, h, l/h
        X, S, V = x
        S = np.maximum(S, 0 * S)
        grow, thin = p["mu"] * S / (p["Ks"] + S) * X, u[0] / V
        return grow - thin * X, -grow / p["Y"] + thin * (p["Sf"] - S), u[0]

    def main(t, x, u, p=p):
        return *nom(t, x[:3], [0.93 * u[0]], p), 0.07 * np.exp(-t / 120)

    def plan(r):
        n, rate = 64, 0.085 + 0.008 * (r % 3)
        t = np.arange(n) * 0.5
        feed = (0.011 + 0.002 * r) * np.exp(rate * t) * (1 + steps(rng, n, -0.25, 0.25, 8))
        return np.round(feed, 4), nothing(n)

    sim = ODESimulator(
        nom, states=["X", "S", "V"], inputs=["feed"], outputs=["X", "V"], params=p, dt=0.5, x0=[2.0, 0.4, 5.0],
    )  # fmt: skip
    data = twin(
        "fed_batch", rng, sim, main, lambda t, x, u, d: main(t, x, u, dict(p, Y=0.5025)), plan,
        lambda r, u: [2.0 + 0.15 * r, 0.4, 5.0 + 0.1 * r, 0.0], see=lambda X: np.c_[X[:, 0] + X[:, 3], X[:, 2]], noise=0.015, runs=6,
        grid=[0.0, 0.01],
    )  # fmt: skip
    return sim, *data, "sensor_drift@X 0.07 (a little less later) + input_gain@feed -0.07"


MAIN["fed_batch"] = [("sensor_drift", ("X",), {"rate": 0.063}), ("input_gain", ("feed",), {"relative_error": -0.07})]
ACCEPTED["fed_batch"] = [["sensor_drift@X"], ["input_gain@feed", "input_curve@feed (c < 0)"]]
NEAR["fed_batch"] = [
    "one of both alone",
    "sensor_gain@X, drift@X, parameter_error or parameter_drift@Y or @Sf for the film",
    "input_bias@feed or sensor_gain@V for the pump",
]
REST["fed_batch"] = ["parameter_error@Y", "sensor_quantization@V"]


FURUTA = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body name="base" pos="0 0 0.5">
<joint name="arm" axis="0 0 1" damping="0.002" stiffness="0.05"/>
<geom type="capsule" size="0.006" fromto="0 0 0 0.2 0 0" mass="0.1" contype="0" conaffinity="0"/>
<body name="rod" pos="0.2 0 0"><joint name="pend" axis="1 0 0" damping="0.0004"/>
<geom type="capsule" size="0.005" fromto="0 0 0 0 0 -0.3" mass="0.12" contype="0" conaffinity="0"/></body></body></worldbody>
<actuator><motor name="torque" joint="arm"/></actuator></mujoco>"""


@case
def furuta_hanging(rng):
    """Furuta pendulum that hangs, excited by its motor, with the cable of its encoder as a known spring.

    The bearing of the arm has a Stribeck curve, and the torque comes 28 ms late (bus) through a current loop of 4 ms. Rest: a little
    friction of the pendulum, encoders of 2048 lines.
    """

    def force(q, v, u, z, rest=0.0):  # z: the torque
        dry = (0.006 + 0.003 * np.exp(-((v[0] / 0.2) ** 2))) * np.tanh(v[0] / 0.03)
        return [-dry, -rest * np.tanh(v[1] / 0.05)], z, (u - z) / 0.004

    sim = MuJoCoSimulator(
        FURUTA, outputs=["arm.pos", "pend.pos"], params=["arm.damping", "pend.damping", "rod.mass"], dt=0.02
    )
    made, starts = [], [np.array([0.0, [0.0, 0.6, -0.9, 0.0][r], 0, 0]) for r in range(4)]
    for r in range(4):
        torque = sines(rng, 247, 0.02, 0.035 + 0.006 * r, 0.25, 1.8, 6) + steps(rng, 247, -0.02, 0.02, 40)
        made.append(np.r_[np.zeros(3), torque][:, None])
    data = robot(
        "furuta_hanging", rng, sim, FURUTA, made, starts, force, lambda q, v, u, z: force(q, v, u, z, 4e-5), [0, 1], 0.015,
        grid=2 * np.pi / 8192, hidden=lambda U: U[0], late=0.028,
    )  # fmt: skip
    return sim, *data, "stribeck_friction@arm (6 to 9 mN m) + input_delay@torque 32 ms (28 ms and a lag of 4)"


MAIN["furuta_hanging"] = [
    ("stribeck_friction", ("arm", "arm.vel"), {"level": 0.006, "static_level": 0.009, "velocity": 0.2}),
    ("input_delay", ("torque",), {"delay": 0.032}),
]
ACCEPTED["furuta_hanging"] = [
    [
        f"{name}@arm or torque"
        for name in ("stribeck_friction", "coulomb_friction", "asymmetric_friction", "lugre_friction")
    ],
    ["input_delay@torque"],
]
NEAR["furuta_hanging"] = [
    "one of both alone",
    "input_lag@torque for the delay",
    "hysteresis@arm of arm.pos, linear_loss@arm of arm.vel or parameter_error@arm.damping for the friction",
]
REST["furuta_hanging"] = ["coulomb_friction@pend", "parameter_error@pend.damping", "input_lag@torque (4 ms)"]


# ------------------------------------------------------------------------------------------------ no main effect


@case
def none_quadruple_tank(rng):
    """Quadruple tank of Johansson, three runs of samples of 5 s; nothing is missing.

    Rest: pumps 0.1 % weaker at full voltage, the water swirls (0.02 of the flow), levels shown in 0.02 cm; outlet a1 free, 4 % off.
    """
    p = {
        "A1": 28.0,
        "A2": 32.0,
        "a1": 0.071,
        "a2": 0.057,
        "a3": 0.071,
        "a4": 0.057,
        "k1": 3.33,
        "k2": 3.35,
        "g1": 0.7,
        "g2": 0.6,
    }

    def nom(t, x, u, p, swirl=0.0):
        out = [p[f"a{k + 1}"] * np.sqrt(2 * 981 * np.maximum(h, 0 * h + 1e-4)) for k, h in enumerate(x)]
        q1, q2 = p["k1"] * u[0], p["k2"] * u[1]
        return (
            (out[2] - out[0] + p["g1"] * q1 + swirl) / p["A1"],
            (out[3] - out[1] + p["g2"] * q2) / p["A2"],
            ((1 - p["g2"]) * q2 - out[2]) / p["A1"],
            ((1 - p["g1"]) * q1 - out[3]) / p["A2"],
        )

    def plan(r):
        v = np.c_[steps(rng, 260, 2.2, 3.8, 28), steps(rng, 260, 2.2, 3.8, 28)]
        return np.round(np.r_[np.full((4, 2), 3.0), v[4:]], 2), 0.02 * coloured(rng, 260, 0.9)

    rest = settled(lambda x: nom(0, x, [3.0, 3.0], p), [12.0, 13.0, 1.8, 1.4], 4000)
    sim = ODESimulator(
        nom, states=["h1", "h2", "h3", "h4"], inputs=["v1", "v2"], outputs=["h1", "h2"], params=dict(p, a1=0.0738), dt=5.0, x0=rest,
    )  # fmt: skip
    data = twin(
        "none_quadruple_tank", rng, sim, lambda t, x, u: nom(t, x, u, p),
        lambda t, x, u, d: nom(t, x, [v * (1 - 0.0005 * (v - 2)) for v in u], p, d[0]), plan, lambda r, u: rest,
        see=lambda X: X[:, :2], noise=0.02, runs=3, grid=0.02,
    )  # fmt: skip
    return sim, *data, "none (a1 free, 4 % off)"


KW["none_quadruple_tank"] = {"free_params": ["a1"]}
ACCEPTED["none_quadruple_tank"] = [[]]
NEAR["none_quadruple_tank"] = []
REST["none_quadruple_tank"] = ["input_gain or input_curve@v1 or v2 (0.1 %)"]


@case
def none_flexible_joint(rng):
    """Rotary flexible joint with its position controller; python-control, nonlinear system; nothing is missing.

    Rest: encoders of 4096 counts, friction of 0.2 mN m, amplifier of 1 ms; stiffness Ks free, 5 % off.
    """
    import control

    p = {"J": 0.0021, "B": 0.016, "K": 0.13, "Ks": 1.3, "Ja": 0.0038, "Ba": 0.0006}

    def f(t, x, u, params):
        th, al, a, b = x
        twist = params["Ks"] * (th - al)
        return np.array(
            [
                a,
                b,
                (params["K"] * u[0] - params["B"] * a - twist) / params["J"],
                (twist - params["Ba"] * b) / params["Ja"],
            ]
        )

    def true(t, x, u, d):
        rates = f(t, x[:4], [x[4]], p)
        rates[2] -= 2e-4 * np.tanh(x[2] / 0.05) / p["J"]
        return [*rates, (u[0] - x[4]) / 1e-3]

    def plan(r):
        aim = steps(rng, 250, -0.8, 0.8, 25)
        return np.r_[np.zeros(4), aim[4:]], nothing(250)

    def control_(y, row, memo):
        v = memo["v"] = 0.5 * memo.get("v", 0.0) + 0.5 * (y[0] - memo.get("y", y[0])) / 0.02
        memo["y"] = y[0]
        return [np.clip(5.0 * (row[0] - y[0]) - 0.15 * v, -5, 5)]

    values = dict(p, Ks=1.365)
    system = control.nlsys(
        f, lambda t, x, u, params: x[:2], states=["th", "al", "dth", "dal"], inputs=["volts"], outputs=["th", "al"], params=values,
    )  # fmt: skip
    sim = ControlSimulator(system, dt=0.02, params=dict(values))
    data = twin(
        "none_flexible_joint", rng, sim, lambda t, x, u: f(t, x, u, p), true, plan, lambda r, u: [0, 0, 0, 0, 0],
        see=lambda X: X[:, :2], order=4, noise=0.015, runs=4, grid=2 * np.pi / 4096, control=control_, scale=[1, 1, 1, 1, 1],
    )  # fmt: skip
    return sim, *data, "none (Ks free, 5 % off)"


KW["none_flexible_joint"] = {"free_params": ["Ks"]}
ACCEPTED["none_flexible_joint"] = [[]]
NEAR["none_flexible_joint"] = []
REST["none_flexible_joint"] = ["input_lag or input_delay@volts (1 ms)", "coulomb_friction@dth (0.1 rad/s2)"]


@case
def none_gas_furnace(rng):
    """Gas furnace of Box and Jenkins, their difference equation with a dead time of three samples, one run of 300.

    Nothing is missing. The noise is theirs, of second order. Rest: display of 0.1 %; delta free, 4 % off.
    """
    p = {"delta": 0.57, "w0": -0.53, "w1": -0.37, "w2": -0.51}

    def step(t, x, u, p, dt):
        return [p["delta"] * x[0] + p["w0"] * x[2] + p["w1"] * x[3] + p["w2"] * x[4], u[0], x[1], x[2], x[3]]

    def ar2(n, a, b):
        e = np.zeros(n + 100)
        for k in range(2, n + 100):
            e[k] = a * e[k - 1] + b * e[k - 2] + rng.normal()
        return e[100:] / e[100:].std()

    gas = np.round(np.r_[np.zeros(6), 1.1 * ar2(294, 1.85, -0.88)], 2)[:, None]

    def play_all():
        x, out = np.zeros(5), []
        for u in gas:
            out.append([53.5 + x[0]])
            x = np.array(step(0, x, u, p, 1.0))
        return np.array(out)

    sim = StepSimulator(
        step, states=["c", "gas1", "gas2", "gas3", "gas4"], inputs=["gas"], outputs=["co2"], output=lambda t, x, u, p: [53.5 + x[0]],
        params=dict(p, delta=0.547), dt=1.0, x0=np.zeros(5),
    )  # fmt: skip
    clean, noise = play_all(), 0.06
    data = hand_in(
        "none_gas_furnace", rng, sim, [gas], clean, noise * clean.std(0), noise, play_all, 0.1, [np.zeros(5)],
        ar2(300, 1.53, -0.63)[:, None],
    )  # fmt: skip
    return sim, *data, "none (delta free, 4 % off)"


KW["none_gas_furnace"] = {"free_params": ["delta"]}
ACCEPTED["none_gas_furnace"] = [[]]
NEAR["none_gas_furnace"] = []
REST["none_gas_furnace"] = []


def main():
    """Print the checks of the cases that were asked for."""
    import argparse
    import time
    import zlib

    parser = argparse.ArgumentParser(description="Sizes of the gaps, over the noise.")
    parser.add_argument("names", nargs="*", default=list(ACCEPTED))
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for name in options.names:
        started = time.process_time()
        sim, U, Y, groups, truth = CASES[name](np.random.default_rng([options.seed, zlib.crc32(name.encode())]))
        built, out = time.process_time() - started, CHECK[name]()
        finite = all(np.all(np.isfinite(a)) for a in (U, Y, out["nominal"], out["main"], out["clean"]))
        gaps = ", ".join(f"{k} {v:.1f}" for k, v in out["gaps"].items())
        print(
            f"{name} {type(sim).__name__} rows {len(Y)} runs {groups[-1] + 1} inputs {U.shape[1]} sd {np.round(Y.std(0), 3)} "
            f"finite {finite}; {gaps}; {built:.1f} s [{truth}]",
            flush=True,
        )


if __name__ == "__main__":
    main()
