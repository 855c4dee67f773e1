"""Fourteen simulated twins of plants in research laboratories and start-ups, recorded as their engineers would.

Five plants have one effect in the form of nature or hardware, three have two at different places, two have one of no
entry of the catalogue, two have none, one has a parameter that is 15 % off beside an effect, and one has an imperfect
record. ``ACCEPTED``, ``NEAR`` and ``WRONG`` are as in ``physical_plants_trades``; all were fixed by engineering
judgement before any diagnosis. ``NOISE`` and ``CHECK`` are those of ``physical_plants_service``, as are the helpers.

    python tests/benchmarks/physical_plants_labs.py [NAME ...] [--seed 81]

prints sizes over the noise: of the gap, of all effects, and of each of two effects.
"""

import numpy as np
from physical_plants import KW, case, sines, steps
from physical_plants_messy import pi
from physical_plants_rigs import balanced
from physical_plants_service import CHECK, NOISE, hand_in, main, robot, twin  # noqa: F401
from physical_plants_si import coloured, kink
from physical_plants_trades import led_in, quiet, rk4
from scipy.integrate import odeint

from sksurrogate.physics import CallableSimulator, ClosedLoopSimulator, MuJoCoSimulator, ODESimulator, StepSimulator

ACCEPTED, NEAR, WRONG = {}, {}, {}


# ------------------------------------------------------------------------------------------ one effect


@case
def pcr_cycler(rng):
    """Thermal cycler of a diagnostics start-up under its own controller: degrees C and volts, each second.

    The foil heater is of nickel and iron: its resistance grows by 0.45 % a kelvin, and more when hot (data sheets
    of such foils). The simulator, a closed loop with a known controller, has the resistance of the cold foil.
    """
    p = {"C": 40.0, "Cs": 9.0, "h": 0.55, "UA": 0.95, "R": 4.6}

    def nom(t, x, u, p, hot=1.0):  # J/K, W/K, ohm; room in degrees C
        b, s = x
        over = p["h"] * (b - s)
        return (u[0] ** 2 / (p["R"] * hot) - over - p["UA"] * (b - u[1])) / p["C"], over / p["Cs"]

    plant = ODESimulator(
        nom, states=["block", "tube"], inputs=["volts", "room"], outputs=["block", "tube"], params=p, dt=1.0,
        x0=[30.0, 30.0],
    )  # fmt: skip
    hand = StepSimulator(
        lambda t, x, u, p, dt: [np.clip(x[0] + 0.03 * (u[0] - u[1]), 0, 24)], states=["sum"], inputs=["aim", "block"],
        outputs=["volts"], output=lambda t, x, u, p: [np.clip(1.6 * (u[0] - u[1]) + x[0], 0, 24)], dt=1.0, x0=[8.0],
    )  # fmt: skip
    sim = ClosedLoopSimulator(plant, hand, outputs=["block", "tube", "volts"])
    made, begins = [], []
    for r in range(3):
        n, levels = 420, []
        while len(levels) < n:
            for level in (95 - 3 * r, rng.uniform(50, 64), 72):
                levels += [round(level)] * int(rng.integers(20, 50))
        room = np.round(23 + r + 0.3 * coloured(rng, n, 0.99), 1)
        made.append(np.c_[room, np.array(levels[:n], float)])
        begins.append(np.array([30.0 + 8 * r, 30.0 + 8 * r, 8.0]))

    def campaign(*on):
        out = []
        for U, start in zip(made, begins):
            x, s = start[:2], start[2]
            for room, aim in U:
                volts = np.clip(1.6 * (aim - x[0]) + s, 0, 24)
                out.append([*x, volts])
                s = np.clip(s + 0.03 * (aim - x[0]), 0, 24)

                def true(t, x, v=volts, room=room):
                    e = x[0] - 25
                    return nom(t, x, [v, room], p, 1 + on[0] * (4.5e-3 * e + 4e-6 * e * e))

                x = odeint(true, x, [0, 1], tfirst=True, rtol=1e-9)[-1]
        return np.array(out)

    e = rng.normal(size=(sum(len(U) for U in made), 3))
    data = hand_in("pcr_cycler", rng, sim, made, begins, campaign, e, [0.006, 0.01, 0.006], grid=[0.05, 0.05, 0.01])
    return sim, *data, "parameter_dependence@R on block 0.0045 1/K (and 4e-6 of the square)"


ACCEPTED["pcr_cycler"] = [["parameter_dependence@R on block (+)", "the same on tube, said to be partial"]]
NEAR["pcr_cycler"] = [
    "parameter_error@R (+), parameter_dependence@R on volts, or input_gain@volts (-), said to be partial",
    "a law at volts or block of block and volts",
]
WRONG["pcr_cycler"] = [
    "any parameter_error, input_gain@volts, radiation or linear_loss@block, any name at tube, said to be all",
    "a sensor effect",
]


LEG = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body name="thigh" pos="0 0 1">
<joint name="hip" axis="0 1 0" damping="1.2" stiffness="14"/>
<geom type="capsule" size="0.04" fromto="0 0 0 0 0 -0.32" mass="3.2" contype="0" conaffinity="0"/>
<body name="shank" pos="0 0 -0.32"><joint name="knee" axis="0 1 0" damping="0.5" stiffness="6"/>
<geom type="capsule" size="0.025" fromto="0 0 0 0 0 -0.3" mass="1.3" contype="0" conaffinity="0"/>
</body></body></worldbody>
<actuator><motor name="hip_drive" joint="hip" gear="0.55"/><motor name="knee_drive" joint="knee" gear="0.22"/>
</actuator></mujoco>"""


@case
def leg_stand(rng):
    """Leg of a legged robot that hangs from its stand, currents in A, angles of hip and knee, samples of 20 ms.

    The iron of the knee motor saturates: torque over current as a brake measured it, 4 % less at 16 A and 33 % less at
    36 A. The simulator is a model of MuJoCo with a constant torque a current.
    """
    amps = np.array([0, 8, 12, 16, 20, 24, 28, 32, 36, 44])
    share = np.array([1, 1, 0.985, 0.96, 0.915, 0.86, 0.795, 0.73, 0.67, 0.57])

    def force(q, v, u, on):
        return [0, 0], [u[0], u[1] * (np.interp(abs(u[1]), amps, share) if on[0] else 1)]

    sim = MuJoCoSimulator(
        LEG, outputs=["hip.pos", "knee.pos"], params=["hip.damping", "knee.damping", "shank.mass"], dt=0.02
    )
    made, begins = [], []
    for r in range(4):
        n, ramp = 350, np.minimum(1, np.arange(350) / 25)
        hip = sines(rng, n, 0.02, 5 + r, 0.3, 2.2, 6) * ramp
        knee = np.clip((sines(rng, n, 0.02, 10 + 2 * r, 0.3, 2.5, 6) + steps(rng, n, -14, 14, 40)) * ramp, -36, 36)
        made.append(np.round(np.c_[hip, knee], 1))
        begins.append(np.array([rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 0, 0]))
    data = robot("leg_stand", rng, sim, LEG, made, begins, force, [0, 1], 0.01, grid=2 * np.pi / 16384)
    return sim, *data, "input_curve@knee_drive (c < 0; torque over current of a table, 33 % less at 36 A)"


ACCEPTED["leg_stand"] = [
    ["input_curve@knee_drive (c < 0)", "input_saturation@knee_drive", "input_curve with input_gain@knee_drive"]
]
NEAR["leg_stand"] = ["input_gain@knee_drive (-), said to be partial"]
WRONG["leg_stand"] = [
    "any name at hip or hip_drive, a sensor effect, or rate_limit, input_lag or input_dead_zone@knee_drive",
    "input_gain@knee_drive, or any friction or loss at knee, said to be all",
]


@case
def triaxial_cell(rng):
    """Triaxial cell of a soil laboratory, cell and pore pressure in kPa, samples of a second; trajectories alone.

    The spool of the proportional valve overlaps by 5 % to each side, with rounded edges; through the overlap leaks 0.12
    of the flow. The simulator has a linear valve.
    """
    A = np.array([[-1 / 45, 1 / 110], [1 / 60, -1 / 38]])
    B = np.array([[0.5], [0.0]])  # kPa/s a percent

    def table(U):
        U = np.asarray(U, float)
        Ad, Bd, _ = balanced((A, B), U, 1.0)
        X = np.zeros((len(U), 2))
        for k in range(len(U) - 1):
            X[k + 1] = Ad @ X[k] + Bd @ U[k]
        return X

    def true(t, x, u, d, on):
        open_ = kink(u[0] - 5, 0.4) - kink(-u[0] - 5, 0.4)
        return A @ x + B[:, 0] * (open_ + 0.12 * (u[0] - open_) if on[0] else u[0])

    def plan(r):
        n = 450
        u = steps(rng, n, -18, 18, 22) + sines(rng, n, 1.0, 4.0 + r, 0.01, 0.08, 5)
        return np.round(np.r_[np.zeros(5), u[5:]], 1), quiet(n)

    sim = CallableSimulator(table, inputs=["valve"], outputs=["cell", "pore"], dt=1.0)
    data = twin(
        "triaxial_cell", rng, sim, true, plan, lambda r, u: [0, 0], see=lambda X, on: X, noise=[0.012, 0.015], runs=3,
        scale=10,
    )  # fmt: skip
    return sim, *data, "input_dead_zone@valve 4.4 to 5 % (overlap with a leak of 0.12 of the flow), simulate only"


ACCEPTED["triaxial_cell"] = [["input_dead_zone@valve", "input_dead_zone with input_gain@valve"]]
NEAR["triaxial_cell"] = ["input_gain@valve (-), or input_curve@valve (c > 0) with a gain, said to be partial"]
WRONG["triaxial_cell"] = ["input_backlash, _lag, _delay, _gain or rate_limit@valve, or a sensor effect said to be all"]


@case
def profiling_float(rng):
    """Miniature profiling float in a test tank, depth from a camera, fourteen descents of 17 s, samples of 0.25 s.

    Drag of a sphere of 6 cm between Reynolds numbers of 1e2 and 1e4 (Clift and Gauvin: 0.4 to 1, never a pure square).
    The simulator, a step in Python, has the linear drag of the cable in its guide alone.
    """
    p = {"m": 0.17, "b": 0.03}

    def nom(t, x, u, p, drag=0.0):  # kg with the water that moves along, N s/m; buoyancy in mN
        return x[1], (1e-3 * u[0] - p["b"] * x[1] - drag) / p["m"]

    def true(t, x, u, d, on):
        v = abs(x[1]) + 1e-9
        Re = v * 0.06 / 1.05e-6
        Cd = 24 / Re * (1 + 0.15 * Re**0.687) + 0.42 / (1 + 42500 * Re**-1.16)
        return nom(t, x, u, p, on[0] * 499 * 2.83e-3 * Cd * v * x[1])

    def plan(r):
        push = steps(rng, 70, -5, 5, 18) + rng.choice([-1, 1]) * rng.uniform(0, 4)
        return np.round(push, 1), quiet(70)

    sim = StepSimulator(rk4(nom, 2), states=["z", "w"], inputs=["buoyancy"], outputs=["z"], params=p, dt=0.25)
    data = twin(
        "profiling_float", rng, sim, true, plan, lambda r, u: [rng.uniform(0.7, 1.7), rng.uniform(-0.02, 0.02)],
        see=lambda X, on: X[:, :1], noise=0.008, runs=14, scale=[1, 0.1], grid=0.001,
    )  # fmt: skip
    return sim, *data, "quadratic_drag@w 4 (a sphere's drag by the Reynolds number, power 1.75 to 2)"


ACCEPTED["profiling_float"] = [["quadratic_drag@w of w", "power_law@w of w (exponent 1.3 to 2.3)"]]
NEAR["profiling_float"] = ["linear_loss@w of w or parameter_error@b (+), said to be partial", "cubic_stiffness@w of w"]
WRONG["profiling_float"] = [
    "any friction with a level, hidden_relaxation or hidden_mode, a name at z or at its sensor",
    "parameter_error@b or @m, or input_gain@buoyancy said to be all",
]


@case
def glovebox_arm(rng):
    """Two-link arm in a glove box, in the plane, torques in N m, angles, samples of 10 ms; gauntlets pull it back.

    The elbow sticks and slides: it holds still up to 0.7 N m and slides at 0.4 N m, Stribeck width 0.1 rad/s; held by a
    switch (Karnopp), not by a steep slope. The simulator, a right-hand side, has the mass matrix and viscous losses.
    """
    p = {"a": 1.9, "b": 0.35, "d": 0.45, "c1": 2.5, "c2": 0.9, "k1": 8.0, "k2": 5.0}

    def loads(x, u, p):  # what accelerates the joints but for dry friction, and the masses of the joints
        q1, q2, w1, w2 = x
        s, c = p["b"] * np.sin(q2), p["b"] * np.cos(q2)
        f1 = u[0] - p["c1"] * w1 - p["k1"] * q1 + s * (2 * w1 * w2 + w2 * w2)
        return f1, u[1] - p["c2"] * w2 - p["k2"] * q2 - s * w1 * w1, p["a"] + 2 * c, p["d"] + c

    def nom(t, x, u, p, rub=0.0):
        f1, f2, M, m = loads(x, u, p)
        f2 = f2 - rub
        det = M * p["d"] - m * m
        return x[2], x[3], (p["d"] * f1 - m * f2) / det, (M * f2 - m * f1) / det

    def hold(x, u):
        f1, f2, M, m = loads(x, u, p)
        return f2 - m * f1 / M

    def true(t, x, u, d, on):
        way = x[4]
        rub = way * (0.4 + 0.3 * np.exp(-((x[3] / 0.1) ** 2))) if way else hold(x[:4], u)
        return *nom(t, x[:4], u, p, on[0] * rub), 0.0

    def tick(x, u, d, on):  # x[4]: the way in which the elbow slides, 0 if it sticks
        x = np.array(x)
        if on[0] and x[4] * x[3] <= 0:
            need = hold([*x[:3], 0.0], u)
            x[3:] = 0.0, np.sign(need) * (abs(need) > 0.7)
        return x

    def plan(r):
        n = 500
        t1 = sines(rng, n, 0.01, 2.5 + r, 0.2, 1.5, 6) + steps(rng, n, -2, 2, 80)
        t2 = sines(rng, n, 0.01, 1.2 + 0.5 * r, 0.15, 1.2, 6) + steps(rng, n, -1, 1, 60)
        return np.round(np.c_[t1, t2] * np.minimum(1, np.arange(n) / 20)[:, None], 2), quiet(n)

    sim = ODESimulator(
        nom, states=["q1", "q2", "w1", "w2"], inputs=["t1", "t2"], outputs=["q1", "q2"], params=p, dt=0.01
    )
    data = twin(
        "glovebox_arm", rng, sim, true, plan, lambda r, u: [rng.uniform(-0.2, 0.2), rng.uniform(-0.1, 0.1), 0, 0, 0],
        see=lambda X, on: X[:, :2], noise=0.008, runs=4, scale=0.1, tick=tick, grid=2 * np.pi / 16384,
    )  # fmt: skip
    return sim, *data, "stribeck_friction@t2 of w2 0.4 to 0.7 N m (with true sticking)"


ACCEPTED["glovebox_arm"] = [[f"{a}_friction@t2 of w2" for a in ("stribeck", "coulomb", "asymmetric", "lugre")]]
NEAR["glovebox_arm"] = [
    "any of these frictions@w2 of w2",
    "hysteresis@t2 of q2, input_dead_zone@t2, linear_loss@t2 of w2 or parameter_error@c2 (+), said to be partial",
]
WRONG["glovebox_arm"] = [
    "any friction at t1 or w1, or of w1",
    "input_backlash@t2, input_gain@t2, parameter_error or a sensor effect said to be all",
]


# ------------------------------------------------------------------------------------------ two effects


@case
def mock_loop(rng):
    """Mock circulation of a blood-pump start-up: flow (l/min) and two pressures (mmHg), samples of 20 ms.

    The cannula is turbulent (4 mmHg at 3 l/min, power 1.75 as Blasius has it), and a bubble in the line of the arterial
    transducer makes it a mass on a spring (4 Hz, damping 0.6). The simulator, a right-hand side, has neither.
    """
    p = {"L": 2.4, "r": 5.0, "k": 9.5, "Ca": 7.0e-4, "Cv": 4.0e-3, "G": 0.055}

    def nom(t, x, u, p, cannula=0.0):  # mmHg s min/l, mmHg min/l, l/mmHg; speed in 1000 rpm, clamp 0 to 1
        Q, Pa, Pv = x
        back = p["G"] * u[1] * (Pa - Pv)
        return (
            (p["k"] * u[0] ** 2 - p["r"] * Q - cannula - Pa + Pv) / p["L"],
            (Q - back) / 60 / p["Ca"],
            (back - Q) / 60 / p["Cv"],
        )

    def true(t, x, u, d, on):
        Q, w = x[0], 8 * np.pi
        cannula = on[0] * 4 * abs(Q / 3) ** 1.75 * np.sign(Q)
        return *nom(t, x[:3], u, p, cannula), x[4], w * w * (x[1] - x[3]) - 1.2 * w * x[4]

    def plan(r):
        n = 500
        t = np.arange(n) * 0.02
        beat = 0.45 * np.maximum(0, np.sin(2 * np.pi * (0.9 + 0.15 * r) * t)) ** 2
        speed = 3.0 + steps(rng, n, -0.3, 0.4, 80) + beat
        return np.c_[np.round(speed, 2), np.round(0.75 + steps(rng, n, -0.25, 0.25, 90), 2)], quiet(n)

    def start(r, u):
        Q = 60.0 / (p["r"] + 1 / p["G"] / u[1])
        Pa = 8 + Q / p["G"] / u[1]
        return [Q, Pa, 8.0, Pa, 0.0]

    sim = ODESimulator(
        nom, states=["Q", "Pa", "Pv"], inputs=["speed", "clamp"], outputs=["Q", "Pa", "Pv"], params=p, dt=0.02,
        x0=[3.0, 80.0, 8.0],
    )  # fmt: skip
    data = twin(
        "mock_loop", rng, sim, true, plan, start, see=lambda X, on: np.c_[X[:, 0], X[:, 3 if on[1] else 1], X[:, 2]],
        noise=[0.015, 0.01, 0.02], runs=3, scale=[1, 10, 10, 10, 100], parts=["cannula", "bubble"],
    )  # fmt: skip
    return sim, *data, "quadratic_drag@Q 0.19 (power 1.75) + sensor_delay or sensor_lag@Pa 48 ms (4 Hz, damping 0.6)"


ACCEPTED["mock_loop"] = [
    ["quadratic_drag, quadratic_loss or power_law (exponent 1.2 to 2.5)@Q of Q", "parameter_dependence@r on Q (+)"],
    ["sensor_delay@Pa", "sensor_lag@Pa", "sensor_delay@Pa with sensor_lag@Pa"],
]
NEAR["mock_loop"] = [
    "one of both alone, said to be partial",
    "linear_loss@Q of Q, constant_bias@Q or parameter_error@r (+) for the cannula, said to be partial",
]
WRONG["mock_loop"] = [
    "any friction with a level at Q, input_lag, input_delay or input_gain@speed, parameter_error@k, said to be all",
    "any name at Pv, clamp, Cv or G, or sensor_gain or sensor_bias@Pa",
]


@case
def dipole_magnet(rng):
    """Bending magnet of a small accelerator behind its chopper (averaged), current and coil temperature, each 0.25 s.

    The yoke saturates: the inductance of small changes falls by 48 % at 60 A (its magnetisation curve), and the
    thermistor sits in resin (a lag of 14 s). The simulator, a right-hand side, has a constant inductance, diodes, and
    copper whose resistance goes with the temperature.
    """
    p = {"L": 0.7, "R": 0.36, "Vf": 0.8, "C": 2600.0, "h": 22.0}
    amps, share = np.array([0, 20, 30, 38, 45, 52, 60, 75]), np.array([1, 0.99, 0.95, 0.87, 0.77, 0.65, 0.52, 0.35])

    def nom(t, x, u, p, iron=1.0):  # H, ohm, J/K, W/K; duty 0 to 1, link in V, water in degrees C
        i, T = x
        R = p["R"] * (1 + 0.0039 * (T - 20))
        return (
            (u[0] * u[1] - (1 - u[0]) * p["Vf"] - R * i) / (p["L"] * iron),
            (R * i * i - p["h"] * (T - u[2])) / p["C"],
        )

    def true(t, x, u, d, on):
        iron = np.interp(x[0], amps, share) if on[0] else 1.0
        return *nom(t, x[:2], u, p, iron), (x[1] - x[2]) / 14

    def plan(r):
        n = 500
        mean = steps(rng, n, 0.28, 0.44, 150)
        duty = np.clip(mean + steps(rng, n, -0.17, 0.17, 20) + sines(rng, n, 0.25, 0.02, 0.02, 0.2, 4), 0.06, 0.62)
        link = 48 - 6 * duty + 0.4 * coloured(rng, n, 0.9)
        water = 18 + 2 * r + 0.5 * coloured(rng, n, 0.99)
        return np.c_[np.round(led_in(duty), 3), np.round(link, 1), np.round(water, 1)], quiet(n)

    def start(r, u):
        i = u[0] * u[1] / 0.4
        return [i, 25.0 + 4 * r, 25.0 + 4 * r]

    sim = ODESimulator(
        nom, states=["i", "T"], inputs=["duty", "link", "water"], outputs=["i", "T"], params=p, dt=0.25,
        x0=[35.0, 30.0],
    )  # fmt: skip
    data = twin(
        "dipole_magnet", rng, sim, true, plan, start, see=lambda X, on: np.c_[X[:, 0], X[:, 2 if on[1] else 1]],
        noise=[0.006, 0.012], runs=4, scale=10, grid=[0, 0.05], parts=["iron", "resin"],
    )  # fmt: skip
    return sim, *data, "parameter_dependence@L on i (c < 0; -48 % at 60 A) + sensor_lag@T 14 s"


ACCEPTED["dipole_magnet"] = [
    ["parameter_dependence@L on i (c < 0)"],
    ["sensor_lag@T", "sensor_delay@T with sensor_lag@T"],
]
NEAR["dipole_magnet"] = [
    "one of both alone, or sensor_delay@T for the resin, said to be partial",
    "parameter_error@L (-), parameter_dependence@L on duty, or a law at i of i, duty and link, said to be partial",
]
WRONG["dipole_magnet"] = [
    "input_curve or input_gain@duty, linear_loss, quadratic_loss or cubic_stiffness@i said to be all",
    "sensor_nonlinearity or sensor_saturation@i, any name at water, or parameter_error@C or @h said to be all",
]


@case
def growth_chamber(rng):
    """Growth chamber of a plant laboratory under its CO2 controller: CO2 in ppm, air in degrees C, each 10 s.

    Air leaks past the door (at full fan 2 air changes an hour, power 1.3 of the fan, as slots have it), and the sample
    comes to the analyser through a hose (25 s, mixed on its way) and a cell of 12 s. The simulator, a right-hand side,
    has the purge by clean air and the plants; neither leak nor hose.
    """
    p = {"inject": 14.0, "purge": 0.0022, "uptake": 0.55, "K": 350.0, "Ca": 7.0, "lamp": 0.42, "U": 0.05}

    def nom(t, x, u, p, leak=0.0):  # ppm/s, ppm, kJ/K, kW, kW/K; valve 0 to 1, lamp 0 to 1, cooler in kW
        c, T = x
        eaten = p["uptake"] * u[1] * c / (c + p["K"]) * (1 + 0.03 * (T - 22))
        air = (p["lamp"] * u[1] - p["U"] * (T - 21) - u[2]) / p["Ca"]
        return p["inject"] * u[0] - p["purge"] * c - eaten + leak, air

    def true(t, x, u, d, on):
        leak = on[0] * 2 / 3600 * u[3] ** 1.3 * (u[4] - x[0])
        hose = np.diff([x[0], *x[2:7]]) / -5.0
        return [*nom(t, x[:2], u, p, leak), *hose, (x[6] - x[7]) / 12]

    def plan(r):
        n = 420
        aim = 900 + 100 * r + steps(rng, n, -350, 350, 45)
        lamp = np.clip(steps(rng, n, 0.1, 1.3, 60), 0, 1)
        cooler = np.clip(0.3 * lamp + steps(rng, n, -0.03, 0.06, 40), 0, None)
        fan = np.round(0.85 + steps(rng, n, -0.15, 0.15, 90), 2)
        out = 480 + 40 * coloured(rng, n, 0.98) + steps(rng, n, -40, 160, 70)
        return np.c_[aim, np.round(lamp, 2), np.round(cooler, 3), fan, np.round(out)], quiet(n)

    def loop(y, row, memo):
        memo.setdefault("I", 0.15)
        return np.r_[np.round(pi(row[0] - y[0], memo, 6e-4, 3e-5, 0, 1), 3), row[1:]]

    sim = ODESimulator(
        nom, states=["co2", "T"], inputs=["valve", "lamp", "cooler", "fan", "corridor"], outputs=["co2", "T"], params=p,
        dt=10.0, x0=[800.0, 22.0],
    )  # fmt: skip
    data = twin(
        "growth_chamber", rng, sim, true, plan, lambda r, u: [*(c := [700.0 + 80 * r, 22.0]), *[c[0]] * 6],
        see=lambda X, on: np.c_[X[:, 7 if on[1] else 0], X[:, 1]], noise=[0.015, 0.02], runs=4, scale=10, loop=loop,
        parts=["leak", "hose"],
    )  # fmt: skip
    return sim, *data, "exchange@co2 of corridor 4.5e-4 1/s (with the fan) + sensor_delay or sensor_lag@co2 37 s"


ACCEPTED["growth_chamber"] = [
    ["exchange@co2 of corridor", "linear_loss@co2 of co2 with linear_loss@co2 of corridor (c < 0)"],
    ["sensor_delay@co2", "sensor_lag@co2", "sensor_delay@co2 with sensor_lag@co2"],
]
NEAR["growth_chamber"] = [
    "one of both alone, said to be partial",
    "linear_loss@co2 of co2 alone, bilinear@co2 of co2*fan, or parameter_error@uptake or @purge (+) for the leak",
    "input_delay@valve for the hose, said to be partial",
]
WRONG["growth_chamber"] = [
    "input_gain@valve, input_lag@valve, parameter_error@inject or @uptake said to be all",
    "any name at T, cooler, U or Ca, or sensor_gain or sensor_bias@co2",
]


# ------------------------------------------------------------------------------------------ an effect of no entry


@case
def gel_reactor(rng):
    """Nine bulk polymerisations of styrene in a calorimeter, monomer (mol/l) and temperature (K), each 3 minutes.

    Gel effect: chains end ever more slowly as the mass thickens, and the rate grows as exp(A1 X + A2 X^2 + A3 X^3) with
    the conversion X (Hui and Hamielec 1972), 3.5-fold at X = 0.5. The simulator, a right-hand side, has ideal kinetics.
    """
    p = {"k": 0.008, "E": 10500.0, "kd": 0.004, "H": 36.0, "U": 0.9}

    def nom(t, x, u, p, gel=1.0):  # 1/min, K, K l/mol; jacket in K, dosing in mmol/l/min
        M, I, T = x
        warm = p["E"] * (1 / 345 - 1 / T)
        rate = p["k"] * gel * np.exp(warm) * M * np.sqrt(np.maximum(I, 0))
        return -rate, 1e-3 * u[1] - p["kd"] * np.exp(1.4 * warm) * I, p["H"] * rate - p["U"] * (T - u[0])

    def true(t, x, u, d, on):
        X, T = 1 - x[0] / 8.35, x[2]
        thick = (2.57 - 5.05e-3 * T) * X + (9.56 - 1.76e-2 * T) * X**2 + (-3.03 + 7.85e-3 * T) * X**3
        return nom(t, x, u, p, np.exp(on[0] * thick))

    def plan(r):
        n = 60
        dosing = np.clip(steps(rng, n, -0.4, 0.3, 15), 0, None)
        return np.round(np.c_[345 + steps(rng, n, -8, 5, 25), dosing], 1), quiet(n)

    sim = ODESimulator(
        nom, states=["M", "I", "T"], inputs=["jacket", "dosing"], outputs=["M", "T"], params=p, dt=3.0,
        x0=[8.0, 0.05, 345.0],
    )  # fmt: skip
    data = twin(
        "gel_reactor", rng, sim, true, plan,
        lambda r, u: [rng.uniform(5.6, 8.3), [0.03, 0.04, 0.05][r % 3], u[0]], see=lambda X, on: X[:, [0, 2]],
        noise=[0.012, 0.02], runs=9, scale=[1, 0.01, 10],
    )  # fmt: skip
    return sim, *data, "unknown at M and T, or k (gel effect: the rate grows exponentially with the conversion)"


ACCEPTED["gel_reactor"] = [["unknown", "parameter_dependence@k on M (c < 0), said to be partial"]]
NEAR["gel_reactor"] = [
    "parameter_dependence@k on M (c < 0) said to be all",
    "a law of M and T at M or T",
    "parameter_error@k (+), parameter_dependence@E or @kd on M, any loss@M of M, said to be partial",
]
WRONG["gel_reactor"] = [
    "a sensor effect",
    "parameter_error, any loss@M, any name at I, dosing or jacket said to be all",
]


@case
def heli_descent(rng):
    """Crop-scouting helicopter of a start-up in climbs and descents, height and climb rate, samples of 0.1 s.

    Vortex-ring state: where it descends as fast as its own wake, v_i = 0.81 sqrt(T), thrust falls by 15 % (a bump
    0.45 v_i wide, as flight tests of rotors have it). The simulator, a right-hand side, has weight, damping and drag.
    """
    p = {"m": 1.8, "b": 1.5, "D": 0.06}

    def nom(t, x, u, p, ring=0.0):  # kg, N s/m, N s2/m2; thrust in N
        w = x[1]
        return w, (u[0] * (1 - ring) - p["b"] * w - p["D"] * w * abs(w)) / p["m"] - 9.81

    def true(t, x, u, d, on):
        v = 0.81 * np.sqrt(u[0])
        return nom(t, x, u, p, on[0] * 0.15 * np.exp(-(((-x[1] / v - 1) / 0.45) ** 2)))

    def plan(r):
        n = 400
        w = np.clip(steps(rng, n, -5.0, 3.0, 30), -5, 3)
        thrust = p["m"] * 9.81 + p["b"] * w + p["D"] * w * abs(w) + 0.8 * coloured(rng, n, 0.9)
        return np.round(led_in(thrust), 2), quiet(n)

    sim = ODESimulator(nom, states=["h", "w"], inputs=["thrust"], outputs=["h", "w"], params=p, dt=0.1, x0=[80.0, 0.0])
    data = twin(
        "heli_descent", rng, sim, true, plan, lambda r, u: [80.0 + 10 * r, rng.uniform(-0.5, 0.5)],
        see=lambda X, on: X, noise=[0.004, 0.025], runs=5, scale=[10, 1],
    )  # fmt: skip
    return sim, *data, "unknown at w (thrust that is lost in the vortex ring, a bump of w over sqrt(thrust))"


ACCEPTED["heli_descent"] = [["unknown"]]
NEAR["heli_descent"] = [
    "a law at w of w, or of w and thrust",
    "input_gain@thrust, constant_bias, quadratic_loss or asymmetric_friction@w, or parameter_error, said to be partial",
]
WRONG["heli_descent"] = [
    "end_stop@w, any friction@w, parameter_error, or input_curve, input_gain or input_lag@thrust said to be all",
    "a sensor effect, or a name at h",
]


# ------------------------------------------------------------------------------------------ no effect


@case
def none_ultrafilter(rng):
    """Ultrafiltration pilot for a protein, two long runs: volume (l), concentration (g/l, each fifth row), minutes.

    Nothing is missing; a thirtieth of the readings is lost; noise of 2.5 and 3 %. The simulator is a right-hand side.
    """
    p = {"A": 0.9, "pi1": 0.0035, "pi2": 6e-5, "mu": 0.006}

    def nom(t, x, u, p):  # l/min/bar, bar; pressure in bar, feed and bleed in l/min, g/l of the feed
        V, c = x
        J = p["A"] * (u[0] - p["pi1"] * c - p["pi2"] * c * c) / (1 + p["mu"] * c)
        return u[1] - u[2] - J, (u[1] * (u[3] - c) + J * c) / V

    def true(t, x, u, d, on):
        return nom(t, x, u, p)

    def plan(r):
        n = 500
        P = 1.5 + 0.2 * r + steps(rng, n, -0.5, 0.6, 50)
        bleed, cf = 0.35 + steps(rng, n, -0.15, 0.2, 45), 18 + steps(rng, n, -6, 6, 60)
        feed = bleed + 0.9 * (P - 0.6) / 1.5 + steps(rng, n, -0.15, 0.15, 30)
        return np.round(np.c_[P, feed, bleed, cf], 2), quiet(n)

    def loop(y, row, memo):  # an operator keeps the vessel half full
        return [row[0], np.round(max(row[1] + 0.03 * (60 - y[0]), 0), 2), *row[2:]]

    ports = ["pressure", "feed", "bleed", "cf"]
    sim = ODESimulator(nom, states=["V", "c"], inputs=ports, outputs=["V", "c"], params=p, dt=1.0, x0=[60.0, 40.0])
    data = twin(
        "none_ultrafilter", rng, sim, true, plan, lambda r, u: [55.0 + 10 * r, 40.0 + 8 * r], see=lambda X, on: X,
        noise=[0.025, 0.03], runs=2, scale=10, every=[1, 5], drop=0.03, loop=loop,
    )  # fmt: skip
    return sim, *data, "none"


ACCEPTED["none_ultrafilter"] = [[]]
NEAR["none_ultrafilter"] = []
WRONG["none_ultrafilter"] = ["any name"]


@case
def none_rover(rng):
    """Delivery rover with two driven wheels, volts and wheel speeds (rad/s), samples of 50 ms; nothing is missing.

    Parameters that are free: the mass 14 % high, the rolling loss 15 % low. The simulator, a step in Python, has the
    mass matrix of the wheels and the pull of a centre of mass ahead of the axle.
    """
    p = {"m": 32.0, "I": 2.9, "c": 0.35, "kt": 0.95, "R": 0.8, "ahead": 0.09}
    start = dict(p, m=p["m"] * 1.14, c=p["c"] * 0.85)

    def nom(t, x, u, p):  # kg, kg m2, N m s; wheels of 0.1 m, 0.25 m from the middle
        l, r = x
        own, far = p["m"] * 0.01 / 4, (p["I"] + p["m"] * p["ahead"] ** 2) * 0.01 / 4 / 0.0625
        a, b = own + far + 0.012, own - far
        pull = p["m"] * p["ahead"] * 0.02 * 0.2 * (r - l)
        fl = p["kt"] * (u[0] - p["kt"] * l) / p["R"] - p["c"] * l + pull * r
        fr = p["kt"] * (u[1] - p["kt"] * r) / p["R"] - p["c"] * r - pull * l
        det = a * a - b * b
        return (a * fl - b * fr) / det, (a * fr - b * fl) / det

    def true(t, x, u, d, on):
        return nom(t, x, u, p)

    def plan(r):
        n = 350
        both, turn = steps(rng, n, -8, 14, 16), steps(rng, n, -6, 6, 11)
        return np.round(led_in(np.c_[both - turn, both + turn]), 1), quiet(n)

    sim = StepSimulator(
        rk4(nom, 4), states=["wl", "wr"], inputs=["ul", "ur"], outputs=["wl", "wr"], params=start, dt=0.05
    )
    data = twin(
        "none_rover", rng, sim, true, plan, lambda r, u: [0, 0], see=lambda X, on: X, noise=0.01, runs=4,
        scale=10,
    )  # fmt: skip
    return sim, *data, "none (mass and rolling loss free, 14 % high and 15 % low)"


KW["none_rover"] = {"free_params": ["m", "c"]}
ACCEPTED["none_rover"] = [["parameter_error@m (-)", "(not needed)"], ["parameter_error@c (+)", "(not needed)"]]
NEAR["none_rover"] = []
WRONG["none_rover"] = ["any name but parameter_error@m and @c"]


# ------------------------------------------------------------------------------------------ beside another fault


@case
def fes_knee(rng):
    """Knee of a seated patient under electrical stimulation, goniometer in rad, samples of 20 ms; a current in mA.

    No fibre answers below about 10 mA (a soft threshold of the recruitment curve), and shank and foot have 15 % more
    inertia than the tables of the body say (J, not free). The simulator, a right-hand side, has a linear muscle.
    """
    p = {"J": 0.34, "mgl": 12.0, "b": 0.7, "k": 3.0, "G": 0.3, "T": 0.14}

    def nom(t, x, u, p, J=1.0):  # kg m2, N m, N m s, N m/mA, s
        q, w, M = x
        return w, (M - p["mgl"] * np.sin(q) - p["k"] * q - p["b"] * w) / (J * p["J"]), (p["G"] * u[0] - M) / p["T"]

    def true(t, x, u, d, on):
        more = kink(u[0] - 10, 1.0) if on[1] and u[0] > 0 else u[0]
        return nom(t, x, [more], p, 1.15 if on[0] else 1.0)

    def plan(r):
        n, u, k = 400, np.zeros(400), 10
        while k < n:
            on, off = int(rng.integers(8, 50)), int(rng.integers(0, 40))
            u[k : k + on] = np.round(rng.uniform(6, 42))
            k += on + off
        return u, quiet(n)

    sim = ODESimulator(nom, states=["q", "w", "M"], inputs=["stim"], outputs=["q"], params=p, dt=0.02)
    data = twin(
        "fes_knee", rng, sim, true, plan, lambda r, u: [rng.uniform(-0.1, 0.3), 0, 0], see=lambda X, on: X[:, :1],
        noise=0.012, runs=5, scale=1, grid=0.002, parts=["inertia", "threshold"],
    )  # fmt: skip
    return sim, *data, "input_dead_zone@stim 10 mA (a soft threshold) + parameter_error@J 0.15"


ACCEPTED["fes_knee"] = [["input_dead_zone@stim"], ["parameter_error@J (+)"]]
NEAR["fes_knee"] = [
    "one of both alone, said to be partial",
    "input_gain or input_bias@stim (-), parameter_error@G (-), or input_curve@stim (c > 0) for the threshold",
    "hidden_mode@w, or parameter_error@b, @mgl and @k (-), for the inertia",
]
WRONG["fes_knee"] = [
    "any friction@w, input_gain@stim or parameter_error@G said to be all",
    "input_lag, input_delay or input_backlash@stim said to be all, or a sensor effect",
]


@case
def cubesat_shroud(rng):
    """CubeSat in a thermal vacuum chamber, one run of 25 hours: panel and battery in K, samples of a minute.

    The panel radiates to the shroud (8 W at 300 K to a cold one; bare metal emits more when it is warm: power 4.3). The
    simulator, a right-hand side, has bolts and straps alone. A tenth of the readings is missing, the panel is shown in
    steps of 0.5 K, and the relay of its heater leaves nine spikes there.
    """
    p = {"C": 700.0, "Cb": 450.0, "G": 0.12, "Gs": 0.12}

    def nom(t, x, u, p, light=0.0):  # J/K, W/K; heaters of panel and battery in W, shroud in K
        a, b = x
        over = p["G"] * (a - b)
        return (u[0] + p["Gs"] * (u[2] - a) - over + light) / p["C"], (u[1] + over) / p["Cb"]

    def true(t, x, u, d, on):
        return nom(t, x, u, p, on[0] * 8 * ((u[2] / 300) ** 4.3 - (x[0] / 300) ** 4.3))

    def plan(r):
        n = 1500
        aim, shroud = steps(rng, n, 150, 330, 110), np.zeros(n)
        shroud[0] = 290
        for k in range(1, n):
            shroud[k] = shroud[k - 1] + np.clip(aim[k] - shroud[k - 1], -1.6, 1.2)
        panel, inner = np.clip(steps(rng, n, -5, 12, 45), 0, None), np.clip(steps(rng, n, -1, 2.5, 60), 0, None)
        return np.round(np.c_[panel, inner, shroud + 0.3 * coloured(rng, n, 0.8)], 1), quiet(n)

    sim = ODESimulator(
        nom, states=["panel", "battery"], inputs=["heater", "inner", "shroud"], outputs=["panel", "battery"], params=p,
        dt=60.0, x0=[290.0, 290.0],
    )  # fmt: skip
    U, Y, groups = twin(
        "cubesat_shroud", rng, sim, true, plan, lambda r, u: [290.0, 291.0], see=lambda X, on: X,
        noise=[0.008, 0.01], runs=1, scale=10, grid=[0.5, 0.1], drop=0.1,
    )  # fmt: skip
    hit = rng.choice(np.arange(20, len(Y)), 9, replace=False)
    Y[hit, 0] += np.round(rng.choice([-1, 1], 9) * rng.uniform(25, 60, 9))
    return sim, U, Y, groups, "radiation@panel of shroud 1.4e-12 (power 4.3); spikes, steps of 0.5 K, a tenth missing"


ACCEPTED["cubesat_shroud"] = [["radiation@panel of shroud"]]
NEAR["cubesat_shroud"] = [
    "exchange@panel of shroud, parameter_error or parameter_dependence@Gs (+), power_law@panel, said to be partial",
    "radiation@panel of shroud beside a small parameter_error@Gs, or beside sensor_quantization@panel",
]
WRONG["cubesat_shroud"] = [
    "exchange, linear_loss or parameter_error@Gs, input_gain@shroud or @heater said to be all",
    "any name at battery, inner or Cb, or a sensor effect but sensor_quantization@panel",
]


if __name__ == "__main__":
    main(ACCEPTED, 81)
