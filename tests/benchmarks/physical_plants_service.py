"""Eighteen simulated twins of plants in service: their records are operating data, not experiments.

Six plants have one effect in the form of nature or hardware, four have two at different places, three have one of no
entry of the catalogue, three have none, and two have a parameter that is 10 to 20 % off beside an effect. ``ACCEPTED``,
``NEAR`` and ``WRONG`` are as in ``physical_plants_trades``; all were fixed by engineering judgement before any
diagnosis. ``NOISE`` is the noise of each output as a share of its deviation. Parameters are those of one plant; starts,
inputs, disturbances and noise are drawn.

``CHECK[name]()``, after the case is built, returns what the nominal simulator, the plant, and the plant with its
effects switched off do without noise, and sizes over the noise: of the gap, of all effects, and of each of two effects.

    python tests/benchmarks/physical_plants_service.py [NAME ...] [--seed 71]

prints these sizes.
"""

import numpy as np
from physical_plants import CASES, KW, case, sines, steps
from physical_plants_messy import pi, settled
from physical_plants_rigs import balanced, moved
from physical_plants_si import coloured, kink
from physical_plants_trades import led_in, quiet, rk4, size
from scipy.integrate import odeint

from sksurrogate.physics import (
    CallableSimulator,
    ClosedLoopSimulator,
    ControlSimulator,
    MuJoCoSimulator,
    ODESimulator,
    StepSimulator,
)

ACCEPTED, NEAR, WRONG, NOISE, CHECK = {}, {}, {}, {}, {}
FINE = 4  # parts of a sample after which a switch or a buffer of the plant acts


def play(rhs, x, U, D, dt, scale, tick=None, loop=None):
    """States (n, n_states) at the samples, inputs held; ``loop(x, k, row)`` writes row k of U, if there is one."""
    X, parts = [], FINE if tick else 1
    x, tolerance = np.array(x, float), 1e-9 * np.asarray(scale, float)
    for k in range(len(U)):
        if loop:
            U[k] = loop(x, k, U[k])
        X.append(x)
        for j in range(parts):
            x = tick(x, U[k], D[k]) if tick else x
            span = [(k + j / parts) * dt, (k + (j + 1) / parts) * dt]
            x = odeint(rhs, x, span, (U[k], D[k]), tfirst=True, rtol=1e-8, atol=tolerance, mxstep=5000)[-1]
    return np.array(X)


def hand_in(name, rng, sim, made, begins, campaign, e, noise, grid=0.0, every=None, drop=0.0, parts=()):
    """Inputs, readings and runs; ``campaign(*on)`` gives what the plant does with its effects on or off."""
    clean = campaign(1, 1)
    sd = np.broadcast_to(noise, clean.shape[1]) * clean.std(0)
    step = np.broadcast_to(grid, clean.shape[1])
    Y = np.where(step > 0, np.round((clean + sd * e) / np.where(step > 0, step, 1)) * step, clean + sd * e)
    rows = np.concatenate([np.arange(len(U)) for U in made])
    for j, gap in enumerate(every or []):
        Y[rows % gap > 0, j] = np.nan
    if drop:  # bursts of about four rows, never the first of a run
        lost = np.convolve(rng.random(len(Y)) < drop / 4, np.ones(4))[: len(Y)] > 0
        Y[lost & (rows > 0)] = np.nan

    def check():
        states = getattr(sim, "states", None)
        free = [sim.simulate(U, **({"x0": x[: len(states)]} if states else {})) for U, x in zip(made, begins)]
        out = {"nominal": np.vstack([np.reshape(y, (len(U), -1)) for y, U in zip(free, made)]), "clean": clean}
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
    return np.vstack(made), Y, np.repeat(np.arange(len(made)), [len(U) for U in made])


def twin(
    name, rng, sim, true, plan, start, *, see, noise, runs, scale=1.0, grid=0.0, hum=None, tick=None, loop=None,
    every=None, drop=0.0, parts=(),
):  # fmt: skip
    """Inputs, readings and runs of a plant.

    ``true(t, x, u, d, on)`` is the plant, ``on`` a pair of switches of its effects; ``tick(x, u, d, on)`` acts between
    parts of a sample. ``see(X, on)`` gives the outputs (n, n_outputs), ``plan(r)`` inputs and hidden disturbances of
    run r, ``start(r, u)`` its first state, ``hum`` the correlation of the noise from row to row, ``every`` for each
    output how many rows lie between its readings, ``drop`` the share of rows without any. In closed loop
    ``loop(y, row, memo)`` makes the inputs of a row from its readings.
    """
    made, hidden = zip(*[[np.array(a, float) for a in plan(r)] for r in range(runs)])
    made, hidden = ([a if a.ndim == 2 else a[:, None] for a in some] for some in (made, hidden))
    begins = [np.asarray(start(r, U[0]), float) for r, U in enumerate(made)]
    outputs = np.shape(see(begins[0][None], (1, 1)))[1]
    e = [
        rng.normal(size=(len(U), outputs))
        if hum is None
        else np.array([coloured(rng, len(U), hum) for _ in range(outputs)]).T
        for U in made
    ]

    def campaign(*on, sd=None):
        out = []
        for U, D, x, b in zip(made, hidden, begins, e):
            memo = {}

            def act(x, k, row, b=b, memo=memo):
                return loop(see(x[None], on)[0] + sd * b[k], row, memo)

            switch = tick and (lambda x, u, d: tick(x, u, d, on))
            X = play(
                lambda t, x, u, d: true(t, x, u, d, on), x, U, D, sim.dt, scale, switch, None if sd is None else act
            )
            out.append(see(X, on))
        return np.vstack(out)

    if loop:  # once without noise, for its size; then the record
        wish = [U.copy() for U in made]
        sd = np.asarray(noise) * campaign(1, 1, sd=0.0).std(0)
        for U, w in zip(made, wish):
            U[:] = w
        campaign(1, 1, sd=sd)
    return hand_in(name, rng, sim, made, begins, campaign, np.vstack(e), noise, grid, every, drop, parts)


def robot(name, rng, sim, text, made, begins, force, columns, noise, grid=0.0, parts=()):
    """A plant of MuJoCo; ``force(q, v, u, on)`` gives forces at the joints and inputs of the actuators."""

    def campaign(*on):
        def push(q, v, u, z):
            return *force(q, v, u, on), ()

        return np.vstack([moved(text, U, x, sim.dt, push)[:, columns] for U, x in zip(made, begins)])

    e = rng.normal(size=(sum(len(U) for U in made), len(columns)))
    return hand_in(name, rng, sim, made, begins, campaign, e, noise, grid, parts=parts)


# ------------------------------------------------------------------------------------------ one effect


@case
def office_doorway(rng):
    """Office with its reheater in closed loop, building log of 5 minutes, two days a run; kW, kJ/K, degrees C.

    Air goes through the open door to the corridor, driven by the difference of temperatures: its heat has power 1.5 of
    the difference (0.07 kW at one kelvin). The simulator, a right-hand side, has the wall between them. People whom no
    one counts give 20 W more or less.
    """
    p = {"Ca": 900.0, "Cw": 12000.0, "h": 0.26, "Uo": 0.045, "Uw": 0.03, "Uc": 0.025, "sun": 0.0022}

    def nom(t, x, u, p, door=0.0):  # K; heat in kW, outside and corridor in degrees C, sun in W/m2
        a, w = x
        out, side, into = p["Uo"] * (u[1] - a), p["Uc"] * (u[2] - a), p["h"] * (w - a)
        return (u[0] + out + side + into + door) / p["Ca"], (p["Uw"] * (u[1] - w) - into + p["sun"] * u[3]) / p["Cw"]

    def true(t, x, u, d, on):
        e = u[2] - x[0]
        return nom(t, x, u, p, d[0] + on[0] * 0.07 * e * abs(e) ** 0.5)

    def plan(r):
        n = 576
        hour = np.arange(n) / 12
        day = np.sin(2 * np.pi * (hour - 9) / 24)
        aim = np.where((hour % 24 > 6) & (hour % 24 < 18), 21.5, 18.5) + steps(rng, n, -0.6, 0.6, 60)
        outside = 3 + 2 * r + 4 * day + 1.5 * coloured(rng, n, 0.99)
        corridor = 18 + 2 * day + steps(rng, n, -2.5, 3.5, 50) + 0.3 * coloured(rng, n, 0.95)
        sun = np.maximum(0, 400 * day * (0.7 + 0.3 * coloured(rng, n, 0.97)))
        return np.c_[aim, np.round(outside, 1), np.round(corridor, 1), np.round(sun)], 0.02 * coloured(rng, n, 0.98)

    def loop(y, row, memo):
        memo.setdefault("I", 0.6)
        return np.r_[np.round(pi(row[0] - y[0], memo, 0.8, 0.05, 0, 3), 2), row[1:]]

    sim = ODESimulator(
        nom, states=["air", "wall"], inputs=["heat", "outside", "corridor", "sun"], outputs=["air"], params=p, dt=300.0,
        x0=[19.0, 17.5],
    )  # fmt: skip
    data = twin(
        "office_doorway", rng, sim, true, plan, lambda r, u: [19.0 + rng.uniform(-1, 1), 17.5],
        see=lambda X, on: X[:, :1], noise=0.03, runs=3, scale=10, loop=loop,
    )  # fmt: skip
    return sim, *data, "exchange@air of corridor (0.07 kW at 1 K, power 1.5 of the difference)"


ACCEPTED["office_doorway"] = [
    [
        "exchange@air of corridor",
        "parameter_error@Uc (+)",
        "linear_loss@air of corridor (c < 0) with linear_loss@air of air",
    ]
]
NEAR["office_doorway"] = [
    "exchange or linear_loss@air of another signal, said to be partial",
    "parameter_dependence@Uc on air or corridor",
    "a law of corridor and air at air",
]
WRONG["office_doorway"] = [
    "radiation@air said to be all",
    "input_gain@heat",
    "any name at wall or sun said to be all",
    "a sensor effect",
]


BOOM = """<mujoco><option timestep="0.005" integrator="RK4"/><worldbody><body name="boom_body" pos="0 0 2">
<joint name="boom" axis="0 -1 0" damping="30000"/>
<geom type="capsule" size="0.25" fromto="0 0 0 5 0 0" mass="1600" contype="0" conaffinity="0"/>
<body name="stick_body" pos="5 0 0"><joint name="stick" axis="0 -1 0" damping="9000"/>
<geom type="capsule" size="0.18" fromto="0 0 0 0 0 -2.6" mass="600" contype="0" conaffinity="0"/>
<geom type="sphere" size="0.4" pos="0 0 -2.8" mass="500" contype="0" conaffinity="0"/></body></body></worldbody>
<actuator><motor name="lift" joint="boom" gear="1000"/><motor name="crowd" joint="stick" gear="1000"/></actuator>
</mujoco>"""


@case
def excavator_boom(rng):
    """Boom and stick of an excavator that digs below its tracks, torques in kN m, angles, samples of 50 ms.

    The seals of the lift cylinders and the pin of the boom rub: 6 kN m, a fiftieth more for each 1 kN m of the cylinder,
    smooth within 0.01 rad/s. The simulator is a model of MuJoCo.
    """

    def force(q, v, u, on):
        return [-on[0] * (6000 + 20 * abs(u[0])) * np.tanh(v[0] / 0.01), 0], u

    sim = MuJoCoSimulator(
        BOOM, outputs=["boom.pos", "stick.pos"], params=["boom.damping", "stick.damping", "boom_body.mass"], dt=0.05
    )
    made, begins = [], []
    for r in range(4):
        n = 300
        lift = 75 + steps(rng, n, -32, 26, 22) + 6 * coloured(rng, n, 0.9)
        crowd = steps(rng, n, -9, 9, 20)
        made.append(np.round(np.c_[led_in(lift), led_in(crowd)], 1))
        begins.append(np.array([-0.75 + 0.15 * r + rng.uniform(-0.05, 0.05), 0.5, 0, 0]))
    data = robot("excavator_boom", rng, sim, BOOM, made, begins, force, [0, 1], 0.01)
    return sim, *data, "coulomb_friction@boom of boom.vel 7.5 kN m (grows with the load)"


ACCEPTED["excavator_boom"] = [
    [f"{a}_friction@boom or @lift of boom.vel" for a in ("coulomb", "asymmetric", "stribeck", "lugre")]
]
NEAR["excavator_boom"] = [
    "hysteresis@boom of boom.pos",
    "linear_loss@boom of boom.vel or parameter_error@boom.damping (+), said to be partial",
    "a friction@lift in another unit, or input_dead_zone@lift, said to be partial",
]
WRONG["excavator_boom"] = [
    "any friction at stick or crowd",
    "input_gain@lift or parameter_error@boom_body.mass said to be all",
    "input_backlash@lift said to be all",
]


@case
def paper_machine(rng):
    """Basis weight and moisture of a paper machine around its operating point, samples of 5 s; linear state space.

    The scanner sits at the reel, 264 m behind the headbox: the sheet comes there 22 s later, at a line speed that
    changes by 7 % to each side. The scanner gives a weight each 15 s. The simulator, of python-control, has the weight
    at the headbox; moisture is read at the last dryer.
    """
    import control

    A = np.array([[-1 / 35, 0, 0], [1 / 60, -1 / 60, 0], [0, 0.05, -1 / 28]])
    B = np.array([[0.045, 0], [0.01, 0], [0, -0.03]])
    C = np.array([[0.6, 0.5, 0], [0, 0, 1.0]])  # g/m2, %; chest and pit, water of the sheet
    system = control.ss(
        A, B, C, np.zeros((2, 2)), states=["chest", "pit", "water"], inputs=["stock", "steam"],
        outputs=["weight", "moisture"],
    )  # fmt: skip

    def true(t, x, u, d, on):
        return [*(A @ x[:3] + B @ u), *np.zeros(len(x) - 3)]

    def tick(x, u, d, on):  # weights of the last ticks of 1.25 s, and that which reaches the scanner
        past = np.r_[C[0] @ x[:3], x[3:-2]]
        return np.r_[x[:3], past, np.interp(22 / d[0] / 1.25 - 1, np.arange(len(past)), past)]

    def see(X, on):
        return np.c_[X[:, -1] if on[0] else X[:, :3] @ C[0], X[:, 2]]

    def plan(r):
        n = 480
        speed = 1 + steps(rng, n, -0.07, 0.07, 60)
        return np.c_[led_in(steps(rng, n, -3, 3, 22)), led_in(steps(rng, n, -4, 4, 28))], speed

    def start(r, u):
        rest = np.linalg.solve(-A, B @ u)
        return [*rest, *np.full(24, C[0] @ rest)]

    sim = ControlSimulator(system, dt=5.0)
    data = twin(
        "paper_machine", rng, sim, true, plan, start, see=see, noise=[0.02, 0.02], runs=4, tick=tick, every=[3, 1]
    )
    return sim, *data, "sensor_delay@weight 22 s (varies by 7 % with the line speed)"


ACCEPTED["paper_machine"] = [["sensor_delay@weight", "sensor_delay@weight with sensor_lag@weight"]]
NEAR["paper_machine"] = ["sensor_lag@weight, said to be partial", "input_delay@stock, said to be partial"]
WRONG["paper_machine"] = [
    "input_delay or input_lag@stock said to be all",
    "any name at steam or moisture",
    "sensor_lag@weight alone, said to be all",
]


@case
def reefer_frost(rng):
    """Refrigerated container after a defrost, air and cargo, degrees C, samples of a minute; a step in Python.

    Frost grows on the evaporator: UA falls as 1/(1 + t/15 h), the same after each defrost. The suction temperature is
    measured and drives the simulator.
    """
    p = {"Ca": 55.0, "Cc": 9000.0, "h": 0.25, "UA": 0.24, "Uw": 0.042, "fan": 0.5, "breath": 0.2}

    def nom(t, x, u, p, UA=None):  # kJ/K, kW; suction and ambient in degrees C, fan 0.5 or 1
        a, c = x
        cold = (p["UA"] if UA is None else UA) * (0.4 + 0.6 * u[2]) * (a - u[0])
        over = p["h"] * (c - a)
        return (p["Uw"] * (u[1] - a) + p["fan"] * u[2] + over - cold) / p["Ca"], (p["breath"] - over) / p["Cc"]

    def true(t, x, u, d, on):
        return nom(t, x, u, p, p["UA"] / (1 + on[0] * t / 54000))

    def plan(r):
        n = 480
        suction = np.clip(steps(rng, n, -12, 1, 35), -11, None) + 0.4 * coloured(rng, n, 0.9)
        ambient = 30 + 2 * r + 3 * np.sin(np.arange(n) / 230 + r) + coloured(rng, n, 0.99)
        fan = np.where(np.cumsum(rng.random(n) < 0.02) % 2, 1.0, 0.5)
        return np.c_[np.round(suction, 1), np.round(ambient, 1), fan], quiet(n)

    sim = StepSimulator(
        rk4(nom, 2), states=["air", "cargo"], inputs=["suction", "ambient", "fan"], outputs=["air", "cargo"], params=p,
        dt=60.0, x0=[4.0, 5.0],
    )  # fmt: skip
    data = twin(
        "reefer_frost", rng, sim, true, plan, lambda r, u: [6 + rng.uniform(-1, 3), 5 + rng.uniform(-1, 1)],
        see=lambda X, on: X, noise=[0.025, 0.03], runs=4, scale=10, grid=[0.05, 0],
    )  # fmt: skip
    return sim, *data, "parameter_drift@UA (1/(1 + t/15 h), runs of 8 h)"


ACCEPTED["reefer_frost"] = [["parameter_drift@UA (-)"]]
NEAR["reefer_frost"] = [
    "parameter_error@UA (-), said to be partial",
    "drift@air (+), said to be partial",
    "parameter_step@UA (-), said to be partial",
]
WRONG["reefer_frost"] = [
    "sensor_drift@air or @cargo",
    "parameter_error@UA said to be all",
    "drift@air or parameter_drift of another parameter said to be all",
    "any name at cargo",
]


@case
def mooring_buoy(rng):
    """Surge of a moored barge from its GPS, m, samples of 1 s; a record of wind and tug forces in kN; 15 % is lost.

    The chains lift off the bottom: their force hardens as sinh(x/7 m). The simulator, a right-hand side, has the
    stiffness at rest. The speed is not measured; a current that no one knows pushes slowly (6 kN).
    """
    p = {"m": 900.0, "k": 35.0, "b": 30.0}

    def nom(t, x, u, p, more=0.0):  # t, kN/m, kN s/m
        return x[1], (u[0] - p["k"] * x[0] - p["b"] * x[1] - more) / p["m"]

    def true(t, x, u, d, on):
        return nom(t, x, u, p, on[0] * p["k"] * (7 * np.sinh(x[0] / 7) - x[0]) - d[0])

    def plan(r):
        n = 600
        push = (
            steps(rng, n, -200, 200, 70) + sines(rng, n, 1.0, 40 + 12 * r, 0.01, 0.06, 5) + 15 * coloured(rng, n, 0.9)
        )
        return np.round(push), 6 * coloured(rng, n, 0.995)

    sim = ODESimulator(nom, states=["x", "v"], inputs=["force"], outputs=["x"], params=p, dt=1.0)
    data = twin(
        "mooring_buoy", rng, sim, true, plan, lambda r, u: [rng.uniform(-4, 4), rng.uniform(-0.3, 0.3)],
        see=lambda X, on: X[:, :1], noise=0.02, runs=4, drop=0.15,
    )  # fmt: skip
    return sim, *data, "cubic_stiffness@v of x 1.3e-4 (sinh(x/7 m))"


ACCEPTED["mooring_buoy"] = [["cubic_stiffness@v of x", "power_law@v of x (exponent 2.4 to 4.5)"]]
NEAR["mooring_buoy"] = [
    "parameter_dependence@k",
    "linear_loss@v of x or parameter_error@k (+), said to be partial",
    "quadratic_drag@v of x",
]
WRONG["mooring_buoy"] = [
    "end_stop@v (one side)",
    "state_saturation@x or sensor_saturation@x",
    "quadratic_drag or any friction@v of v said to be all",
    "input_curve@force said to be all",
]


@case
def shake_table(rng):
    """Servo-hydraulic shaking table of an earthquake laboratory, samples of 5 ms; a tool that gives trajectories alone.

    The spool of the servo valve has V-shaped notches: beyond the linear part its flow grows as 0.45 abs(u)^1.3 / (1 + 0.3
    abs(u)) more. Outputs are displacement (mm) and pressure (bar).
    """
    # mm, mm/s, bar; a spring that centres, the column of oil, a bypass
    A = np.array([[0, 1, 0], [-30.0, -9.0, 60.0], [0, -22.0, -7.0]])
    B = np.array([[0.0], [0.0], [4200.0]])

    def table(U):
        U = np.asarray(U, float)
        Ad, Bd, _ = balanced((A, B), U, 5e-3)
        X = np.zeros((len(U), 3))
        for k in range(len(U) - 1):
            X[k + 1] = Ad @ X[k] + Bd @ U[k]
        return X[:, [0, 2]]

    def true(t, x, u, d, on):
        a = abs(u[0])
        return A @ x + B[:, 0] * u[0] * (1 + on[0] * 0.45 * a**1.3 / (1 + 0.3 * a))

    def plan(r):
        n = 600
        u = sines(rng, n, 5e-3, 0.35 + 0.15 * r, 0.5, 6, 8) + steps(rng, n, -0.3, 0.3, 60)
        return np.clip(np.r_[np.zeros(4), u[4:]], -1.6, 1.6), quiet(n)

    sim = CallableSimulator(table, inputs=["valve"], outputs=["y", "P"], dt=5e-3)
    data = twin(
        "shake_table", rng, sim, true, plan, lambda r, u: [0, 0, 0], see=lambda X, on: X[:, [0, 2]], noise=0.012,
        runs=3, scale=[1, 100, 10],
    )  # fmt: skip
    return sim, *data, "input_curve@valve 0.38 (0.45 abs(u)^1.3 / (1 + 0.3 abs(u))), simulate only"


ACCEPTED["shake_table"] = [["input_curve@valve (c > 0)"]]
NEAR["shake_table"] = ["input_gain@valve (+), said to be partial", "input_curve@valve with input_gain@valve"]
WRONG["shake_table"] = [
    "a sensor effect said to be all",
    "input_gain@valve said to be all",
    "input_dead_zone@valve said to be all",
]


# ------------------------------------------------------------------------------------------ two effects


@case
def ev_dyno(rng):
    """Drive train of an electric car on its test stand, samples of 2.5 ms: two speeds and the torque of the shaft.

    Oil is churned in the gearbox (3.2 N m at 200 rad/s, power 1.7), and the transducer of the shaft has a Bessel filter
    of 23 Hz. The machine of the stand holds a speed, in closed loop. The simulator, a right-hand side with outputs,
    knows neither churning nor filter. The noise is coloured (0.5 from row to row).
    """
    p = {"J1": 0.06, "J2": 0.4, "k": 420.0, "c": 0.5, "b": 0.03}

    def shaft(t, x, u, p):
        return [x[0], x[2], p["k"] * x[1] + p["c"] * (x[0] - x[2])]

    def nom(t, x, u, p, oil=0.0):  # rad/s, rad; torques in N m
        T = p["k"] * x[1] + p["c"] * (x[0] - x[2])
        return (u[0] - p["b"] * x[0] - T - oil) / p["J1"], x[0] - x[2], (T - u[1]) / p["J2"]

    def true(t, x, u, d, on):
        oil = on[0] * 3.2 * np.maximum(x[0] / 200, 0) ** 1.7
        T, w = shaft(t, x, u, p)[2], 145.0
        return *nom(t, x[:3], u, p, oil), x[4], w * w * (T - x[3]) - 1.73 * w * x[4]

    def see(X, on):
        return np.c_[X[:, 0], X[:, 2], X[:, 3] if on[1] else shaft(0, X.T, 0, p)[2]]

    def plan(r):
        n = 700
        torque = 25 + steps(rng, n, -45, 45, 50) + sines(rng, n, 2.5e-3, 6.0, 2, 12, 5)
        speed = np.linspace(0, [90, -40, 60][r], n) + [90, 230, 150][r]
        return np.c_[led_in(np.round(torque, 1)), speed], quiet(n)

    def loop(y, row, memo):
        memo.setdefault("I", 20.0)
        return [row[0], np.round(pi(y[1] - row[1], memo, 4.0, 0.02, -120, 120), 1)]

    def start(r, u):
        w = u[1]
        return [w, u[0] / p["k"], w, u[0], 0.0]

    sim = ODESimulator(
        nom, states=["w1", "twist", "w2"], inputs=["motor", "brake"], outputs=["w1", "w2", "torque"], params=p,
        dt=2.5e-3, output=shaft, x0=[90.0, 0.0, 90.0],
    )  # fmt: skip
    data = twin(
        "ev_dyno", rng, sim, true, plan, start, see=see, noise=[0.008, 0.008, 0.015], runs=3, scale=[10, 0.1, 10, 10, 1e3],
        hum=0.5, loop=loop, parts=["churning", "filter"],
    )  # fmt: skip
    return sim, *data, "quadratic_drag@w1 (power 1.7) + sensor_lag@torque 12 ms (second order, 145 rad/s)"


ACCEPTED["ev_dyno"] = [
    ["quadratic_drag@w1 of w1", "quadratic_loss@w1 of w1", "power_law@w1 of w1 (exponent 1.2 to 2.4)"],
    ["sensor_lag@torque", "sensor_delay@torque with sensor_lag@torque"],
]
NEAR["ev_dyno"] = [
    "one of both alone, said to be partial",
    "sensor_delay@torque for the filter",
    "linear_loss@w1 of w1 or parameter_error@b (+) for the churning, said to be partial",
    "a loss at w1 of w2, or a loss at w2, for the churning, said to be partial",
]
WRONG["ev_dyno"] = [
    "coulomb_friction@w1 said to be all",
    "input_gain or input_bias@motor said to be all",
    "hidden_mode@w1 or w2",
    "input_lag@motor or brake",
]


@case
def sludge_digester(rng):
    """Anaerobic digester of a sewage works, samples of 3 hours: gas, and fatty acids once a day; trajectories alone.

    Deliveries are mixed in a pit of 55 m3 before they are fed (a lag of 1 to 2 days, by the feed), and the gas meter
    counts moisture too (10 %, a point more when it is warm). The simulator, a tool, has the digester alone.
    """
    p = {"V": 1100.0, "mu1": 0.9, "Ks": 7.5, "mu2": 0.72, "Kv": 9.5, "Ki": 256.0, "a": 0.5}

    def nom(t, x, cod, feed):  # g/l, mmol/l, 1/d; feed in m3/d, COD of the delivery in g/l
        S, X, v, M = x
        D = feed / p["V"] * 8
        r1, r2 = p["mu1"] * S / (p["Ks"] + S) * X, p["mu2"] * v / (v + p["Kv"] + v * v / p["Ki"]) * M
        return [
            D * (cod - S) - 42 * r1, r1 - p["a"] * D * X, D * (1.4 * cod - v) + 116 * r1 - 268 * r2,
            r2 - p["a"] * D * M,
        ]  # fmt: skip

    def gas(X):
        v = X[:, 2]
        return 453 * p["mu2"] * v / (v + p["Kv"] + v * v / p["Ki"]) * X[:, 3]

    begin = settled(lambda x: nom(0, x, 11.0, 36.0), [2.0, 0.5, 12.0, 0.4], 300)
    step = rk4(lambda t, x, u, p: nom(t, x, u[1], u[0]), 2)

    def table(U):
        X = [begin]
        for u in np.asarray(U, float)[:-1]:
            X.append(step(0, X[-1], u, p, 0.125))
        X = np.array(X)
        return np.c_[gas(X), X[:, 2]]

    def true(t, x, u, d, on):
        return [*nom(t, x[:4], x[4] if on[0] else u[1], u[0]), u[0] / 55 * (u[1] - x[4])]

    def see(X, on):
        warm = 0.01 * np.sin(2 * np.pi * np.arange(len(X)) / 8)
        return np.c_[gas(X) * (1 + on[1] * (0.1 + warm)), X[:, 2]]

    def plan(r):
        n = 360
        feed, cod = 36 + steps(rng, n, -10, 10, 36), 11 + steps(rng, n, -4, 4, 16)
        feed[:8], cod[:8] = 36, 11
        return np.round(np.c_[feed, cod], 1), quiet(n)

    sim = CallableSimulator(table, inputs=["feed", "cod"], outputs=["gas", "acids"], dt=0.125)
    data = twin(
        "sludge_digester", rng, sim, true, plan, lambda r, u: [*begin, 11.0], see=see, noise=[0.02, 0.03], runs=4,
        every=[1, 8], parts=["pit", "meter"],
    )  # fmt: skip
    return sim, *data, "input_lag@cod 1.5 d (by the feed) + sensor_gain@gas 0.10, simulate only"


ACCEPTED["sludge_digester"] = [["input_lag@cod", "input_delay@cod with input_lag@cod"], ["sensor_gain@gas (+)"]]
NEAR["sludge_digester"] = [
    "one of both alone, said to be partial",
    "input_delay@cod for the pit",
    "sensor_nonlinearity@gas or sensor_bias@gas for the meter",
]
WRONG["sludge_digester"] = [
    "input_gain@feed or @cod said to be all",
    "sensor_lag or sensor_delay@gas said to be all",
    "input_lag@feed",
    "sensor_gain@acids",
]


@case
def hydro_unit(rng):
    """Francis unit that feeds an island, in closed loop: flow and speed in parts of the rated, samples of 0.5 s.

    The linkage of the guide vanes has play (0.012 to each side) and yields within 0.3 s, and the trash rack is clogged:
    a loss of head of 0.09 with power 1.9 of the flow. The simulator, a nonlinear system of python-control, knows neither.
    """
    import control

    p = {"Tw": 1.6, "Ta": 9.0, "d": 1.2, "kf": 0.03, "q0": 0.06, "A": 1.1}

    def f(t, x, u, params, rack=0.0):
        q, w = x
        h = (q / (params["A"] * u[0])) ** 2
        power = h * (q - params["q0"])
        return np.array(
            [
                (1 - h - params["kf"] * q * q - rack) / params["Tw"],
                (power - u[1] - params["d"] * (w - 1)) / params["Ta"],
            ]
        )

    def true(t, x, u, d, on):
        e = u[0] - x[2]
        gate = x[2] if on[0] else u[0]
        rack = on[1] * 0.09 * max(x[0], 0) ** 1.9
        return [*f(t, x[:2], [gate, u[1]], p, rack), (e - np.clip(e, -0.012, 0.012)) / 0.3]

    def plan(r):
        n = 480
        load = 0.5 + 0.07 * r + steps(rng, n, -0.16, 0.16, 40) + 0.01 * coloured(rng, n, 0.9)
        return np.c_[np.zeros(n), led_in(np.round(load, 3))], quiet(n)

    def loop(y, row, memo):
        memo.setdefault("I", memo.setdefault("first", row[1] + 0.12))
        return [np.round(pi(1 - y[1], memo, 1.6, 0.06, 0.12, 1.0), 3), row[1]]

    def start(r, u):
        return [u[1] + 0.08, 1.0 + rng.uniform(-0.01, 0.01), u[1] + 0.12]

    system = control.nlsys(
        f, lambda t, x, u, params: x[:2], states=["q", "w"], inputs=["gate", "load"], outputs=["q", "w"], params=p
    )
    sim = ControlSimulator(system, dt=0.5, params=dict(p), x0=[0.6, 1.0])
    data = twin(
        "hydro_unit", rng, sim, true, plan, start, see=lambda X, on: X[:, :2], noise=[0.015, 0.02], runs=4,
        scale=0.1, loop=loop, parts=["play", "rack"],
    )  # fmt: skip
    return sim, *data, "input_backlash@gate 0.012 (yields in 0.3 s) + quadratic_drag@q 0.056 (power 1.9)"


ACCEPTED["hydro_unit"] = [
    ["input_backlash@gate"],
    [
        "quadratic_drag@q of q",
        "quadratic_loss@q of q",
        "power_law@q of q (exponent 1.3 to 2.5)",
        "parameter_error@kf (+)",
    ],
]
NEAR["hydro_unit"] = [
    "one of both alone, said to be partial",
    "input_lag, input_delay or rate_limit@gate for the play, said to be partial",
    "linear_loss@q of q, constant_bias@q (-) or input_gain@gate (-) for the rack, said to be partial",
]
WRONG["hydro_unit"] = [
    "sensor_gain@q or @w",
    "any name at load",
    "parameter_error@A or @q0 said to be all",
    "coulomb_friction at q or w",
]


GIMBAL = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body name="yoke" pos="0 0 1">
<joint name="pan" axis="0 0 1" damping="0.05" stiffness="0.25"/>
<geom type="box" size="0.03 0.15 0.03" mass="0.8" contype="0" conaffinity="0"/>
<body name="camera"><joint name="tilt" axis="0 1 0" damping="0.03" stiffness="0.2"/>
<geom type="box" size="0.12 0.06 0.07" mass="2.2" contype="0" conaffinity="0"/></body></body></worldbody>
<actuator><motor name="pan_motor" joint="pan"/><motor name="tilt_motor" joint="tilt"/></actuator></mujoco>"""


@case
def camera_gimbal(rng):
    """Camera gimbal of a patrol boat, pan and tilt, torques in N m, angles, samples of 20 ms.

    The slip rings of the pan axis rub (0.045 N m, 0.06 at creep, smooth within 0.02 rad/s), and the tilt axis meets a
    rubber buffer from 0.45 rad on (9 N m/rad^1.4, power 1.4). The simulator is a model of MuJoCo.
    """

    def force(q, v, u, on):
        rub = (0.045 + 0.015 * np.exp(-((v[0] / 0.1) ** 2))) * np.tanh(v[0] / 0.02)
        return [-on[0] * rub, -on[1] * 9 * kink(q[1] - 0.45, 0.008) ** 1.4], u

    sim = MuJoCoSimulator(
        GIMBAL, outputs=["pan.pos", "tilt.pos"], params=["pan.damping", "tilt.damping", "camera.mass"], dt=0.02
    )
    made, begins = [], []
    for r in range(4):
        n = 350
        pan = steps(rng, n, -0.25, 0.25, 35) + sines(rng, n, 0.02, 0.06, 0.2, 2, 5)
        tilt = 0.03 + steps(rng, n, -0.12, 0.13, 40) + sines(rng, n, 0.02, 0.03, 0.2, 2, 5)
        made.append(np.round(np.c_[led_in(pan), led_in(tilt)], 3))
        begins.append(np.array([rng.uniform(-0.4, 0.4), rng.uniform(-0.2, 0.2), 0, 0]))
    data = robot(
        "camera_gimbal", rng, sim, GIMBAL, made, begins, force, [0, 1], 0.01, grid=2 * np.pi / 8192,
        parts=["friction", "buffer"],
    )  # fmt: skip
    return sim, *data, "stribeck_friction@pan 0.045 to 0.06 N m + end_stop@tilt from 0.45 rad (power 1.4)"


ACCEPTED["camera_gimbal"] = [
    [f"{a}_friction@pan or @pan_motor of pan.vel" for a in ("stribeck", "coulomb", "asymmetric", "lugre")],
    ["end_stop@tilt or @tilt_motor of tilt.pos"],
]
NEAR["camera_gimbal"] = [
    "one of both alone, said to be partial",
    "hysteresis@pan of pan.pos or linear_loss@pan of pan.vel for the friction, said to be partial",
    "cubic_stiffness or power_law@tilt of tilt.pos for the buffer, said to be partial",
    "input_dead_zone@pan_motor for the friction, said to be partial",
]
WRONG["camera_gimbal"] = [
    "any friction at tilt",
    "sensor_saturation@tilt.pos",
    "an end_stop at pan",
    "input_saturation@tilt_motor",
]


# ------------------------------------------------------------------------------------------ an effect of no entry


@case
def pack_entropy(rng):
    """Cell and housing of a lithium-ion pack in a truck, degrees C, samples of 30 s; current in A, charge positive.

    The entropy of the cell takes heat up or gives it off with the sign of the current and the state of charge: i T dU/dT,
    with dU/dT from -0.35 to 0.25 mV/K along the charge. The simulator, a right-hand side, has the heat of R i^2.
    """
    p = {"R": 0.0012, "C": 1050.0, "h": 0.9, "Cc": 700.0, "hc": 1.6, "cap": 180000.0}

    def slope(s):  # V/K
        return 1e-3 * (-0.1 + 0.35 * np.tanh((s - 0.38) / 0.07) - 0.5 / (1 + ((s - 0.7) / 0.06) ** 2))

    def nom(t, x, u, p, entropy=0.0):  # charge 0 to 1, degrees C
        _, T, c = x
        over = p["h"] * (T - c)
        return (
            u[0] / p["cap"],
            (p["R"] * u[0] ** 2 + entropy - over) / p["C"],
            (over - p["hc"] * (c - u[1])) / p["Cc"],
        )

    def true(t, x, u, d, on):
        return nom(t, x, u, p, on[0] * u[0] * (x[1] + 273.15) * slope(x[0]))

    def plan(r):
        n, s = 600, [0.85, 0.2, 0.6, 0.5][r]
        current, k = np.zeros(n), 6
        while k < n:
            m = int(rng.integers(20, 70))
            a = rng.choice([-1, 1]) * rng.uniform(15, 75)
            a = -a if not 0.08 < s + a * 30 * m / p["cap"] < 0.95 else a
            a = 0.0 if not 0.08 < s + a * 30 * m / p["cap"] < 0.95 else a
            current[k : k + m] = np.round(a)
            s, k = s + a * 30 * len(current[k : k + m]) / p["cap"], k + m
        return np.c_[current, np.round(22 + steps(rng, n, -3, 3, 120), 1)], quiet(n)

    sim = ODESimulator(
        nom, states=["soc", "T", "case"], inputs=["current", "coolant"], outputs=["soc", "T", "case"], params=p, dt=30.0,
        x0=[0.5, 22.0, 22.0],
    )  # fmt: skip
    data = twin(
        "pack_entropy", rng, sim, true, plan, lambda r, u: [[0.85, 0.2, 0.6, 0.5][r], u[1], u[1]],
        see=lambda X, on: X, noise=[0.005, 0.015, 0.015], runs=4, scale=[1, 10, 10],
    )  # fmt: skip
    return sim, *data, "unknown at T (i T dU/dT, which turns its sign along the charge)"


ACCEPTED["pack_entropy"] = [["unknown"]]
NEAR["pack_entropy"] = [
    "linear_loss@T of current, said to be partial",
    "bilinear@T of current*soc, with linear_loss@T of current or without, said to be partial",
    "parameter_dependence@R on soc, said to be partial",
]
WRONG["pack_entropy"] = [
    "any name at case, coolant or soc",
    "a sensor effect",
    "input_curve, input_bias or input_gain@current said to be all",
    "parameter_error@R said to be all",
    "any of NEAR said to be all",
]


@case
def algae_pond(rng):
    """Algae in a raceway pond and its temperature, samples of half an hour, ten days; the probe has coloured noise.

    Algae shade each other: growth takes the mean of the light over the depth (Beer and Lambert, 0.2 m2/g). The simulator,
    a right-hand side, has the light of the surface at all depths.
    """
    p = {"mu": 0.055, "K": 160.0, "r": 0.006, "h": 0.09, "sun": 0.0025, "best": 27.0, "wide": 11.0}

    def warm(T, p):
        return np.exp(-(((T - p["best"]) / p["wide"]) ** 2))

    def nom(t, x, u, p, lost=0.0):  # g/m2 over 100, degrees C, 1/h; light in W/m2, dilution in 1/h, air in degrees C
        X, T = x
        grown = p["mu"] * u[0] / (p["K"] + u[0]) * warm(T, p) * X
        return grown - lost - (p["r"] + u[1]) * X, p["h"] * (u[2] - T) + p["sun"] * u[0]

    def true(t, x, u, d, on):
        X, T = x
        deep = 2.0 * X + 1e-9
        mean = np.log((p["K"] + u[0]) / (p["K"] + u[0] * np.exp(-deep))) / deep
        return nom(t, x, u, p, on[0] * p["mu"] * (u[0] / (p["K"] + u[0]) - mean) * warm(T, p) * X)

    def plan(r):
        n = 480
        hour = np.arange(n) / 2
        light = np.maximum(0, 700 * np.sin(2 * np.pi * (hour - 6) / 24) * (0.75 + 0.25 * coloured(rng, n, 0.95)))
        thin = np.clip(steps(rng, n, -0.008, 0.02, 40), 0, None)
        air = 22 + 2 * r + 5 * np.sin(2 * np.pi * (hour - 9) / 24) + coloured(rng, n, 0.98)
        return np.c_[np.round(light), np.round(thin, 4), np.round(air, 1)], quiet(n)

    sim = ODESimulator(
        nom, states=["X", "T"], inputs=["light", "dilution", "air"], outputs=["X", "T"], params=p, dt=0.5,
        x0=[0.5, 22.0],
    )  # fmt: skip
    data = twin(
        "algae_pond", rng, sim, true, plan, lambda r, u: [[0.3, 1.2, 0.6][r] * rng.uniform(0.9, 1.1), 21.0 + r],
        see=lambda X, on: X, noise=[0.03, 0.02], runs=3, scale=[1, 10], hum=0.7,
    )  # fmt: skip
    return sim, *data, "unknown at X (mean of the light over the depth)"


ACCEPTED["algae_pond"] = [["unknown"]]
NEAR["algae_pond"] = [
    "quadratic_loss or power_law@X of X, or bilinear@X of X*light, said to be partial",
    "parameter_dependence@mu on X (-) or @K on X (+), said to be partial",
    "parameter_error@mu (-) or @K (+), said to be partial",
]
WRONG["algae_pond"] = [
    "any name at T or air",
    "sensor_saturation or sensor_nonlinearity@X said to be all",
    "parameter_error@r or @mu said to be all",
    "linear_loss@X of X said to be all",
    "input_gain, input_lag or input_saturation@light said to be all",
]


@case
def mr_seat(rng):
    """Seat of a truck on a shaker, with a magnetorheological damper, samples of 10 ms; a step in Python.

    The fluid yields only above a force that grows with the current (0.25 + 1.1 N/kg at 1 A, smooth within 3 cm/s). The
    simulator, which has the acceleration of the floor as its input, knows a damping that grows with the current alone.
    """
    p = {"k": 95.0, "c": 2.2, "cI": 0.9}

    def nom(t, x, u, p, held=0.0):  # m, m/s of the seat over the floor; floor in m/s2, current in A
        return x[1], -u[0] - p["k"] * x[0] - (p["c"] + p["cI"] * u[1]) * x[1] - held

    def true(t, x, u, d, on):
        return nom(t, x, u, p, on[0] * (0.25 + 1.1 * u[1]) * np.tanh(x[1] / 0.03))

    def plan(r):
        n = 600
        floor = sines(rng, n, 0.01, 2.2 + 0.7 * r, 0.7, 4, 8) * np.minimum(1, np.arange(n) / 40)
        return np.c_[np.round(floor, 3), np.round(np.clip(steps(rng, n, -0.4, 1.5, 50), 0, None), 2)], quiet(n)

    sim = StepSimulator(
        rk4(nom, 4), states=["rel", "vr"], inputs=["floor", "current"], outputs=["rel", "vr"], params=p, dt=0.01
    )
    data = twin(
        "mr_seat", rng, sim, true, plan, lambda r, u: [rng.uniform(-0.02, 0.02), 0], see=lambda X, on: X, noise=0.015,
        runs=4, scale=[0.01, 0.1],
    )  # fmt: skip
    return sim, *data, "unknown at vr (friction whose level goes with the current)"


ACCEPTED["mr_seat"] = [
    ["unknown", "coulomb_friction, asymmetric_friction, stribeck_friction or lugre_friction@vr of vr, partial"]
]
NEAR["mr_seat"] = [
    "linear_loss or power_law@vr of vr, parameter_error@c or @cI (+), said to be partial",
    "bilinear@vr of current*vr, said to be partial",
]
WRONG["mr_seat"] = [
    "any friction@vr said to be all",
    "bilinear, linear_loss or parameter_error said to be all",
    "a name at floor or at a sensor",
    "hidden_mode or hidden_relaxation@vr said to be all",
]


# ------------------------------------------------------------------------------------------ no effect


@case
def none_mine_fan(rng):
    """Two airways of a mine behind one fan, flows in m3/s, samples of 2 s; nothing is missing.

    The draught of the shaft wanders with the weather (13 Pa, 0.99 from row to row). The simulator is a right-hand side.
    """
    p = {"L1": 9.0, "L2": 14.0, "R0": 0.035, "R1": 0.16, "R2": 0.09, "P": 1500.0, "s": 0.02}

    def nom(t, x, u, p, draught=0.0):  # Pa, kg/m4; fan 0 to 1, openings of two regulators 0 to 1
        a, b = x
        Q = a + b
        head = p["P"] * u[0] ** 2 - p["s"] * Q * Q - p["R0"] * Q * abs(Q) + draught
        return (
            (head - p["R1"] / (0.1 + u[1]) ** 2 * a * abs(a)) / p["L1"],
            (head - p["R2"] / (0.1 + u[2]) ** 2 * b * abs(b)) / p["L2"],
        )

    def true(t, x, u, d, on):
        return nom(t, x, u, p, d[0])

    def plan(r):
        n = 450
        fan, doors = 0.75 + steps(rng, n, -0.15, 0.2, 60), [0.6 + steps(rng, n, -0.35, 0.35, 45) for _ in range(2)]
        return np.round(np.c_[fan, *doors], 2), 13 * coloured(rng, n, 0.99)

    sim = ODESimulator(
        nom, states=["Q1", "Q2"], inputs=["fan", "door1", "door2"], outputs=["Q1", "Q2"], params=p, dt=2.0,
        x0=[50.0, 60.0],
    )  # fmt: skip
    data = twin(
        "none_mine_fan", rng, sim, true, plan,
        lambda r, u: settled(lambda x: nom(0, x, u, p), [50.0, 60.0], 400) * rng.uniform(0.9, 1.1, 2),
        see=lambda X, on: X, noise=0.015, runs=3, scale=10,
    )  # fmt: skip
    return sim, *data, "none (a draught that wanders)"


ACCEPTED["none_mine_fan"] = [[]]
NEAR["none_mine_fan"] = ["unknown or partial with a disturbance at Q1 and Q2 and no name"]
WRONG["none_mine_fan"] = ["any name"]


SCARA = """<mujoco><option timestep="0.005" integrator="RK4"/><worldbody><body name="upper" pos="0 0 0.5">
<joint name="shoulder" axis="0 0 1" damping="4.0"/>
<geom type="capsule" size="0.04" fromto="0 0 0 0.35 0 0" mass="4" contype="0" conaffinity="0"/>
<body name="fore" pos="0.35 0 0"><joint name="elbow" axis="0 0 1" damping="1.6"/>
<geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="2.5" contype="0" conaffinity="0"/>
<body name="part" pos="0.3 0 0"><geom type="sphere" size="0.04" mass="2.0" contype="0" conaffinity="0"/></body>
</body></body></worldbody>
<actuator><motor name="t1" joint="shoulder"/><motor name="t2" joint="elbow"/></actuator></mujoco>"""


@case
def none_scara(rng):
    """Assembly robot with two horizontal axes, torques in N m, angles, samples of 20 ms; nothing is missing.

    Parameters that are free: the damping of the shoulder 15 % high, the mass of the part 12 % low. The simulator is a
    model of MuJoCo.
    """
    start = {"shoulder.damping": 4.6, "elbow.damping": 1.6, "part.mass": 1.76}
    sim = MuJoCoSimulator(SCARA, outputs=["shoulder.pos", "elbow.pos"], params=start, dt=0.02)
    made, begins = [], []
    for r in range(3):
        n = 400
        t1 = sines(rng, n, 0.02, 6.0 + r, 0.15, 1.5, 6) * np.minimum(1, np.arange(n) / 20)
        t2 = sines(rng, n, 0.02, 2.2, 0.15, 2, 6) * np.minimum(1, np.arange(n) / 20)
        made.append(np.round(np.c_[t1, t2], 2))
        begins.append(np.array([0, rng.uniform(-0.8, 0.8), 0, 0]))
    data = robot(
        "none_scara",
        rng,
        sim,
        SCARA,
        made,
        begins,
        lambda q, v, u, on: ([0, 0], u),
        [0, 1],
        0.01,
        grid=2 * np.pi / 16384,
    )
    return sim, *data, "none (damping of the shoulder and mass of the part free, 15 % high and 12 % low)"


KW["none_scara"] = {"free_params": ["shoulder.damping", "part.mass"]}
ACCEPTED["none_scara"] = [
    ["parameter_error@shoulder.damping (-)", "(not needed)"],
    ["parameter_error@part.mass (+)", "(not needed)"],
]
NEAR["none_scara"] = []
WRONG["none_scara"] = ["any name but parameter_error@shoulder.damping and @part.mass"]


@case
def none_incubator(rng):
    """Infant incubator with its own controller, air and mattress, degrees C, samples of 30 s; nothing is missing.

    The simulator is a closed loop with a known controller. A twentieth of the readings is lost.
    """
    p = {"Ca": 9.0, "Cm": 22.0, "h": 0.022, "U": 0.016, "P": 0.4}

    def nom(t, x, u, p):  # kJ/K, kW; heater 0 to 1, room in degrees C
        a, m = x
        return (p["P"] * u[0] - p["U"] * (a - u[1]) - p["h"] * (a - m)) / p["Ca"], p["h"] * (a - m) / p["Cm"]

    box = ODESimulator(
        nom, states=["air", "bed"], inputs=["heater", "room"], outputs=["air", "bed"], params=p, dt=30.0,
        x0=[30.0, 29.0],
    )  # fmt: skip
    hand = StepSimulator(
        lambda t, x, u, p, dt: [x[0] + dt * 0.0008 * (u[0] - u[1])], states=["sum"], inputs=["aim", "air"],
        outputs=["heater"], output=lambda t, x, u, p: [np.clip(0.25 * (u[0] - u[1]) + x[0], 0, 1)], dt=30.0, x0=[0.2],
    )  # fmt: skip
    sim = ClosedLoopSimulator(box, hand, outputs=["air", "bed", "heater"])
    made, begins = [], []
    for r in range(3):
        n = 360
        aim = np.round(32 + r + steps(rng, n, -2, 2, 45), 1)
        made.append(np.c_[np.round(22 + steps(rng, n, -2, 2, 90) + 0.2 * coloured(rng, n, 0.98), 1), aim])
        begins.append(np.array([30.0, 29.0, 0.2]))

    def campaign(*on):
        out = []
        for U, start in zip(made, begins):
            x, s = start[:2], start[2]
            for room, aim in U:
                heat = np.clip(0.25 * (aim - x[0]) + s, 0, 1)
                out.append([*x, heat])
                s = s + 30 * 0.0008 * (aim - x[0])
                x = odeint(lambda t, x, heat=heat, room=room: nom(t, x, [heat, room], p), x, [0, 30], tfirst=True)[-1]
        return np.array(out)

    e = rng.normal(size=(sum(len(U) for U in made), 3))
    data = hand_in("none_incubator", rng, sim, made, begins, campaign, e, 0.02, grid=[0.05, 0.05, 0], drop=0.05)
    return sim, *data, "none"


ACCEPTED["none_incubator"] = [[]]
NEAR["none_incubator"] = ["sensor_quantization@air or @bed"]
WRONG["none_incubator"] = ["any other name"]


# ------------------------------------------------------------------------------------------ a parameter and an effect


@case
def cgm_patient(rng):
    """Glucose of a patient with a pump and a sensor below the skin, mg/dl, samples of 5 minutes, a day a run.

    The patient is less sensitive to insulin than the model says (p3 16 % less, not free), and the sensor reads the
    interstitial fluid (lags of 9 and 4 minutes). The simulator is Bergman's model with a gut, a right-hand side.
    """
    p = {"p1": 0.012, "p2": 0.025, "p3": 1.1e-5, "Gb": 130.0, "ke": 0.09, "V": 12.0, "ka": 0.028, "Vg": 130.0}

    def nom(t, x, u, p, weak=1.0):  # mg/dl, 1/min, mU/l, mg; insulin in mU/min over the basal rate, meal in mg/min
        G, X, I, q1, q2 = x
        return (
            -(p["p1"] + X) * G + p["p1"] * p["Gb"] + p["ka"] * q2 / p["Vg"],
            -p["p2"] * X + weak * p["p3"] * I,
            -p["ke"] * I + u[0] / p["V"],
            u[1] - p["ka"] * q1,
            p["ka"] * (q1 - q2),
        )

    def true(t, x, u, d, on):
        return *nom(t, x[:5], u, p, 0.84 if on[0] else 1.0), (x[0] - x[5]) / 9, (x[5] - x[6]) / 4

    def plan(r):
        n = 288
        insulin, meal = steps(rng, n, -5, 12, 30), np.zeros(n)
        for k in (rng.integers(15, 50), rng.integers(95, 140), rng.integers(190, 230)):
            carbs = rng.uniform(25, 70)
            meal[k : k + 3] += carbs * 1000 / 15
            insulin[k + int(rng.integers(-2, 4)) : k + 4] += carbs * 18
        return np.c_[led_in(np.round(insulin, 1), 3), np.round(meal)], quiet(n)

    sim = ODESimulator(
        nom, states=["G", "X", "I", "q1", "q2"], inputs=["insulin", "meal"], outputs=["cgm"], params=p, dt=5.0,
        x0=[130.0, 0, 0, 0, 0], output=lambda t, x, u, p: [x[0]],
    )  # fmt: skip

    data = twin(
        "cgm_patient", rng, sim, true, plan, lambda r, u: [130.0, 0, 0, 0, 0, 130.0, 130.0],
        see=lambda X, on: X[:, 6:7] if on[1] else X[:, :1], noise=0.015, runs=5, scale=[10, 1e-2, 10, 1e3, 1e3, 10, 10],
        grid=1.0, parts=["insulin", "sensor"],
    )  # fmt: skip
    return sim, *data, "parameter_error@p3 -0.16 + sensor_lag@cgm 13 min (9 and 4)"


ACCEPTED["cgm_patient"] = [
    ["parameter_error@p3 (-)", "input_gain@insulin (-)", "parameter_error@V (+)", "linear_loss@X of I (c > 0)"],
    ["sensor_lag@cgm", "sensor_delay@cgm with sensor_lag@cgm"],
]
NEAR["cgm_patient"] = [
    "one of both alone, said to be partial",
    "sensor_delay@cgm for the sensor",
    "parameter_error@p2 or @ke (+) for the patient",
]
WRONG["cgm_patient"] = [
    "sensor_gain or sensor_bias@cgm",
    "input_lag or input_delay@meal said to be all",
    "a law at G said to be all",
    "parameter_error@ka said to be all",
]


@case
def spin_ergometer(rng):
    """Bicycle ergometer with a flywheel and an eddy-current brake, rider's heart rate each 10 s, samples of a second.

    The spokes fan air (0.5 N m at 50 rad/s, power 1.8), and the flywheel is 17 % heavier than its sheet says (J, not
    free). The rider holds a cadence, in closed loop. The simulator, a step in Python, has brake and bearings.
    """
    p = {"J": 0.62, "b": 0.006, "km": 0.014, "wc": 140.0, "rest": 70.0, "beat": 0.42, "tau": 45.0}

    def nom(t, x, u, p, fan=0.0, J=1.0):  # rad/s, 1/min; torque at the flywheel in N m, current in A
        w, f = x
        brake = p["km"] * u[1] ** 2 * w / (1 + (w / p["wc"]) ** 2)
        return (u[0] - p["b"] * w - brake - fan) / (J * p["J"]), (p["rest"] + p["beat"] * u[0] * w - f) / p["tau"]

    def true(t, x, u, d, on):
        return nom(t, x, u, p, on[0] * 0.5 * (max(x[0], 0) / 50) ** 1.8, 1.17 if on[1] else 1.0)

    def plan(r):
        n = 400
        cadence = 42 + 3 * r + steps(rng, n, -18, 14, 15)
        amps = 2.4 + steps(rng, n, -1.2, 1.4, 25)
        return np.c_[cadence, led_in(np.round(amps, 1), 3)], quiet(n)

    def loop(y, row, memo):
        memo.setdefault("I", 3.0)
        asked = pi(row[0] - y[0], memo, 0.35, 0.02, 0, 11) + 0.2 * rng.normal()
        return [np.round(max(asked, 0), 2), row[1]]

    sim = StepSimulator(
        rk4(nom, 4), states=["w", "heart"], inputs=["torque", "current"], outputs=["w", "heart"], params=p, dt=1.0,
        x0=[25.0, 90.0],
    )  # fmt: skip
    data = twin(
        "spin_ergometer", rng, sim, true, plan, lambda r, u: [rng.uniform(15, 35), rng.uniform(80, 110)],
        see=lambda X, on: X, noise=[0.01, 0.03], runs=4, scale=10, every=[1, 10], grid=[0, 1.0], loop=loop, parts=["fan", "mass"],
    )  # fmt: skip
    return sim, *data, "quadratic_drag@w (0.5 N m at 50 rad/s, power 1.8) + parameter_error@J 0.17"


ACCEPTED["spin_ergometer"] = [
    ["quadratic_drag@w of w", "quadratic_loss@w of w", "power_law@w of w (exponent 1.3 to 2.5)"],
    ["parameter_error@J (+)"],
]
NEAR["spin_ergometer"] = [
    "one of both alone, said to be partial",
    "linear_loss@w of w or parameter_error@b (+) for the fan, said to be partial",
    "input_gain@torque (-) with parameter_error@km (-) for the flywheel",
]
WRONG["spin_ergometer"] = [
    "coulomb_friction@w said to be all",
    "input_lag or sensor_lag for the flywheel, said to be all",
    "any name at heart",
    "sensor_gain@w",
]


def main(known=ACCEPTED, seed=71):
    """Print the checks of the cases that were asked for."""
    import argparse
    import time
    import zlib

    parser = argparse.ArgumentParser(description="Sizes of the gaps, over the noise.")
    parser.add_argument("names", nargs="*", default=list(known))
    parser.add_argument("--seed", type=int, default=seed)
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
