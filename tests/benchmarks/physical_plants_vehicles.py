"""Fourteen simulated twins of vehicles and machines: road, rail, water, air, lifts and construction machines.

Six plants have one effect in the form of nature or hardware, one has one beside a wrong mass, three have two at
different places, two have one of no entry of the catalogue, and two have none. Three simulators give trajectories alone.
``ACCEPTED``, ``NEAR`` and ``WRONG`` are as in ``physical_plants_trades``; all were fixed by engineering judgement before any
diagnosis, and a comment above them gives the reason. "(not needed)" marks a name that may be missing. ``NOISE`` and
``CHECK`` are those of ``physical_plants_service``, as are the helpers.

    python tests/benchmarks/physical_plants_vehicles.py [NAME ...] [--seed 101]

prints sizes over the noise: of the gap, of all effects, and of each of two effects.
"""

import numpy as np
from physical_plants import KW, case, sines, steps
from physical_plants_messy import pi
from physical_plants_service import CHECK, NOISE, main, twin  # noqa: F401
from physical_plants_si import coloured, kink
from physical_plants_trades import led_in, quiet, rk4

from sksurrogate.physics import CallableSimulator, ODESimulator, StepSimulator

ACCEPTED, NEAR, WRONG = {}, {}, {}


def tool(rhs, x0, dt, parts, see):
    """A function (U, p) that returns the outputs of a run that begins at ``x0``: a tool that gives trajectories alone."""

    def table(U, p):
        x, h, X = list(x0), dt / parts, []
        for u in np.asarray(U, float).tolist():
            X.append(x)
            for _ in range(parts):
                a = rhs(0, x, u, p)
                b = rhs(0, [v + h / 2 * w for v, w in zip(x, a)], u, p)
                c = rhs(0, [v + h / 2 * w for v, w in zip(x, b)], u, p)
                d = rhs(0, [v + h * w for v, w in zip(x, c)], u, p)
                x = [v + h / 6 * (i + 2 * j + 2 * k + l) for v, i, j, k, l in zip(x, a, b, c, d)]
        return see(np.array(X), p)

    return table


# ------------------------------------------------------------------------------------------ one effect


@case
def leaf_spring(rng):
    """Frame of a trailer on its leaf springs, pushed by a hydraulic exciter, N and m, samples of 20 ms.

    The leaves rub on each other: the force between them moves towards 1.5 kN within a stroke of 2 mm (Fancher), and
    this level grows with the load on the spring. The simulator, a right-hand side, has a linear spring and a damper.
    The speed is not measured. The stiffness is free and 5 % low.
    """
    p = {"m": 4500.0, "k": 2.5e5, "c": 6500.0}

    def nom(t, x, u, p, rub=0.0):
        return x[1], (u[0] - p["k"] * x[0] - p["c"] * x[1] - rub) / p["m"]

    def true(t, x, u, d, on):
        level = 1500 * (1 + p["k"] * x[0] / 45000)
        return *nom(t, x[:2], u, p, on[0] * x[2]), (level * x[1] - x[2] * abs(x[1])) / 2e-3

    def plan(r):
        n = (520, 430, 360)[r]
        push = steps(rng, n, -3500, 3500, 45) + sines(rng, n, 0.02, 2200 + 700 * r, 0.3, 3.0, 6)
        return np.round(push * np.minimum(1, np.arange(n) / 20)), quiet(n)

    sim = ODESimulator(
        nom, states=["x", "v"], inputs=["push"], outputs=["x"], params=dict(p, k=0.95 * p["k"]), dt=0.02,
        units={"x": "m", "v": "m/s", "push": "N", "k": "N/m", "time": "s"},
    )  # fmt: skip
    data = twin(
        "leaf_spring", rng, sim, true, plan, lambda r, u: [0, 0, 0], see=lambda X, on: X[:, :1], noise=0.01, runs=3,
        scale=[0.01, 0.1, 1000],
    )  # fmt: skip
    return sim, *data, "hysteresis or lugre_friction@v (1.5 kN within 2 mm, grows with the load); k free, 5 % low"


# A dry friction that needs a stroke to turn over: both forms of the catalogue with that memory are right. Its stiffness
# at small strokes is three times that of the spring, so dry friction without a stroke is only near.
KW["leaf_spring"] = {"free_params": ["k"]}
ACCEPTED["leaf_spring"] = [
    ["hysteresis@v or @push of x", "lugre_friction@v or @push of v"],
    ["parameter_error@k (+)", "(not needed)"],
]
NEAR["leaf_spring"] = [
    "coulomb_friction, asymmetric_friction or stribeck_friction@v or @push of v",
    "linear_loss@v of v or parameter_error@c (+), said to be partial",
    "parameter_error@k (+) more than 8 % off, said to be partial",
]
WRONG["leaf_spring"] = [
    "input_backlash or input_dead_zone@push",
    "a sensor effect",
    "cubic_stiffness or end_stop@v said to be all",
    "parameter_error@k, @c or @m said to be all",
]


@case
def trailer_brake(rng):
    """Air brake of a trailer, pressure of relay valve and chamber in Pa, samples of 50 ms; trajectories alone.

    The control line is 20 m long: the pressure wave comes 0.21 s late, 0.18 to 0.24 s by what the couplings hold back,
    and a volume before the relay valve has a lag of 20 ms. The simulator has the valves at the pedal. kq is free and 6 %
    low.
    """
    p = {"T": 0.09, "kq": 3900.0}  # s; sqrt(Pa)/s: the orifice before the chamber

    def nom(t, x, u, p):
        e = x[0] - x[1]
        return (u[0] - x[0]) / p["T"], p["kq"] * e / (abs(e) + 5e3) ** 0.5

    def true(t, x, u, d, on):
        return [*nom(t, x[:2], x[2:3] if on[0] else u, p), (x[3] - x[2]) / 0.02, *np.zeros(25)]

    def tick(x, u, d, on):  # the line: pressures of the last ticks of 12.5 ms, and that which has come through
        line = np.r_[u[0], x[4:-1]]
        return np.r_[x[:3], np.interp(d[0] / 0.0125, np.arange(24), line), line]

    def plan(r):
        n = (300, 240, 340, 260)[r]
        pedal = np.clip(steps(rng, n, -2e5, 7e5, 16) + 3e4 * coloured(rng, n, 0.9), 0, 7e5)
        pedal[:8] = 0
        return np.round(pedal, -3), 0.21 + steps(rng, n, -0.03, 0.03, 60)

    start = dict(p, kq=0.94 * p["kq"])
    sim = CallableSimulator(
        tool(nom, [0.0, 0.0], 0.05, 4, lambda X, p: X), inputs=["pedal"], outputs=["relay", "chamber"], params=start,
        dt=0.05, units={"pedal": "Pa", "relay": "Pa", "chamber": "Pa", "T": "s", "time": "s"},
    )  # fmt: skip
    data = twin(
        "trailer_brake", rng, sim, true, plan, lambda r, u: np.zeros(28), see=lambda X, on: X[:, :2], noise=0.012,
        runs=4, scale=1e5, tick=tick,
    )  # fmt: skip
    return sim, *data, "input_delay@pedal 0.21 s (0.18 to 0.24, lag of 20 ms), simulate only; kq free, 6 % low"


# A wave along a pipe is a delay; the small lag is real, so a lag beside the delay is right as well. Both outputs lie
# behind the same pipe, so delays of both sensors do the same; one of them does not.
KW["trailer_brake"] = {"free_params": ["kq"]}
ACCEPTED["trailer_brake"] = [
    [
        "input_delay@pedal",
        "input_delay@pedal with input_lag@pedal (at most 60 ms) or parameter_error@T (+)",
        "sensor_delay@relay with sensor_delay@chamber",
    ],
    ["parameter_error@kq (+)", "(not needed)"],
]
NEAR["trailer_brake"] = [
    "input_delay@pedal with rate_limit@pedal",
    "input_lag@pedal or parameter_error@T (+), said to be partial",
]
WRONG["trailer_brake"] = [
    "input_lag or rate_limit@pedal said to be all",
    "parameter_error@T said to be all",
    "a sensor effect at one output alone, said to be all",
    "input_backlash, _gain, _dead_zone or _saturation@pedal",
]


@case
def notch_locomotive(rng):
    """Diesel-electric locomotive with a freight train, lever 0 to 1, m/s and N, samples of 2 s; trajectories alone.

    The engine has eight notches, whose powers are not quite even (within 1.5 % of full power), and a governor motor
    that moves between them with 0.3 s. The simulator follows the lever. The constant of the train's resistance is free
    and 12 % high.
    """
    p = {"M": 6e5, "P": 2.2e6, "T": 3.0, "a": 6000.0, "b": 250.0, "c": 20.0}
    power = np.array([0, 0.11, 0.245, 0.385, 0.5, 0.615, 0.76, 0.88, 1.0])

    def nom(t, x, u, p):  # m/s, share of full power; grade as a slope
        v, e = x
        drag = p["a"] + p["b"] * v + p["c"] * v * v
        return (p["P"] * e / (v + 4) - drag) / p["M"] - 9.81 * u[1], (u[0] - e) / p["T"]

    def true(t, x, u, d, on):
        asked = power[int(np.round(8 * u[0]))]
        return *nom(t, x[:2], [x[2] if on[0] else u[0], u[1]], p), (asked - x[2]) / 0.3

    def plan(r):
        n = (330, 250, 290)[r]
        lever = np.clip(0.55 + steps(rng, n, -0.38, 0.42, 14) + 0.04 * coloured(rng, n, 0.95), 0.08, 1)
        grade = 0.0035 * sines(rng, n, 2.0, 1.0, 0.002, 0.012, 4)
        lever[:4], grade[:4] = 0.5, 0
        return np.c_[np.round(lever, 3), np.round(grade, 4)], quiet(n)

    sim = CallableSimulator(
        tool(nom, [10.0, 0.5], 2.0, 4, lambda X, p: np.c_[X[:, 0], p["P"] * X[:, 1] / (X[:, 0] + 4)]),
        inputs=["lever", "grade"], outputs=["speed", "effort"], params=dict(p, a=1.12 * p["a"]), dt=2.0,
        units={"speed": "m/s", "effort": "N", "M": "kg", "P": "W", "a": "N", "time": "s"},
    )  # fmt: skip
    data = twin(
        "notch_locomotive", rng, sim, true, plan, lambda r, u: [10.0, 0.5, 0.5],
        see=lambda X, on: np.c_[X[:, 0], p["P"] * X[:, 1] / (X[:, 0] + 4)], noise=[0.006, 0.012], runs=3,
        scale=[10, 1, 1],
    )  # fmt: skip
    return sim, *data, "input_quantization@lever 0.125 (uneven notches), simulate only; a free, 12 % high"


# Only a quantizer gives steps where the lever moves smoothly. Uneven notches leave some rest.
KW["notch_locomotive"] = {"free_params": ["a"]}
ACCEPTED["notch_locomotive"] = [
    ["input_quantization@lever", "input_quantization@lever with input_lag@lever (at most 1 s)"],
    ["parameter_error@a (-)", "(not needed)"],
]
NEAR["notch_locomotive"] = [
    "unknown or partial with a law of the lever",
    "input_quantization@lever beside a small parameter_error@P, @T or input_gain@lever",
]
WRONG["notch_locomotive"] = [
    "input_backlash, input_dead_zone, input_curve or input_saturation@lever said to be all",
    "any name at grade",
    "a sensor effect",
    "none, or parameter_error@a said to be all",
]


@case
def forklift_mast(rng):
    """Mast of a forklift, single acting, Pa, m and m3/s, samples of 50 ms; a driver who sets pallets down and takes them.

    The lowering valve leaks through a scratched seat: an orifice with a laminar part, 1.9e-5 m3/s at 8 MPa. The
    simulator, a right-hand side, has a tight valve. The load on the forks is recorded. The damping is free and 10 % low.
    """
    p = {"m": 900.0, "A": 2.5e-3, "stiff": 1.75e11, "c": 9000.0}  # Pa/m3: bulk modulus over volume

    def nom(t, x, u, p, leak=0.0):  # lift, speed, pressure; flow in m3/s (up +), load in kg
        m = p["m"] + u[1]
        return x[1], (p["A"] * x[2] - p["c"] * x[1]) / m - 9.81, p["stiff"] * (u[0] - leak - p["A"] * x[1])

    def true(t, x, u, d, on):
        P = max(x[2], 0)
        return nom(t, x, u, p, on[0] * 8.5e-9 * (np.sqrt(P + 4e5) - np.sqrt(4e5)))

    def plan(r):
        n = (640, 460, 560)[r]
        height = 1.6 + steps(rng, n, -1.1, 1.3, 70)
        pallets = np.clip(steps(rng, n, -500, 2200, 90), 0, None)
        load = np.convolve(
            np.r_[np.full(19, pallets[0]), pallets], np.ones(20) / 20, "valid"
        )  # set down within a second
        return np.c_[height, led_in(np.round(load, -1), 4)], quiet(n)

    def loop(y, row, memo):  # the driver moves the lever in his own time
        asked = np.clip(7e-4 * (row[0] - y[0]), -8e-4, 7e-4)
        memo["q"] = memo.get("q", 0.0) + np.clip(asked - memo.get("q", 0.0), -6e-5, 6e-5)
        return [np.round(memo["q"], 6), row[1]]

    sim = ODESimulator(
        nom, states=["h", "w", "P"], inputs=["flow", "load"], outputs=["h", "P"], params=dict(p, c=0.9 * p["c"]), dt=0.05,
        x0=[1.0, 0.0, 3.5e6],
        units={"h": "m", "w": "m/s", "P": "Pa", "flow": "m3/s", "load": "kg", "time": "s"},
    )  # fmt: skip
    data = twin(
        "forklift_mast", rng, sim, true, plan, lambda r, u: [rng.uniform(0.8, 2.2), 0, 9.81 * (p["m"] + u[1]) / p["A"]],
        see=lambda X, on: X[:, [0, 2]], noise=[0.01, 0.02], runs=3, scale=[1, 1, 1e6], loop=loop,
    )  # fmt: skip
    return sim, *data, "sqrt_leak@P of P (8.5e-9 m3/s/sqrt(Pa), laminar below 0.4 MPa); c free, 10 % low"


# Pressures go from 3 to 11 MPa with the load, so that the square root differs from a constant and from a line by about a
# fifth of itself. The flow enters this balance alone: the same law at the port of the flow is a twin.
KW["forklift_mast"] = {"free_params": ["c"]}
ACCEPTED["forklift_mast"] = [
    ["sqrt_leak@P or @flow of P", "power_law@P or @flow of P (exponent 0.35 to 0.75)"],
    ["parameter_error@c (+)", "(not needed)"],
]
NEAR["forklift_mast"] = [
    "linear_loss@P or @flow of P, constant_bias@P or input_bias@flow (-), said to be partial",
    "linear_loss@P of P with constant_bias@P (-)",
    "a law of P at P",
]
WRONG["forklift_mast"] = [
    "sensor_drift@h, or a sensor effect said to be all",
    "any name at w or load said to be all",
    "constant_bias@P, input_bias@flow, input_gain@flow or parameter_error@A said to be all",
]


@case
def hexarotor_fault(rng):
    """Climb of a hexarotor in a cage, climb rate in m/s, throttle 0 to 1, samples of 0.1 s, closed loop.

    At 18 s of each flight the test program weakens one of the six motors within a second: the thrust loses 6 %. The
    simulator, a right-hand side, has all rotors. The thrust is not measured; gusts push (0.05 m/s2). The damping of the
    inflow is free and 10 % high.
    """
    p = {"kT": 35.0, "T": 0.09, "c": 0.45}

    def nom(t, x, u, p, weak=0.0):  # m/s2 of thrust, m/s
        return (p["kT"] * (1 - weak) * u[0] ** 2 - x[0]) / p["T"], x[0] - 9.81 - p["c"] * x[1]

    def true(t, x, u, d, on):
        a, b = nom(t, x, u, p, on[0] * 0.06 * np.clip(t - 18, 0, 1))
        return a, b + d[0]

    def plan(r):
        n = (400, 360, 440)[r]
        return steps(rng, n, -1.8, 1.8, 18), 0.05 * coloured(rng, n, 0.9)

    def loop(y, row, memo):
        memo.setdefault("I", 0.53)
        return [np.round(pi(row[0] - y[0], memo, 0.06, 0.004, 0.25, 0.95), 4)]

    sim = ODESimulator(
        nom,
        states=["f", "w"],
        inputs=["throttle"],
        outputs=["w"],
        params=dict(p, c=1.1 * p["c"]),
        dt=0.1,
        x0=[9.81, 0.0],
    )
    data = twin(
        "hexarotor_fault", rng, sim, true, plan, lambda r, u: [9.81, 0.0], see=lambda X, on: X[:, 1:], noise=0.015,
        runs=3, scale=[1, 1], loop=loop,
    )  # fmt: skip
    return sim, *data, "parameter_step@kT -0.06 at 18.5 s (a ramp of 1 s); c free, 10 % high"


# The thrust is kT u^2: a step of kT and a gain of the throttle that sets in are the same. A constant force from 18 s
# on leaves what the throttle changes, a tenth of it.
KW["hexarotor_fault"] = {"free_params": ["c"]}
ACCEPTED["hexarotor_fault"] = [
    [
        "parameter_step@kT (-) at 17.5 to 19.5 s",
        "parameter_error@kT (-), input_gain or input_curve@throttle (-) with that onset",
    ],
    ["parameter_error@c (-)", "(not needed)"],
]
NEAR["hexarotor_fault"] = [
    "step_disturbance@f or @w (-), or input_bias@throttle (-) with an onset, at 17.5 to 19.5 s",
    "parameter_drift or parameter_error@kT (-), said to be partial",
]
WRONG["hexarotor_fault"] = [
    "a sensor effect said to be all",
    "any name without an onset, or with one outside of 16 to 21 s, said to be all",
    "input_lag, input_delay or rate_limit@throttle said to be all",
]


@case
def tug_drift(rng):
    """Tug on station, sway in m/s and yaw rate in rad/s, forces in N, samples of 1 s.

    A hull that drifts sideways turns into the flow: a moment of 5.4e5 N m at 1 m/s of sway, less per speed when the flow
    separates. The simulator, a step in Python, has sway and yaw without each other. A tide that nobody knows pushes (4
    kN). The damping of the yaw is free and 8 % low.
    """
    p = {"m": 9e5, "dv": 9e4, "I": 5.5e7, "dr": 6e6}

    def nom(t, x, u, p):
        return (u[0] - p["dv"] * x[0]) / p["m"], (u[1] - p["dr"] * x[1]) / p["I"]

    def true(t, x, u, d, on):
        a, b = nom(t, x, u, p)
        return a + d[0] / p["m"], b + on[0] * 5.8e5 * x[0] / (1 + (x[0] / 1.8) ** 2) ** 0.5 / p["I"]

    def plan(r):
        n = (420, 520, 330, 380)[r]
        side = steps(rng, n, -1.3e5, 1.3e5, 26) + 8e3 * coloured(rng, n, 0.9)
        turn = steps(rng, n, -5e5, 5e5, 17)
        return np.round(np.c_[led_in(side), led_in(turn)], -2), 4e3 * coloured(rng, n, 0.98)

    sim = StepSimulator(
        rk4(nom, 2), states=["v", "r"], inputs=["side", "turn"], outputs=["v", "r"], params=dict(p, dr=0.92 * p["dr"]),
        dt=1.0, units={"v": "m/s", "r": "rad/s", "side": "N", "turn": "N m", "m": "kg", "time": "s"},
    )  # fmt: skip
    data = twin(
        "tug_drift", rng, sim, true, plan, lambda r, u: [rng.uniform(-0.3, 0.3), 0], see=lambda X, on: X, noise=0.02,
        runs=4, scale=[1, 0.1],
    )  # fmt: skip
    return sim, *data, "linear_loss@r of v, c < 0 (5.4e5 N m at 1 m/s, bends); dr free, 8 % low"


# The moment of the drifting hull (Munk) is nearly linear in the sway; the bend is a tenth of it. It enters the yaw's
# balance, whose port is the input turn.
KW["tug_drift"] = {"free_params": ["dr"]}
ACCEPTED["tug_drift"] = [
    ["linear_loss@r or @turn of v (c < 0)", "exchange@r of v with linear_loss@r of r or parameter_error@dr (-)"],
    ["parameter_error@dr (+)", "(not needed)"],
]
NEAR["tug_drift"] = [
    "exchange@r of v",
    "input_coupling@turn of side, said to be partial",
    "a law of v at r",
]
WRONG["tug_drift"] = [
    "input_coupling@turn of side said to be all",
    "sensor_coupling@r of v said to be all",
    "any name at v or side, or parameter_error@I or @dr said to be all",
]


# ------------------------------------------------------------------------------------------ one effect and a wrong mass


@case
def elevator_rope(rng):
    """Freight elevator with a geared machine under its speed control, N and m, samples of 20 ms; the sheave is measured.

    The car (600 kg of the 3 t that move) hangs on ropes that stretch, softer the lower it is: 9 to 14 rad/s. The
    simulator, a right-hand side, moves all masses as one. The mass is free.
    """
    p = {"M": 3000.0, "b": 400.0}

    def nom(t, x, u, p):
        return x[1], (u[0] - p["b"] * x[1]) / p["M"]

    def true(t, x, u, d, on):
        s, v, z, w = x
        if not on[0]:
            a, b = nom(t, x[:2], u, p)
            return a, b, v, b
        pull = 1.5e6 / max(25 - s, 12) * (z - s) + 450 * (w - v)
        return v, (u[0] - p["b"] * v + pull) / 2400, w, -pull / 600

    def plan(r):
        n = (520, 460, 400)[r]
        return steps(rng, n, -1.2, 1.2, 45) + sines(rng, n, 0.02, 0.12, 0.4, 4, 5), quiet(n)

    def loop(y, row, memo):  # the aim passes a ramp
        was = memo.get("aim", 0.0)
        memo["aim"] = was + np.clip(row[0] - was, -0.06, 0.06)
        return [np.round(pi(memo["aim"] - y[1], memo, 26000, 900, -20000, 20000))]

    sim = ODESimulator(
        nom, states=["s", "v"], inputs=["force"], outputs=["s", "v"], params=p, dt=0.02,
        units={"s": "m", "v": "m/s", "force": "N", "M": "kg", "time": "s"},
    )  # fmt: skip
    data = twin(
        "elevator_rope", rng, sim, true, plan, lambda r, u: [0, 0, 0, 0], see=lambda X, on: X[:, :2],
        noise=[0.004, 0.008], runs=3, scale=0.1, loop=loop,
    )  # fmt: skip
    return sim, *data, "hidden_mode@v of s (25 1/s2, 10 rad/s, changes with the rope) and M -0.2"


# A mass on a spring is a hidden mode. M is the whole mass, and what moves as one is 2400 kg: with the mode M must be
# lower by a fifth. M is a factor of all that enters, so a gain of the force does nearly the same (b is small).
KW["elevator_rope"] = {"free_params": ["M"]}
ACCEPTED["elevator_rope"] = [
    ["hidden_mode@v or @force of s", "hidden_mode@v or @force of v"],
    ["parameter_error@M (-)", "input_gain@force (+)"],
]
NEAR["elevator_rope"] = ["one of both alone, said to be partial", "a law of the past of s or v, unknown or partial"]
WRONG["elevator_rope"] = [
    "input_lag, input_delay or rate_limit@force said to be all",
    "a sensor effect said to be all",
    "parameter_error@M or a friction said to be all",
    "hidden_relaxation said to be all",
]


# ------------------------------------------------------------------------------------------ two effects


@case
def traction_overload(rng):
    """Traction motor on a test stand in a short overload, current loop of its inverter, V and A, samples of 20 ms.

    The dead time of the inverter takes 2.5 V against the direction of the current (smooth within 10 A), and the copper
    warms by 2.4 K/s at 250 A: R rises by up to a sixth, each run from cold. The simulator, a right-hand side in rotor
    coordinates that takes the speed from the dynamometer, has neither. The inductance is free and right.
    """
    p = {"R": 0.05, "L": 1e-3, "psi": 0.15}

    def nom(t, x, u, p, loss=(0.0, 0.0), warm=1.0):  # A, A; V, V, rad/s of the shaft; four pole pairs
        d, q = x
        e, R = 4 * u[2], p["R"] * warm
        return (
            (u[0] - loss[0] - R * d) / p["L"] + e * q,
            (u[1] - loss[1] - R * q - e * p["psi"]) / p["L"] - e * d,
        )

    def true(t, x, u, d, on):
        square = x[0] ** 2 + x[1] ** 2
        loss = on[0] * 2.5 / np.sqrt(square + 100) * x[:2]
        return *nom(t, x[:2], u, p, loss, 1 + on[1] * 0.0039 * x[2]), 3.84e-5 * square - x[2] / 90

    def plan(r):
        n = (700, 800, 620)[r]
        aims = np.c_[steps(rng, n, -60, 15, 60), steps(rng, n, -380, 400, 22)]
        return np.c_[aims, np.round(3 + 6 * sines(rng, n, 0.02, 1.0, 0.05, 0.4, 4), 2)], quiet(n)

    def loop(y, row, memo):
        d, q = memo.setdefault("d", {}), memo.setdefault("q", {})
        e = 4 * row[2]
        ud = pi(row[0] - y[0], d, 0.015, 0.006, -40, 40) - e * p["L"] * y[1]
        uq = pi(row[1] - y[1], q, 0.015, 0.006, -40, 40) + e * (p["psi"] + p["L"] * y[0])
        return np.round([ud, uq, row[2]], 2)

    sim = ODESimulator(
        nom, states=["id", "iq"], inputs=["ud", "uq", "w"], outputs=["id", "iq"], params=p, dt=0.02,
        units={"id": "A", "iq": "A", "w": "rad/s", "ud": "V", "uq": "V", "R": "ohm", "time": "s"},
    )  # fmt: skip
    data = twin(
        "traction_overload", rng, sim, true, plan, lambda r, u: [0, 0, 0], see=lambda X, on: X[:, :2], noise=0.008,
        runs=3, scale=[100, 100, 10], loop=loop, parts=["dead time", "copper"],
    )  # fmt: skip
    return sim, *data, "coulomb_friction@iq of iq 2.5 V (of the vector of currents) + parameter_drift@R 0.9 % a second"


# The loss of the dead time has the direction of the current, most of it in q: a friction at iq, of its own balance or
# of the port uq. Its part in d is 0.9 V (root of the mean square); without a name for it the answer should be partial.
# The warmth of the copper is not measured; it rises nearly evenly in 16 s.
KW["traction_overload"] = {"free_params": ["L"]}
ACCEPTED["traction_overload"] = [
    [f"{a}_friction@iq or @uq of iq" for a in ("coulomb", "asymmetric", "stribeck")]
    + ["power_law@iq or @uq of iq (odd, exponent at most 0.3)"],
    ["parameter_drift@R (+)"],
    [
        "a friction, linear_loss or a law of id and iq@id or @ud of id (c > 0)",
        "parameter_error@R (+ or -) of at most 4 % beside the friction and the drift",
        "(not needed where the answer is said to be partial)",
    ],
]
NEAR["traction_overload"] = [
    "one of both alone, said to be partial",
    "parameter_error or parameter_step@R (+) for the copper, said to be partial",
    "a law of iq at iq for the inverter, or a law of iq with id",
]
WRONG["traction_overload"] = [
    "parameter_error@R, @L or @psi said to be all",
    "input_dead_zone@uq or @ud said to be all",
    "any name at w, or a sensor effect said to be all",
]


@case
def sea_glider(rng):
    """Glider that dives by the oil in its bladder and turns at depths it reads, m and m3, samples of 1 s; depth alone.

    Water that moves with the hull adds 24 % to its mass, and the hull and what air it holds shrink with the depth:
    0.02 N/m, a little less when deep. The simulator, a right-hand side, has the dry mass and a stiff hull. Mass and drag
    are free; the drag is right.
    """
    p = {"m": 62.0, "d": 14.0, "g": 10055.0}  # kg, kg/m, N/m3

    def nom(t, x, u, p, sink=0.0, added=0.0):  # depth, speed downwards; volume of the bladder over trim
        w = x[1]
        return w, (sink - p["g"] * u[0] - p["d"] * w * abs(w)) / (p["m"] * (1 + added))

    def true(t, x, u, d, on):
        return nom(t, x, u, p, on[1] * 0.02 * x[0] / (1 + abs(x[0]) / 200), 0.24 * on[0])

    def plan(r):
        n = (520, 430, 600, 480)[r]
        return steps(rng, n, 2.2e-4, 4.8e-4, 18), quiet(n)

    def loop(y, row, memo):  # a size of the stroke is planned; with large ones the glider turns deeper
        large = (row[0] - 2.2e-4) / 2.6e-4
        down = memo.get("down", True)
        memo["down"] = y[0] < 18 + 22 * large and (down or y[0] < 12 - 8 * large)
        return [np.round(1e-4 - row[0] if memo["down"] else row[0], 6)]

    sim = ODESimulator(
        nom, states=["z", "w"], inputs=["bladder"], outputs=["z"], params=p, dt=1.0,
        x0=[8.0, 0.0], units={"z": "m", "w": "m/s", "bladder": "m3", "m": "kg", "d": "kg/m", "time": "s"},
    )  # fmt: skip
    data = twin(
        "sea_glider", rng, sim, true, plan, lambda r, u: [8.0, 0.0], see=lambda X, on: X[:, :1], noise=0.006, runs=4,
        scale=[1, 0.1], loop=loop, parts=["mass", "hull"],
    )  # fmt: skip
    return sim, *data, "parameter_error@m 0.24 + linear_loss@w of z, c < 0 (0.02 N/m, bends); m, d free"


# Added mass is a wrong inertia; force and drag over the mass can both be lower instead, which is the same. A hull that
# shrinks pulls down in proportion to the depth.
KW["sea_glider"] = {"free_params": ["m", "d"]}
ACCEPTED["sea_glider"] = [
    ["parameter_error@m (+)", "parameter_error@g (-) or input_gain@bladder (-), with parameter_error@d (-)"],
    [
        "linear_loss@w or @bladder of z (c of the sign that pulls down)",
        "exchange@w of z with linear_loss@w of w or parameter_error@d",
        "power_law@w of z in the sign that pulls down (exponent 0.7 to 1.2)",
    ],
]
NEAR["sea_glider"] = [
    "one of both alone, said to be partial",
    "constant_bias@w or input_bias@bladder for the hull, said to be partial",
    "a law of z at w for the hull",
    "parameter_error@d beside both",
]
WRONG["sea_glider"] = [
    "input_lag, input_delay or rate_limit@bladder said to be all",
    "a sensor effect said to be all",
    "parameter_error@d or @g said to be all",
    "bilinear or coulomb_friction@w said to be all",
]


@case
def stack_fan(rng):
    """Air-cooled fuel-cell stack of a delivery robot, degrees C, A, fan 0 to 1, samples of 2 s; trajectories alone.

    The thermistor of the stack sits in a sleeve (11 s and 3 s) and reads 1.8 K high; that of the exhaust is good. The
    simulator reads both as they are. Heat capacity and the fan's share of the cooling are free; the latter is 7 % low.
    """
    p = {"C": 2400.0, "h0": 4.0, "h1": 22.0, "Te": 9.0}

    def nom(t, x, u, p):  # J/K, W/K; 48 cells, heat by the loss of voltage
        T, e = x
        heat = 48 * u[0] * (0.35 + 0.006 * u[0])
        over = T - u[2]
        return (heat - (p["h0"] + p["h1"] * u[1]) * over) / p["C"], (u[2] + 0.62 * over - e) / p["Te"]

    def true(t, x, u, d, on):
        return *nom(t, x[:2], u, p), (x[0] - x[2]) / 11, (x[2] - x[3]) / 3

    def see(X, on):
        return np.c_[X[:, 3 if on[0] else 0] + 1.8 * on[1], X[:, 1]]

    def plan(r):
        n = (420, 340, 480)[r]
        amps, fan = steps(rng, n, 6, 40, 22), np.clip(steps(rng, n, 0.1, 1.0, 18), 0, 1)
        outside = 25 + 1.5 * coloured(rng, n, 0.99)
        return np.c_[np.round(amps, 1), np.round(fan, 2), np.round(outside, 1)], quiet(n)

    sim = CallableSimulator(
        tool(nom, [25.0, 25.0], 2.0, 2, lambda X, p: X), inputs=["amps", "fan", "outside"], outputs=["stack", "exhaust"],
        params=dict(p, h1=0.93 * p["h1"]), dt=2.0,
    )  # fmt: skip
    data = twin(
        "stack_fan", rng, sim, true, plan, lambda r, u: [25.0] * 4, see=see, noise=[0.012, 0.015], runs=3, scale=10,
        parts=["sleeve", "offset"],
    )  # fmt: skip
    return sim, *data, "sensor_lag@stack 14 s (11 and 3) + sensor_bias@stack 1.8 K, simulate only; h1 free, 7 % low"


# The exhaust is read rightly and depends on the same temperature, so the place is this one sensor. The second lag of
# 3 s may be named as a delay of this sensor.
KW["stack_fan"] = {"free_params": ["C", "h1"]}
ACCEPTED["stack_fan"] = [
    ["sensor_lag@stack", "sensor_lag@stack with sensor_delay@stack"],
    ["sensor_bias@stack (+)"],
    ["parameter_error@h1 (+)", "(not needed)"],
]
NEAR["stack_fan"] = [
    "one of both alone, said to be partial",
    "sensor_delay@stack for the sleeve, said to be partial",
    "sensor_gain or sensor_coupling@stack for the offset, said to be partial",
]
WRONG["stack_fan"] = [
    "input_bias@outside or input_lag said to be all",
    "any name at exhaust said to be all",
    "sensor_drift@stack, or parameter_error@C said to be all",
    "sensor_gain@stack said to be all",
]


# ------------------------------------------------------------------------------------------ of no entry


@case
def excavator_swing(rng):
    """Swing drive of an excavator, rad/s and Pa of load pressure, joystick -1 to 1, samples of 50 ms.

    Relief valves open on both sides of the motor at 11 MPa, with a slope and a bend of 0.4 MPa. The simulator, a
    right-hand side, has none. The leakage of the motor is free and 10 % low.
    """
    p = {"J": 6e4, "D": 2.4e-3, "b": 2500.0, "q": 2.2e-3, "stiff": 8e11, "cl": 4e-12}

    def nom(t, x, u, p, spill=0.0):  # kg m2, m3/rad, N m s, m3/s, Pa/m3, m3/(Pa s)
        w, P = x
        return (p["D"] * P - p["b"] * w) / p["J"], p["stiff"] * (p["q"] * u[0] - p["D"] * w - p["cl"] * P - spill)

    def true(t, x, u, d, on):
        over = kink(x[1] - 1.1e7, 4e5) - kink(-x[1] - 1.1e7, 4e5)
        return nom(t, x, u, p, on[0] * 4e-10 * over)

    def plan(r):
        n = (420, 360, 480)[r]
        stick, soft = steps(rng, n, -0.95, 0.95, 32), np.zeros(n)
        for k in range(1, n):  # a hand that takes a second
            soft[k] = soft[k - 1] + 0.09 * (stick[k] - soft[k - 1])
        return np.round(soft, 3), quiet(n)

    sim = ODESimulator(
        nom, states=["w", "P"], inputs=["stick"], outputs=["w", "P"], params=dict(p, cl=0.9 * p["cl"]), dt=0.05,
        units={"w": "rad/s", "P": "Pa", "J": "kg m2", "D": "m3/rad", "q": "m3/s", "time": "s"},
    )  # fmt: skip
    data = twin(
        "excavator_swing", rng, sim, true, plan, lambda r, u: [0, 0], see=lambda X, on: X, noise=0.015, runs=3,
        scale=[0.1, 1e6],
    )  # fmt: skip
    return sim, *data, "unknown at P (relief on both sides from 11 MPa on); cl free, 10 % low"


# An end stop of the catalogue has one side; a relief on both has no name. An end stop said to be partial is right for
# one of the two valves. The flow of the stick enters this balance alone.
KW["excavator_swing"] = {"free_params": ["cl"]}
ACCEPTED["excavator_swing"] = [
    [
        "unknown with a law of P at P or @stick",
        "end_stop@P or @stick of P, said to be partial",
        "unknown",
    ],
    ["parameter_error@cl (+)", "(not needed)"],
]
NEAR["excavator_swing"] = [
    "cubic_stiffness or power_law@P or @stick of P (odd, exponent of at least 2.5)",
    "state_saturation@P or sensor_saturation@P, said to be partial",
    "parameter_dependence@cl on P, linear_loss@P of P or parameter_error@cl (+), said to be partial",
]
WRONG["excavator_swing"] = [
    "input_saturation, rate_limit or input_lag@stick said to be all",
    "any name at w said to be all",
    "parameter_error@cl or @stiff, or state_saturation@P said to be all",
]


@case
def genset_deadband(rng):
    """Two gensets of an island in droop, frequency over 50 Hz and power in shares, samples of 0.1 s.

    Their governors do not act within 0.06 Hz to each side, with a rounded edge (0.015 Hz). The simulator, a right-hand
    side, has the droop alone. The position of the rack is not measured. The damping of the loads is free and right.
    """
    p = {"H": 2.5, "D": 1.2, "droop": 0.04, "Tg": 0.25, "Tt": 0.5}

    def nom(t, x, u, p, dead=0.0):  # Hz, shares of the rating; load and set point in shares
        f, rack, power = x
        return (
            (power - u[0] - p["D"] * f / 50) * 50 / (2 * p["H"]),
            (u[1] - (f - dead) / (50 * p["droop"]) - rack) / p["Tg"],
            (rack - power) / p["Tt"],
        )

    def true(t, x, u, d, on):
        acts = kink(x[0] - 0.06, 0.015) - kink(-x[0] - 0.06, 0.015)
        return nom(t, x, u, p, on[0] * (x[0] - acts))

    def plan(r):
        n = (500, 420, 560)[r]
        load = 0.55 + steps(rng, n, -0.09, 0.09, 40) + 0.006 * coloured(rng, n, 0.95)
        aim = 0.55 + steps(rng, n, -0.02, 0.02, 120)
        return np.round(np.c_[led_in(load), led_in(aim)], 4), quiet(n)

    def start(r, u):
        f = 50 * p["droop"] * (u[1] - u[0]) / (1 + p["droop"] * p["D"])
        return [f, u[0], u[0] + p["D"] * f / 50]

    sim = ODESimulator(
        nom, states=["f", "rack", "power"], inputs=["load", "aim"], outputs=["f", "power"], params=p, dt=0.1,
        x0=[0.0, 0.55, 0.55], units={"f": "Hz", "time": "s"},
    )  # fmt: skip
    data = twin(
        "genset_deadband", rng, sim, true, plan, start, see=lambda X, on: X[:, [0, 2]], noise=0.02, runs=3, scale=0.1
    )
    return sim, *data, "unknown at rack (a dead band of 0.06 Hz in the droop); D free, right"


# The governor's input is a state, so the dead zone of an input does not apply. What is missing is a straight line
# within the band and constant beyond it, with the sign opposite to a friction: a law of f at the rack (or at its port,
# the set point).
KW["genset_deadband"] = {"free_params": ["D"]}
ACCEPTED["genset_deadband"] = [["unknown with a law of f at rack or @aim", "unknown"]]
NEAR["genset_deadband"] = [
    "parameter_error@droop (+) or linear_loss@rack or @aim of f (c < 0), said to be partial",
    "parameter_dependence@droop on f, said to be partial",
    "a friction@rack or @aim of f with a negative level, said to be partial",
]
WRONG["genset_deadband"] = [
    "parameter_error@droop, @H or @D, or linear_loss said to be all",
    "input_dead_zone@load or input_backlash@aim or @load said to be all",
    "input_lag or input_delay said to be all",
    "a sensor effect said to be all",
]


# ------------------------------------------------------------------------------------------ no effect


@case
def none_ebus(rng):
    """Electric bus on its line, m/s and N, slope from the map, head wind from a mast, samples of 1 s; nothing is missing.

    Parameters that are free: the mass 11 % low (passengers), the rolling resistance 14 % high. The simulator is a
    right-hand side.
    """
    p = {"m": 15500.0, "roll": 0.0095, "drag": 3.6}

    def nom(t, x, u, p):  # m/s; N, slope, m/s
        air = x[0] + u[2]
        v = (u[0] - p["drag"] * air * abs(air)) / p["m"] - 9.81 * (p["roll"] * np.tanh(x[0] / 0.2) + u[1])
        return (v / 1.05,)

    def true(t, x, u, d, on):
        return nom(t, x, u, p)

    def plan(r):
        n = (380, 300, 440)[r]
        slope = np.round(0.014 * sines(rng, n, 1.0, 1.0, 0.003, 0.02, 4), 3)
        wind = np.round(2 + 1.5 * r + 1.2 * coloured(rng, n, 0.95), 1)
        return np.c_[np.clip(steps(rng, n, 3, 17, 26), 4, 16), slope, wind], quiet(n)

    def loop(y, row, memo):  # the driver
        memo["F"] = memo.get("F", 0.0) + np.clip(4500 * (row[0] - y[0]) - memo.get("F", 0.0), -6000, 6000)
        return [np.round(np.clip(memo["F"], -24000, 21000), -1), row[1], row[2]]

    sim = ODESimulator(
        nom, states=["v"], inputs=["force", "slope", "wind"], outputs=["v"],
        params=dict(p, m=0.89 * p["m"], roll=1.14 * p["roll"]), dt=1.0, x0=[8.0],
        units={"v": "m/s", "force": "N", "wind": "m/s", "m": "kg", "drag": "kg/m", "time": "s"},
    )  # fmt: skip
    data = twin(
        "none_ebus", rng, sim, true, plan, lambda r, u: [rng.uniform(6, 11)], see=lambda X, on: X, noise=0.012, runs=3,
        scale=10, loop=loop,
    )  # fmt: skip
    return sim, *data, "none (mass and rolling resistance free, 11 % low and 14 % high)"


# Nothing but what the user has freed.
KW["none_ebus"] = {"free_params": ["m", "roll"]}
ACCEPTED["none_ebus"] = [["parameter_error@m (+)", "(not needed)"], ["parameter_error@roll (-)", "(not needed)"]]
NEAR["none_ebus"] = []
WRONG["none_ebus"] = ["any name but parameter_error@m and @roll"]


@case
def none_ropeway(rng):
    """Drive of a ropeway, rope in m/s and armature in A, volts and load of the cabins, samples of 0.5 s; nothing is missing.

    The wind at the cabins wanders (0.8 kN, 0.99 from row to row). The simulator is a step in Python. The friction of the
    bullwheels is free and right.
    """
    p = {"M": 48000.0, "b": 2600.0, "k": 60.0, "R": 0.09, "L": 0.05}

    def nom(t, x, u, p, wind=0.0):  # kg, N s/m, N/A; V, N of uneven cabins
        v, i = x
        return (p["k"] * i - p["b"] * v - u[1] - wind) / p["M"], (u[0] - p["k"] * v - p["R"] * i) / p["L"]

    def true(t, x, u, d, on):
        return nom(t, x, u, p, d[0])

    def plan(r):
        n = (420, 360, 500)[r]
        volts = 300 + steps(rng, n, -110, 90, 45)
        cabins = 7000 * sines(rng, n, 0.5, 1.0, 0.004, 0.05, 6)
        return np.c_[led_in(np.round(volts, 1)), np.round(cabins, -1)], 800 * coloured(rng, n, 0.99)

    def start(r, u):
        v = (p["k"] * u[0] / p["R"] - u[1]) / (p["b"] + p["k"] ** 2 / p["R"])
        return [v * rng.uniform(0.95, 1.0), (u[0] - p["k"] * v) / p["R"]]

    sim = StepSimulator(
        rk4(nom, 4), states=["v", "i"], inputs=["volts", "cabins"], outputs=["v", "i"], params=p, dt=0.5,
        x0=[5.0, 200.0], units={"v": "m/s", "i": "A", "volts": "V", "cabins": "N", "M": "kg", "time": "s"},
    )  # fmt: skip
    data = twin(
        "none_ropeway", rng, sim, true, plan, start, see=lambda X, on: X, noise=[0.01, 0.015], runs=3, scale=[1, 100]
    )
    return sim, *data, "none (a wind that wanders); b free, right"


# The wind does not repeat from run to run, and no signal tells of it.
KW["none_ropeway"] = {"free_params": ["b"]}
ACCEPTED["none_ropeway"] = [[]]
NEAR["none_ropeway"] = [
    "unknown or partial with a disturbance at v and no name",
    "parameter_error@b of less than 6 %",
]
WRONG["none_ropeway"] = ["any other name", "a law of signals said to be certain"]


if __name__ == "__main__":
    main(ACCEPTED, 101)
