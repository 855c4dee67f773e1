"""Free runs with an effect against scipy's integrator and equations written down once more, without the package.

``friction`` and other kinks are smoothed in the simulator over 1/500 of the signal's size and sharp in the reference:
hence a thousandth there, 1e-5 of the output's deviation elsewhere.
"""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

SHARP, SMOOTH = 2e-3, 2e-5


def spring(q, v, u):
    return u - 20 * q - 0.3 * v


def sgn(v):
    """Sign, so steep that scipy can just follow."""
    return np.tanh(v / 1e-5)


def bouc_wen(dv, z, limit):
    return dv * (1 - abs(z) / limit * (1 + np.sign(dv * z)) / 2)


def bristle(v, z):
    return v - 100 * abs(v) * z / (0.3 + 0.2 * np.exp(-((v / 0.1) ** 2)))


def only(force):
    """dx/dt of the spring with one more force."""
    return lambda t, z, u: (z[1], spring(z[0], z[1], u) + force(t, z[0], z[1], u))


def wen_on_speed(t, z, u):
    dv = spring(z[0], z[1], u) - 3 * z[2]
    return z[1], dv, bouc_wen(dv, z[2], 0.3)


#: name, variable, values, right-hand side, hidden states at the start ("u": the input there), tolerance
OSCILLATOR = [
    ("constant_bias", None, (0.7,), only(lambda t, q, v, u: 0.7), (), SMOOTH),
    ("linear_loss", "v", (0.9,), only(lambda t, q, v, u: -0.9 * v), (), SMOOTH),
    ("linear_loss", "u", (0.3,), only(lambda t, q, v, u: -0.3 * u), (), SMOOTH),
    ("quadratic_loss", "q", (9.0,), only(lambda t, q, v, u: -9 * q * q), (), SMOOTH),
    ("quadratic_drag", "v", (0.8,), only(lambda t, q, v, u: -0.8 * v * abs(v)), (), SMOOTH),
    ("coulomb_friction", "v", (0.3,), only(lambda t, q, v, u: -0.3 * sgn(v)), (), SHARP),
    ("asymmetric_friction", "v", (0.3, -0.2), only(lambda t, q, v, u: -0.3 * sgn(v) + 0.2), (), SHARP),
    (
        "stribeck_friction", "v", (0.2, 0.5, 0.2),
        only(lambda t, q, v, u: -(0.2 + 0.3 * np.exp(-((v / 0.2) ** 2))) * sgn(v)), (), SHARP,
    ),
    ("cubic_stiffness", "q", (60.0,), only(lambda t, q, v, u: -60 * q**3), (), SMOOTH),
    ("gravity_tilt", "q", (5.0,), only(lambda t, q, v, u: -5 * np.sin(q)), (), SMOOTH),
    ("bilinear", "q*u", (2.0,), only(lambda t, q, v, u: 2 * q * u), (), SMOOTH),
    ("exchange", "q", (0.5,), only(lambda t, q, v, u: 0.5 * (q - v)), (), SMOOTH),
    ("end_stop", "q", (400.0, 0.1), only(lambda t, q, v, u: -400 * max(q - 0.1, 0)), (), SMOOTH),
    ("drift", None, (0.5,), only(lambda t, q, v, u: 0.5 * t), (), SMOOTH),
    ("periodic_disturbance", None, (2.0, 9.0, 1.0), only(lambda t, q, v, u: 2 * np.sin(9 * t + 1)), (), SMOOTH),
    ("step_disturbance", None, (2.0, 1.234), only(lambda t, q, v, u: 2.0 * (t > 1.234)), (), SMOOTH),
    (
        "hysteresis", "q", (8.0, 0.05),
        lambda t, z, u: (z[1], spring(z[0], z[1], u) - 8 * z[2], bouc_wen(z[1], z[2], 0.05)), (0.0,), SMOOTH,
    ),
    ("hysteresis", "v", (3.0, 0.3), wen_on_speed, (0.0,), SMOOTH),
    (
        "lugre_friction", "v", (100.0, 0.3, 0.5, 0.1),
        lambda t, z, u: (z[1], spring(z[0], z[1], u) - 100 * z[2], bristle(z[1], z[2])), (0.0,), SMOOTH,
    ),
    (
        "hidden_relaxation", "q", (10.0, 0.2),
        lambda t, z, u: (z[1], spring(z[0], z[1], u) - 10 * (z[0] - z[2]), (z[0] - z[2]) / 0.2), (0.1,), SMOOTH,
    ),
    (
        "hidden_relaxation", "u", (-0.4, 0.3),
        lambda t, z, u: (z[1], spring(z[0], z[1], u) + 0.4 * (u - z[2]), (u - z[2]) / 0.3), ("u",), SMOOTH,
    ),
    (
        "hidden_mode", "q", (6.0, 7.0, 0.1),
        lambda t, z, u: (z[1], spring(z[0], z[1], u) + 6 * (z[2] - z[0]), z[3], 49 * (z[0] - z[2]) - 1.4 * z[3]),
        (0.1, 0.0), SMOOTH,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("name", "variable", "values", "rhs", "hidden", "tolerance"), OSCILLATOR)
def test_effect_on_an_oscillator(name, variable, values, rhs, hidden, tolerance, oscillator, force, reference):
    start = (0.1, 0.0)
    hidden = [force[0, 0] if value == "u" else value for value in hidden]
    with_effect = AugmentedSimulator(oscillator, [CATALOGUE[name]("v", variable)], [values])
    edges = (1.234,) if name == "step_disturbance" else ()
    exact = reference(rhs, (*start, *hidden), force[:, 0], edges=edges)
    found = with_effect.simulate(force, start)[:, 0]
    size = np.std(exact[:, 0])
    assert np.max(np.abs(found - exact[:, 0])) < tolerance * size
    assert np.max(np.abs(found - oscillator.simulate(force, start)[:, 0])) > 0.02 * size  # the effect is there
    X, dX = with_effect.simulate_states(force, start)
    np.testing.assert_allclose(X, exact[:, :2], atol=tolerance * 3 * np.std(exact[:, 1]))
    derivatives = np.array([rhs(0.02 * k, z, u)[:2] for k, (z, u) in enumerate(zip(exact, force[:, 0]))])
    if tolerance == SMOOTH:
        np.testing.assert_allclose(dX, derivatives, atol=2e-3 * np.std(derivatives[:, 1]))


def tanks(more):
    """dx/dt of the tanks (parameters a = 1, b = 0.6) and two more flows."""

    def rhs(t, z, u):
        upper, lower = z
        one, two = more(t, upper, lower, u)
        return u[0] - upper + one, upper - 0.6 * lower + u[1] + two

    return rhs


def limited(t, z, u):
    """The upper tank is full at 1.2."""
    rate = u[0] - z[0]
    return (min(rate, 0.0) if z[0] >= 1.2 else rate), min(z[0], 1.2) - 0.6 * z[1] + u[1]


def spilling(t, z, u):
    rate = u[0] - z[0]
    cut = max(rate, 0.0) if z[0] >= 1.2 else 0.0
    return rate - cut, min(z[0], 1.2) - 0.6 * z[1] + u[1] + 0.7 * cut


TANKS = [
    ("sqrt_leak", "lower", "lower", (0.3,), tanks(lambda t, a, b, u: (0, -0.3 * np.sqrt(max(b, 0)))), SMOOTH),
    ("power_law", "upper", "upper", (0.3, 1.7), tanks(lambda t, a, b, u: (-0.3 * a**1.7, 0)), SMOOTH),
    ("power_law", "upper", "lower*upper", (0.3, 0.6), tanks(lambda t, a, b, u: (-0.3 * b**0.6 * a, 0)), SMOOTH),
    ("exchange", "upper", "lower", (0.4,), tanks(lambda t, a, b, u: (0.4 * (b - a), 0)), SMOOTH),
    ("exchange", "lower", "first", (0.4,), tanks(lambda t, a, b, u: (0, 0.4 * (u[0] - b))), SMOOTH),
    ("radiation", "lower", "upper", (0.02,), tanks(lambda t, a, b, u: (0, 0.02 * (a**4 - b**4))), SMOOTH),
    ("bilinear", "lower", "second*upper", (0.2,), tanks(lambda t, a, b, u: (0, 0.2 * u[1] * a)), SMOOTH),
    ("parameter_error", "a", None, (0.3,), tanks(lambda t, a, b, u: (-0.3 * a, 0.3 * a)), SMOOTH),
    ("parameter_error", "idle", None, (0.3,), tanks(lambda t, a, b, u: (0.3, 0)), SMOOTH),
    ("parameter_drift", "b", None, (0.1,), tanks(lambda t, a, b, u: (0, -0.06 * t * b)), SMOOTH),
    (
        "parameter_step",
        "a",
        None,
        (0.3, 3.33),
        tanks(lambda t, a, b, u: (-0.3 * a * (t > 3.33), 0.3 * a * (t > 3.33))),
        SMOOTH,
    ),
    ("input_gain", "second", None, (0.3,), tanks(lambda t, a, b, u: (0, 0.3 * u[1])), SMOOTH),
    ("input_coupling", "first", "second", (0.3,), tanks(lambda t, a, b, u: (0.3 * u[1], 0)), SMOOTH),
    ("input_curve", "first", None, (0.2,), tanks(lambda t, a, b, u: (0.2 * u[0] * abs(u[0]), 0)), SMOOTH),
    ("state_saturation", "upper", None, (1.2,), limited, SHARP),
    ("overflow", "upper", "lower", (1.2, 0.7), spilling, SHARP),
]


@pytest.mark.parametrize(("name", "location", "variable", "values", "rhs", "tolerance"), TANKS)
def test_effect_on_two_tanks(name, location, variable, values, rhs, tolerance, make_tanks, reference):
    plant, n, dt = make_tanks(), 80, 0.1
    U = np.abs(np.repeat(np.random.default_rng(1).normal(1.0, 0.6, size=(n // 8, 2)), 8, axis=0))
    steps = 200 if tolerance == SHARP else 4  # the reference steps over a limit by up to one of its steps
    exact = reference(rhs, (1.0, 0.5), U, n=n, dt=dt, edges=(3.33,), steps=steps)
    outputs = np.c_[exact[:, 0], exact[:, 0] + 2 * exact[:, 1]]
    with_effect = AugmentedSimulator(plant, [CATALOGUE[name](location, variable)], [values])
    found = with_effect.simulate(U)
    assert np.max(np.abs(found - outputs)) < tolerance * np.std(outputs)
    assert np.max(np.abs(found - plant.simulate(U))) > 0.02 * np.std(outputs)


@pytest.mark.parametrize(("name", "size"), [("input_delay", 0.053), ("input_lag", 0.07)])
@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_late_inputs(name, size, hold, make_oscillator, force, reference):
    """A delay that is not a multiple of dt and a lag, both holds."""
    plant, dt, u = make_oscillator(hold), 0.02, force[:, 0]
    t = dt * np.arange(len(u))
    held = hold == "zoh"

    def signal(now):
        if now <= 0:
            return u[0]
        return u[min(int(now / dt), len(u) - 1)] if held else np.interp(now, t, u)

    if name == "input_delay":
        edges = (dt * np.arange(len(u)) + size) if held else ()
        exact = reference(
            lambda now, z, w: (z[1], spring(z[0], z[1], w)), (0.1, 0.0), lambda s: signal(s - size), edges=edges
        )
    else:
        given = u if held else signal
        rhs = lambda now, z, w: (z[1], spring(z[0], z[1], z[2]), (w - z[2]) / size)  # noqa: E731
        exact = reference(rhs, (0.1, 0.0, u[0]), given)
    found = AugmentedSimulator(plant, [CATALOGUE[name]("u")], [(size,)]).simulate(force, (0.1, 0.0))[:, 0]
    assert np.max(np.abs(found - exact[:, 0])) < SMOOTH * np.std(exact[:, 0])


@pytest.mark.parametrize("name", ["sensor_lag", "sensor_delay"])
@pytest.mark.parametrize("size", [0.004, 0.033, 0.2])
def test_slow_sensors_see_the_path_between_the_samples(name, size, oscillator, force, reference):
    dt, n = 0.02, len(force)
    rhs = lambda t, z, u: (z[1], spring(z[0], z[1], u), (z[0] - z[2]) / size)  # noqa: E731
    fine = reference(rhs, (0.1, 0.0, 0.1), np.repeat(force[:, 0], 10), n=10 * n, dt=dt / 10)
    if name == "sensor_lag":
        exact = fine[::10, 2]
    else:
        exact = np.interp(dt * np.arange(n) - size, dt / 10 * np.arange(10 * n), fine[:, 0])
    found = AugmentedSimulator(oscillator, [CATALOGUE[name]("q")], [(size,)]).simulate(force, (0.1, 0.0))[:, 0]
    assert np.max(np.abs(found - exact)) < 2e-4 * np.std(exact)  # the cubic, and the straight line of the reference


def test_several_effects_at_once(oscillator, force, reference):
    def rhs(t, z, u):
        q, v, wall, acting = z
        dv = 0.9 * acting - 20 * q - 0.3 * v - 0.5 * v * abs(v) - 4 * (q - wall) + 0.5 * (t > 0.77)
        return v, dv, (q - wall) / 0.3, (np.clip(u, -2, 2) - acting) / 0.05

    effects = [("sensor_bias", "q"), ("input_lag", "u"), ("quadratic_drag", "v", "v"), ("hidden_relaxation", "v", "q")]
    effects += [("input_saturation", "u"), ("step_disturbance", "v"), ("linear_loss", "v", "u")]
    values = [(0.1,), (0.05,), (0.5,), (4.0, 0.3), (2.0,), (0.5, 0.77), (0.1,)]
    many = AugmentedSimulator(oscillator, [CATALOGUE[name](*place) for name, *place in effects], values)
    start = np.clip(force[0, 0], -2, 2)
    exact = reference(rhs, (0.1, 0.0, 0.1, start), force[:, 0], edges=(0.77,))
    found = many.simulate(force, (0.1, 0.0))[:, 0]
    assert np.max(np.abs(found - exact[:, 0] - 0.1)) < 2 * SMOOTH * np.std(exact[:, 0])


@pytest.mark.parametrize(
    ("effect", "values", "limit", "limit_value"),
    [
        # bristles too stiff for any step are dry friction, and so is a spring that yields at once
        (CATALOGUE["lugre_friction"]("v", "v"), (1e7, 0.3, 0.3, 0.1), "coulomb_friction", 0.3),
        (CATALOGUE["hysteresis"]("v", "q"), (1e6, 3e-7), "coulomb_friction", 0.3),
        # a companion as fast as that is half a step late: - 5 (q - z) is about - 5 (dt / 2) v
        (CATALOGUE["hidden_relaxation"]("v", "q"), (5.0, 1e-9), "linear_loss", 0.05),
    ],
)
def test_hidden_states_too_fast_for_a_step_do_not_upset_it(effect, values, limit, limit_value, oscillator, force):
    """One substep a sample, as a fit takes it: finite, and near the limit that the fast state tends to."""
    times = [0.02 * np.arange(len(force))]
    model, record = PlantModel(describe(oscillator)), Record.from_runs([force], [force], times, 0.02)

    def run(effect, theta):
        whole = AugmentedModel(model, (effect,), (), record, n_sub=1, scale=np.array([0.1, 0.5]))
        bound = whole.bind(np.array(theta)[:, None])
        x, out = bound.start(np.array([0.1, 0.0])[:, None, None]), []
        for k in range(len(force)):
            out.append(x[0, 0, 0])
            x = bound(x, np.array([k]))
        return np.array(out)

    found, near = run(effect, values), run(CATALOGUE[limit]("v", "v"), (limit_value,))
    assert np.max(np.abs(found - near)) < 0.04 * np.std(near)  # the fast state is up to a step late
