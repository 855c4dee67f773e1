"""Twelve simulated twins of ships, ports and offshore works: crane, ROV, engine, buoy, ballast, desalination, fish farm, quay.

Seven plants have one effect in the form of nature or hardware, four of them beside a free parameter that is 4 to 8 % off,
two have two at different places, one has one of no entry of the catalogue, and two have none. One simulator is a model
of MuJoCo, one steps; three records are of closed loops.
``ACCEPTED``, ``NEAR`` and ``WRONG`` are as in ``physical_plants_trades``; all were fixed by engineering judgement before any
diagnosis, and a comment above them gives the reason. "(not needed)" marks a name that may be missing. ``NOISE`` and
``CHECK`` are those of ``physical_plants_service``, as are the helpers.

    python tests/benchmarks/physical_plants_coast.py [NAME ...] [--seed 151]

prints sizes over the noise: of the gap, of all effects, and of each of two effects.
"""

import numpy as np
from physical_plants import KW, case, sines, steps
from physical_plants_messy import pi
from physical_plants_robots import rig
from physical_plants_service import CHECK, NOISE, main, twin  # noqa: F401
from physical_plants_si import coloured, kink
from physical_plants_trades import led_in, quiet, rk4

from sksurrogate.physics import MuJoCoSimulator, ODESimulator, StepSimulator

ACCEPTED, NEAR, WRONG = {}, {}, {}
DRY = ("coulomb", "asymmetric", "stribeck", "lugre")


# ------------------------------------------------------------------------------------------ one effect


@case
def heave_compensator(rng):
    """Passive heave compensator above a load of 12 t under water, stroke in m, samples of 0.1 s, three sea states.

    The piston's seals rub: 1.6 kN that go with the gas pressure, 1.2 kN more at a crawl (exponential, 0.05 m/s), and they
    lose 15 % as they warm up (20 s); smooth within 8 mm/s. The simulator, a right-hand side, has the gas spring and the
    oil's damping. The speed is not measured. The exponent of the gas is free and right.
    """
    p = {"m": 12000.0, "L": 18.0, "n": 1.3, "c": 5000.0}

    def nom(t, x, u, p, rub=0.0):  # m, m/s; m/s2 of the crane's tip, gas let in as a share of the load
        gas = (1 + u[1]) * (p["L"] / (p["L"] - x[0])) ** p["n"]
        return x[1], u[0] - 9.81 * (gas - 1) - (p["c"] * x[1] + rub) / p["m"]

    def true(t, x, u, d, on):
        gas = (1 + u[1]) * (p["L"] / (p["L"] - x[0])) ** p["n"]
        level = (1600 * gas + 1200 * np.exp(-abs(x[1]) / 0.05)) * (0.85 + 0.15 * np.exp(-t / 20))
        return nom(t, x, u, p, on[0] * level * np.tanh(x[1] / 0.008))

    def plan(r):
        n = (620, 540, 480)[r]
        sea = sines(rng, n, 0.1, 0.2 + 0.1 * r, 0.07, 0.17, 8) * np.minimum(1, np.arange(n) / 50)
        return np.c_[np.round(sea, 3), np.round(led_in(steps(rng, n, -0.04, 0.04, 110), 40), 3)], quiet(n)

    sim = ODESimulator(
        nom, states=["stroke", "v"], inputs=["tip", "trim"], outputs=["stroke"], params=p, dt=0.1,
        units={"stroke": "m", "v": "m/s", "tip": "m/s2", "m": "kg", "L": "m", "time": "s"},
    )  # fmt: skip
    data = twin(
        "heave_compensator", rng, sim, true, plan, lambda r, u: [-u[1] * 18 / 1.3, 0], see=lambda X, on: X[:, :1],
        noise=0.015, runs=3, scale=[1, 1], grid=0.002,
    )  # fmt: skip
    return sim, *data, "stribeck_friction@v of v 0.13 to 0.23 m/s2 (goes with the gas, warms up); n free, right"


# Dry friction with a little more at a crawl. The tip's acceleration enters this balance alone, so that its port is the
# same place. Gas and warmth change the level by a fifth, which may be left over.
KW["heave_compensator"] = {"free_params": ["n"]}
ACCEPTED["heave_compensator"] = [[f"{a}_friction@v or @tip of v" for a in DRY]]
NEAR["heave_compensator"] = [
    "hysteresis@v of stroke",
    "power_law@v of v (exponent at most 0.4)",
    "load_friction@tip or @trim of v, said to be partial",
    "linear_loss@v of v or parameter_error@c (+), said to be partial",
]
WRONG["heave_compensator"] = [
    "parameter_error@n, @c, @m or @L, or linear_loss@v said to be all",
    "quadratic_drag@v said to be all",
    "input_dead_zone, input_backlash or input_gain@tip said to be all",
    "a sensor effect",
]


@case
def marine_governor(rng):
    """Slow two-stroke engine with a controllable propeller, rad/s, rack and pitch 0 to 1, samples of 0.1 s; closed loop.

    A rack that has moved acts at the next cylinder that fires, and its pressure a fifth of a turn later: 0.05 s and a
    quarter of a turn, 0.2 s at full speed and 0.31 s at 6 rad/s. The simulator, a right-hand side, has torque behind
    a known lag alone. The governor is not known. The sea turns the propeller's torque by 0.15 %. Its constant is free
    and 4 % low.
    """
    p = {"J": 9e4, "kM": 8e5, "T": 0.25, "kq": 6000.0}

    def nom(t, x, u, p, sea=0.0):  # rad/s, N m
        load = p["kq"] * (0.2 + u[1]) * x[0] * abs(x[0])
        return (x[1] - load * (1 + sea)) / p["J"], (p["kM"] * u[0] - x[1]) / p["T"]

    def true(t, x, u, d, on):
        return [*nom(t, x[:2], [x[2] if on[0] else u[0], u[1]], p, d[0]), *np.zeros(21)]

    def tick(x, u, d, on):  # racks of the last ticks of 25 ms, and the one that burns now
        line = np.r_[u[0], x[3:-1]]
        late = 0.05 + 0.5 * np.pi / max(x[0], 4.0)
        return np.r_[x[:2], np.interp(late / 0.025, np.arange(20), line), line]

    def plan(r):
        n = (560, 480, 620)[r]
        pitch, aim = np.clip(steps(rng, n, 0.35, 0.85, 45), 0, 1), steps(rng, n, 6.5, 10.2, 70)
        pitch[:12], aim[:12] = 0.6, 8
        for k in range(1, n):  # pitch servo
            pitch[k] = pitch[k - 1] + np.clip(pitch[k] - pitch[k - 1], -0.03, 0.03)
        return np.c_[aim, np.round(pitch, 3)], 0.0015 * coloured(rng, n, 0.95)

    def loop(y, row, memo):
        memo.setdefault("I", 0.384)
        return [np.round(pi(row[0] - y[0], memo, 0.16, 0.012, 0.06, 1.0), 3), row[1]]

    sim = ODESimulator(
        nom, states=["w", "M"], inputs=["rack", "pitch"], outputs=["w"], params=dict(p, kq=0.96 * p["kq"]), dt=0.1,
        x0=[8.0, 3.072e5], units={"w": "rad/s", "M": "N m", "J": "kg m2", "kM": "N m", "T": "s", "time": "s"},
    )  # fmt: skip
    data = twin(
        "marine_governor", rng, sim, true, plan, lambda r, u: [8, 3.072e5, *np.full(21, 0.384)],
        see=lambda X, on: X[:, :1], noise=0.012, runs=3, scale=[10, 1e5] + [1] * 21, loop=loop, tick=tick,
    )  # fmt: skip
    return sim, *data, "input_delay@rack 0.24 s (0.2 to 0.31 by the speed); kq free, 4 % low"


# The pitch acts at once, so neither the tachometer is late nor all inputs. Wait and known lag follow one another; 0.24 s
# named as a delay with a small lag, or as a delay with another T, is as right. What the speed does to the wait is left over
# (two to three times the noise).
KW["marine_governor"] = {"free_params": ["kq"]}
ACCEPTED["marine_governor"] = [
    [
        "input_delay@rack (0.15 to 0.32 s)",
        "input_delay@rack with input_lag@rack (at most 0.2 s) or parameter_error@T",
    ],
    ["parameter_error@kq (+)", "(not needed)"],
]
NEAR["marine_governor"] = [
    "input_lag@rack or parameter_error@T (+), said to be partial",
    "input_delay@rack with rate_limit@rack or with parameter_error@J",
    "parameter_dependence@T on w, or a law of w, beside input_delay@rack",
    "a law of the past of rack",
]
WRONG["marine_governor"] = [
    "input_lag or rate_limit@rack, or parameter_error@T said to be all",
    "sensor_delay or sensor_lag@w said to be all",
    "any name at pitch said to be all",
    "parameter_error@J, @kM or @kq said to be all",
]


@case
def wave_buoy(rng):
    """Heave of a wave-energy buoy of 5 m, m and kN, samples of 0.2 s, generator as a damper that is reset at times.

    The waves that the buoy radiates come back on it: the force remembers the speed as 20 exp(-0.8 t) cos(1.3 t) kN/m. The
    simulator, a right-hand side, has added mass and the skeg's drag. The wave force comes from a buoy upstream. The
    speed is not measured. The drag is free and right.
    """
    p = {"m": 60.0, "K": 197.0, "b": 6.0}

    def nom(t, x, u, p, waves=0.0):  # t, kN/m, kN s/m
        return x[1], (u[0] - u[1] - p["K"] * x[0] - p["b"] * x[1] - waves) / p["m"]

    def true(t, x, u, d, on):
        return *nom(t, x[:2], u, p, on[0] * 20 * x[2]), x[1] - 0.8 * x[2] - 1.3 * x[3], 1.3 * x[2] - 0.8 * x[3]

    def plan(r):
        n = (640, 560, 480)[r]
        wave = sines(rng, n, 0.2, 30 + 12 * r, 0.11, 0.42, 9) + 4 * coloured(rng, n, 0.8)
        return np.c_[np.round(wave * np.minimum(1, np.arange(n) / 40), 1), steps(rng, n, 2, 26, 60)], quiet(n)

    def loop(y, row, memo):
        was = memo.get("z", y[0])
        memo["z"] = y[0]
        memo["v"] = 0.5 * memo.get("v", 0.0) + 0.5 * (y[0] - was) / 0.2
        return [row[0], np.round(row[1] * memo["v"], 1)]

    sim = ODESimulator(
        nom, states=["z", "v"], inputs=["wave", "generator"], outputs=["z"], params=p, dt=0.2,
        units={"z": "m", "v": "m/s", "wave": "kN", "generator": "kN", "m": "t", "K": "kN/m", "time": "s"},
    )  # fmt: skip
    data = twin(
        "wave_buoy", rng, sim, true, plan, lambda r, u: np.zeros(4), see=lambda X, on: X[:, :1], noise=0.02, runs=3,
        scale=[1, 1, 1, 1], loop=loop,
    )  # fmt: skip
    return (
        sim,
        *data,
        "hidden_mode or hidden_relaxation@v of z (radiated waves: 20 exp(-0.8 t) cos(1.3 t)); b free, right",
    )


# A force that remembers the speed for a second and turns its sign: both forms with a hidden part have such a memory when
# the position drives them (the mode with damping near 0.5). Two of them, or one with a part of the drag, are as right.
# More drag alone fits one frequency only. Wave and generator enter this balance alone.
KW["wave_buoy"] = {"free_params": ["b"]}
ACCEPTED["wave_buoy"] = [
    [
        "hidden_mode@v (or @wave, @generator) of z or v",
        "hidden_relaxation@v (or @wave, @generator) of z or v",
        "hidden_mode or hidden_relaxation with linear_loss@v, cubic_stiffness@v or parameter_error@b, @K or @m",
        "a law of the past of v or z at v, unknown or partial",
    ],
    ["parameter_error@b", "(not needed)"],
]
NEAR["wave_buoy"] = [
    "linear_loss@v of v or parameter_error@b (+), said to be partial",
    "parameter_error@K or @m with linear_loss@v or parameter_error@b (+)",
    "unknown with no law",
]
WRONG["wave_buoy"] = [
    "linear_loss@v, quadratic_drag@v or parameter_error@b said to be all",
    "a friction with a level, said to be all",
    "input_lag, input_delay or input_gain@wave or @generator said to be all",
    "a sensor effect said to be all",
]


@case
def ballast_transfer(rng):
    """Two wing tanks of a heavy-lift ship and the pump between them, m and m3/s, samples of 2 s; levels are measured.

    Bends and valves of the pipe take a head that goes with power 1.85 of the flow (23 kPa at 0.15 m3/s), beside the loss
    in proportion. The simulator, a right-hand side of four states, has the latter alone. Flow and pump speed are not
    measured; the inclinometer is. The loss in proportion is free and right.
    """
    p = {"A": 60.0, "L": 1.4e6, "P": 6e4, "R": 1.9e5, "T": 5.0, "arm": 24.0}

    def nom(t, x, u, p, bends=0.0):  # m, m, m3/s to starboard, share of the speed; command, heel in rad
        head = 10055 * (x[0] - x[1] + p["arm"] * u[1]) + p["P"] * x[3] * abs(x[3])
        return -x[2] / p["A"], x[2] / p["A"], (head - p["R"] * x[2] - bends) / p["L"], (u[0] - x[3]) / p["T"]

    def true(t, x, u, d, on):
        return nom(t, x, u, p, on[0] * 7.7e5 * x[2] * (x[2] * x[2] + 1e-5) ** 0.425)

    def plan(r):
        n = (700, 620, 560, 480)[r]
        command = steps(rng, n, -1, 1, 70)
        heel = 0.012 * coloured(rng, n, 0.995) + steps(rng, n, -0.015, 0.015, 130)
        command[:6] = 0
        return np.c_[np.round(command, 2), np.round(led_in(heel), 4)], quiet(n)

    sim = ODESimulator(
        nom, states=["port", "starboard", "q", "speed"], inputs=["command", "heel"], outputs=["port", "starboard"],
        params=p, dt=2.0, x0=[4.0, 4.0, 0.0, 0.0],
        units={"port": "m", "starboard": "m", "q": "m3/s", "A": "m2", "P": "Pa", "heel": "rad", "T": "s", "time": "s"},
    )  # fmt: skip

    def start(r, u):
        level = rng.uniform(-0.6, 0.6)
        return [4.2 + level, 4.2 - level, 0.0, 0.0]

    data = twin(
        "ballast_transfer", rng, sim, true, plan, start, see=lambda X, on: X[:, :2], noise=0.012, runs=4,
        scale=[1, 1, 0.1, 1],
    )  # fmt: skip
    return sim, *data, "quadratic_drag or power_law@q of q (power 1.85); R free, right; two of four states measured"


# The loss turns with the flow, and the flow is the same at both tanks. Command and heel act through it, so an end of the
# pump's torque or another gain is not the same: heads of the tanks drive the flow as well. Power 1.85 is a square
# within a few percent, with a small part of R.
KW["ballast_transfer"] = {"free_params": ["R"]}
ACCEPTED["ballast_transfer"] = [
    ["quadratic_drag@q of q", "power_law@q of q (exponent 1.3 to 2.6)"],
    ["parameter_error@R", "(not needed)"],
]
NEAR["ballast_transfer"] = [
    "cubic_stiffness@q of q",
    "parameter_error@R (+) or linear_loss@q of q, said to be partial",
    "a law of q at q",
    "quadratic_drag or power_law@heel of q",
]
WRONG["ballast_transfer"] = [
    "parameter_error@R, @P, @A, @L or @T, or linear_loss@q said to be all",
    "input_gain, input_saturation, input_curve or input_lag@command said to be all",
    "a friction with a level, or sqrt_leak, said to be all",
    "a sensor effect said to be all",
]


@case
def tidal_generator(rng):
    """Tidal turbine with a permanent-magnet generator and no gear, rad/s and degrees C, samples of 5 s, steps of current.

    The magnets weaken by 0.15 % per kelvin and follow the winding with 2 min, so that the torque of an ampere falls. The
    simulator, a right-hand side, has it as at 20 degrees. Eddies that the profiler does not see push (0.2 %). The
    resistance of the winding is free and 6 % low.
    """
    p = {"J": 4e5, "a": 6e4, "b": 4.5e4, "kt": 320.0, "C": 1e5, "R": 0.08, "h": 120.0}

    def nom(t, x, u, p, weak=0.0, eddy=0.0):  # N m, A, m/s, W/K; water in degrees C
        w, T = x
        rotor = p["a"] * u[0] * u[0] * (1 + eddy) - p["b"] * u[0] * w
        heat = p["R"] * (1 + 0.0039 * (T - 20)) * u[1] * u[1]
        return (rotor - p["kt"] * (1 - weak) * u[1]) / p["J"], (heat - p["h"] * (T - u[2])) / p["C"]

    def true(t, x, u, d, on):
        return *nom(t, x[:2], u, p, on[0] * 0.0015 * (x[2] - 20), d[0]), (x[1] - x[2]) / 120

    def plan(r):
        n = (720, 600, 660)[r]
        stream = 2.15 + 0.3 * np.sin(np.arange(n) / 330 + 2 * r) + 0.12 * coloured(rng, n, 0.9)
        current = steps(rng, n, 120, 370, 90) + 15 * coloured(rng, n, 0.9)
        water = np.full(n, 8.0) + 1.5 * r + 0.2 * coloured(rng, n, 0.995)
        return np.c_[np.round(led_in(stream), 2), np.round(led_in(current)), np.round(water, 1)], 0.002 * coloured(
            rng, n, 0.8
        )

    sim = ODESimulator(
        nom, states=["w", "T"], inputs=["stream", "current", "water"], outputs=["w", "T"],
        params=dict(p, R=0.94 * p["R"]), dt=5.0, x0=[1.7, 30.0],
        units={"w": "rad/s", "T": "degC", "stream": "m/s", "current": "A", "water": "degC", "kt": "N m/A", "time": "s"},
    )  # fmt: skip

    def start(r, u):
        T = rng.uniform(20, 45)
        return [(p["a"] * u[0] ** 2 - p["kt"] * u[1]) / (p["b"] * u[0]), T, T]

    data = twin(
        "tidal_generator", rng, sim, true, plan, start, see=lambda X, on: X[:, :2], noise=[0.012, 0.012], runs=3,
        scale=[1, 10, 10],
    )  # fmt: skip
    return sim, *data, "parameter_dependence@kt on T (-0.15 %/K from 20 degrees, lag of 2 min); R free, 6 % low"


# A constant that goes with the temperature. As a term it is a product of current and T; a gain of the current's torque is
# half of it, and the current heats as well, so that a wrong gauge of it would show in T.
KW["tidal_generator"] = {"free_params": ["R"]}
ACCEPTED["tidal_generator"] = [
    [
        "parameter_dependence@kt on T (-)",
        "bilinear@w of T and current (+), alone or with parameter_error@kt",
        "a law of T (and its past) at kt, or of T and current at w",
    ],
    ["parameter_error@R (+)", "(not needed)"],
]
NEAR["tidal_generator"] = [
    "parameter_error@kt (-) or linear_loss@w of current or T, said to be partial",
    "power_law@w of a product with current",
    "parameter_drift@kt (-), said to be partial",
    "parameter_dependence@kt on current",
]
WRONG["tidal_generator"] = [
    "input_gain, input_bias or input_curve@current said to be all",
    "parameter_error@kt, @a or @b said to be all",
    "input_gain or input_curve@stream said to be all",
    "a sensor effect said to be all",
    "any name at T said to be all",
]


DECK_CRANE = """<mujoco><option timestep="0.01" integrator="RK4"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody><body name="jib" pos="0 0 14">
<joint name="slew" axis="0 0 1" damping="20000"/>
<geom type="capsule" size="0.3" fromto="0 0 0 12 0 0" mass="3000"/><body name="load" pos="12 0 0">
<joint name="swing" axis="1 0 0" damping="2500"/><geom type="capsule" size="0.03" fromto="0 0 0 0 0 -6" mass="60"/>
<geom type="sphere" size="0.6" pos="0 0 -6.5" mass="2000"/></body></body></worldbody>
<actuator><position name="drive" joint="slew" kp="400000" kv="350000"/></actuator></mujoco>"""


@case
def deck_crane(rng):
    """Slewing crane on a pier with a load that swings sideways, two joints, angles, samples of 0.1 s.

    A rubber buffer stands in the way from 0.62 rad on: 1.1 MN m at 1 rad, power 1.35 of how far it is pressed, and a
    tenth of it by the rate. The simulator is a model of MuJoCo without it. The load's mass is free and 5 % high.
    """

    def act(m, d, u, z, on):
        e = max(d.qpos[0] - 0.62, 0.0)
        return [-on[0] * 1.1e6 * e**1.35 * max(1 + 0.1 * d.qvel[0] / 0.1, 0), 0], u(), z

    def lighter(m, on):
        m.body_mass[2] /= 1.05
        m.body_inertia[2] /= 1.05

    sim = MuJoCoSimulator(
        DECK_CRANE, outputs=["slew.pos", "swing.pos"], params=["slew.damping", "swing.damping", "load.mass"], dt=0.1
    )
    made, begins = [], []
    for r in range(4):
        n = (420, 380, 360, 400)[r]
        aim = np.clip(steps(rng, n, -0.5, 1.1, 55), -0.5, 0.95)
        aim[:10] = aim[0] = 0.1 * r
        for k in range(1, n):  # the lever's ramp
            aim[k] = aim[k - 1] + np.clip(aim[k] - aim[k - 1], -0.025, 0.025)
        made.append(np.round(aim + 0.01 * coloured(rng, n, 0.9), 3)[:, None])
        begins.append(np.array([0.1 * r, rng.uniform(-0.05, 0.05), 0, 0]))
    data = rig("deck_crane", rng, sim, made, begins, act, 0.015, finer=0.002, change=lighter)
    return sim, *data, "end_stop@slew of slew.pos at 0.62 rad (power 1.35, some damping); load.mass free, 5 % high"


# One side only, from an angle on. The drive is a servo, so its input over kp is the same port. A limit of the command
# looks alike at rest, but the jib still comes further with the swing of the load.
KW["deck_crane"] = {"free_params": ["load.mass"]}
ACCEPTED["deck_crane"] = [
    ["end_stop@slew or @drive of slew.pos (edge 0.55 to 0.75 rad)"],
    ["parameter_error@load.mass (-)", "(not needed)"],
]
NEAR["deck_crane"] = [
    "cubic_stiffness@slew of slew.pos, said to be partial",
    "input_saturation@drive with end_stop, or said to be partial",
    "an unknown law of slew.pos at slew with a one-sided shape",
    "end_stop@slew with linear_loss, quadratic_drag or a friction@slew",
]
WRONG["deck_crane"] = [
    "input_saturation@drive, sensor_saturation@slew.pos or state_saturation said to be all",
    "parameter_error@load.mass or @slew.damping said to be all",
    "any name at swing said to be all",
    "a friction or input_backlash said to be all",
]


@case
def rov_thruster(rng):
    """Surge and yaw of an inspection ROV with two thrusters, joystick -1 to 1, m/s and rad/s, samples of 0.1 s.

    The magnetic coupling of the port thruster does not turn below 0.09 of the command, and what is above acts less that
    much; it bends within 0.012. Its controller has steps of 1/200. The tether, which no one knows, pulls by 1.5 N. The
    simulator, a right-hand side, has two alike. Speeds from Doppler log and gyro. The yaw's damping is free and 8 % low.
    """
    p = {"m": 750.0, "I": 120.0, "F": 200.0, "T": 0.18, "d1": 150.0, "d2": 180.0, "r1": 60.0, "r2": 90.0, "arm": 0.35}

    def nom(t, x, u, p, tether=0.0):  # m/s, rad/s, thrust of each in N
        v, r, a, b = x
        return (
            (a + b - p["d1"] * v - p["d2"] * v * abs(v) + tether) / p["m"],
            (p["arm"] * (a - b) - p["r1"] * r - p["r2"] * r * abs(r)) / p["I"],
            (p["F"] * u[0] * (1 - 0.12 * abs(v)) - a) / p["T"],
            (p["F"] * u[1] * (1 - 0.12 * abs(v)) - b) / p["T"],
        )

    def true(t, x, u, d, on):
        port = np.sign(u[0]) * kink(abs(u[0]) - 0.09, 0.012) if on[0] else u[0]
        return nom(t, x, [np.round(200 * port) / 200, u[1]], p, d[0])

    def plan(r):
        n = (520, 460, 480, 420)[r]
        push, turn = steps(rng, n, -0.6, 0.7, 34), steps(rng, n, -0.3, 0.3, 22)
        port, star = (np.clip(push + s * turn, -1, 1) for s in (1, -1))
        for side in (port, star):  # hands need a third of a second
            side[:8] = 0
            side[:] = np.convolve(np.r_[np.zeros(2), side], np.ones(3) / 3, "valid")
        return np.round(np.c_[port, star], 3), 1.5 * coloured(rng, n, 0.97)

    sim = ODESimulator(
        nom, states=["v", "r", "fp", "fs"], inputs=["port", "starboard"], outputs=["v", "r"],
        params=dict(p, r1=0.92 * p["r1"]), dt=0.1,
        units={"v": "m/s", "r": "rad/s", "fp": "N", "fs": "N", "m": "kg", "F": "N", "T": "s", "time": "s"},
    )  # fmt: skip
    data = twin(
        "rov_thruster", rng, sim, true, plan, lambda r, u: np.zeros(4), see=lambda X, on: X[:, :2], noise=[0.015, 0.012],
        runs=4, scale=[1, 1, 100, 100],
    )  # fmt: skip
    return sim, *data, "input_dead_zone@port 0.09 (soft); r1 free, 8 % low"


# A dead band at one of two inputs: the same at starboard would turn the other way. A constant lack with large commands
# sets it apart from a gain.
KW["rov_thruster"] = {"free_params": ["r1"]}
ACCEPTED["rov_thruster"] = [
    ["input_dead_zone@port (0.06 to 0.12)", "coulomb_friction or asymmetric_friction@fp of fp"],
    ["parameter_error@r1 (+)", "(not needed)"],
]
NEAR["rov_thruster"] = [
    "input_dead_zone@port with a small input_gain or input_curve@port",
    "input_gain@port (-) or input_curve@port, said to be partial",
    "a law of port at port, or of fp at fp",
    "stribeck_friction or power_law@fp of fp",
]
WRONG["rov_thruster"] = [
    "any name at starboard or fs said to be all",
    "input_gain, input_bias, input_backlash or input_saturation@port said to be all",
    "a friction@v or @r, or quadratic_drag, said to be all",
    "parameter_error@F, @arm or @r1 said to be all",
    "a sensor effect said to be all",
]


# ------------------------------------------------------------------------------------------ two effects


@case
def ro_skid(rng):
    """Membranes of a desalination skid, m3/h, g/l in brine loop and permeate tank, operating log of 10 minutes.

    The membranes foul after each cleaning: their permeability falls by 6 % and levels off with 70 h. The conductivity
    cell of the tank ends at 0.325 g/l (bend of 3 mg/l). The simulator, a step in Python, has neither. The brine is not
    measured. The passage of salt is free and 5 % low.
    """
    p = {"A": 0.95, "B": 0.085, "V": 6.0, "Vt": 6.0, "Tq": 0.12, "osm": 0.75}

    def nom(t, x, u, p, foul=0.0):  # m3/h, g/l, g/l; bar, m3/h of feed, degrees C; 36 g/l in the sea
        Q, c, s = x
        pure = p["A"] * (1 - foul) * np.exp(0.027 * (u[2] - 15)) * (u[0] - p["osm"] * c)
        salt = p["B"] * c
        return (
            (pure - Q) / p["Tq"],
            (36 * u[1] - (u[1] - Q) * c - salt) / p["V"],
            (salt - Q * s) / p["Vt"],
        )

    def true(t, x, u, d, on):
        return nom(t, x, u, p, on[0] * 0.06 * (1 - np.exp(-t / 70)))

    def see(X, on):
        s = X[:, 2]
        return np.c_[X[:, 0], 0.325 - kink(0.325 - s, 0.003) if on[1] else s]

    def plan(r):
        n = (520, 460, 560)[r]
        bar = 59 + steps(rng, n, -9, 7, 20)
        feed = 44 + steps(rng, n, -5, 7, 40)
        sea = 13.5 + r + 1.2 * np.sin(np.arange(n) / 24 + r) + 0.3 * coloured(rng, n, 0.98)
        return np.round(np.c_[led_in(bar), led_in(feed), led_in(sea)], 1), quiet(n)

    sim = StepSimulator(
        rk4(nom, 6), states=["Q", "brine", "salt"], inputs=["bar", "feed", "sea"], outputs=["Q", "salt"],
        params=dict(p, B=0.95 * p["B"]), dt=1 / 6, x0=[15.5, 54.0, 0.3],
        units={"Q": "m3/h", "brine": "g/l", "salt": "g/l", "bar": "bar", "feed": "m3/h", "sea": "degC", "time": "h"},
    )  # fmt: skip

    def start(r, u):
        x = np.array([15.5, 54.0, 0.3])
        for _ in range(4000):
            x = x + 0.01 * np.array(nom(0, x, u, p))
        return x

    data = twin(
        "ro_skid", rng, sim, true, plan, start, see=see, noise=[0.015, 0.03], runs=3, scale=[10, 10, 0.1],
        parts=["fouling", "cell"],
    )  # fmt: skip
    return (
        sim,
        *data,
        "parameter_drift@A -0.05 % an hour (levels off) + sensor_saturation@salt 0.325 g/l; B free, 5 % low",
    )


# The permeability falls and takes the flow along; the brine's own answer sets it apart from the sensor of the flow. The
# cell has flat tops in one output while the flow moves on.
KW["ro_skid"] = {"free_params": ["B"]}
ACCEPTED["ro_skid"] = [
    ["parameter_drift@A (-)", "parameter_drift@A with parameter_error@A"],
    ["sensor_saturation@salt (0.31 to 0.34 g/l)"],
    ["parameter_error@B (+)", "(not needed)"],
]
NEAR["ro_skid"] = [
    "one of both alone, said to be partial",
    "parameter_error@A (-), drift@Q (-), sensor_drift@Q (-) or parameter_drift@osm (+) for the fouling",
    "state_saturation@salt for the cell",
    "sensor_nonlinearity or sensor_gain@salt (-) for the cell, said to be partial",
]
WRONG["ro_skid"] = [
    "parameter_error@A, @B or @osm said to be all",
    "input_gain, input_bias or input_saturation@bar said to be all",
    "sensor_lag@salt said to be all",
    "any name at feed or sea said to be all",
]


@case
def quay_hawsers(rng):
    """Sway of a tanker in her hawsers at a quay, laser in m and load pin of a breast line in kN, samples of 2 s.

    The water under the keel has to pass her as she sways: a drag of power 1.9 of the speed, beside the linear one. The
    pin sits 23 degrees out of the line's direction and reads 8 % low; its amplifier has 0.5 kN. The simulator, a right-hand
    side with its outputs, has neither. The speed is not measured. The linear drag is free and right.
    """
    p = {"m": 22000.0, "k": 260.0, "k3": 14.0, "b": 200.0, "F0": 150.0, "f1": 90.0, "f2": 12.0}

    def nom(t, x, u, p, keel=0.0):  # t, kN/m; wind and passing ships in kN, off the quay
        lines = p["k"] * x[0] + p["k3"] * x[0] * x[0] * x[0]
        return x[1], (u[0] + u[1] - lines - p["b"] * x[1] - keel) / p["m"]

    def line(t, x, u, p):
        return x[0], p["F0"] + p["f1"] * x[0] + p["f2"] * x[0] * x[0]

    def true(t, x, u, d, on):
        v = x[1]
        return nom(t, x, u, p, on[0] * 1900 * v * (v * v + 1e-6) ** 0.45 - d[0])

    def see(X, on):
        y, pull = line(0, X.T, None, p)
        return np.c_[y, pull * (1 - 0.08 * on[1])]

    def plan(r):
        n = (520, 420, 460, 380)[r]
        wind = np.round(steps(rng, n, -150, 320, 60) + 40 * coloured(rng, n, 0.9), -1)
        ships = np.zeros(n)
        for k in rng.integers(40, n - 60, 4):  # push, then suction
            z = (np.arange(n) - k - 20) / rng.uniform(7, 11)
            ships -= rng.uniform(120, 300) * z * np.exp(-z * z / 2)
        return np.c_[led_in(wind), np.round(led_in(ships))], 1.5 * coloured(rng, n, 0.95)

    sim = ODESimulator(
        nom, states=["y", "v"], inputs=["wind", "ships"], outputs=["y", "pull"], output=line, params=p, dt=2.0,
        units={"y": "m", "v": "m/s", "pull": "kN", "wind": "kN", "ships": "kN", "m": "t", "k": "kN/m", "time": "s"},
    )  # fmt: skip
    data = twin(
        "quay_hawsers", rng, sim, true, plan, lambda r, u: [(u[0] + u[1]) / p["k"] * 0.95, 0], see=see,
        noise=[0.015, 0.02], runs=4, scale=[1, 0.1], grid=[0.0, 0.5], parts=["keel", "pin"],
    )  # fmt: skip
    return sim, *data, "quadratic_drag@v of v (power 1.9) + sensor_gain@pull -8 %; b free, right"


# Laser and pin see the same sway, so the pin's scale is plain, its preload included. The forces enter one balance, whose
# ports are the same place.
KW["quay_hawsers"] = {"free_params": ["b"]}
ACCEPTED["quay_hawsers"] = [
    ["quadratic_drag@v (or @wind, @ships) of v", "power_law@v (or @wind, @ships) of v (exponent 1.4 to 2.6)"],
    ["sensor_gain@pull (-8 %)"],
    ["parameter_error@b", "(not needed)"],
]
NEAR["quay_hawsers"] = [
    "one of both alone, said to be partial",
    "linear_loss@v of v, cubic_stiffness@v of v or parameter_error@b (+) for the keel, said to be partial",
    "sensor_bias@pull with sensor_coupling@pull or parameter_error@f1 for the pin",
    "parameter_error@F0 (-) with parameter_error@f1 (-) for the pin",
]
WRONG["quay_hawsers"] = [
    "sensor_bias@pull, sensor_drift@pull or sensor_coupling@pull said to be all",
    "input_gain@wind or @ships said to be all",
    "a friction with a level, said to be all",
    "parameter_error@k, @k3, @b or @m said to be all",
]


# ------------------------------------------------------------------------------------------ of no entry


@case
def salmon_pen(rng):
    """Oxygen in two layers of a salmon pen, mg/l, samples of 5 minutes over the tide; current, sea, feed, diffuser.

    Fish circle in slack water and stand on the current when it runs; between both, about 0.2 m/s, the school breaks up
    and swims restlessly: a bell of 5.5 mg/l/h, 0.05 m/s wide, in the upper layer, with 3 min of delay in their minds. The
    simulator, a right-hand side, has respiration that goes with the feed alone. The exchange is free and 5 % low.
    """
    p = {"k": 55.0, "R": 8.0, "mix": 1.5}

    def nom(t, x, u, p, swim=0.0):  # mg/l, h; m/s, mg/l, share, mg/(l h)
        a, b = x
        flush = p["k"] * u[0]
        return (
            flush * (u[1] - a) - p["R"] * (1 + 0.4 * u[2]) + p["mix"] * (b - a) + u[3] - swim,
            flush * (u[1] - b) - 0.4 * p["R"] + p["mix"] * (a - b),
        )

    def true(t, x, u, d, on):
        bell = 5.5 * np.exp(-(((u[0] - 0.2) / 0.05) ** 2) / 2)
        return *nom(t, x[:2], u, p, on[0] * x[2]), (bell - x[2]) * 20

    def plan(r):
        n = (500, 420, 460)[r]
        hour = np.arange(n) / 12
        current = 0.06 + 0.32 * abs(np.sin(np.pi * hour / 6.2 + r)) + 0.025 * coloured(rng, n, 0.8)
        sea = 8.6 + 0.3 * np.sin(2 * np.pi * hour / 24 + r) + 0.1 * coloured(rng, n, 0.98)
        feed = np.where((hour % 24 > 7) & (hour % 24 < 18), steps(rng, n, 0.2, 1, 18), 0)
        blow = np.where(rng.random(n).cumsum() % 40 < 16, 4.0, 0.0)
        return np.c_[
            np.round(np.clip(current, 0.05, None), 3), np.round(sea, 2), np.round(feed, 2), blow
        ], 0.05 * coloured(rng, n, 0.9)

    sim = ODESimulator(
        nom, states=["upper", "lower"], inputs=["current", "sea", "feed", "blow"], outputs=["upper", "lower"],
        params=dict(p, k=0.95 * p["k"]), dt=1 / 12, x0=[7.3, 8.0],
        units={"upper": "mg/l", "lower": "mg/l", "current": "m/s", "sea": "mg/l", "k": "1/m", "time": "h"},
    )  # fmt: skip

    def start(r, u):
        x = np.array([7.0, 8.0])
        for _ in range(3000):
            x = x + 0.005 * np.array(nom(0, x, u, p))
        return [*x, 0.0]

    data = twin(
        "salmon_pen", rng, sim, true, plan, start, see=lambda X, on: X[:, :2], noise=0.02, runs=3, scale=[1, 1, 1],
    )  # fmt: skip
    return sim, *data, "unknown at upper (bell of current about 0.2 m/s); k free, 5 % low"


# A bell of the current has no entry: every form of the catalogue that the current can drive grows with it. The place is
# the balance of the upper layer; feed and diffuser enter that balance alone, so their ports are the same place.
KW["salmon_pen"] = {"free_params": ["k"]}
ACCEPTED["salmon_pen"] = [
    [
        "unknown or partial with a law of current at upper (or @blow, @feed), highest near 0.2 m/s and small at both ends",
        "unknown with a law of current at R",
        "unknown at upper",
    ],
    ["parameter_error@k (+)", "(not needed)"],
]
NEAR["salmon_pen"] = [
    "constant_bias@upper (-) or parameter_error@R (+), said to be partial",
    "linear_loss, quadratic_loss or power_law@upper of current, said to be partial",
    "bilinear@upper of current and another signal, said to be partial",
    "unknown with no law and another place",
]
WRONG["salmon_pen"] = [
    "any one name of the catalogue said to be all",
    "a sensor effect",
    "any name at lower or sea said to be all",
    "input_gain or input_curve@current said to be all",
]


# ------------------------------------------------------------------------------------------ no effect


@case
def none_radar_scanner(rng):
    """Turning unit of a ship's radar, rad/s and N m, samples of 50 ms, modes of its drive; nothing is missing.

    The swell rolls the ship and the scanner is not quite balanced: 0.3 N m about 0.1 Hz, never twice the same. The
    simulator is a right-hand side. The inertia is free and 8 % high, the drag of the bearing free and 5 % low.
    """
    p = {"J": 60.0, "b": 22.0, "kw": 0.5, "T": 0.1}

    def nom(t, x, u, p, swell=0.0):  # rad/s, N m; command in N m, wind in m/s
        return (x[1] - (p["b"] + p["kw"] * u[1]) * x[0] + swell) / p["J"], (u[0] - x[1]) / p["T"]

    def true(t, x, u, d, on):
        return nom(t, x, u, p, d[0])

    def plan(r):
        n = (620, 520, 560)[r]
        asked = np.round(steps(rng, n, 25, 150, 70))
        wind = np.clip(9 + 2 * r + steps(rng, n, -4, 4, 90) + coloured(rng, n, 0.95), 0, None)
        return np.c_[led_in(asked), np.round(led_in(wind), 1)], sines(rng, n, 0.05, 0.3, 0.07, 0.14, 8) * coloured(
            rng, n, 0.995
        )

    def start(r, u):
        return [u[0] / (p["b"] + p["kw"] * u[1]), u[0]]

    sim = ODESimulator(
        nom, states=["w", "M"], inputs=["torque", "wind"], outputs=["w"],
        params=dict(p, J=1.08 * p["J"], b=0.95 * p["b"]), dt=0.05, x0=[3.0, 80.0],
        units={"w": "rad/s", "M": "N m", "torque": "N m", "wind": "m/s", "J": "kg m2", "b": "N m s", "time": "s"},
    )  # fmt: skip
    data = twin(
        "none_radar_scanner",
        rng,
        sim,
        true,
        plan,
        start,
        see=lambda X, on: X[:, :1],
        noise=0.012,
        runs=3,
        scale=[1, 100],
    )
    return sim, *data, "none (swell below the noise; J and b free, 8 % high and 5 % low)"


# Nothing but what the user has freed. The swell is half of the noise and has no fixed line or phase.
KW["none_radar_scanner"] = {"free_params": ["J", "b"]}
ACCEPTED["none_radar_scanner"] = [["parameter_error@J (-)", "(not needed)"], ["parameter_error@b (+)", "(not needed)"]]
NEAR["none_radar_scanner"] = [
    "unknown or partial with a disturbance and no name",
    "periodic_disturbance@w below half of the noise beside the free parameters",
]
WRONG["none_radar_scanner"] = ["any other name", "a law of signals said to be certain"]


@case
def none_cold_store(rng):
    """Cold store of a fish auction under its thermostat, degrees C and kW, samples of a minute; nothing is missing.

    The record is messy: one row in seven is lost in bursts, the probe in the boxes is read every sixth minute, and the air
    by a display of 0.01 K. Boats unload through the door, which the log has. The simulator is a right-hand side. The
    walls' conductance is free and right.
    """
    p = {"Ca": 420.0, "Cf": 5200.0, "h": 1.1, "U": 0.22, "door": 0.9, "fan": 0.7, "cool": 16.0}

    def nom(t, x, u, p, people=0.0):  # kJ/K, kW/K, kW; time in s; compressor share, door 0 to 1, outside in degrees C
        a, f = x
        cold = p["cool"] * u[0] * (1 + 0.02 * (a + 2))
        walls = (p["U"] + p["door"] * u[1]) * (u[2] - a)
        return (walls + p["h"] * (f - a) + p["fan"] + people - cold) / p["Ca"], p["h"] * (a - f) / p["Cf"]

    def true(t, x, u, d, on):
        return nom(t, x, u, p, d[0])

    def plan(r):
        n = (640, 520, 580)[r]
        door = np.where(rng.random(n) < 0.02, 1, 0)
        door = np.minimum(np.convolve(door, np.ones(6))[:n], 1) * np.round(rng.uniform(0.3, 1, n), 1)
        outside = 11 + 2 * r + 3 * np.sin(np.arange(n) / 190) + 0.3 * coloured(rng, n, 0.97)
        aim = -1.5 + steps(rng, n, -1.5, 1.5, 120)
        return np.c_[aim, led_in(door), np.round(outside, 1)], 0.01 * coloured(rng, n, 0.95)

    def loop(y, row, memo):  # three cylinders, half a kelvin
        stage = memo.get("stage", 0)
        e = y[0] - row[0]
        memo["stage"] = stage = int(np.clip(stage + (e > 0.5) - (e < -0.5), 0, 3))
        return [round(stage / 3, 3), row[1], row[2]]

    sim = ODESimulator(
        nom, states=["air", "fish"], inputs=["compressor", "door", "outside"], outputs=["air", "fish"], params=p, dt=60.0,
        x0=[1.0, 3.0],
        units={"air": "degC", "fish": "degC", "door": "1", "outside": "degC", "Ca": "kJ/K", "U": "kW/K", "time": "s"},
    )  # fmt: skip
    data = twin(
        "none_cold_store", rng, sim, true, plan, lambda r, u: [1 + r, 4.0 + r], see=lambda X, on: X, noise=[0.03, 0.015],
        runs=3, scale=10, loop=loop, grid=[0.01, 0.0], every=[1, 6], drop=0.14,
    )  # fmt: skip
    return sim, *data, "none (one row in seven lost, a probe read every sixth row, closed loop; U free, right)"


# Nothing is missing. The display is finer than a hundredth of the deviation; people who work there give 10 W.
KW["none_cold_store"] = {"free_params": ["U"]}
ACCEPTED["none_cold_store"] = [["parameter_error@U of less than 3 %", "(not needed)"]]
NEAR["none_cold_store"] = [
    "unknown or partial with a disturbance and no name",
    "sensor_quantization@air 0.01 K",
]
WRONG["none_cold_store"] = ["any other name", "a law of signals said to be certain"]


if __name__ == "__main__":
    main(ACCEPTED, 151)
