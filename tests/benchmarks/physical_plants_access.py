"""Physical plants whose simulators give trajectories or steps alone, or hold their controller."""

import numpy as np
from physical_plants import case, record, run, sines, steps
from scipy.integrate import solve_ivp

from sksurrogate.physics import CallableSimulator, ClosedLoopSimulator, ControlSimulator, ODESimulator, StepSimulator


@case
def tool_two_mass(rng):
    """A foreign tool gives trajectories only; actuator has a lag of second order."""
    dt = 0.02

    def plant(t, x, u):
        a, va, b, vb = x
        f = 40.0 * (b - a) + 1.0 * (vb - va)
        return [va, u[0] - 0.6 * va + f, vb, -f / 0.5]

    def table(U):
        return run(plant, [0] * 4, U, dt)[:, [0, 2]]

    sim = CallableSimulator(table, inputs=["force"], outputs=["a", "b"])
    runs = []
    for n in (200, 200, 200):
        U = steps(rng, n, -3, 3, 15)[:, None]

        def rhs(t, x, u):
            return [*plant(t, x[:4], [x[4]]), (x[5] - x[4]) / 0.02, (u[0] - x[5]) / 0.08]

        X = run(rhs, [0] * 4 + [U[0, 0]] * 2, U, dt)
        runs.append((U, X[:, [0, 2]]))
    return (sim, *record(rng, runs, lambda X, U: X, 0.01), "input_lag@force (0.08 and 0.02), simulate only")


@case
def tool_sensor_soft(rng):
    """Trajectories only; a force cell that saturates softly."""
    dt = 0.01

    def plant(t, x, u):
        return [x[1], u[0] - 2.0 * x[1] - 60.0 * x[0]]

    sim = CallableSimulator(lambda U: run(plant, [0, 0], U, dt)[:, :1], inputs=["force"], outputs=["y"])
    runs = []
    for n in (250, 250, 250):
        U = sines(rng, n, dt, 9.0, 0.3, 2.0)[:, None]
        y = run(plant, [0, 0], U, dt)[:, :1]
        runs.append((U, 0.22 - 0.02 * np.logaddexp(0, (0.22 - y) / 0.02)))
    return (
        sim,
        *record(rng, runs, lambda X, U: X, 0.01),
        "sensor_saturation@y at 0.22 (soft, one side), simulate only",
    )


@case
def control_drive(rng):
    """python-control, nonlinear system; motor with a resistance that rises with its temperature (one long run)."""
    import control

    dt = 0.02
    p = {"R": 1.0, "k": 0.5, "J": 0.05, "b": 0.02}

    def f(t, x, u, params):
        i, w = x
        return np.array(
            [(u[0] - params["R"] * i - params["k"] * w) / 0.05, (params["k"] * i - params["b"] * w) / params["J"]]
        )

    sys_ = control.nlsys(f, None, inputs=["u"], outputs=["i", "w"], states=["i", "w"], params=p)
    sim = ControlSimulator(sys_, dt=dt, params=dict(p))
    n = 800

    def rhs(t, x, u):
        return list(f(t, x[:2], u, dict(p, R=1.0 * (1 + 0.004 * x[2])))) + [(9.0 * x[0] ** 2 - x[2]) / 12.0]

    U = sines(rng, n, dt, 4.0, 0.1, 2.0)[:, None]
    runs = [(U, run(rhs, [0, 0, 0], U, dt)[:, :2])]
    return (
        sim,
        *record(rng, runs, lambda X, U: X, 0.005),
        "R drifts up with heating: parameter_drift@R or law/partial at i",
    )


@case
def diff_ball_mill(rng):
    """Difference equation of a cascade; the middle stage is fed with a transport lag that is not a whole number of samples."""

    def step(t, x, u, p, dt):
        a, b, c = x
        return [
            a + dt * (u[0] - p["ka"] * a),
            b + dt * (p["ka"] * a - p["kb"] * b),
            c + dt * (p["kb"] * b - p["kc"] * c),
        ]

    dt, p = 0.5, {"ka": 0.3, "kb": 0.5, "kc": 0.2}
    sim = StepSimulator(step, states=["a", "b", "c"], inputs=["feed"], outputs=["a", "c"], params=p, dt=dt)
    runs = []
    for n in (200, 240, 160):
        U = steps(rng, n, 0, 4, 14)[:, None]
        X = [np.array([0.0, 0, 0])]
        for k in range(n - 1):
            x = X[-1].copy()
            for j in range(1):
                nx = np.array(step(0, x, U[k], p, dt))
                nx[2] -= dt * 0.35 * x[2] / (x[2] + 1.0) * min(x[2], 1e9)  # screen that passes more when it is loaded
                x = nx
            X.append(x)
        runs.append((U, np.array(X)[:, [0, 2]]))
    return (
        sim,
        *record(rng, runs, lambda X, U: X, 0.01),
        "loss at c ~ c^2/(c+1): linear_loss/power_law@c (between linear and square)",
    )


@case
def loop_backlash(rng):
    """Position loop known with its controller; Coulomb friction with width in the plant."""
    dt = 0.02
    p = {"c": 0.6}
    axis = ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["c"] * x[1]),
        states=["q", "v"],
        inputs=["force"],
        outputs=["q", "v"],
        params=p,
        dt=dt,
    )
    ctl = StepSimulator(
        lambda t, x, u, p, dt: [x[0] + dt * (u[0] - u[1])],
        output=lambda t, x, u, p: [30.0 * (u[0] - u[1]) + 8.0 * x[0] - 6.0 * u[2]],
        states=["sum"],
        inputs=["ref", "q", "v"],
        outputs=["force"],
        dt=dt,
    )
    sim = ClosedLoopSimulator(axis, ctl, outputs=["q", "force"])
    runs = []
    for n in (240, 200, 260):
        ref = steps(rng, n, -1, 1, 30)
        x, z, Y = np.zeros(2), 0.0, []
        for r in ref:
            u = 30.0 * (r - x[0]) + 8.0 * z - 6.0 * x[1]
            Y.append([x[0], u])
            z += dt * (r - x[0])
            s = solve_ivp(
                lambda t, y, u=u: [y[1], u - 0.6 * y[1] - 1.5 * np.tanh(y[1] / 0.03)],
                (0, dt),
                x,
                rtol=1e-8,
                atol=1e-10,
                method="LSODA",
            )
            x = s.y[:, -1]
        runs.append((ref[:, None], np.array(Y)))
    return (sim, *record(rng, runs, lambda X, U: X, 0.01), "coulomb_friction@v in the loop (controller known)")
