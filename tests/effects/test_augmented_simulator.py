"""A simulator with effects is a simulator again."""

import pickle

import numpy as np
import pytest
from scipy.linalg import expm
from sklearn.base import clone

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.exceptions import SimulationDiverged, SimulatorError
from sksurrogate.physics import BaseSimulator, CallableSimulator, ODESimulator, StepSimulator
from sksurrogate.physics._simulator import describe


def drag(values=({"coefficient": 0.8},), plant=None, **kwargs):
    return AugmentedSimulator(plant, [CATALOGUE["quadratic_drag"]("v", "v")], list(values), **kwargs)


def falling_rhs(t, x, u, p):
    """At module level, so that it pickles."""
    return x[1], u[0] - p["c"] * x[1]


class Recording(BaseSimulator):
    """Gives trajectories only: a first-order filter of the held input."""

    inputs, outputs, states, dt, hold = ("u",), ("y",), None, 0.1, "zoh"

    def __init__(self, params=None):
        self.params = params

    def set_params(self, **params):
        self.params = {**self.params, **{key.removeprefix("params__"): value for key, value in params.items()}}
        return self

    def simulate(self, U, x0=None, t=None):
        y = [0.0 if x0 is None else float(np.ravel(x0)[0])]
        decay = np.exp(-self.params["k"] * self.dt)
        for u in np.asarray(U)[:-1, 0]:
            y.append(decay * y[-1] + (1 - decay) * u / self.params["k"])
        return np.array(y)[:, None]


class Stepper(BaseSimulator):
    """The same filter by steps, with a state."""

    states, inputs, outputs, params, dt = ("y",), ("u",), ("y",), {"k": 2.0}, 0.1

    def step(self, t, x, u, p, dt):
        decay = np.exp(-p["k"] * dt)
        return (decay * x[0] + (1 - decay) * u[0] / p["k"],)

    def simulate(self, U, x0=None, t=None):
        return Recording(self.params).simulate(U, x0)


# ---- as an estimator and as a simulator ----------------------------------------------------------------------------
def test_survives_clone_pickle_repr_and_says_what_a_simulator_says():
    plant = ODESimulator(
        falling_rhs, states=["q", "v"], inputs=["u"], outputs=["q"], params={"c": 0.1}, dt=0.05, x0=[1.0, 0.0]
    )
    wide = drag(plant=plant, retuned={"c": 0.2})
    U = np.ones((20, 1))
    expected = wide.simulate(U)
    for other in (clone(wide), pickle.loads(pickle.dumps(wide))):
        np.testing.assert_array_equal(other.simulate(U), expected)
    assert repr(wide).startswith("AugmentedSimulator(") and "QuadraticDrag" in repr(wide)
    shown = describe(wide)
    assert (shown.states, shown.inputs, shown.outputs) == (("q", "v"), ("u",), ("q",))
    assert (dict(shown.params), shown.dt, shown.hold, shown.x0.tolist()) == ({"c": 0.2}, 0.05, "zoh", [1.0, 0.0])


def test_parameters_are_reached_by_name_and_nothing_given_is_written(oscillator, force):
    retuned = {"k": 25.0}
    wide = drag(plant=oscillator, retuned=retuned)
    wide.set_params(params__c=0.5, sharpness=100.0)
    assert wide.params == {"m": 1.0, "k": 25.0, "c": 0.5} and retuned == {"k": 25.0}
    assert wide.sharpness == 100.0 and oscillator.params["c"] == 0.3
    assert wide.get_params()["simulator__dt"] == 0.02
    with pytest.raises(ValueError, match="params__z: the simulator has no such parameter"):
        wide.set_params(params__z=1.0)


def test_retuned_parameters_are_those_of_a_plant_built_with_them(oscillator, force):
    other = clone(oscillator).set_params(params__k=25.0)
    np.testing.assert_allclose(
        drag(plant=oscillator, retuned={"k": 25.0}).simulate(force), drag(plant=other).simulate(force), rtol=1e-12
    )
    np.testing.assert_allclose(
        AugmentedSimulator(oscillator, retuned={"k": 25.0}).simulate(force), other.simulate(force)
    )


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_null_values_give_the_simulator(hold, make_tanks):
    plant, random = make_tanks(hold), np.random.default_rng(0)
    U = np.abs(random.normal(size=(30, 2)))
    effects, values = [], []
    for cls in CATALOGUE.values():
        if cls.name != "sensor_rectification":
            effect = next(iter(cls.instances(describe(plant), plant.states)))
            effects.append(effect)
            shaped = cls.linear and not cls.acts_at_null
            shapes = tuple(0.3 for _ in cls.parameters[1:]) if shaped else tuple(p.null for p in cls.parameters[1:])
            values.append((cls.parameters[0].null, *shapes))
    still = AugmentedSimulator(plant, effects, values)
    np.testing.assert_array_equal(still.simulate(U, [0.3, 0.4]), plant.simulate(U, [0.3, 0.4]))


def test_next_to_null_is_next_to_the_simulator(oscillator, force):
    """Dropping effects at null hides no jump."""
    plain = oscillator.simulate(force)
    for name, place, theta in [
        ("linear_loss", ("v", "v"), (1e-9,)),
        ("input_delay", ("u",), (1e-9,)),
        ("input_lag", ("u",), (1e-9,)),
        ("sensor_lag", ("q",), (1e-9,)),
        ("state_saturation", ("v",), (1e9,)),
        ("rate_limit", ("u",), (1e9,)),
        ("hysteresis", ("v", "q"), (1e-9, 0.1)),
    ]:
        near = AugmentedSimulator(oscillator, [CATALOGUE[name](*place)], [theta]).simulate(force)
        np.testing.assert_allclose(near, plain, atol=2e-7, err_msg=name)


def test_batch_is_run_by_run(oscillator):
    U = np.random.default_rng(0).normal(size=(3, 40, 1))
    X0 = np.array([[0.1, 0.0], [0.0, 0.2], [-0.1, 0.1]])
    effects = [CATALOGUE["quadratic_drag"]("v", "v"), CATALOGUE["input_lag"]("u"), CATALOGUE["sensor_delay"]("q")]
    wide = AugmentedSimulator(oscillator, effects, [(0.5,), (0.05,), (0.03,)])
    together = wide.simulate_batch(U, X0)
    for k in range(3):
        np.testing.assert_allclose(together[k], wide.simulate(U[k], X0[k]), atol=1e-7)
    np.testing.assert_allclose(wide.simulate_batch(U)[1], wide.simulate(U[1]), atol=1e-7)


def test_states_and_derivatives_fit_each_other(oscillator):
    t = 0.02 * np.arange(200)
    wide = drag(plant=oscillator)
    X, dX = wide.simulate_states(np.zeros((200, 1)), [0.3, 0.0])
    np.testing.assert_allclose(wide.simulate(np.zeros((200, 1)), [0.3, 0.0])[:, 0], X[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.gradient(X, t, axis=0)[2:-2], dX[2:-2], atol=2e-2)


def test_kinks_get_sharper_and_the_answer_settles(oscillator, force):
    dry = CATALOGUE["coulomb_friction"]("v", "v")
    runs = [AugmentedSimulator(oscillator, [dry], [(0.3,)], sharpness=s).simulate(force) for s in (50, 500, 3000)]
    assert np.max(np.abs(runs[1] - runs[2])) < 0.15 * np.max(np.abs(runs[0] - runs[2])) < 0.01
    wide = AugmentedSimulator(oscillator, [dry], [(0.3,)], scale=[1e-3, 1e-3])
    assert np.max(np.abs(wide.simulate(force) - runs[2])) < 1e-4


def test_friction_brings_a_free_swing_to_rest(oscillator):
    dry = AugmentedSimulator(oscillator, [CATALOGUE["coulomb_friction"]("v", "v")], [{"level": 1.0}])
    X, _ = dry.simulate_states(np.zeros((150, 1)), [0.3, 0.0])
    assert np.all(np.abs(X[-20:, 1]) < 2e-3)  # it creeps within the width of the smoothed kink
    assert abs(X[-1, 0]) <= 1.0 / 20


def test_a_stiff_plant_is_left_to_scipy():
    stiff = ODESimulator(
        lambda t, x, u, p: (1e5 * (np.cos(x[1]) - x[0]), x[0] - x[1]),
        states=["fast", "slow"], inputs=["u"], outputs=["slow"], params={}, dt=0.1, x0=[1.0, 0.0],
    )  # fmt: skip
    U = np.zeros((30, 1))
    leak = CATALOGUE["linear_loss"]("slow", "slow")
    found = AugmentedSimulator(stiff, [leak], [(0.5,)]).simulate(U)
    same = ODESimulator(
        lambda t, x, u, p: (np.cos(x[0]) - 1.5 * x[0],),
        states=["slow"],
        inputs=["u"],
        outputs=["slow"],
        params={},
        dt=0.1,
    )
    np.testing.assert_allclose(found, same.simulate(U), atol=5e-5)  # the fast state is 1e-5 late
    forced = clone(same).set_params(method="Radau")
    late = [CATALOGUE["input_delay"]("u"), CATALOGUE["state_saturation"]("slow")]
    a, b = (AugmentedSimulator(s, late, [(0.13,), (0.4,)]).simulate(U) for s in (same, forced))
    np.testing.assert_allclose(a, b, atol=1e-6)
    assert np.max(a) == pytest.approx(0.4)


def test_effects_count_time_from_the_first_row_and_the_simulator_by_its_stamps(oscillator):
    push = AugmentedSimulator(oscillator, [CATALOGUE["step_disturbance"]("v")], [{"size": 1.0, "time": 1.0}])
    U = np.zeros((100, 1))
    late = push.simulate(U, t=4.0 + 0.02 * np.arange(100))
    assert np.all(late[:50] == 0) and np.all(late[55:] > 0)
    np.testing.assert_allclose(push.simulate(U, t=1.7e9 + 0.02 * np.arange(100)), late, atol=1e-5)
    clock = ODESimulator(lambda t, x, u, p: (np.cos(t),), states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.02)
    loss = AugmentedSimulator(clock, [CATALOGUE["constant_bias"]("x")], [(0.5,)])
    t = 4.0 + 0.02 * np.arange(100)
    np.testing.assert_allclose(loss.simulate(U, t=t)[:, 0], np.sin(t) - np.sin(4.0) + 0.5 * (t - 4.0), atol=1e-8)
    with pytest.raises(SimulatorError, match=r"not evenly spaced \(row 3\)"):
        push.simulate(U[:4], t=[0.0, 0.02, 0.04, 0.07])
    with pytest.raises(SimulatorError, match="one time for each row"):
        push.simulate(U[:4], t=[0.0, 0.02])


@pytest.mark.parametrize(
    ("name", "variable", "values"),
    [("parameter_dependence", "q", (0.3, 0.1)), ("parameter_drift", None, (0.05,)), ("linear_loss", "q", (1.0,))],
)
def test_effects_in_a_simulator_that_steps_are_of_second_order_in_its_step(name, variable, values):
    def rhs(t, x, u, p):
        return x[1], u[0] - p["k"] * x[0] - 0.6 * x[1]

    def step(t, x, u, p, dt):  # to rounding
        A = np.array([[0.0, 1.0, 0.0], [-float(np.ravel(p["k"])[0]), -0.6, 1.0], [0.0, 0.0, 0.0]])
        return expm(dt * A)[:2] @ np.array([float(x[0]), float(x[1]), float(u[0])])

    given = {"states": ["q", "v"], "inputs": ["u"], "outputs": ["q"], "params": {"k": 4.0}}
    effect = CATALOGUE[name]("v" if name == "linear_loss" else "k", variable)
    steps, error = np.repeat(np.random.default_rng(0).normal(size=10), 1), {}
    for dt in (0.1, 0.05):
        U = np.repeat(steps, round(0.8 / dt))[:, None]
        runs = [
            AugmentedSimulator(s, [effect], [values]).simulate(U, x0=[0.3, -0.2])
            for s in (StepSimulator(step, dt=dt, **given), ODESimulator(rhs, dt=dt, **given))
        ]
        error[dt] = np.abs(runs[0] - runs[1]).max()
    assert 3.5 < error[0.1] / error[0.05] < 4.5


def test_a_friction_acts_by_its_second_number_alone(oscillator):
    U = np.sin(0.3 * np.arange(200))[:, None]
    for name, values in (("asymmetric_friction", (0.0, 0.2)), ("load_friction", (0.0, 0.3))):
        nothing, next_to = (
            AugmentedSimulator(oscillator, [CATALOGUE[name]("v", "v")], [(size, values[1])]).simulate(U)
            for size in (0.0, 1e-9)
        )
        np.testing.assert_allclose(nothing, next_to, atol=1e-6)
        assert np.abs(nothing - oscillator.simulate(U)).max() > 1e-3


@pytest.mark.parametrize("method", ["LSODA", "auto"])
def test_a_companion_much_faster_than_a_sample_is_as_fast_under_every_integrator(method):
    tau, c = 0.003, 3.0

    def alone(t, x, u, p):
        return x[1], u[0] - 4.0 * x[0] - 0.6 * x[1]

    def whole(t, x, u, p):
        return x[1], u[0] - 4.0 * x[0] - 0.6 * x[1] - c * (x[1] - x[2]), (x[1] - x[2]) / tau

    given = {"inputs": ["u"], "outputs": ["q"], "params": {}, "dt": 0.1}
    plant = ODESimulator(alone, states=["q", "v"], method=method, **given)
    truth = ODESimulator(whole, states=["q", "v", "z"], method="LSODA", **given)
    U = np.repeat(np.random.default_rng(0).normal(size=20), 5)[:, None]
    slow = AugmentedSimulator(plant, [CATALOGUE["hidden_relaxation"]("v", "v")], [(c, tau)])
    bare = plant.simulate(U)
    effect = np.abs(truth.simulate(U, x0=[0.0, 0.0, 0.0]) - bare).max()
    assert np.abs(slow.simulate(U) - bare).max() == pytest.approx(effect, rel=0.02)


def test_stamps_since_1970_are_even_though_they_are_rounded(make_tanks):
    plant, U = make_tanks(), np.abs(np.random.default_rng(0).normal(size=(40, 2)))
    slow = AugmentedSimulator(plant, [CATALOGUE["sensor_lag"]("level")], [(0.3,)])
    stamps = 1.7e9 + plant.dt * np.arange(40)
    assert np.ptp(np.diff(stamps)) > 1e-6 * plant.dt
    np.testing.assert_allclose(slow.simulate(U, t=stamps), slow.simulate(U), atol=1e-5)


def test_without_memory_it_is_a_right_hand_side_again(make_tanks):
    plant, U = make_tanks(), np.abs(np.random.default_rng(0).normal(size=(40, 2)))
    places = [("quadratic_drag", "upper", "upper"), ("bilinear", "lower", "second*upper"), ("parameter_error", "a")]
    places += [("sensor_coupling", "level", "scale"), ("sensor_gain", "level"), ("drift", "lower")]
    values = [(0.2,), (0.1,), (0.3,), (0.1,), (0.2,), (0.05,)]
    wide = AugmentedSimulator(plant, [CATALOGUE[name](*place) for name, *place in places], values, retuned={"b": 0.7})
    assert describe(wide).access == "rhs"
    names = {name: getattr(plant, name) for name in ("states", "inputs", "outputs", "dt", "x0")}
    same = ODESimulator(wide.rhs, output=wide.output, params=wide.params, **names)
    np.testing.assert_allclose(same.simulate(U), wide.simulate(U), atol=1e-6)
    again = AugmentedSimulator(wide, [CATALOGUE["linear_loss"]("upper", "upper")], [(0.1,)])
    flat = clone(wide).set_params(effects=[*wide.effects, *again.effects], values=[*values, (0.1,)])
    np.testing.assert_allclose(again.simulate(U), flat.simulate(U), atol=1e-6)


@pytest.mark.parametrize(
    "place", [("hysteresis", "v", "q"), ("input_gain", "u"), ("sensor_lag", "q"), ("state_saturation", "v")]
)
def test_with_a_memory_or_a_limit_only_trajectories_are_left(place, oscillator):
    name, *where = place
    cls = CATALOGUE[name]
    values = tuple(0.3 for _ in cls.parameters)
    wide = AugmentedSimulator(oscillator, [cls(*where)], [values])
    assert not hasattr(wide, "rhs") and describe(wide).access == "trajectory"
    twice = AugmentedSimulator(wide, [CATALOGUE["sensor_bias"]("q")], [(0.1,)])
    U = np.ones((20, 1))
    np.testing.assert_allclose(twice.simulate(U), wide.simulate(U) + 0.1, atol=1e-12)


def test_kinks_of_the_right_hand_side_are_as_wide_as_the_scale_says(oscillator):
    dry = AugmentedSimulator(oscillator, [CATALOGUE["coulomb_friction"]("v", "v")], [(0.3,)])
    x, u = np.array([0.0, 1e-3]), np.array([0.0])
    soft = clone(dry).set_params(scale=[0.1, 0.5])
    assert dry.rhs(0.0, x, u, dry.params)[1] == pytest.approx(-0.3 - 3e-4)
    assert soft.rhs(0.0, x, u, dry.params)[1] == pytest.approx(-0.3 * np.tanh(1.0) - 3e-4)
    assert not hasattr(dry, "output")  # outputs are states by name


# ---- simulators that give less ---------------------------------------------------------------------------------------
def test_trajectories_take_effects_before_behind_and_in_parameters():
    u = np.random.default_rng(0).normal(size=(60, 1))
    plant = Recording({"k": 2.0})
    effects = [
        CATALOGUE[name](place) for name, place in [("sensor_bias", "y"), ("input_gain", "u"), ("parameter_error", "k")]
    ]
    found = AugmentedSimulator(plant, effects, [(0.3,), (0.5,), (0.25,)]).simulate(u, [0.2])
    np.testing.assert_allclose(found, Recording({"k": 2.5}).simulate(1.5 * u, [0.2]) + 0.3, atol=1e-12)
    late = AugmentedSimulator(plant, [CATALOGUE["input_delay"]("u")], [(0.25,)]).simulate(u)
    past = np.r_[u[:1], u[:1], u[:1], u[:-3]] / 2 + np.r_[u[:1], u[:1], u[:-2]] / 2
    np.testing.assert_allclose(late, plant.simulate(past), atol=1e-12)
    batch = AugmentedSimulator(plant, effects, [(0.3,), (0.5,), (0.25,)]).simulate_batch(
        np.stack([u, -u]), [[0.2], [0.2]]
    )
    np.testing.assert_allclose(batch[0], found)


def test_a_slow_sensor_on_a_trajectory_runs_between_the_samples():
    t = 0.1 * np.arange(100)
    u = np.sin(0.7 * t)[:, None]
    plant = Recording({"k": 2.0})
    found = AugmentedSimulator(plant, [CATALOGUE["sensor_lag"]("y")], [(0.4,)]).simulate(u)[:, 0]
    fine = np.interp(np.linspace(0, t[-1], 20001), t, plant.simulate(u)[:, 0])
    w, h = np.empty_like(fine), t[-1] / 20000
    w[0] = fine[0]
    for k in range(20000):
        w[k + 1] = w[k] + h / 0.4 * (fine[k] - w[k])
    assert np.max(np.abs(found - np.interp(t, np.linspace(0, t[-1], 20001), w))) < 2e-3


@pytest.mark.parametrize("n", [2, 3])
def test_a_slow_sensor_of_a_ramp_is_the_same_in_a_short_record(n):
    plant = CallableSimulator(lambda U, x0=None, t=None: 2.0 * U, inputs=["u"], outputs=["y"], dt=0.1)
    slow = AugmentedSimulator(plant, [CATALOGUE["sensor_lag"]("y")], [(0.4,)])
    ramp = np.arange(10.0)[:, None]
    np.testing.assert_allclose(slow.simulate(ramp[:n]), slow.simulate(ramp)[:n], atol=1e-12)


def test_trajectories_refuse_effects_on_balances():
    plant = Recording({"k": 2.0})
    slow = AugmentedSimulator(plant, [CATALOGUE["parameter_drift"]("k")], [(0.1,)])
    with pytest.raises(SimulatorError, match="needs rhs or step; Recording only gives trajectories"):
        slow.simulate(np.zeros((5, 1)))
    with pytest.raises(SimulatorError, match="gives no states"):
        slow.simulate_states(np.zeros((5, 1)))


def test_a_step_function_takes_effects_on_balances():
    rate = ODESimulator(
        lambda t, x, u, p: (u[0] - p["k"] * x[0],), states=["y"], inputs=["u"], outputs=["y"], params={"k": 2.0}, dt=0.1
    )
    t = 0.1 * np.arange(80)
    U = np.sin(t)[:, None]
    cases = [
        ("quadratic_drag", (1.5,), 5e-3),
        ("hidden_relaxation", (1.0, 0.7), 5e-3),
        ("hysteresis", (1.0, 0.2), 2e-2),
    ]
    for name, values, tolerance in cases:  # effects and steps take turns: second order in dt, first where z has kinks
        effect = CATALOGUE[name]("y", "y")
        a, b = (AugmentedSimulator(s, [effect], [values]).simulate(U, [0.5]) for s in (rate, Stepper()))
        assert np.max(np.abs(a - b)) < tolerance * np.std(a), name
    X, dX = AugmentedSimulator(Stepper(), [CATALOGUE["constant_bias"]("y")], [(0.1,)]).simulate_states(U, [0.5])
    assert X.shape == dX.shape == (80, 1)


def test_terms_go_amid_each_of_the_steps_that_a_simulator_calls_its_own():
    """Midpoint rule from the middle of the simulator's own step: the rate that the step itself had does not count twice."""

    class Stepping(Stepper):
        timestep = 0.05  # two steps in a sample

    plant, h = Stepping(), 0.05
    effects = [CATALOGUE["linear_loss"]("y", "y"), CATALOGUE["linear_loss"]("u", "y")]
    U, y, c = np.sin(np.arange(20.0))[:, None], [0.5], 3.0
    for u in np.repeat(U[:-1, 0], 2):
        after = float(plant.step(0.0, [y[-1]], [u - 0.2 * y[-1]], plant.params, h)[0])
        y.append(after - h * c * (1 - c * h / 2) * (y[-1] + after) / 2)
    found = AugmentedSimulator(plant, effects, [(c,), (0.2,)]).simulate(U, [0.5])[:, 0]
    np.testing.assert_allclose(found, y[::2], rtol=1e-10)


# ---- what goes wrong -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([], "effects has 1 entries, values 0"),
        ([{"level": 1.0}], r"got \['level'\], expected \['coefficient'\]"),
        ([(1.0, 2.0)], "got 2 numbers"),
    ],
)
def test_values_must_fit_the_effects(values, message, oscillator):
    with pytest.raises(SimulatorError, match=message):
        drag(values, oscillator).simulate(np.zeros((5, 1)))


def test_shapes_and_names_are_checked(oscillator):
    with pytest.raises(SimulatorError, match=r"one column for each of inputs=\['u'\]"):
        drag(plant=oscillator).simulate(np.zeros((5, 3)))
    with pytest.raises(ValueError, match="location='w' is not a state"):
        AugmentedSimulator(oscillator, [CATALOGUE["drift"]("w")], [(1.0,)]).simulate(np.zeros((5, 1)))
    with pytest.raises(SimulatorError, match="retuned: the simulator has no parameter 'zz'"):
        drag(plant=oscillator, retuned={"zz": 1.0}).simulate(np.zeros((5, 1)))


def test_an_effect_that_blows_up_says_when_and_which_state(oscillator):
    wild = AugmentedSimulator(oscillator, [CATALOGUE["quadratic_drag"]("v", "v")], [(-500.0,)])
    with pytest.raises(SimulationDiverged, match="state '"):
        wild.simulate(np.full((200, 1), 5.0))
