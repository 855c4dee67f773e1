"""What a simulator that steps is asked: little, for its steps are dear."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.gap.fit import _ode
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.gap.screen._screen import screen
from sksurrogate.kernels import damped_steps, output_error
from sksurrogate.kernels.record import Record
from sksurrogate.physics import MuJoCoSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

pytest.importorskip("mujoco")

PENDULUM = """<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" damping="0.1" armature="0.01"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.5"/></body></worldbody>
<actuator><motor name="torque" joint="hinge" gear="2"/></actuator></mujoco>"""
NAMES = ["hinge.damping", "hinge.armature", "torque.gear"]


@pytest.fixture(scope="module")
def null():
    """The simulator alone; the pendulum has a third more damping."""
    how = {"outputs": ["hinge.pos"], "params": NAMES, "dt": 0.01}
    simulator = MuJoCoSimulator(PENDULUM, **how)
    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(-1.0, 1.0, (2, 10, 1)), 12, axis=1)
    real = MuJoCoSimulator(PENDULUM, **how).set_params(**{"params__hinge.damping": 0.13})
    Y = [real.simulate(u) + 1e-3 * rng.normal(size=(120, 1)) for u in U]
    record = Record.from_runs(list(U), Y, [0.01 * np.arange(120)] * 2, 0.01)
    model = PlantModel(describe(simulator))
    model.probe(np.zeros(1))
    problem, smoothed = build_problem(model, record, (), ["hinge.vel"])
    return problem.fit((), np.zeros(0), smoothed.x)


@pytest.fixture(scope="module")
def responses(null):
    return Responses(null, null.fit.x)


@pytest.mark.parametrize("start, share", [(0.05, 0.5), (3.0, 0.8)])
def test_slopes_serve_again_as_long_as_steps_keep_their_promise(monkeypatch, null, start, share):
    asked, slopes = [], output_error.linearise
    for steps in (output_error, damped_steps):
        monkeypatch.setattr(steps, "linearise", lambda *given: asked.append(1) or slopes(*given))

    def fitted():
        asked.clear()
        found = null.problem.fit((CATALOGUE["parameter_error"]("hinge.damping"),), np.array([start]), null.fit.x)
        return found, len(asked)

    (again, few), _ = fitted(), monkeypatch.setattr(AugmentedModel, "may_jump", False)
    fresh, many = fitted()
    assert few <= share * many
    assert again.fit.theta[0] == pytest.approx(fresh.fit.theta[0], abs=1e-4)
    assert again.fit.theta[0] == pytest.approx(0.3, abs=0.03) and again.fit.cost == pytest.approx(
        fresh.fit.cost, rel=1e-5
    )
    there = slopes(again.model, again.fit.theta, again.fit.x, np.ones(1)).J_theta
    assert np.abs(again.linearised.J_theta - there).max() < 0.01 * np.abs(there).max()  # those of where it ended


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "kind, variable, starts",
    [
        ("parameter_dependence", "hinge.vel", [[0.02, -0.02, 0.01], [0.0, 0.02, -0.05]]),
        ("parameter_dependence", "torque", [[0.05, -0.05], [0.0, 0.01]]),
        ("parameter_drift", None, [[0.05, -0.05]]),
    ],
)
def test_one_step_tells_what_all_values_of_a_parameter_that_moves_change(
    monkeypatch, responses, name, kind, variable, starts
):
    effect, starts = CATALOGUE[kind](name, *([variable] if variable else [])), np.array(starts)
    assert len(responses.along[0]) == 1  # the force that holds the simulator on the path: once for all effects
    asked, step = [], PlantModel.step
    monkeypatch.setattr(PlantModel, "step", lambda self, *given: asked.append(1) or step(self, *given))
    found, _ = responses.columns(effect, starts)
    assert len(asked) <= 5  # the model's own steps in one sample
    monkeypatch.setattr(AugmentedModel, "may_jump", False)
    alone, _ = responses.columns(effect, starts)
    size = np.abs(alone).max(axis=(0, 2))
    assert np.all(size > 0) and np.all(np.abs(found - alone).max(axis=(0, 2)) < 0.15 * size)


@pytest.mark.parametrize(
    "effect, values",
    [
        ("input_gain", [[0.1]]),
        ("input_dead_zone", [[0.2]]),
        ("input_saturation", [[0.4, 0.6]]),
        ("input_delay", [[0.013]]),
    ],
)
def test_a_unit_of_an_input_tells_what_all_its_changes_change(responses, null, effect, values):
    effect, starts = CATALOGUE[effect]("torque"), np.array(values)
    model, theta = null.problem.augmented((effect,)), np.stack([null.theta_with(start) for start in starts.T], axis=1)
    whole = model.bind(theta)(np.repeat(responses.smoothed.x[:, None], starts.shape[1], axis=1)) - responses.after
    changed = responses.entered(effect, model, theta)
    assert np.linalg.norm(whole) > 0
    assert np.linalg.norm(changed - whole) < 0.03 * np.linalg.norm(whole)


@pytest.mark.parametrize("steps_itself", [True, False])
def test_retuning_alone_has_no_more_steps_than_its_folds_where_slopes_are_dear(monkeypatch, null, steps_itself):
    most, fit = [], _ode.output_error
    monkeypatch.setattr(_ode, "output_error", lambda *given, **how: most.append(how["max_steps"]) or fit(*given, **how))
    monkeypatch.setattr(AugmentedModel, "may_jump", steps_itself)
    _, tuned = null.baselines(null.problem.record)
    assert set(most) == {_ode.REFIT_STEPS if steps_itself else _ode.FIT_STEPS}
    assert tuned.fit.theta[0] == pytest.approx(np.log(1.3), abs=0.1)  # the damping, by its ratio


SERVO = """<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="hinge" axis="0 1 0" damping="0.01" armature="0.01"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.2"/></body></worldbody>
<actuator><position name="target" joint="hinge" kp="0.5" kv="0.03"/></actuator></mujoco>"""


def expected_of_armature(held, **real):
    """The null, and what the screen expects of an armature beside it; a joint that is held stays at rest."""
    how = {"outputs": ["hinge.pos"], "dt": 0.01}
    simulator, plant = (MuJoCoSimulator(SERVO, **how) for _ in range(2))
    rng, n = np.random.default_rng(1), 200
    U = np.repeat(rng.uniform(-0.6, 0.6, (3, n // 25, 1)), 25, axis=1)
    plant.set_params(**{f"params__{name}": value for name, value in real.items()})
    Y = [(0.0 if held else plant.simulate(u)) + 5e-4 * rng.normal(size=(n, 1)) for u in U]
    record = Record.from_runs(list(U), Y, [0.01 * np.arange(n)] * 3, 0.01)
    model = PlantModel(describe(simulator))
    model.probe(np.zeros(1))
    problem, smoothed = build_problem(model, record, (), ["hinge.vel"])
    null = problem.fit((), np.zeros(0), smoothed.x)
    (start,) = screen([CATALOGUE["parameter_error"]("hinge.armature")], null, smoothed.x, None).starts
    return null.fit, start


def test_an_inertia_is_nothing_in_a_joint_that_does_not_move():
    """The model alone would move: along a path at rest heavier joints would explain why the plant does not."""
    null, start = expected_of_armature(held=True)
    assert null.cost > 1e4 and start.white < 0.02 * (start.white + start.left)


def test_the_screen_knows_the_size_of_a_wrong_inertia():
    """To first order in the error, and to any order in the gap: the model is held on the path of the plant."""
    null, start = expected_of_armature(held=False, **{"hinge.armature": 0.02})
    assert null.cost > 1e4 and start.left < 0.01 * null.cost
    assert start.theta[0] == pytest.approx(1.0, abs=0.05)
