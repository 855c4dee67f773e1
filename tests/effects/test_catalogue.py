"""The catalogue: names, declarations, nulls, columns, places, starting values."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone

from sksurrogate.effects import CATALOGUE, Probe, build_effects
from sksurrogate.effects._disturbance import frequencies
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.effects._structure import kinematic_states
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator, StepSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe
from sksurrogate.testing import check_effect

#: Public API: names in order, parameters magnitude first.
TABLE = {
    "parameter_error": ["relative_error"],
    "parameter_drift": ["rate"],
    "parameter_step": ["relative_error", "time"],
    "parameter_dependence": ["slope", "relative_error"],
    "backlash": ["half_width"],
    "constant_bias": ["value"],
    "linear_loss": ["coefficient"],
    "quadratic_loss": ["coefficient"],
    "quadratic_drag": ["coefficient"],
    "coulomb_friction": ["level"],
    "asymmetric_friction": ["level", "offset"],
    "stribeck_friction": ["level", "static_level", "velocity"],
    "load_friction": ["coefficient", "level"],
    "cubic_stiffness": ["coefficient"],
    "sqrt_leak": ["coefficient"],
    "power_law": ["coefficient", "exponent"],
    "exchange": ["coefficient"],
    "radiation": ["coefficient"],
    "bilinear": ["coefficient"],
    "gravity_tilt": ["level"],
    "end_stop": ["stiffness", "edge"],
    "state_saturation": ["limit"],
    "overflow": ["limit", "share"],
    "drift": ["rate"],
    "periodic_disturbance": ["amplitude", "angular_frequency", "phase"],
    "step_disturbance": ["size", "time"],
    "hysteresis": ["stiffness", "limit"],
    "lugre_friction": ["stiffness", "level", "static_level", "velocity"],
    "hidden_relaxation": ["coefficient", "time_constant"],
    "hidden_mode": ["gain", "angular_frequency", "damping"],
    "input_gain": ["relative_error"],
    "input_bias": ["value"],
    "input_curve": ["coefficient"],
    "input_coupling": ["coefficient"],
    "input_dead_zone": ["half_width"],
    "input_backlash": ["half_width"],
    "input_saturation": ["limit"],
    "rate_limit": ["limit"],
    "input_quantization": ["step"],
    "input_delay": ["delay"],
    "input_lag": ["time_constant"],
    "sensor_lag": ["time_constant"],
    "sensor_delay": ["delay"],
    "sensor_coupling": ["coefficient"],
    "sensor_nonlinearity": ["coefficient"],
    "sensor_gain": ["relative_error"],
    "sensor_bias": ["value"],
    "sensor_drift": ["rate"],
    "sensor_rectification": [],
    "sensor_saturation": ["limit"],
    "sensor_quantization": ["step"],
}
#: Effects whose first parameter may have either sign; of the others it is not negative.
SIGNED = {
    *(
        "parameter_error",
        "parameter_drift",
        "parameter_step",
        "parameter_dependence",
        "constant_bias",
        "linear_loss",
        "quadratic_loss",
        "exchange",
    ),
    *("bilinear", "drift", "periodic_disturbance", "step_disturbance", "input_gain", "input_bias", "input_curve"),
    *("input_coupling", "sensor_coupling", "sensor_nonlinearity", "sensor_gain", "sensor_bias", "sensor_drift"),
    *("state_saturation", "overflow", "sensor_saturation"),  # a limit may lie below zero
}
EVERY = pytest.mark.parametrize("cls", CATALOGUE.values(), ids=CATALOGUE)


def test_names_parameters_and_order_are_those_of_the_table():
    assert {name: [p.name for p in cls.parameters] for name, cls in CATALOGUE.items()} == TABLE
    assert list(CATALOGUE) == list(TABLE)


@EVERY
def test_declaration_says_what_a_reader_needs(cls):
    assert cls.equation and cls.signature and {*cls.twins, *cls.nests} <= set(CATALOGUE) - {cls.name}
    assert cls.__doc__ and "``" in cls.__doc__
    assert all(p.unit or p.name in ("relative_error", "exponent", "damping") for p in cls.parameters)
    if cls.parameters:
        assert (cls.parameters[0].low < 0) == (cls.name in SIGNED)


@pytest.mark.parametrize("kind", ["input", "output"])
def test_order_of_action_is_that_of_the_table(kind):
    orders = [cls.order for cls in CATALOGUE.values() if cls.kind == kind]
    assert orders == list(range(len(orders)))


@EVERY
def test_contract(cls):
    check_effect(cls)


@EVERY
def test_contract_where_inputs_are_joined_linearly(cls, make_tanks):
    check_effect(cls, make_tanks("foh"))


@EVERY
def test_clone_pickle_repr(cls):
    effect = cls("place", "signal")
    for other in (clone(effect), pickle.loads(pickle.dumps(effect))):
        assert type(other) is cls and other.key == (cls.name, "place", "signal")
    assert eval(repr(effect), {cls.__name__: cls}).key == effect.key


def random_record(plant, n_runs=2, n=30, seed=0):
    random = np.random.default_rng(seed)
    U = [random.normal(size=(n, len(plant.inputs))) for _ in range(n_runs)]
    t = plant.dt * np.arange(n)
    return Record.from_runs(U, [np.zeros((n, len(plant.outputs)))] * n_runs, [t] * n_runs, plant.dt)


@EVERY
@settings(max_examples=8, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31), foh=st.booleans(), n_sub=st.integers(1, 4))
def test_null_gives_the_simulator_back_at_any_state(cls, seed, foh, n_sub, make_tanks):
    if cls.name == "sensor_rectification":
        pytest.skip("it has no parameter, hence no null value")
    plant = describe(make_tanks("foh" if foh else "zoh"))
    model, random, record = PlantModel(plant), np.random.default_rng(seed), random_record(plant, seed=seed)
    scale = np.ones(2)
    bare = AugmentedModel(model, (), (), record, n_sub=n_sub, scale=scale).bind(np.zeros((0, 1)))
    for effect in cls.instances(plant, plant.states):
        whole = AugmentedModel(model, (effect,), (), record, n_sub=n_sub, scale=scale)
        null = whole.bind(np.array([[p.null] for p in cls.parameters]))
        x = random.normal(size=(whole.n_states, 1, record.n_samples))
        np.testing.assert_allclose(null(x)[:2], bare(x[:2]), rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(null.outputs(x), bare.outputs(x[:2]), rtol=1e-10, atol=1e-10)


def test_all_effects_at_once_in_columns_equal_them_one_by_one(make_tanks):
    plant = describe(make_tanks())
    record, random = random_record(plant), np.random.default_rng(1)
    effects = [
        CATALOGUE[name]("first") for name in ("input_bias", "input_backlash", "rate_limit", "input_delay", "input_lag")
    ]
    effects += [CATALOGUE["hysteresis"]("upper", "lower"), CATALOGUE["overflow"]("upper", "lower")]
    effects += [CATALOGUE["parameter_step"]("a"), CATALOGUE["step_disturbance"]("lower")]
    effects += [
        CATALOGUE[name]("level") for name in ("sensor_lag", "sensor_delay", "sensor_gain", "sensor_quantization")
    ]
    whole = AugmentedModel(PlantModel(plant), effects, ("b",), record, n_sub=3, scale=np.ones(2))
    theta = random.uniform(0.1, 0.9, size=(whole.n_theta, 5))
    x = random.normal(size=(whole.n_states, 5, record.n_samples))
    together = whole.bind(theta)
    for k in range(5):
        alone = whole.bind(theta[:, k : k + 1])
        np.testing.assert_allclose(together(x)[:, k], alone(x[:, k : k + 1])[:, 0], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(
            together.outputs(x)[:, k], alone.outputs(x[:, k : k + 1])[:, 0], rtol=1e-12, atol=1e-12
        )


def test_runs_do_not_see_each_other(make_tanks):
    plant = describe(make_tanks())
    record = random_record(plant)
    one = record.select([1])
    names = ("input_backlash", "rate_limit", "input_delay", "input_lag")
    effects = [CATALOGUE[name]("first") for name in names] + [
        CATALOGUE[name]("level") for name in ("sensor_lag", "sensor_delay")
    ]
    both, second = (AugmentedModel(PlantModel(plant), effects, (), r, n_sub=2, scale=np.ones(2)) for r in (record, one))
    theta = np.full((6, 1), 0.17)
    x = np.random.default_rng(0).normal(size=(2, 1, record.n_samples))
    rows = slice(record.starts[1], None)
    np.testing.assert_allclose(both.bind(theta)(x)[..., rows], second.bind(theta)(x[..., rows]), rtol=1e-12)
    np.testing.assert_allclose(
        both.bind(theta).outputs(x)[..., rows], second.bind(theta).outputs(x[..., rows]), rtol=1e-12
    )


# ---- building ------------------------------------------------------------------------------------------------------
def test_whole_catalogue_over_a_plant_is_not_too_long_and_nothing_comes_twice(make_oscillator):
    plant = describe(make_oscillator())
    found = build_effects(plant, ["v"])
    assert 50 <= len(found) <= 100
    assert len({effect.key for effect in found}) == len(found)
    assert {effect.name for effect in found} == set(CATALOGUE) - {"input_coupling"}  # one input: nothing to couple with
    four = ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["k"] * x[0], x[3], u[1] - p["k"] * x[2]),
        states=["a", "va", "b", "vb"], inputs=["f", "g"], outputs=["a", "b"], params={"k": 1.0}, dt=0.1,
    )  # fmt: skip
    assert kinematic_states(PlantModel(describe(four))) == ("a", "b")
    assert len(build_effects(describe(four), ["va", "vb"])) <= 350


def test_products_have_sorted_names(make_tanks):
    plant = describe(make_tanks())
    pairs = [e.variable for e in build_effects(plant, ["upper"], "bilinear")]
    assert pairs == ["first*lower", "first*second", "first*upper", "lower*second", "lower*upper", "second*upper"]


def test_names_classes_instances_and_own_places_may_be_mixed(make_tanks):
    plant = describe(make_tanks())
    mine = CATALOGUE["linear_loss"]("upper", "second")
    found = build_effects(plant, ["upper"], ["input_gain", CATALOGUE["drift"], mine, mine])
    assert [e.key for e in found] == [
        ("input_gain", "first", None), ("input_gain", "second", None), ("drift", "upper", None), mine.key,
    ]  # fmt: skip
    assert found[-1] is mine
    assert [e.key for e in build_effects(plant, ["lower"], CATALOGUE["drift"]())] == [("drift", "lower", None)]
    assert build_effects(plant, ["lower"], "drift")[0].location == "lower"


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        (["coulomb"], r"'coulomb' is not in the catalogue; did you mean 'coulomb_friction'"),
        (["zzz"], r"known are \['parameter_error'"),
        ([3], "neither a name of the catalogue"),
        ([CATALOGUE["drift"]("third")], r"location='third' is not a state of the simulator: \['upper', 'lower'\]"),
        ([CATALOGUE["exchange"]("upper", "third")], "variable='third' is made of signals"),
        ([CATALOGUE["input_coupling"]("first", "upper")], "variable='upper' is made of signals"),
    ],
)
def test_what_cannot_be_built_is_explained(effects, message, make_tanks):
    with pytest.raises(ValueError, match=message):
        build_effects(describe(make_tanks()), ["upper"], effects)


def test_trajectories_alone_allow_inputs_sensors_and_parameters():
    class Recorded:
        inputs, outputs, params, dt = ("u",), ("y",), {"k": 1.0}, 0.1

        def simulate(self, U, x0=None, t=None):
            return U

    found = build_effects(describe(Recorded()), [])
    kinds = {effect.kind for effect in found}
    assert kinds == {"input", "output", "parameter"}
    assert {e.name for e in found if e.kind == "parameter"} == {"parameter_error"}


# ---- kinematic identities ------------------------------------------------------------------------------------------
def simulator_of(rhs, states):
    return describe(ODESimulator(rhs, states=states, inputs=["u"], outputs=states[:1], params={"k": 2.0}, dt=0.1))


def test_kinematic_identities_are_found_and_nothing_else(make_oscillator, make_tanks):
    assert kinematic_states(PlantModel(describe(make_oscillator()))) == ("q",)
    assert kinematic_states(PlantModel(describe(make_tanks()))) == ()
    chain = simulator_of(lambda t, x, u, p: (x[2], u[0] - x[0], x[1]), ["a", "b", "c"])
    assert kinematic_states(PlantModel(chain)) == ("a", "c")
    damped = simulator_of(lambda t, x, u, p: (x[1] - 1e-6 * x[0], u[0]), ["a", "b"])
    assert kinematic_states(PlantModel(damped)) == ()
    scaled = simulator_of(lambda t, x, u, p: (p["k"] * x[1], u[0]), ["a", "b"])
    assert kinematic_states(PlantModel(scaled)) == ()
    root = simulator_of(lambda t, x, u, p: (x[1], -np.sqrt(x[0])), ["a", "b"])  # not finite at half of the points
    assert kinematic_states(PlantModel(root)) == ("a",)


def test_kinematic_identities_are_seen_through_a_step_function():
    class Stepper:
        states, inputs, outputs, params, dt = ("q", "v"), ("u",), ("q",), {}, 0.1

        def simulate(self, U, x0=None, t=None):
            return U

        def step(self, t, x, u, p, dt):
            v = x[1] + dt * (u[0] - x[0])
            return x[0] + dt * v, v

    assert kinematic_states(PlantModel(describe(Stepper()))) == ("q",)


def test_a_light_body_that_inputs_move_fast_within_a_step_has_a_speed():
    def step(t, x, u, p, dt):
        q, v = x
        for _ in range(10):  # steps of its own, whatever dt is
            v = v + 0.002 * (u[0] - 0.8 * np.sin(q) - p["d"] * v) / (0.014 + 0.002 * p["d"])
            q = q + 0.002 * v
        return q, v

    names = {"states": ["q", "v"], "inputs": ["torque"], "outputs": ["q"], "params": {"d": 0.05}, "dt": 0.02}
    assert kinematic_states(PlantModel(describe(StepSimulator(step, **names)))) == ("q",)


# ---- starting values -----------------------------------------------------------------------------------------------
def probe(x, v=None, rate=1.0, dt=0.1):
    return Probe(v, x, rate, dt, dt * len(x), np.array([0]))


@pytest.mark.parametrize("name", ["state_saturation", "sensor_saturation", "overflow", "input_saturation"])
def test_limits_start_inside_the_reached_range(name):
    x = np.random.default_rng(0).normal(size=500)
    reached = np.abs(x) if name == "input_saturation" else x
    limits = [start[0] for start in CATALOGUE[name]().starts(probe(x))]
    assert 3 <= len(limits) <= 9 and all(np.any(reached > limit) for limit in limits)


def test_a_signal_that_never_moves_offers_no_limit_edge_or_play():
    still = probe(np.full(50, 2.0), np.full(50, -2.0))
    for name in (
        "state_saturation",
        "sensor_saturation",
        "rate_limit",
        "input_backlash",
        "sqrt_leak",
        "power_law",
        "hysteresis",
    ):
        assert CATALOGUE[name]().starts(still) == []


def test_a_binary_input_is_cut_by_some_limit():
    u = np.sign(np.random.default_rng(0).normal(size=200))
    assert min(start[0] for start in CATALOGUE["input_saturation"]().starts(probe(u))) < 1


def test_delays_and_lags_start_between_a_third_and_thirty_samples():
    for name in ("input_delay", "input_lag", "sensor_delay", "sensor_lag"):
        found = [start[0] for start in CATALOGUE[name]().starts(probe(np.arange(300.0)))]
        assert found[0] == pytest.approx(0.03) and found[-1] == pytest.approx(3.0)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(share=st.floats(0.02, 0.98), n=st.integers(60, 230))
def test_every_line_lies_within_the_main_lobe_of_a_frequency_tried(share, n):
    dt = 0.05
    w = share * np.pi / (3 * dt)
    nearest = np.min(np.abs(frequencies(n * dt, dt) - w))
    assert nearest <= 0.51 * 2 * np.pi / (n * dt) or w < np.pi / (n * dt)
    assert np.max(frequencies(n * dt, dt)) < np.pi / (3 * dt) + 2 * np.pi / (n * dt)


def test_of_many_lines_the_slowest_stay_and_the_others_keep_a_ratio():
    dt, n = 0.05, 6000
    found = frequencies(n * dt, dt) * n * dt / (2 * np.pi)
    np.testing.assert_allclose(found[:5], [0.5, 0.75, 1, 2, 3])
    assert found[-1] == pytest.approx(n / 6, abs=1) and np.max(found[21:] / found[20:-1]) < 1.1


def test_quantizations_are_searched_closely_and_nothing_else_is():
    u = np.random.default_rng(0).normal(size=400)
    for name, cls in CATALOGUE.items():
        near = cls().scan(tuple(1.0 for _ in cls.parameters))
        assert bool(near) == name.endswith("_quantization")
    steps = np.array(CATALOGUE["input_quantization"]().starts(probe(u)))[:, 0]
    wanted = np.linspace(0.05, 0.9, 50) * np.max(np.abs(u))
    assert np.max(np.min(np.abs(steps[:, None] / wanted - 1), axis=0)) < 0.1


@settings(deadline=None, derandomize=True)
@given(amplitude=st.floats(-5, 5), phase=st.floats(-40, 40))
def test_canonical_oscillation_is_the_same_oscillation(amplitude, phase):
    effect, t = CATALOGUE["periodic_disturbance"]("v"), np.linspace(0, 3, 50)
    c, w, turned = effect.canonical((amplitude, 2.0, phase))
    assert c >= 0 and -np.pi < turned <= np.pi
    np.testing.assert_allclose(c * np.sin(w * t + turned), amplitude * np.sin(w * t + phase), atol=1e-9)


@pytest.mark.parametrize("name", ["hidden_mode", "periodic_disturbance"])
def test_what_shows_no_three_quarters_of_a_period_is_no_oscillation(name):
    effect = CATALOGUE[name]("first", "first") if name == "hidden_mode" else CATALOGUE[name]("first")
    frequency = [p.name for p in effect.parameters].index("angular_frequency")
    assert effect.lower_bounds(20.0)[frequency] * 20.0 == pytest.approx(0.75 * 2 * np.pi)
