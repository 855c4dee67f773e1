"""Simulators with effects as state-space forms: the map from sample to sample equals ``simulate``, slopes equal formulae."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, InputEffect, Parameter
from sksurrogate.effects._onset import can_start, starting
from sksurrogate.effects._small_signal import pade_of
from sksurrogate.exceptions import SimulatorError, SurrogateError
from sksurrogate.export import state_space, to_casadi, to_graph
from sksurrogate.physics import CallableSimulator, ODESimulator, StepSimulator, linearise, steady_state

SCALE, X0 = (0.5, 1.0, 0.5), (0.05, 0.1, 0.2)
U = np.repeat(np.random.default_rng(0).normal(size=(8, 2)), 5, axis=0) * [1.5, 0.6]


def _rhs(t, x, u, p):
    q, v, h = x
    return v, (u[0] - p["k"] * q - p["c"] * v) / p["m"] + 0.1 * u[1], u[1] - 0.5 * h + 0.1 * q


def _step(t, x, u, p, dt):
    return [a + dt * b for a, b in zip(x, _rhs(t, x, u, p))]


NAMES = {"states": ["q", "v", "h"], "inputs": ["u", "w"], "params": {"m": 1.0, "k": 4.0, "c": 0.6}, "dt": 0.05}
ODE = ODESimulator(_rhs, outputs=["q", "h"], **NAMES)
SHOWN = ODESimulator(_rhs, outputs=["q", "h"], output=lambda t, x, u, p: (x[0] + 0.2 * u[0], x[2] * x[2]), **NAMES)
STEP = StepSimulator(_step, outputs=["q", "h"], **NAMES)
STEP_SHOWN = StepSimulator(_step, outputs=["q", "h"], output=SHOWN.output, **NAMES)

#: name -> place, variable, values; others act on v by v with 0.2.
CASES = {
    "parameter_step": ("k", None, (0.3, 1.0)), "step_disturbance": ("v", None, (0.5, 1.0)), "drift": ("v", None, (0.2,)),
    "constant_bias": ("v", None, (0.2,)), "periodic_disturbance": ("v", None, (0.4, 2.0, 0.3)),
    "overflow": ("q", "h", (0.5, 0.4)), "state_saturation": ("q", None, (0.3,)), "power_law": ("v", "v", (0.3, 1.6)),
    "hysteresis": ("v", "q", (1.0, 0.2)), "lugre_friction": ("v", "v", (20.0, 0.3, 0.5, 0.1)),
    "hidden_relaxation": ("v", "q", (0.5, 0.4)), "hidden_mode": ("v", "q", (0.5, 6.0, 0.1)),
    "stribeck_friction": ("v", "v", (0.2, 0.4, 0.1)), "end_stop": ("v", "q", (5.0, 0.2)), "bilinear": ("v", "q*v", (0.2,)),
    "exchange": ("v", "q", (0.2,)), "radiation": ("v", "q", (0.2,)), "input_coupling": ("u", "w", (0.2,)),
    "input_delay": ("u", None, (0.123,)), "rate_limit": ("u", None, (2.0,)), "input_saturation": ("u", None, (1.0,)),
    "input_quantization": ("u", None, (0.5,)), "sensor_delay": ("q", None, (0.123,)), "sensor_coupling": ("q", "h", (0.2,)),
    "sensor_rectification": ("q", None, ()),
}  # fmt: skip
PLACE = {"parameter": ("k", None), "input": ("u", None), "output": ("q", None), "state": ("v", "v")}
#: Effects that are linearised by no side.
SLOPELESS = {"input_backlash", "input_quantization", "sensor_quantization"}


def _with(simulator, *names):
    effects, values = [], []
    for name in names:
        kind = CATALOGUE[name]
        place, variable, given = CASES.get(name, (*PLACE[kind.kind], (0.2,) * len(kind.parameters)))
        effects.append(kind(place, variable))
        values.append(given)
    return AugmentedSimulator(simulator, effects, values, scale=SCALE)


def _simulated(model):
    """Outputs, and the substeps that the free run took."""
    return model.simulate(U, x0=X0), model.substeps(U, x0=X0)


def _run(function, x):
    out = []
    for u in U:
        found = function(x, u)
        x, _ = np.ravel(found[0]), out.append(np.ravel(found[1]))
    return np.array(out)


def _numpy(model, n_sub):
    graph = model.to_graph(n_sub)
    return lambda x, u: (graph(x=x, u=u)["x_next"], graph(x=x, u=u)["y"])


def _casadi(model, n_sub):
    pytest.importorskip("casadi")
    function = to_casadi(model, n_sub=n_sub)
    return lambda x, u: [part.full() for part in function(x, u)]


@pytest.mark.slow
@pytest.mark.parametrize("simulator", [ODE, SHOWN, STEP, STEP_SHOWN], ids=["states", "outputs", "step", "step_outputs"])
@pytest.mark.parametrize("name", CATALOGUE)
def test_every_effect_of_the_catalogue_runs_as_it_is_simulated(name, simulator):
    model = _with(simulator, name)
    expected, n_sub = _simulated(model)
    found = _run(_numpy(model, n_sub), model.start_state(X0, U[0], n_sub))
    assert np.max(np.abs(found - expected)) < 1e-9


@pytest.mark.parametrize("first", ["parameter_step", "parameter_drift", "parameter_dependence"])
def test_a_wrong_parameter_that_changes_too_runs_as_it_is_simulated(first):
    """The error acts on what the other effect has made of the parameter."""
    effects = [
        CATALOGUE[first]("k", "q" if first == "parameter_dependence" else None),
        CATALOGUE["parameter_error"]("k"),
    ]
    values = [(0.3, 1.0)[: len(effects[0].parameters)], (0.2,)]
    model = AugmentedSimulator(ODE, effects, values, scale=SCALE)
    expected, n_sub = _simulated(model)
    found = _run(_numpy(model, n_sub), model.start_state(X0, U[0], n_sub))
    np.testing.assert_allclose(found, expected, atol=1e-9)


MANY = (
    ("input_saturation", "rate_limit", "input_delay", "input_lag", "sensor_lag", "sensor_delay", "sensor_gain"),
    ("input_backlash", "input_delay", "hysteresis", "hidden_mode", "sensor_delay"),
    ("lugre_friction", "input_quantization", "input_lag", "overflow", "drift", "sensor_quantization"),
)


@pytest.mark.slow
@pytest.mark.parametrize("run", [_numpy, _casadi], ids=["numpy", "casadi"])
@pytest.mark.parametrize("names", MANY)
def test_several_effects_run_as_they_are_simulated(names, run):
    model = _with(SHOWN, *names)
    expected, n_sub = _simulated(model)
    found = _run(run(model, n_sub), model.start_state(X0, U[0], n_sub))
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("name", ["input_backlash", "rate_limit", "input_delay", "input_lag"])
def test_an_actuator_that_was_at_rest_runs_as_it_is_simulated(name):
    plain = _with(SHOWN, name)
    model = AugmentedSimulator(SHOWN, [CATALOGUE[name]("u", before=0.0)], plain.values, scale=SCALE)
    expected, n_sub = _simulated(model)
    assert np.max(np.abs(expected - _simulated(plain)[0])) > 1e-3
    found = _run(_numpy(model, n_sub), model.start_state(X0, U[0], n_sub))
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("simulator", [SHOWN, STEP_SHOWN], ids=["outputs", "step_outputs"])
@pytest.mark.parametrize("name", [name for name in CATALOGUE if can_start(CATALOGUE[name]())])
def test_an_effect_with_an_onset_runs_as_it_is_simulated(name, simulator):
    plain = _with(simulator, name, "sensor_delay" if name == "sensor_lag" else "sensor_lag")
    late = starting(plain.effects[0])
    model = AugmentedSimulator(
        simulator, [late, plain.effects[1]], [(*plain.values[0], 0.62), plain.values[1]], scale=SCALE
    )
    expected, n_sub = _simulated(model)
    found = _run(_numpy(model, n_sub), model.start_state(X0, U[0], n_sub))
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("time", [1.0, 1.013])  # at a sample, within one
@pytest.mark.parametrize(("name", "place"), [("step_disturbance", "v"), ("parameter_step", "k")])
def test_a_step_in_time_is_simulated_in_fixed_steps_and_exported_as_it_is(name, place, time):
    model = AugmentedSimulator(ODE, [CATALOGUE[name](place)], [(0.5, time)], scale=SCALE)
    expected, n_sub = _simulated(model)
    assert n_sub < 32  # no integrator of scipy
    np.testing.assert_allclose(_run(_numpy(model, n_sub), model.start_state(X0, U[0])), expected, atol=1e-9)
    fine = _run(_numpy(model, 32), model.start_state(X0, U[0]))
    np.testing.assert_allclose(fine, expected, atol=2e-5)  # the jump is spread over a substep


@pytest.mark.parametrize("names", [("sensor_lag",), ("sensor_delay", "parameter_drift")])
def test_slow_sensors_of_a_step_simulator_show_every_run_as_if_it_were_alone(names):
    model = _with(STEP_SHOWN, *names)
    together = model.simulate_batch(np.stack([U, 0.3 - U]), [X0, X0])
    alone = [model.simulate(u, x0=X0) for u in (U, 0.3 - U)]
    np.testing.assert_allclose(together, alone, atol=1e-12)


def test_python_control_takes_the_steps_of_simulate():
    control = pytest.importorskip("control")
    model = _with(ODE, "linear_loss")
    expected, n_sub = _simulated(model)
    system = model.to_control(n_sub)
    found = control.input_output_response(system, 0.05 * np.arange(len(U)), U.T, X0).outputs
    np.testing.assert_allclose(found.T, expected, atol=1e-9)


@pytest.mark.slow
def test_the_steps_of_a_plain_simulator_are_those_of_its_run():
    for plant, many in ((ODE, 1), (ODE, 40), (SHOWN, 1)):  # 40: closed window by window
        inputs = np.tile(U, (many, 1))
        graph, x, found = to_graph(plant, plant.substeps(inputs, x0=X0)), np.array(X0), []
        for u in inputs:
            values = graph(x=x, u=u)
            x, _ = values["x_next"], found.append(values["y"])
        np.testing.assert_allclose(found, plant.simulate(inputs, x0=X0), atol=1e-9)


def test_a_run_in_steps_of_scipy_has_no_number_of_steps():
    stiff = ODESimulator(
        lambda t, x, u, p: [-1e5 * (x[0] - u[0])], states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1
    )
    worn = AugmentedSimulator(stiff, [CATALOGUE["input_gain"]("u")], [(0.1,)])
    for model in (stiff, worn):
        with pytest.raises(SimulatorError, match="integrator simulates this run with variable steps"):
            model.substeps(U[:, :1])


@pytest.mark.slow
def test_kinks_over_sizes_that_an_export_does_not_know_are_refused_with_the_sizes():
    friction = AugmentedSimulator(ODE, [CATALOGUE["coulomb_friction"]("v", "v")], [(0.2,)])
    with pytest.raises(SimulatorError, match=r"scale=None: .* Give scale=\[[\d., ]+\] for both") as error:
        friction.substeps(U, x0=X0)
    sizes = [float(size) for size in str(error.value).split("scale=[")[1].split("]")[0].split(",")]
    expected, n_sub = _simulated(friction.set_params(scale=sizes))
    np.testing.assert_allclose(_run(_numpy(friction, n_sub), friction.start_state(X0, U[0])), expected, atol=1e-9)
    assert AugmentedSimulator(ODE, [CATALOGUE["linear_loss"]("v", "v")], [(0.2,)]).substeps(U, x0=X0) < 10
    driven = AugmentedSimulator(ODE, [CATALOGUE["coulomb_friction"]("v", "u")], [(0.2,)], scale=SCALE)
    with pytest.raises(SimulatorError, match="a kink over an input"):
        driven.substeps(np.where(np.arange(len(U))[:, None] < 5, 1e-3, U), x0=X0)
    with pytest.raises(SimulatorError, match=r"t has steps of 0\.1"):
        friction.substeps(U, x0=X0, t=0.1 * np.arange(len(U)))


def test_states_are_named_and_the_clock_is_there_only_where_something_depends_on_time():
    graph = _with(ODE, "input_delay", "hidden_mode").to_graph()
    lines = [f"input_delay_u_{k}" for k in range(3)]
    assert graph.states == ["q", "v", "h", "hidden_mode_v_0", "hidden_mode_v_1", *lines]
    assert graph.signals == (["u", "w"], ["q", "h"])
    assert _with(ODE, "drift").to_graph().states == ["q", "v", "h", "time"]


def test_a_lag_and_a_relaxation_are_linearised_as_by_hand():
    model = _with(ODE, "input_lag", "hidden_relaxation")
    x = steady_state(model, [0.4, 0.1])
    local = linearise(model, x, [0.4, 0.1])
    expected = np.array(
        [
            [0, 1, 0, 0, 0],
            [-4 - 0.5, -0.6, 0, 0.5, 1],
            [0.1, 0, -0.5, 0, 0],
            [1 / 0.4, 0, 0, -1 / 0.4, 0],
            [0, 0, 0, 0, -1 / 0.2],
        ]
    )
    np.testing.assert_allclose(local.A, expected, atol=1e-8)
    np.testing.assert_allclose(local.B, [[0, 0], [0, 0.1], [0, 1], [0, 0], [5, 0]], atol=1e-8)
    np.testing.assert_allclose(local.f, 0, atol=1e-8)
    assert local.states == ("q", "v", "h", "hidden_relaxation_v", "input_lag_u")


@pytest.mark.parametrize("name", ["input_delay", "sensor_delay"])
def test_delays_are_linearised_by_pade_with_the_order_that_is_asked_for(name):
    w, delay = 2.0, 0.123
    plain = linearise(ODE, np.zeros(3), np.zeros(2))

    def gain(local):
        resolved = np.linalg.solve(1j * w * np.eye(len(local.A)) - local.A, local.B[:, 0])
        return (local.C @ resolved + local.D[:, 0])[0]

    errors = []
    for order in (1, 2, 3):
        local = linearise(_with(ODE, name), np.zeros(3), np.zeros(2), pade=order)
        assert len(local.A) == 3 + order
        errors.append(abs(gain(local) / gain(plain) - np.exp(-1j * w * delay)))
    assert errors[0] < 2e-3 and errors[1] < 1e-5 and errors[2] < 1e-7


@pytest.mark.parametrize("order", [1, 2, 4])
def test_pade_has_gain_one_and_the_phase_of_the_delay(order):
    A, B, C, D = pade_of(0.3, order)
    for w in (0.0, 0.5, 1.0):
        value = C @ np.linalg.solve(1j * w * np.eye(order) - A, B) + D
        assert abs(value) == pytest.approx(1.0) and np.angle(value) == pytest.approx(
            -0.3 * w, abs={1: 3e-3, 2: 1e-5, 4: 1e-9}[order]
        )


@pytest.mark.parametrize("simulator", [ODE, STEP], ids=["ode", "step"])
@pytest.mark.parametrize("name", CATALOGUE)
def test_every_effect_is_linearised_or_refused_with_its_reason(name, simulator):
    model, x, u = _with(simulator, name), np.array([0.05, 0.01, 0.2]), np.array([0.1, 0.1])
    if name in SLOPELESS:
        with pytest.raises(SimulatorError, match=f"{name} on .* cannot be linearised: the slope of a"):
            linearise(model, x, u)
        return
    local = linearise(model, x, u)
    assert len(local.A) == len(local.states) and np.all(np.isfinite(local.A))


def test_a_state_at_its_limit_has_no_slope():
    with pytest.raises(SimulatorError, match=r"'q' is at its limit 0\.3"):
        linearise(_with(ODE, "state_saturation"), [0.3, 0.0, 0.0], [0.0, 0.0])


def test_python_control_runs_it_with_the_names_of_its_signals():
    control = pytest.importorskip("control")
    model = _with(ODE, "input_delay", "sensor_lag", "lugre_friction")
    system = model.to_control()
    assert system.input_labels == ["u", "w"] and system.output_labels == ["q", "h"]
    assert system.state_labels[:3] == ["q", "v", "h"] and system.dt == 0.05
    start = model.start_state(X0, U[0], 16)
    found = control.input_output_response(system, 0.05 * np.arange(len(U)), U.T, start).outputs
    np.testing.assert_allclose(found.T, model.simulate(U, x0=X0), atol=1e-4)
    local = linearise(model, [0.1, 0.01, 0.0], [0.0, 0.0]).to_control()
    assert local.input_labels == ["u", "w"] and local.state_labels[-3:] == [
        "input_delay_u_0",
        "input_delay_u_1",
        "sensor_lag_q",
    ]


def test_a_discrete_state_space_is_exact_for_a_delay_of_whole_samples():
    late = AugmentedSimulator(ODE, [CATALOGUE["input_delay"]("u")], [(0.1,)])
    plain, found = (state_space(m, [0.0, 0.0], x0) for m, x0 in ((ODE, np.zeros(3)), (late, np.zeros(3 + 3))))
    response = [m.C @ np.linalg.matrix_power(m.A, 10 + k) @ m.B[:, 0] for m, k in ((plain, 0), (found, 2))]
    np.testing.assert_allclose(*response, atol=1e-12)


def test_what_has_no_state_space_form_says_why():
    table = AugmentedSimulator(CallableSimulator(np.sin), [CATALOGUE["input_gain"]("u0")], [(0.1,)])
    with pytest.raises(SimulatorError, match="gives trajectories only"):
        table.to_graph()
    foh = ODESimulator(_rhs, outputs=["q"], hold="foh", **NAMES)
    with pytest.raises(SimulatorError, match='hold="foh" has no state-space form'):
        to_graph(_with(foh, "input_gain"))
    ahead = AugmentedSimulator(ODE, [CATALOGUE["sensor_delay"]("q", earliest=-1.0)], [(-0.1,)])
    with pytest.raises(SimulatorError, match="shows what is to come"):
        ahead.to_graph()
    branching = ODESimulator(
        lambda t, x, u, p: [u[0] if x[0] > 0 else -x[0]], states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1
    )
    with pytest.raises(SurrogateError, match="branch on values"):
        AugmentedSimulator(branching, [CATALOGUE["input_lag"]("u")], [(0.1,)]).to_graph()


class _Mean(InputEffect):
    """The mean of this sample and the last: a memory of one's own."""

    name, order, parameters = "input_mean", 3, (Parameter("share"),)

    def transform(self, u, v, theta, h, starts):
        before = np.concatenate([u.mean[..., :1], u.mean[..., :-1]], axis=-1)
        return replace(u, mean=u.mean + theta[0] * (before - u.mean))


def test_an_actuator_of_ones_own_with_a_memory_is_refused_and_one_without_is_exported():
    with pytest.raises(SimulatorError, match="input_mean: an actuator of your own with a memory"):
        AugmentedSimulator(ODE, [_Mean("u")], [(0.5,)]).to_graph()

    class Bent(CATALOGUE["input_curve"]):
        name = "input_bent"

    model = AugmentedSimulator(ODE, [Bent("u")], [(0.2,)])
    expected, n_sub = _simulated(model)
    np.testing.assert_allclose(_run(_numpy(model, n_sub), np.array(X0)), expected, atol=1e-9)


def test_a_simulator_that_branches_with_where_is_exported():
    plant = ODESimulator(
        lambda t, x, u, p: [u[0] - np.where(x[0] > 0, np.sqrt(np.abs(x[0])), 0.5 * x[0]) - np.clip(x[0], -0.1, 0.1)],
        states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.05,
    )  # fmt: skip
    graph, x = to_graph(plant, 32), np.array([0.4])
    for u in U[:, :1]:
        expected = plant.set_params(method="RK4").simulate(np.stack([u, u]), x0=x)[1]
        x = graph(x=x, u=u)["x_next"]
        np.testing.assert_allclose(x, expected, atol=1e-5)  # a root at 0
