"""Twenty plants whose records are messy, as measured ones are: a main effect (or two, or none) and a rest that no one would name.

``ACCEPTED``, ``NEAR`` and ``NOISE`` are as in ``physical_plants_si``: the names were fixed by engineering judgement before any
diagnosis ran. ``NOISE`` is the white part of the noise only. The rest of each plant is two to four of: a sensor that is a little
bent, a disturbance that wanders, rounding, an input that acts 0.2 sample late, a parameter that is about 1 % off, a fast pole,
coloured noise, spikes, steps of an actuator. ``CLOSED`` are recorded in closed loop, ``ONE_RUN`` in one run, ``SLOW`` a little
slowly. ``CHECK[name]()``, after the case is built, returns what the nominal simulator, the nominal model with the main effects
alone, and the plant without noise do.
"""

import numpy as np
from physical_plants import KW, case, sines, steps
from physical_plants_si import coloured, kink
from scipy.integrate import odeint

from sksurrogate.physics import ODESimulator

ACCEPTED, NEAR, NOISE, CHECK = {}, {}, {}, {}
CLOSED = ["muffle_furnace", "ship_steering", "peltier_stage", "belt_conveyor", "none_water_heater"]
ONE_RUN = ["wind_tunnel_fan", "pump_station", "ship_steering", "district_heating_pipe", "syringe_pump", "well_drawdown"]
SLOW = ["pneumatic_cylinder", "reflow_oven"]
FINE = 5  # parts of a sample


def straight(H, j):
    """The input of the fine moment j."""
    return H[max(j, 0)]


def play(rhs, x, U, D, dt, scale, pipe=straight, late=0, control=None, reading=None):
    """States at the samples. ``control(y, row, memo)`` writes each row of U from a reading; inputs act ``late`` fifths late."""
    n, X, memo, size = len(U), [], {}, 1e-8 * np.asarray(scale, float)
    H = np.repeat(U, FINE, axis=0)
    for k in range(n):
        if control:
            U[k] = control(reading(x, k), U[k], memo)
            H[FINE * k : FINE * (k + 1)] = U[k]
        X.append(x)
        V = [pipe(H, FINE * k + j - late) for j in range(FINE)]
        j = 0
        while j < FINE and k < n - 1:
            last = j + 1
            while last < FINE and np.array_equal(V[last], V[j]):
                last += 1
            span = [(k + j / FINE) * dt, (k + last / FINE) * dt]
            x = odeint(
                lambda t, x, u, d: rhs(t, x, u, d),
                x,
                span,
                (V[j], D[k]),
                tfirst=True,
                rtol=1e-7,
                atol=size,
                mxstep=5000,
            )[-1]
            j = last
    return np.array(X)


def measure(
    name,
    rng,
    sim,
    main,
    true,
    plan,
    start,
    *,
    see,
    noise,
    runs=1,
    order=None,
    lens=None,
    worn=None,
    control=None,
    pipe=straight,
    late=0,
    grid=0.0,
    spikes=0,
    hum=0.0,
    scale=1.0,
):
    """Inputs, readings and runs of a plant.

    ``main(t, x, u)`` is the nominal model with the main effects (the first ``order`` states), ``true(t, x, u, d)`` has the rest
    too; ``plan(r)`` gives inputs and hidden disturbances of run r. ``see`` are the states that the sensors follow, ``lens`` is a
    main effect of a sensor, ``worn`` its share of the rest; ``grid`` is the resolution, ``hum`` coloured over white noise.
    """
    made = [plan(r) for r in range(runs)]
    made = [(U if U.ndim == 2 else U[:, None], D if D.ndim == 2 else D[:, None]) for U, D in made]
    begins = [np.asarray(start(r, made[r][0][0]), float) for r in range(runs)]
    wish = [U.copy() for U, _ in made]
    order = order or len(begins[0])
    lens, worn = lens or (lambda Y: Y), worn or (lambda Y: Y)
    e = [rng.normal(size=(len(U), len(see))) for U, _ in made]
    if hum:
        e = [a + hum * np.array([coloured(rng, len(a)) for _ in see]).T for a in e]

    def campaign(sd):
        out = []
        for (U, D), x, w, b in zip(made, begins, wish, e):
            U[:] = w

            def reading(x, k, b=b):
                return worn(lens(x[None, see]))[0] + sd * b[k]

            out.append(worn(lens(play(true, x, U, D, sim.dt, scale, pipe, late, control, reading)[:, see])))
        return np.vstack(out)

    clean = campaign(0.0)
    if control:
        clean = campaign(noise * clean.std(0))
    sd = noise * clean.std(0)
    Y = clean + sd * np.vstack(e)
    for k in rng.integers(5, len(Y), spikes):
        j = rng.integers(len(see))
        Y[k, j] += rng.choice([-1, 1]) * 15 * sd[j]
    step = np.broadcast_to(grid, len(see))
    Y = np.where(step > 0, np.round(Y / np.where(step > 0, step, 1)) * step, Y)
    g = np.repeat(np.arange(runs), [len(U) for U, _ in made])

    def check():
        some = [
            lens(
                play(
                    lambda t, x, u, d: main(t, x, u),
                    x[:order],
                    U.copy(),
                    D,
                    sim.dt,
                    np.broadcast_to(scale, len(x))[:order],
                    pipe,
                )[:, see]
            )
            for (U, D), x in zip(made, begins)
        ]
        ns = len(sim.states)
        nominal = [sim.simulate(U, x0=x[:ns]) for (U, _), x in zip(made, begins)]
        return {"nominal": np.vstack(nominal), "main": np.vstack(some), "clean": clean, "sd": sd, "readings": Y}

    NOISE[name], CHECK[name] = noise, check
    return np.vstack([U for U, _ in made]), Y, g


def settled(f, x, span):
    """Where x' = f(x) has come to rest after ``span``."""
    return odeint(lambda t, x: f(x), x, [0, span], tfirst=True, mxstep=50000)[-1]


def pi(e, memo, kp, ki, low, high):
    """One step of a PI controller that does not wind up; ``ki`` per sample."""
    asked = memo.get("I", 0.0) + kp * e
    if low < asked < high or e * asked < 0:
        memo["I"] = memo.get("I", 0.0) + ki * e
    return float(np.clip(asked, low, high))


# ------------------------------------------------------------------------------------------------ one main effect


@case
def wind_tunnel_fan(rng):
    """Fan and air speed of a wind tunnel, one run. Main: the screen clogs with the air that passed. Rest: gusts at the outlet, Pitot tube 0.4 % bent, display of 1 rpm, two spikes."""
    p = {"T": 6.0, "a": 7.4, "K": 0.667, "L": 42.0}

    def nom(t, x, u, p, K=None):
        n, w = x
        return (u[0] - n) / p["T"], (p["a"] * (n / 100) ** 2 - (p["K"] if K is None else K) * w * abs(w)) / p["L"]

    def main(t, x, u, gust=0.0):
        n, w, dust = x
        d = nom(t, [n, w], u, p, p["K"] * (1 + 0.2 * dust / (1 + 0.5 * dust)))
        return d[0], d[1] + gust / p["L"], w / 22 / 1000

    def plan(r):
        return np.round(steps(rng, 1300, 450, 1000, 50) / 10) * 10, 12.0 * coloured(rng, 1300, 0.97)

    sim = ODESimulator(
        nom, states=["n", "w"], inputs=["rpm_set"], outputs=["n", "w"], params=p, dt=1.0, x0=[600.0, 20.0]
    )
    data = measure(
        "wind_tunnel_fan",
        rng,
        sim,
        main,
        lambda t, x, u, d: main(t, x, u, d[0]),
        plan,
        lambda r, u: [u[0], u[0] / 100 * np.sqrt(7.4 / 0.667), 0],
        see=[0, 1],
        noise=0.02,
        grid=[1, 0.01],
        spikes=2,
        worn=lambda Y: Y + np.c_[0 * Y[:, 0], 0.004 * (Y[:, 1] - 22) ** 2 / 10],
    )
    return sim, *data, "parameter_drift@K (+ 0.2 per 1000 s at first, then slower, faster with more air)"


ACCEPTED["wind_tunnel_fan"] = [
    ["parameter_drift@K", "parameter_drift@a (c < 0)", "parameter_drift@L with parameter_drift@K"]
]
NEAR["wind_tunnel_fan"] = [
    "drift@w (grows in time, not with the speed)",
    "sensor_drift@w",
    "parameter_step@K or @a",
    "parameter_error@K or @a",
]


@case
def radiator_room(rng):
    """Radiator and room. Main: the radiator gives heat with the power 1.3 of its excess (EN 442). Rest: people and sun of 19 W, burner in steps of 5 %, display of 0.1 K, losses 0.5 % off."""
    p = {"UA": 24.0, "H": 42.0, "Cw": 1.6e5, "Cr": 1.2e6}

    def nom(t, x, u, p, UA=None):
        q = (p["UA"] if UA is None else UA) * (x[0] - x[1])
        return (1000 * u[0] - q) / p["Cw"], (q - p["H"] * (x[1] - u[1])) / p["Cr"]

    def main(t, x, u, p=p):
        return nom(t, x, u, p, 24 * (kink(x[0] - x[1], 1.0) / 42) ** 0.3)

    def true(t, x, u, d):
        a, b = main(t, x, u, dict(p, H=42.2))
        return a, b + d[0] / p["Cr"]

    def plan(r):
        q = np.round(np.clip(steps(rng, 180, -0.3, 2.0 - 0.2 * r, 18), 0, 2) / 0.1) * 0.1
        return np.c_[q, 4 + sines(rng, 180, 300, 3, 1e-5, 6e-5, 4)], 19 * coloured(rng, 180, 0.95)

    sim = ODESimulator(
        nom,
        states=["Tw", "Ta"],
        inputs=["burner_kW", "Tout"],
        outputs=["Tw", "Ta"],
        params=p,
        dt=300.0,
        x0=[45.0, 20.0],
    )
    data = measure(
        "radiator_room",
        rng,
        sim,
        main,
        true,
        plan,
        lambda r, u: [40 + 4 * r, 19.5 + 0.4 * r],
        see=[0, 1],
        runs=5,
        noise=0.01,
        grid=[0.1, 0.1],
    )
    return sim, *data, "parameter_dependence@UA on Tw (power 1.3 of Tw - Ta)"


ACCEPTED["radiator_room"] = [["parameter_dependence@UA on Tw", "law@Tw and Ta of Tw, Ta (or of their difference)"]]
NEAR["radiator_room"] = [
    "quadratic_loss, power_law, linear_loss, exchange@Tw, said to be partial (the room is not explained)",
    "parameter_error@UA, said to be partial",
    "parameter_dependence@UA on burner_kW",
    "parameter_dependence@Cw on Tw",
]


@case
def pump_station(rng):
    """Well, pump and water tower, one run. Main: a crack of the tower leaks, and opens with the pressure (FAVAD). Rest: meter of the demand 0.4 % off, level probe bent by 0.3 %, levels shown in cm, pump in steps of 50 rpm."""
    p = {"A1": 60.0, "A2": 120.0, "H0": 42.0, "Hs": 22.0, "k": 0.0022}

    def nom(t, x, u, p, leak=0.0):
        rise = p["H0"] * (u[0] / 1450) ** 2 - p["Hs"] - x[1] + x[0]
        q = np.sqrt(np.maximum(rise, 0 * rise + 1e-3) / p["k"])
        return (u[1] - q) / (60 * p["A1"]), (q - u[2] - leak) / (60 * p["A2"])

    def main(t, x, u):
        h = max(x[1], 0.0)
        return nom(t, x, u, p, 1.1 * (0.45 + 0.13 * h) * np.sqrt(h))

    def true(t, x, u, d):
        return main(t, x, [u[0], u[1] + d[0], u[2] * 1.004])

    def plan(r):
        n, h1, h2, fill, rows = 1400, 4.0, 4.0, True, []
        demand, extra = steps(rng, n, 35, 110, 45), steps(rng, n, -14, 14, 40)
        for k in range(n):  # the operator's plan of the day before, from a rough balance
            fill = h2 < 6.3 if fill else h2 < 2.6
            aim = demand[k] + (28 if fill else -28)
            rpm = 50 * np.round(1450 * np.sqrt((22 + h2 - h1 + 0.0022 * max(aim, 20) ** 2) / 42) / 50)
            q = np.sqrt(max(42 * (rpm / 1450) ** 2 - 22 - h2 + h1, 1e-3) / 0.0022)
            supply = max(q + extra[k] + 6 * (4 - h1), 0)
            h1, h2 = h1 + (supply - q) / 3600, h2 + (q - demand[k] - 1.6) / 7200
            rows.append([rpm, np.round(supply), np.round(demand[k], 1)])
        return np.array(rows), 0.8 * coloured(rng, n, 0.98)

    sim = ODESimulator(
        nom,
        states=["h1", "h2"],
        inputs=["rpm", "supply", "demand"],
        outputs=["h1", "h2"],
        params=p,
        dt=1.0,
        x0=[4.0, 4.0],
    )
    data = measure(
        "pump_station",
        rng,
        sim,
        main,
        true,
        plan,
        lambda r, u: [4, 4],
        see=[0, 1],
        noise=0.03,
        grid=0.01,
        worn=lambda Y: Y + 0.003 * (Y - 4) ** 2 / 2,
    )
    return sim, *data, "power_law@h2 (about 1, between 0.5 and 1.5), 1 to 4 m3/h"


ACCEPTED["pump_station"] = [
    ["power_law@h2", "linear_loss@h2", "sqrt_leak@h2", "quadratic_loss@h2", "quadratic_drag@h2"]
]
NEAR["pump_station"] = [
    "constant_bias@h2 (a leak without its law)",
    "input_bias@demand or input_gain@demand (more water goes out than is metered)",
    "the same laws @h1",
    "drift@h2",
]


@case
def ebike_drive(rng):
    """Speed of an electric bicycle. Main: the iron of the hub motor saturates. Rest: head wind that wanders, speed shown in 0.1 km/h, current acts 0.2 sample late, grade sensor 2 % off."""
    p = {"m": 105.0, "kf": 3.5, "Crr": 0.007, "cd": 0.33}

    def nom(t, x, u, p, push=None, wind=0.0):
        v = x[0] / 3.6 + wind
        force = p["kf"] * u[0] if push is None else push
        return (3.6 * (force / p["m"] - 9.81 * (p["Crr"] + u[1] / 100) - p["cd"] * v * abs(v) / p["m"]),)

    def push(i):
        return 3.5 * 26 * np.arcsinh(i / 13) / 2

    def plan(r):
        amps = steps(rng, 240, 6, 14 + 3 * r, 14)
        return np.c_[amps, sines(rng, 240, 1.0, 0.7, 0.004, 0.03, 4)], 0.4 * coloured(rng, 240, 0.95)

    sim = ODESimulator(nom, states=["v"], inputs=["amps", "grade"], outputs=["v"], params=p, dt=1.0, x0=[20.0])
    data = measure(
        "ebike_drive",
        rng,
        sim,
        lambda t, x, u: nom(t, x, u, p, push(u[0])),
        lambda t, x, u, d: nom(t, x, [u[0], 1.02 * u[1]], p, push(u[0]), d[0]),
        plan,
        lambda r, u: [18 + 2 * r],
        see=[0],
        runs=4,
        noise=0.025,
        grid=0.1,
        late=1,
    )
    return sim, *data, "input_curve or input_saturation@amps (asinh: 3 % less at 10 A, 15 % at 23 A)"


ACCEPTED["ebike_drive"] = [
    [
        "input_curve@amps (c < 0)",
        "input_saturation@amps",
        "parameter_dependence@kf on amps (c < 0)",
        "quadratic_loss@v of amps",
        "quadratic_drag@v of amps",
        "power_law@v of amps",
    ]
]
NEAR["ebike_drive"] = [
    "input_gain@amps (c < 0) or parameter_error@kf, said to be partial",
    "end_stop@v of amps",
    "quadratic_drag or power_law@v of v (a loss that rises with the speed)",
    "parameter_error@cd",
]


@case
def muffle_furnace(rng):
    """Furnace with its controller, in degrees C. Main: the peephole radiates. Rest: mains wander by 1 %, thermocouple bent by 0.3 %, shown in whole degrees; loss H free, 3 % off."""
    p = {"C": 9.0, "Cw": 40.0, "G": 0.008, "H": 0.004}

    def nom(t, x, u, p):
        q = p["G"] * (x[0] - x[1])
        return (u[0] - q) / p["C"], (q - p["H"] * (x[1] - 22)) / p["Cw"]

    def main(t, x, u):
        a, b = nom(t, x, u, p)
        return a - 2.1e-13 * ((x[0] + 273.15) ** 4 - 295.0**4) / p["C"], b

    def plan(r):
        goal = 50 * np.round(steps(rng, 300, 350, 800 + 40 * r, 60) / 50)
        return goal, 0.016 * coloured(rng, 300, 0.97)

    def control(y, row, memo):
        return [np.round(pi(row[0] - y[0], memo, 0.02, 0.0004, 0, 6), 2)]

    sim = ODESimulator(
        nom, states=["T", "W"], inputs=["kW"], outputs=["T"], params=dict(p, H=0.00412), dt=20.0, x0=[22.0, 22.0]
    )
    data = measure(
        "muffle_furnace",
        rng,
        sim,
        main,
        lambda t, x, u, d: main(t, x, [u[0] * (1 + d[0])]),
        plan,
        lambda r, u: [22, 22],
        see=[0],
        runs=4,
        noise=0.01,
        grid=1.0,
        control=control,
        worn=lambda Y: Y + 0.003 * Y * (Y - 600) / 600,
    )
    return sim, *data, "radiation@T (0.23 kW at 750 degrees C, 0.07 at 500); H free"


KW["muffle_furnace"] = {"free_params": ["H"]}
ACCEPTED["muffle_furnace"] = [
    [
        "power_law@T",
        "quadratic_loss@T",
        "quadratic_drag@T",
        "cubic_stiffness@T",
        "radiation@T",
        "parameter_dependence@G on T",
        "end_stop@T",
        "radiation@T of W",
        "power_law@kW of T",
    ],
]
NEAR["muffle_furnace"] = [
    "linear_loss@T (a loss that is missing, not its law)",
    "exchange@T of W",
    "parameter_error@G or parameter_dependence@H on T or W",
    "the same laws @W",
    "input_curve@kW (c < 0)",
]


@case
def wine_fermenter(rng):
    """Yeast, sugar and alcohol of six vats. Main: alcohol slows the yeast. Rest: temperature at the yeast differs by 0.75 K (wanders), refractometer bent by 0.5 %, sugar shown in 0.5 g/l, yield 1 % off."""
    p = {"mu": 0.055, "Ks": 12.0, "Y": 0.042}

    def nom(t, x, u, p, live=1.0):
        S = np.maximum(x[1], 0 * x[1])
        grow = p["mu"] * (1 + 0.05 * (u[0] - 20)) * S / (p["Ks"] + S) * x[0] * live
        return grow, -grow / p["Y"], 0.47 * grow / p["Y"]

    def main(t, x, u, p=p):
        return nom(t, x, u, p, 1 - (max(x[2], 0) / 150) ** 1.4)

    def plan(r):
        return np.round(steps(rng, 65, 17, 23, 12), 1), 0.75 * coloured(rng, 65, 0.9)

    sim = ODESimulator(
        nom, states=["X", "S", "E"], inputs=["T"], outputs=["X", "S"], params=p, dt=3.0, x0=[0.3, 210.0, 0.0]
    )
    data = measure(
        "wine_fermenter",
        rng,
        sim,
        main,
        lambda t, x, u, d: main(t, x, [u[0] + d[0]], dict(p, Y=0.0424)),
        plan,
        lambda r, u: [0.3 + 0.04 * r, 245 - 14 * ((3 * r) % 6), 0],
        see=[0, 1],
        runs=6,
        noise=0.012,
        grid=[0.0, 0.5],
        worn=lambda Y: Y + np.c_[0 * Y[:, 0], 0.005 * Y[:, 1] * (1 - Y[:, 1] / 240) * 2],
    )
    return sim, *data, "parameter_dependence@mu on E or S (1 - (E / 150)^1.4)"


ACCEPTED["wine_fermenter"] = [
    [
        "parameter_dependence@mu on E (c < 0)",
        "parameter_dependence@mu on S (c > 0)",
        "law@X and S of X, S or E",
        "bilinear@X of E*X with a law@S",
    ],
]
NEAR["wine_fermenter"] = [
    "parameter_dependence@mu on X",
    "parameter_dependence@Ks on E or S",
    "parameter_error@mu or parameter_drift@mu, said to be partial",
    "bilinear@X of E*X or X*S or linear_loss/quadratic_loss@X alone",
    "parameter_error@Ks",
]


@case
def ship_steering(rng):
    """Heading of a coaster with its autopilot, one run. Main: the steering gear turns by 1.7 degrees/s at most. Rest: waves and wind, compass in 0.1 degree, whole degrees of rudder, Nomoto gain 1 % off."""
    p = {"K": 0.045, "T": 22.0}

    def nom(t, x, u, p):
        return x[1], (p["K"] * u[0] - x[1]) / p["T"]

    def main(t, x, u, p=p):
        return *nom(t, x[:2], [x[2]], p), 1.7 * np.tanh((u[0] - x[2]) / 1.5)

    def true(t, x, u, d):
        a, b, c = main(t, x, u, dict(p, K=0.0454))
        return a, b + d[0], c

    def plan(r):
        wind = 0.0007 * coloured(rng, 1400, 0.96)
        return 5 * np.round(steps(rng, 1400, -35, 35, 55) / 5), wind + 0.0015 * np.sin(0.61 * np.arange(1400))

    def control(y, row, memo):
        return [np.round(np.clip(1.6 * (row[0] - y[0]) - 16 * y[1], -30, 30))]

    sim = ODESimulator(nom, states=["psi", "r"], inputs=["rudder"], outputs=["psi", "r"], params=p, dt=1.0)
    data = measure(
        "ship_steering",
        rng,
        sim,
        main,
        true,
        plan,
        lambda r, u: [0, 0, 0],
        see=[0, 1],
        noise=0.02,
        grid=[0.1, 0.0],
        control=control,
    )
    return sim, *data, "rate_limit@rudder 1.7 (soft within 1.5 degrees)"


ACCEPTED["ship_steering"] = [["rate_limit@rudder"]]
NEAR["ship_steering"] = ["input_lag@rudder, said to be partial", "input_delay@rudder, said to be partial"]


@case
def loudspeaker_woofer(rng):
    """Cone of a woofer. Main: surround and spider harden. Rest: the coil leaves the gap a little, laser bent by 0.4 %, eddy currents (a pole of 0.05 ms), coloured noise."""
    p = {"M": 0.03, "k": 2.5, "b": 1.8, "Bl": 7.0, "R": 6.0, "L": 0.6}

    def nom(t, x, u, p, k=1.0, Bl=1.0):  # mm, mm/s, A; L in mH
        y, v, i = x
        force = p["Bl"] * Bl * i - p["k"] * k * y - p["b"] * v / 1000
        return v, 1000 * force / p["M"], 1000 * (u[0] - p["R"] * i - p["Bl"] * Bl * v / 1000) / p["L"]

    def stiff(y):
        return 1 + 0.4 * (np.abs(y - 0.15) / 5) ** 2.4

    def true(t, x, u, d):
        return *nom(t, x[:3], [x[3]], p, stiff(x[0]), 1 - 0.006 * (x[0] - 0.2) ** 2), (u[0] - x[3]) / 5e-5

    def plan(r):
        return sines(rng, 400, 5e-4, 5.5 + 1.5 * r, 15, 95, 7), np.zeros(400)

    sim = ODESimulator(nom, states=["y", "v", "i"], inputs=["volts"], outputs=["y", "i"], params=p, dt=5e-4)
    data = measure(
        "loudspeaker_woofer",
        rng,
        sim,
        lambda t, x, u: nom(t, x, u, p, stiff(x[0])),
        true,
        plan,
        lambda r, u: [0, 0, 0, 0],
        see=[0, 2],
        order=3,
        runs=4,
        noise=0.015,
        hum=0.6,
        scale=[1, 100, 1, 1],
        worn=lambda Y: Y + np.c_[0.004 * Y[:, 0] ** 2 / 5, 0 * Y[:, 1]],
    )
    return sim, *data, "cubic_stiffness@v of y (power 3.4, centre at 0.15 mm)"


ACCEPTED["loudspeaker_woofer"] = [
    ["cubic_stiffness@v of y", "power_law@v of y (exponent 2 to 5)", "quadratic_drag@v of y"]
]
NEAR["loudspeaker_woofer"] = [
    "end_stop@v of y (one side)",
    "parameter_error@k (+), said to be partial",
    "linear_loss@v of y",
]


@case
def district_heating_pipe(rng):
    """Substation and building at the end of a pipe, one run. Main: the water needs its way through the pipe (plug flow). Rest: pipe wall of 20 s, pipe loses 0.1 %, outdoor sensor wanders, displays of 0.1 and 0.05 K."""
    p = {"V": 2.0, "g": 0.02, "gb": 0.006, "l": 0.003}

    def nom(t, x, u, p):  # minutes, m3/h
        return (
            u[1] / 60 / p["V"] * (u[0] - x[0]) - p["g"] * (x[0] - x[1]),
            p["gb"] * (x[0] - x[1]) - p["l"] * (x[1] - u[2]),
        )

    def true(t, x, u, d):
        return *nom(t, x[:2], [x[2] - 0.001 * (x[2] - 10), u[1], u[2] + d[0]], p), (u[0] - x[2]) / 0.35

    def pipe(H, j):  # the supply that entered 0.27 m3 ago; flow and weather act at once
        k, left = j, 0.27
        while left > 0 and k > 0:
            k, left = k - 1, left - H[k, 1] / 60 / FINE
        return np.r_[H[max(k, 0), 0], H[max(j, 0), 1:]]

    def plan(r):
        n = 1400
        U = np.c_[
            np.round(steps(rng, n, 62, 92, 35)),
            np.round(steps(rng, n, 3.1, 4.3, 70), 1),
            2 + sines(rng, n, 1, 3, 5e-4, 3e-3, 3),
        ]
        return U, 0.25 * coloured(rng, n, 0.98)

    sim = ODESimulator(
        nom, states=["T1", "T2"], inputs=["Ts", "flow", "Tout"], outputs=["T1", "T2"], params=p, dt=1.0, x0=[65.0, 45.0]
    )
    data = measure(
        "district_heating_pipe",
        rng,
        sim,
        lambda t, x, u: nom(t, x, u, p),
        true,
        plan,
        lambda r, u: [*settled(lambda x: nom(0, x, u, p), [65, 45], 5000), u[0]],
        see=[0, 1],
        order=2,
        noise=0.03,
        grid=[0.1, 0.05],
        pipe=pipe,
        late=0,
    )
    return sim, *data, "input_delay@Ts 4.4 min (3.8 to 5.2 with the flow)"


ACCEPTED["district_heating_pipe"] = [["input_delay@Ts"]]
NEAR["district_heating_pipe"] = [
    "input_lag@Ts, said to be partial",
    "sensor_delay or sensor_lag@T1",
    "hidden_relaxation@T1 of Ts",
    "rate_limit@Ts",
]


@case
def syringe_pump(rng):
    """Syringe, tube and needle, one run. Main: play of the screw, with a nut that yields. Rest: area 0.8 % off, bubble (the tube is softer at low pressure), scale in 0.1 mg, coloured noise."""
    p = {"A": 60.0, "C": 2.0, "R": 0.8, "Tp": 0.4}

    def nom(t, x, u, p, x_p=None, C=1.0):  # microlitres, kPa, mm, s
        P = (p["A"] * (u[0] if x_p is None else x_p) - x[0]) / (p["C"] * C)
        return P / p["R"], (P - x[1]) / p["Tp"]

    def main(t, x, u, p=p, C=1.0):
        e = u[0] - x[2]
        grip = kink(e - 0.018, 0.0012) - kink(-e - 0.018, 0.0012)
        return *nom(t, x[:2], u, p, x[2], C), 9 * grip

    def true(t, x, u, d):
        return main(t, x, u, dict(p, A=60.5), 1 + 0.08 * np.exp(-x[1] / 2))

    def plan(r):
        speed = np.clip(steps(rng, 1000, -0.09, 0.09, 22), -0.06, 0.06)
        speed[:8] = 0.0
        path = np.cumsum(speed) * 0.25
        turned = 2.4 - np.abs((path + 1.2) % 4.8 - 2.4) - 1.2  # turns at the ends of its way
        return np.round(turned, 4), np.zeros(1000)

    sim = ODESimulator(nom, states=["V", "P"], inputs=["plunger"], outputs=["V", "P"], params=p, dt=0.25)
    data = measure(
        "syringe_pump",
        rng,
        sim,
        main,
        true,
        plan,
        lambda r, u: [0, 0, 0],
        see=[0, 1],
        noise=0.006,
        hum=0.5,
        grid=[0.1, 0.0],
        scale=[1, 1, 0.01],
    )
    return sim, *data, "input_backlash@plunger 0.018 mm (soft: 0.11 s)"


ACCEPTED["syringe_pump"] = [["input_backlash@plunger", "hysteresis@V of plunger", "hysteresis@plunger of V"]]
NEAR["syringe_pump"] = [
    "input_lag@plunger or input_delay@plunger, said to be partial",
    "coulomb_friction@V",
    "input_dead_zone@plunger",
]


@case
def belt_conveyor(rng):
    """Belt with its speed controller. Main: the hopper opens at 60 s and the belt fills within 9 s. Rest: lumps, moved mass 5 % more when full, whole percent of torque, torque acts 0.2 sample late; b free, 2 % off."""
    p = {"m": 1800.0, "b": 260.0, "F0": 700.0, "kF": 20.0, "T": 0.4}

    def nom(t, x, u, p, extra=0.0, m=1.0):
        return (x[1] - p["b"] * x[0] - p["F0"] - extra) / (p["m"] * m), (p["kF"] * u[0] - x[1]) / p["T"]

    def load(t, full=75.0):
        return full * np.clip((t - 60) / 9, 0, 1)

    def true(t, x, u, d):
        return nom(t, x, u, p, load(t) * (1 + d[0]), 1 + 0.0007 * load(t))

    def plan(r):
        return steps(rng, 240, 1.1, 1.6 + 0.15 * r, 45), 0.3 * coloured(rng, 240, 0.95)

    def control(y, row, memo):
        memo.setdefault("I", 52.0)
        return [np.round(pi(row[0] - y[0], memo, 60, 3, 0, 100))]

    sim = ODESimulator(
        nom, states=["v", "F"], inputs=["torque"], outputs=["v"], params=dict(p, b=265.0), dt=0.5, x0=[1.3, 1038.0]
    )
    data = measure(
        "belt_conveyor",
        rng,
        sim,
        lambda t, x, u: nom(t, x, u, p, load(t)),
        true,
        plan,
        lambda r, u: [1.3, 1038],
        see=[0],
        runs=5,
        noise=0.03,
        control=control,
        late=1,
        scale=[1, 100],
    )
    return sim, *data, "step_disturbance@v -0.042 at 60 s (ramp of 9 s); b free"


KW["belt_conveyor"] = {"free_params": ["b"]}
ACCEPTED["belt_conveyor"] = [
    [
        "step_disturbance@v",
        "parameter_step@F0",
        "step_disturbance@torque",
        "step_disturbance@F",
        "parameter_step@kF (c < 0)",
    ],
]
NEAR["belt_conveyor"] = ["parameter_step@b (right time)", "drift@v", "parameter_drift@F0, @kF or @b"]


@case
def well_drawdown(rng):
    """Drawdown in a pumped well, one run. Main: the ground around gives its water back slowly (three shells). Rest: air pressure, level in cm, turbulence at the screen, pump in whole m3/h; G free, 2 % off."""
    p = {"A": 0.35, "G": 12.4}

    def nom(t, x, u, p):  # minutes, m3/h, m
        return ((u[0] - p["G"] * x[0]) / (60 * p["A"]),)

    def main(t, x, u, turbulent=0.0, air=0.0):
        s, a, b = x
        q = 30 * (s - a - turbulent * abs(s - a) * (s - a))
        return (u[0] - q) / 21, (q - 45 * (a - b)) / (60 * 4), (45 * (a - b) - 40 * (b - air)) / (60 * 14)

    def plan(r):
        return np.round(steps(rng, 720, 6, 38, 26)), 0.085 * coloured(rng, 720, 0.985)

    sim = ODESimulator(nom, states=["s"], inputs=["Q"], outputs=["s"], params=dict(p, G=12.6), dt=1.0, x0=[1.0])
    data = measure(
        "well_drawdown",
        rng,
        sim,
        main,
        lambda t, x, u, d: main(t, x, u, 0.04, d[0]),
        plan,
        lambda r, u: settled(lambda x: main(0, x, u), [1, 1, 1], 3000),
        see=[0],
        noise=0.02,
        grid=0.01,
    )
    return sim, *data, "hidden_relaxation@s of s (8 and 15 min); G free"


KW["well_drawdown"] = {"free_params": ["G"]}
ACCEPTED["well_drawdown"] = [
    ["hidden_relaxation@s of s", "hidden_relaxation@Q of s", "hidden_relaxation@s of Q", "hidden_relaxation@Q of Q"],
]
NEAR["well_drawdown"] = [
    "input_lag@Q, said to be partial",
    "parameter_error@A (+), said to be partial",
    "sensor_lag@s",
    "hidden_mode@s",
]


# ------------------------------------------------------------------------------------------------ two main effects


@case
def pneumatic_cylinder(rng):
    """Cylinder against a spring, behind a pressure regulator. Main: seals with a Stribeck curve, and a supply that ends at 400 kPa. Rest: bore 0.6 % off, gauge in kPa, input 0.2 sample late, load on the rod wanders."""
    p = {"T": 0.06, "A": 0.491, "M": 1.5, "k": 2.0, "b": 0.11, "F0": 20.0}

    def nom(t, x, u, p, held=0.0):  # mm, mm/s, kPa, N
        y, v, P = x
        return v, 1000 * (p["A"] * P - p["k"] * y - p["b"] * v - p["F0"] - held) / p["M"], (u[0] - P) / p["T"]

    def main(t, x, u, p=p, load=0.0):
        v = x[1]
        held = (7 + 5 * np.exp(-((abs(v) / 18) ** 1.3))) * np.tanh(v / 1.5)
        return nom(t, x, [402 - kink(402 - u[0], 5.0)], p, held + load)

    def plan(r):
        return 5 * np.round(steps(rng, 240, 90, 400 + 30 * r, 13) / 5), 2.2 * coloured(rng, 240, 0.95)

    sim = ODESimulator(
        nom, states=["y", "v", "P"], inputs=["kPa"], outputs=["y", "P"], params=p, dt=0.04, x0=[40.0, 0.0, 200.0]
    )
    data = measure(
        "pneumatic_cylinder",
        rng,
        sim,
        main,
        lambda t, x, u, d: main(t, x, u, dict(p, A=0.494), d[0]),
        plan,
        lambda r, u: [(0.491 * min(u[0], 400) - 20) / 2, 0, min(u[0], 400)],
        see=[0, 2],
        runs=5,
        noise=0.015,
        grid=[0.1, 1],
        late=1,
        scale=[1, 10, 10],
    )
    return sim, *data, "stribeck_friction@v (7 to 12 N, smooth) + input_saturation@kPa 402 (soft)"


ACCEPTED["pneumatic_cylinder"] = [
    ["stribeck_friction@v", "coulomb_friction@v", "asymmetric_friction@v", "lugre_friction@v"],
    ["input_saturation@kPa", "state_saturation@P"],
]
NEAR["pneumatic_cylinder"] = [
    "one of both alone",
    "hysteresis@v of y or power_law@v (exponent below 0.5) for the friction",
    "sensor_saturation@P or end_stop@P for the supply",
]


@case
def galvo_scanner(rng):
    """Mirror scanner, rotor data of the sheet. Main: the mirror hangs on an elastic shaft, and the capacitive sensor is bent. Rest: bearings with a little friction, amplifier of 0.05 ms, torque 0.7 % off."""
    p = {"g": 4.2e5, "w0": 380.0, "d": 0.12}

    def nom(t, x, u, p):  # degrees, A
        return x[1], p["g"] * u[0] - p["w0"] ** 2 * x[0] - 2 * p["d"] * p["w0"] * x[1]

    def main(t, x, u, g=1.0, f=0.0):
        q, w, m, n = x
        twist = 1350.0**2 * (q - m + 0.002 * (q - m) ** 3) + 2 * 0.015 * 1350 * (w - n)
        v, a = nom(t, [q, w], [g * u[0]], p)
        return v, a - 0.07 * twist - f * np.tanh(w / 40), n, twist

    def plan(r):
        wave = sines(rng, 400, 2e-4, 0.55 + 0.1 * r, 25, 330, 9) + steps(rng, 400, -0.4, 0.4, 50)
        return np.r_[np.zeros(4), wave[4:]], np.zeros(400)

    sim = ODESimulator(nom, states=["q", "w"], inputs=["amps"], outputs=["q"], params=p, dt=2e-4)
    data = measure(
        "galvo_scanner",
        rng,
        sim,
        main,
        lambda t, x, u, d: [*main(t, x[:4], [x[4]], 1.007, 9e3), (u[0] - x[4]) / 5e-5],
        plan,
        lambda r, u: [0] * 5,
        see=[0],
        order=4,
        runs=4,
        noise=0.008,
        scale=[1, 100, 1, 100, 1],
        lens=lambda Y: Y + 0.03 * Y**2 / (1 + 0.04 * Y**2),
    )
    return sim, *data, "hidden_mode@w of q (1.3e5 1/s2, 1350 rad/s) + sensor_nonlinearity@q 0.03"


ACCEPTED["galvo_scanner"] = [["hidden_mode@w of q", "hidden_mode@amps of q"], ["sensor_nonlinearity@q"]]
NEAR["galvo_scanner"] = [
    "one of both alone",
    "quadratic_loss@w of q for the sensor",
    "hidden_mode@w of another signal",
    "parameter_error@w0 or @g (the slow part), said to be partial",
]


@case
def reflow_oven(rng):
    """Zone and board of a reflow oven, read every 5 s. Main: the thermocouple under its tape is slow, and the carrier draws heat out of the board (fin). Rest: zone sensor bent by 0.3 %, exhaust wanders, display of 0.5 K."""
    p = {"kz": 6.2, "Tz": 55.0, "Tb": 32.0, "T0": 25.0}

    def nom(t, x, u, p):
        return (p["T0"] + p["kz"] * u[0] - x[0]) / p["Tz"], (x[0] - x[1]) / p["Tb"]

    def main(t, x, u, air=0.0):
        _, b, tape, bead = x
        a, c = nom(t, x[:2], u, p)
        return a + air / p["Tz"], c - 0.0021 * (b - 25) * (1 + 0.0012 * (b - 25)), (b - tape) / 6, (tape - bead) / 2.5

    def plan(r):
        return np.round(steps(rng, 170, 4, 34 + 2 * r, 12)), 5.0 * coloured(rng, 170, 0.9)

    sim = ODESimulator(
        nom, states=["zone", "board"], inputs=["power"], outputs=["zone", "board"], params=p, dt=5.0, x0=[25.0, 25.0]
    )
    data = measure(
        "reflow_oven",
        rng,
        sim,
        main,
        lambda t, x, u, d: main(t, x, u, d[0]),
        plan,
        lambda r, u: [25] * 4,
        see=[0, 3],
        runs=5,
        noise=0.012,
        grid=0.5,
        worn=lambda Y: Y + np.c_[0.003 * (Y[:, 0] - 25) * (1 - Y[:, 0] / 150), 0 * Y[:, 1]],
    )
    return (
        sim,
        *data,
        "sensor_lag@board 8 s (6 and 2.5) + linear_loss@board 0.0021 to 25 degrees C (a little more when hot)",
    )


ACCEPTED["reflow_oven"] = [
    ["sensor_lag@board"],
    [
        "linear_loss@board",
        "power_law@board",
        "quadratic_loss@board",
        "quadratic_drag@board",
        "sqrt_leak@board",
        "linear_loss@board of zone",
    ],
    ["constant_bias@board", "(not needed)"],
]
NEAR["reflow_oven"] = [
    "one of both alone",
    "sensor_delay@board for the lag",
    "sensor_gain@board (c < 0) or constant_bias@board for the loss",
    "parameter_error@Tb (+) for the lag",
]


@case
def cable_winch(rng):
    """Winch that pays rope out and hauls it in. Main: dry friction of the gear, and layers on the drum that change its radius. Rest: load 0.4 % off, load swings, torque 0.2 sample late, a spike, encoder of 1 cm."""
    p = {"m": 200.0, "r": 0.12, "J": 8.0, "b": 25.0}

    def nom(t, x, u, p, r=None, held=0.0):
        r = p["r"] if r is None else r
        return r * x[1], (p["m"] * 9.81 * r - u[0] - p["b"] * x[1] - held) / (p["J"] + p["m"] * r**2)

    def main(t, x, u, p=p, pull=0.0):
        layer = 0.12 - 0.0035 * (x[0] - 14 + 0.9 * np.sin(2 * np.pi * x[0] / 5.6)) / 5.6
        held = (5.5 + 0.8 * np.exp(-abs(x[1]) / 0.1)) * np.tanh(x[1] / 0.02)
        return nom(t, x, u, p, layer, held - pull)

    def plan(r):
        back = -sines(rng, 300, 0.2, 22 + 4 * r, 0.012, 0.12, 4) - steps(rng, 300, -14, 14, 30)
        return np.round(235.4 + back - back.mean()), 1.5 * coloured(rng, 300, 0.9) + 1.7 * np.sin(
            1.1 * np.arange(300) * 0.2
        )

    sim = ODESimulator(nom, states=["l", "w"], inputs=["torque"], outputs=["l", "w"], params=p, dt=0.2, x0=[14.0, 0.0])
    data = measure(
        "cable_winch",
        rng,
        sim,
        main,
        lambda t, x, u, d: main(t, x, u, dict(p, m=200.8), d[0]),
        plan,
        lambda r, u: [8 + 4 * r, 0],
        see=[0, 1],
        runs=4,
        noise=0.02,
        late=1,
        spikes=1,
        grid=[0.01, 0.0],
    )
    return sim, *data, "coulomb_friction@w 0.5 + parameter_dependence@r on l (-0.005 1/m)"


ACCEPTED["cable_winch"] = [
    [
        "coulomb_friction@w",
        "stribeck_friction@w",
        "asymmetric_friction@w",
        "lugre_friction@w",
        "any of these @torque of w",
    ],
    [
        "parameter_dependence@r on l",
        "linear_loss@w of l",
        "linear_loss@torque of l",
        "power_law@w of l",
        "parameter_dependence@m on l",
    ],
    ["constant_bias@w", "input_bias@torque", "(not needed)"],
]
NEAR["cable_winch"] = [
    "one of both alone",
    "linear_loss@w of w or parameter_error@b for the friction",
    "gravity_tilt, quadratic_loss or sqrt_leak@w of l",
]


@case
def peltier_stage(rng):
    """Cooled stage with its controller, in degrees C. Main: the air warms the cold plate (natural convection), and the clamped block of the hot side stores heat. Rest: Seebeck 0.2 % off, thermistor bent by 0.3 %, draught, whole 0.01 A."""
    p = {"al": 0.05, "R": 2.0, "K": 0.5, "Cc": 60.0, "Ch": 300.0, "hs": 3.2}

    def nom(t, x, u, p):
        c, h = x
        i, flow = u[0], p["K"] * (x[1] - x[0])
        cold = p["al"] * i * (c + 273.15) - p["R"] * i * i / 2 - flow
        hot = p["al"] * i * (h + 273.15) + p["R"] * i * i / 2 - flow
        return (u[1] - cold) / p["Cc"], (hot - p["hs"] * (h - u[2])) / p["Ch"]

    def main(t, x, u, p=p):
        a, b = nom(t, x[:2], u, p)
        warm = u[2] - x[0]
        leak = 0.021 * warm * (warm**2 + 1) ** 0.125
        block = 3.0 * (x[1] - x[2])
        return a + leak / p["Cc"], b - block / p["Ch"], block / 330

    def plan(r):
        n = 260
        U = np.c_[
            steps(rng, n, -12 + 2 * r, 14, 38),
            steps(rng, n, 0.5, 3.0, 30),
            23 + r + sines(rng, n, 5, 0.8, 3e-4, 2e-3, 3),
        ]
        return U, 0.22 * coloured(rng, n, 0.97)

    def control(y, row, memo):
        return [np.round(pi(y[0] - row[0], memo, 0.22, 0.012, 0.2, 3.2), 2), *row[1:]]

    sim = ODESimulator(
        nom, states=["Tc", "Th"], inputs=["amps", "load", "Ta"], outputs=["Tc", "Th"], params=p, dt=5.0, x0=[22.0, 24.0]
    )
    data = measure(
        "peltier_stage",
        rng,
        sim,
        main,
        lambda t, x, u, d: main(t, x, [u[0], u[1], u[2] + d[0]], dict(p, al=0.0499)),
        plan,
        lambda r, u: [22 + r, 24 + r, 24 + r],
        see=[0, 1],
        runs=4,
        noise=0.012,
        grid=0.01,
        control=control,
        worn=lambda Y: Y + 0.003 * Y * (1 - Y / 20),
    )
    return sim, *data, "exchange@Tc of Ta 8e-4 (power 1.25) + hidden_relaxation@Th of Th (0.01, 110 s)"


ACCEPTED["peltier_stage"] = [
    [
        "exchange@Tc of Ta",
        "linear_loss@Tc of Tc",
        "quadratic_loss@Tc of Tc",
        "power_law@Tc of Tc",
        "radiation@Tc of Ta",
        "exchange@Tc of Th",
        "parameter_error@K (+)",
        "parameter_dependence@K on Tc, Th or Ta",
    ],
    ["hidden_relaxation@Th of Th", "hidden_relaxation@Th of Tc or amps"],
    ["constant_bias@Tc", "(not needed)"],
]
NEAR["peltier_stage"] = [
    "one of both alone",
    "constant_bias@Tc or input_bias@load for the leak",
    "parameter_error@Ch (+) for the block",
    "sensor_lag@Th for the block",
]


# ------------------------------------------------------------------------------------------------ no main effect


@case
def none_water_heater(rng):
    """Stratified tank with its thermostat; nothing is missing. Rest: mains water wanders by 0.1 K, display of 0.1 K, element 0.2 % off; UA free, 5 % off."""
    p = {"V": 60.0, "UA": 2.4, "mix": 25.0}

    def nom(t, x, u, p):  # kW, l/min, minutes
        c, low, up = 4.186 * p["V"], x[0], x[1]
        stir = p["mix"] * (low - up) / 1000 * 60
        return (
            (60 * u[0] - stir - 4.186 * u[1] * (low - u[2]) - 0.06 * p["UA"] * (low - 20)) / c,
            (stir + 4.186 * u[1] * (low - up) - 0.06 * p["UA"] * (up - 20)) / c,
        )

    def plan(r):
        draw = np.round(np.clip(steps(rng, 260, -3, 5 + r, 14), 0, 8), 1)
        return np.c_[steps(rng, 260, 48, 65, 90), draw, np.full(260, 10.0 + r)], 0.1 * coloured(rng, 260, 0.95)

    def control(y, row, memo):
        return [np.round(np.clip(0.9 * (row[0] - y[0]), 0, 9), 1), *row[1:]]

    sim = ODESimulator(
        nom,
        states=["low", "up"],
        inputs=["kW", "draw", "cold"],
        outputs=["low", "up"],
        params=dict(p, UA=2.28),
        dt=1.0,
        x0=[50.0, 52.0],
    )
    data = measure(
        "none_water_heater",
        rng,
        sim,
        lambda t, x, u: nom(t, x, u, p),
        lambda t, x, u, d: nom(t, x, [1.002 * u[0], u[1], u[2] + d[0]], p),
        plan,
        lambda r, u: [50 + r, 52 + r],
        see=[0, 1],
        runs=4,
        noise=0.02,
        grid=0.1,
        control=control,
    )
    return sim, *data, "none (UA free, 5 % off)"


KW["none_water_heater"] = {"free_params": ["UA"]}
ACCEPTED["none_water_heater"] = [[]]
NEAR["none_water_heater"] = []


@case
def none_centrifuge(rng):
    """Motor and basket of a laboratory centrifuge; nothing is missing. Rest: drive acts 0.2 sample late, shunt bent by 0.2 %, air wanders, display of 1 rpm, one spike; d free, 4 % off."""
    p = {"R": 0.8, "L": 0.2, "k": 0.09, "J": 0.02, "d": 1.1e-6}

    def nom(t, x, u, p, air=0.0):  # A, rpm, V; L in H (with its choke)
        w = x[1] * np.pi / 30
        return (
            (u[0] - p["R"] * x[0] - p["k"] * w) / p["L"],
            30 / np.pi * (p["k"] * x[0] - p["d"] * (1 + air) * w * abs(w)) / p["J"],
        )

    def plan(r):
        return steps(rng, 220, 8, 24 + 3 * r, 24), 0.03 * coloured(rng, 220, 0.95)

    sim = ODESimulator(
        nom,
        states=["i", "n"],
        inputs=["volts"],
        outputs=["i", "n"],
        params=dict(p, d=1.15e-6),
        dt=0.05,
        x0=[0.1, 1500.0],
    )
    data = measure(
        "none_centrifuge",
        rng,
        sim,
        lambda t, x, u: nom(t, x, u, p),
        lambda t, x, u, d: nom(t, x, u, p, d[0]),
        plan,
        lambda r, u: settled(lambda x: nom(0, x, u, p), [0.1, 1500], 60),
        see=[0, 1],
        runs=5,
        noise=0.03,
        late=1,
        grid=[0.0, 1.0],
        spikes=1,
        scale=[1, 100],
        worn=lambda Y: Y + np.c_[0.002 * Y[:, 0] ** 2 / 5, 0 * Y[:, 1]],
    )
    return sim, *data, "none (d free, 4 % off)"


KW["none_centrifuge"] = {"free_params": ["d"]}
ACCEPTED["none_centrifuge"] = [[]]
NEAR["none_centrifuge"] = []


@case
def none_surge_tank(rng):
    """Tunnel and surge tank of a hydro station; nothing is missing. Rest: coloured noise, lake level wanders by 1 cm, turbine flow 0.1 % off; friction c free, 4 % off."""
    p = {"L": 2500.0, "A": 12.0, "As": 60.0, "c": 0.012}

    def nom(t, x, u, p):
        h, q = x
        return (q - u[0]) / p["As"], 9.81 * p["A"] / p["L"] * (u[1] - h - p["c"] * q * abs(q))

    def plan(r):
        turbine = np.round(steps(rng, 300, 8, 14 + 2 * r, 30), 1)
        return np.c_[turbine, 40 + steps(rng, 300, -0.5, 0.5, 90)], 0.01 * coloured(rng, 300, 0.97)

    sim = ODESimulator(
        nom,
        states=["h", "q"],
        inputs=["turbine", "lake"],
        outputs=["h", "q"],
        params=dict(p, c=0.0125),
        dt=10.0,
        x0=[38.5, 11.0],
    )
    data = measure(
        "none_surge_tank",
        rng,
        sim,
        lambda t, x, u: nom(t, x, u, p),
        lambda t, x, u, d: nom(t, x, [1.001 * u[0], u[1] + d[0]], p),
        plan,
        lambda r, u: [u[1] - 0.012 * u[0] ** 2, u[0]],
        see=[0, 1],
        runs=4,
        noise=0.03,
        hum=0.4,
    )
    return sim, *data, "none (c free, 4 % off)"


KW["none_surge_tank"] = {"free_params": ["c"]}
ACCEPTED["none_surge_tank"] = [[]]
NEAR["none_surge_tank"] = []


#: Names of the rest that are true: right beside the main effect, right alone in a plant of none, and never needed.
REST = {
    "radiator_room": ["sensor_quantization@Tw or Ta", "parameter_error@H", "constant_bias@Ta"],
    "pump_station": [
        "sensor_quantization@h1 or h2",
        "input_gain@demand",
        "constant_bias@h1",
        "sensor_nonlinearity@h1 or h2",
    ],
    "ebike_drive": ["sensor_quantization@v", "input_delay@amps (0.2 s)", "input_gain@grade"],
    "muffle_furnace": ["sensor_quantization@T", "sensor_nonlinearity@T", "sensor_gain@T"],
    "wine_fermenter": ["sensor_quantization@S", "sensor_nonlinearity@S", "parameter_error@Y", "input_bias@T"],
    "ship_steering": [
        "sensor_quantization@psi",
        "parameter_error@K",
        "input_gain@rudder",
        "periodic_disturbance@r (0.61 rad/s)",
    ],
    "loudspeaker_woofer": ["sensor_nonlinearity@y", "parameter_error@Bl", "input_lag@volts (0.05 ms)"],
    "district_heating_pipe": [
        "input_lag@Ts (0.35)",
        "sensor_quantization@T1 or T2",
        "input_gain or input_bias@Ts",
        "input_bias@Tout",
    ],
    "syringe_pump": [
        "parameter_error@A or @C",
        "input_gain@plunger",
        "sensor_quantization@V",
        "input_lag@plunger (0.11 s)",
    ],
    "belt_conveyor": ["input_delay or input_lag@torque (0.1 s)", "parameter_step@m"],
    "well_drawdown": ["quadratic_loss@s (c > 0) or quadratic_drag@s", "drift@s", "sensor_quantization@s"],
    "pneumatic_cylinder": ["input_delay or input_lag@kPa (8 ms)", "parameter_error@A", "sensor_quantization@y or P"],
    "galvo_scanner": [
        "coulomb_friction@w",
        "input_gain@amps",
        "parameter_error@g",
        "input_lag or input_delay@amps (0.05 ms)",
    ],
    "reflow_oven": ["sensor_nonlinearity@zone", "sensor_gain@zone", "sensor_quantization@zone or board"],
    "cable_winch": [
        "input_delay or input_lag@torque (0.04 s)",
        "parameter_error@m or @r",
        "periodic_disturbance@w (1.1 rad/s)",
    ],
    "peltier_stage": ["sensor_nonlinearity@Tc or Th", "sensor_gain@Tc or Th", "parameter_error@al", "input_bias@Ta"],
    "wind_tunnel_fan": ["sensor_nonlinearity@w", "sensor_bias@w", "sensor_quantization@n or w"],
    "none_water_heater": ["sensor_quantization@low or up"],
    "none_centrifuge": ["input_delay or input_lag@volts (0.01 s)", "sensor_nonlinearity@i"],
}
