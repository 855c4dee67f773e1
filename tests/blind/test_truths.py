"""The check's own equations: against closed forms, against the nominal simulators, against the catalogue's equations."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sksurrogate.blind import draw
from sksurrogate.blind._equations import two_rooms
from sksurrogate.blind._excite import coloured
from sksurrogate.blind._inexact import FORGOTTEN, FULL, LEAN, RESTED, loop_rate
from sksurrogate.blind._march import march
from sksurrogate.blind._plants import PLANTS
from sksurrogate.blind._retune import beyond_retuning
from sksurrogate.blind._score import _right
from sksurrogate.blind._truths import KINDS, NOVEL, Truth, remaining, twins_of
from sksurrogate.effects import CATALOGUE, AugmentedSimulator, starting
from sksurrogate.effects._onset import can_start


def experiment(plant, n_samples=40, n_runs=2, seed=0):
    rng = np.random.default_rng(seed)
    U = np.stack(
        [
            np.clip(
                d.middle + d.swing * np.repeat(rng.uniform(-1, 1, (n_runs, n_samples // 10)), 10, axis=1), d.low, d.high
            )
            for d in plant.drives
        ],
        axis=2,
    )
    X0 = np.array(plant.start) + np.array(plant.spread) * rng.uniform(-1, 1, (n_runs, len(plant.states)))
    return U, X0


def test_there_are_enough_plants_domains_and_effects():
    assert len(PLANTS) >= 12 and len({plant.domain for plant in PLANTS.values()}) >= 6
    assert len(KINDS) + len(NOVEL) >= 40 and set(KINDS) == set(CATALOGUE)


@pytest.mark.parametrize("name", PLANTS)
def test_without_an_effect_a_plant_is_its_simulator(name):
    plant = PLANTS[name]
    U, X0 = experiment(plant)
    course = march(plant, U, X0, substeps=8)
    expected = plant.simulator().simulate_batch(U, X0)
    np.testing.assert_allclose(course.outputs, expected, atol=5e-5 * np.abs(expected).max())


OSCILLATOR = [  # name, location, variable, params
    ("parameter_error", "stiffness", None, {"relative_error": 0.1}),
    ("parameter_drift", "stiffness", None, {"rate": 0.05}),
    ("parameter_step", "damping", None, {"relative_error": 0.5, "time": 1.5}),
    ("parameter_dependence", "stiffness", "velocity", {"slope": 0.1, "relative_error": 0.05}),
    ("parameter_dependence", "gain", "force", {"slope": 0.08, "relative_error": -0.1}),
    ("constant_bias", "velocity", None, {"value": -0.4}),
    ("linear_loss", "velocity", "velocity", {"coefficient": 0.3}),
    ("quadratic_loss", "velocity", "position", {"coefficient": 0.4}),
    ("quadratic_drag", "velocity", "velocity", {"coefficient": 0.3}),
    ("coulomb_friction", "velocity", "velocity", {"level": 0.5}),
    ("asymmetric_friction", "velocity", "velocity", {"level": 0.5, "offset": 0.2}),
    ("stribeck_friction", "velocity", "velocity", {"level": 0.4, "static_level": 0.8, "velocity": 0.5}),
    ("load_friction", "force", "velocity", {"coefficient": 0.2, "level": 0.1}),
    ("cubic_stiffness", "velocity", "position", {"coefficient": 3.0}),
    ("exchange", "velocity", "position", {"coefficient": 0.3}),
    ("radiation", "velocity", "position", {"coefficient": 0.1}),
    ("bilinear", "velocity", "force*position", {"coefficient": 0.3}),
    ("gravity_tilt", "velocity", "position", {"level": 0.8}),
    ("end_stop", "velocity", "position", {"stiffness": 8.0, "edge": 0.2}),
    ("state_saturation", "velocity", None, {"limit": 0.6}),
    ("drift", "velocity", None, {"rate": 0.2}),
    ("periodic_disturbance", "velocity", None, {"amplitude": 0.5, "angular_frequency": 3.0, "phase": 0.4}),
    ("step_disturbance", "velocity", None, {"size": 0.7, "time": 1.0}),
    ("hysteresis", "velocity", "position", {"stiffness": 4.0, "limit": 0.2}),
    ("lugre_friction", "velocity", "velocity", {"stiffness": 9.0, "level": 0.4, "static_level": 0.6, "velocity": 0.3}),
    ("hidden_relaxation", "velocity", "position", {"coefficient": 2.0, "time_constant": 0.6}),
    ("hidden_mode", "velocity", "position", {"gain": 2.0, "angular_frequency": 6.0, "damping": 0.1}),
    ("input_gain", "force", None, {"relative_error": 0.1}),
    ("input_bias", "force", None, {"value": 0.3}),
    ("input_curve", "force", None, {"coefficient": 0.05}),
    ("input_dead_zone", "force", None, {"half_width": 0.5}),
    ("input_backlash", "force", None, {"half_width": 0.5}),
    ("input_saturation", "force", None, {"limit": 2.0}),
    ("rate_limit", "force", None, {"limit": 20.0}),
    ("input_quantization", "force", None, {"step": 0.7}),
    ("input_delay", "force", None, {"delay": 0.083}),
    ("input_lag", "force", None, {"time_constant": 0.11}),
    ("sensor_lag", "position", None, {"time_constant": 0.11}),
    ("sensor_delay", "position", None, {"delay": 0.083}),
    ("sensor_coupling", "position", "velocity", {"coefficient": 0.1}),
    ("sensor_nonlinearity", "position", None, {"coefficient": 0.2}),
    ("sensor_gain", "position", None, {"relative_error": 0.1}),
    ("sensor_bias", "position", None, {"value": 0.1}),
    ("sensor_drift", "position", None, {"rate": 0.05}),
    ("sensor_rectification", "velocity", None, {}),
    ("sensor_saturation", "position", None, {"limit": 0.2}),
    ("sensor_quantization", "position", None, {"step": 0.1}),
]
TANKS = [
    ("cascaded_tanks", ("sqrt_leak", "lower", "lower", {"coefficient": 0.1})),
    ("cascaded_tanks", ("power_law", "upper", "upper", {"coefficient": 0.02, "exponent": 1.4})),
    ("cascaded_tanks", ("overflow", "upper", "lower", {"limit": 6.0, "share": 0.6})),
    ("two_mass_drive", ("backlash", "shaft", "twist", {"half_width": 0.01})),
    ("two_mass_drive", ("backlash", "shaft_damping", "abs(motor_speed - load_speed)", {"half_width": 0.1})),
    ("mixing_tank", ("input_coupling", "water", "brine", {"coefficient": 0.2})),
]
EVERY = [("oscillator", one) for one in OSCILLATOR] + TANKS


def test_every_effect_is_compared():
    assert {one[0] for _, one in EVERY} == set(CATALOGUE)


@pytest.mark.parametrize("plant_name, effect", EVERY, ids=[one[0] for _, one in EVERY])
def test_two_ways_to_one_effect(plant_name, effect):
    """Own equations and integration against the catalogue's: they differ by the smoothing of kinks alone."""
    name, location, variable, params = effect
    plant = PLANTS[plant_name]
    U, X0 = experiment(plant)
    if name in ("state_saturation", "overflow"):
        X0[:, plant.states.index(location)] = np.minimum(X0[:, plant.states.index(location)], params["limit"])
    course = march(plant, U, X0, [Truth(name, location, variable, params, 3e-3)], substeps=12)
    augmented = AugmentedSimulator(plant.simulator(), [CATALOGUE[name](location, variable)], [params])
    theirs = np.stack([augmented.simulate(u, x0=x) for u, x in zip(U, X0)])
    without = plant.simulator().simulate_batch(U, X0)
    change = np.sqrt(np.mean((theirs - without) ** 2))
    assert change > 1e-3 * np.std(without)
    assert np.sqrt(np.mean((course.outputs - theirs) ** 2)) < 0.02 * change


RESTING = [one for one in OSCILLATOR if one[0] in ("input_backlash", "rate_limit", "input_delay", "input_lag")]


@pytest.mark.parametrize("effect", RESTING, ids=[one[0] for one in RESTING])
def test_two_ways_to_an_actuator_that_was_at_rest(effect):
    name, location, variable, params = effect
    plant = PLANTS["oscillator"]
    U, X0 = experiment(plant)
    course = march(plant, U, X0, [Truth(name, location, variable, params, 3e-3, variant=RESTED)], substeps=12)
    theirs, settled = (
        np.stack([one.simulate(u, x0=x) for u, x in zip(U, X0)])
        for one in (
            AugmentedSimulator(plant.simulator(), [CATALOGUE[name](location, before=before)], [params])
            for before in (0.0, None)
        )
    )
    change = np.sqrt(np.mean((theirs - settled) ** 2))
    assert change > 1e-3 * np.std(settled)
    assert np.sqrt(np.mean((course.outputs - theirs) ** 2)) < 0.02 * change


CAN_START = [
    (plant, one) for plant, one in EVERY if can_start(CATALOGUE[one[0]](*one[1:3])) and one[0] != "sensor_saturation"
]


@pytest.mark.slow
@pytest.mark.parametrize("plant_name, effect", CAN_START, ids=[one[0] for _, one in CAN_START])
def test_two_ways_to_one_effect_that_begins(plant_name, effect):
    """The same from a moment within a sample on; before it nothing is different."""
    name, location, variable, params = effect
    plant = PLANTS[plant_name]
    U, X0 = experiment(plant)
    moment = 13.4 * plant.dt
    later = {**params, "onset": moment}
    course = march(plant, U, X0, [Truth(name, location, variable, later, 3e-3)], substeps=20)
    augmented = AugmentedSimulator(plant.simulator(), [starting(CATALOGUE[name](location, variable))], [later])
    theirs = np.stack([augmented.simulate(u, x0=x) for u, x in zip(U, X0)])
    without = plant.simulator().simulate_batch(U, X0)
    np.testing.assert_allclose(theirs[:, :14], without[:, :14], atol=1e-5 * np.abs(without).max())
    change = np.sqrt(np.mean((theirs - without) ** 2))
    assert change > 1e-3 * np.std(without)
    assert np.sqrt(np.mean((course.outputs - theirs) ** 2)) < 0.03 * change


ENDS = [case for case in CAN_START if case[1][0] in ("parameter_error", "state_saturation", "overflow", "input_gain")]


@pytest.mark.slow
@pytest.mark.parametrize("plant_name, effect", ENDS, ids=[one[0] for _, one in ENDS])
def test_two_ways_to_one_effect_that_begins_and_ends(plant_name, effect):
    """No state is beyond its limit where that sets in: it is brought back within a substep, not at once."""
    name, location, variable, params = effect
    plant = PLANTS[plant_name]
    U, X0 = experiment(plant)
    within = {**params, "onset": 13.4 * plant.dt, "end": 17.7 * plant.dt}
    course = march(plant, U, X0, [Truth(name, location, variable, within, 3e-3)], substeps=20)
    effects = [starting(CATALOGUE[name](location, variable), ("onset", "end"))]
    augmented = AugmentedSimulator(plant.simulator(), effects, [within])
    theirs = np.stack([augmented.simulate(u, x0=x) for u, x in zip(U, X0)])
    without = plant.simulator().simulate_batch(U, X0)
    change = np.sqrt(np.mean((theirs - without) ** 2))
    assert change > 1e-3 * np.std(without)
    assert np.sqrt(np.mean((course.outputs - theirs) ** 2)) < 0.03 * change


def test_a_lag_and_a_delay_are_exact_in_continuous_time():
    """An integrator behind a lag falls behind by tau times the step; a delay of whole samples shifts the input."""
    plant, tau = PLANTS["battery"], 1.3
    start = np.array([plant.start])
    U = np.zeros((1, 30, 1))
    U[0, 5:] = 2.0
    plain = march(plant, U, start).states[0, :, 0]
    lagged = march(plant, U, start, [Truth("input_lag", "load", None, {"time_constant": tau})]).states[0, :, 0]
    age = np.maximum(plant.dt * (np.arange(30) - 5), 0.0)
    expected = 2.0 / plant.params["capacity"] * tau * (1 - np.exp(-age / tau))
    np.testing.assert_allclose(lagged - plain, expected, atol=1e-9)
    shifted = march(plant, U, start, [Truth("input_delay", "load", None, {"delay": 3 * plant.dt})])
    moved = np.concatenate([np.zeros((1, 3, 1)), U[:, :-3]], axis=1)
    np.testing.assert_allclose(shifted.states, march(plant, moved, start).states, atol=1e-12)
    late = march(plant, U, start, [Truth("input_delay", "load", None, {"delay": 0.7 * plant.dt})]).states[0, -1, 0]
    assert late - plain[-1] == pytest.approx(0.7 * plant.dt * 2.0 / plant.params["capacity"], rel=1e-9)


def test_halving_the_step_changes_a_smooth_plant_by_a_sixteenth():
    plant = PLANTS["pendulum"]
    U, X0 = experiment(plant)
    truth = [Truth("cubic_stiffness", "rate", "angle", {"coefficient": 2.0})]
    exact = march(plant, U, X0, truth, substeps=32).outputs
    errors = [np.abs(march(plant, U, X0, truth, substeps=n).outputs - exact).max() for n in (2, 4)]
    assert 10 < errors[0] / errors[1] < 24


@pytest.mark.slow
def test_parameters_may_differ_from_column_to_column():
    plant = PLANTS["oscillator"]
    U, X0 = experiment(plant)
    for name, key, values in (("sensor_delay", "delay", [0.03, 0.11]), ("input_delay", "delay", [0.03, 0.11])):
        location = "position" if name == "sensor_delay" else "force"
        together = march(plant, U, X0, [Truth(name, location, None, {key: np.array(values)})]).outputs
        for r, value in enumerate(values):
            alone = march(plant, U[[r]], X0[[r]], [Truth(name, location, None, {key: value})]).outputs[0]
            np.testing.assert_allclose(together[r], alone, atol=1e-6)


def test_twins_are_names_of_the_catalogue_and_leave_with_the_effect():
    for name in KINDS:
        assert set(twins_of(name)) <= set(CATALOGUE)
        left = remaining([name])
        assert name not in left and not set(left) & set(twins_of(name)) and len(left) >= 20


def test_the_equations_are_not_the_catalogues():
    """Nothing of the rooms that the diagnosis is made of is imported."""
    import sksurrogate.blind as blind

    for path in Path(blind.__file__).parent.glob("*.py"):
        assert not re.search(
            r"from sksurrogate\.(effects|kernels)|import sksurrogate\.(effects|kernels)", path.read_text()
        )


@pytest.mark.slow
def test_what_retuning_can_imitate_leaves_no_gap():
    """A linear loss in the reactor is another flow and another feed; a quantized sensor is nothing of the kind."""
    plant = PLANTS["reactor"]
    case = draw("none", 5, plant=plant)
    U = case.question.X.reshape(len(case.starts), -1, 1)
    gaps = {}
    for truth in (
        Truth("linear_loss", "concentration", "concentration", {"coefficient": 0.02 * plant.params["flow"]}),
        Truth("sensor_quantization", "concentration", None, {"step": 0.3 * float(case.scale[0])}),
    ):
        y = march(plant, U, case.starts, [truth], substeps=12).outputs
        nominal = march(plant, U, case.starts, substeps=12).outputs
        alone = float(np.sqrt(np.mean(((y - nominal) / case.noise) ** 2)))
        gaps[truth.name] = beyond_retuning(replace(case, truths=(truth,))) / alone
    assert gaps["linear_loss"] < 0.02 and gaps["sensor_quantization"] > 0.9


def test_a_curved_input_and_a_quadratic_loss_in_that_input_leave_the_catalogue_together():
    """``u + c u |u|`` pushes one balance as ``c u^2`` does where u keeps its sign."""
    assert "quadratic_loss" not in remaining(["input_curve"])


@pytest.mark.slow
def test_experiments_in_which_a_pendulum_tumbles_are_drawn_again():
    plant = PLANTS["pendulum"]
    assert plant.holds(np.full((1, 5, 2), 6.0))
    assert not plant.holds(np.array([[[7.0, 0.0]]]))
    for seed in range(3):
        case = draw("effect", seed, plant=plant)
        angle = case.question.y.reshape(len(case.question.X), -1)[:, 0]
        assert np.abs(angle).max() < 6.3 + 10 * case.unit[0]


@pytest.mark.slow
def test_the_arm_of_onsets_draws_effects_that_begin_within_the_runs():
    case = draw("onset", 3, plant=PLANTS["oscillator"])
    truth, plant = case.truths[0], case.plant
    n_samples = case.facts["n_samples"]
    assert 0.25 <= truth.params["onset"] / (n_samples * plant.dt) <= 0.75 and list(truth.params)[-1] == "onset"
    U, X0 = case.question.X.reshape(len(case.starts), n_samples, -1), case.starts
    there, absent = (march(plant, U, X0, acting, substeps=12).outputs for acting in ([truth], []))
    before = int(truth.params["onset"] / plant.dt) + 1
    np.testing.assert_array_equal(there[:, :before], absent[:, :before])
    assert np.abs(there[:, before:] - absent[:, before:]).max() > 3.0 * case.noise.min()


@pytest.mark.parametrize(
    ("name", "twin", "verdict", "right"),
    [
        ("sensor_bias", "drift", "explained", True),
        ("constant_bias", "sensor_bias", "explained", True),  # an offset of the sensor is in the class
        ("constant_bias", "drift", "explained", False),
        ("sensor_bias", "drift", "unknown", False),
    ],
)
def test_a_trend_of_a_sensor_is_right_where_the_sensor_is_in_the_class(name, twin, verdict, right):
    effect = {"name": name, "location": "v", "variable": None, "equivalents": [[twin, "q", None]]}
    assert _right("trends", {"verdict": verdict, "effects": [effect]}, 0) is right
    assert _right("trends", {"verdict": "none", "effects": []}, 0)


@pytest.mark.parametrize("outdoors", [-10.0, 20.0])
def test_a_room_as_warm_as_outdoors_and_its_heater_keeps_its_temperature(outdoors):
    p = PLANTS["two_rooms"].params
    rates = two_rooms(0.0, (outdoors, outdoors), (0.0, outdoors), p)
    assert rates[1] == 0.0 and rates[0] == pytest.approx(p["to_air"] * (20.0 - outdoors))


@pytest.mark.parametrize("samples", [3.0, 20.0])
def test_noise_that_fades_has_unit_variance_and_its_memory(samples):
    noise = coloured(np.random.default_rng(0), (400, 400), samples)
    np.testing.assert_allclose(noise.std(axis=0), 1.0, atol=0.2)  # 400 draws: a deviation of 0.035
    assert np.mean(noise[:, 200:] ** 2) == pytest.approx(1.0, abs=0.1)
    assert np.mean(noise[:, 300:-1] * noise[:, 301:]) == pytest.approx(np.exp(-1.0 / samples), abs=0.1)


@pytest.mark.parametrize("variant", ["", LEAN, FULL])
def test_a_loop_yields_to_its_limit_whatever_it_forgets_on_the_way_back(variant):
    truth = Truth("hysteresis", "v", "y", {"stiffness": 1.0, "limit": 2.0}, variant=variant)
    share = FORGOTTEN.get(variant, 0.5)
    assert loop_rate(truth, 3.0, 0.5) == pytest.approx(3.0 * (1.0 - 0.5 / 2.0))
    assert loop_rate(truth, -3.0, 0.5) == pytest.approx(-3.0 * (1.0 + (2.0 * share - 1.0) * 0.5 / 2.0))
    assert loop_rate(truth, 3.0, 2.0) == pytest.approx(0.0)
