"""What a simulator that steps is asked: little, for its steps are dear."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.gap.fit import _ode
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.kernels import output_error
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
    problem, smoothed = build_problem(model.plant, model, record, (), ["hinge.vel"])
    return problem.fit((), np.zeros(0), smoothed.x)


@pytest.fixture(scope="module")
def responses(null):
    return Responses(null, null.fit.x)


def test_slopes_serve_again_where_a_fit_hardly_moves(monkeypatch, null):
    asked, slopes = [], output_error.linearise
    monkeypatch.setattr(output_error, "linearise", lambda *given: asked.append(1) or slopes(*given))

    def fitted():
        asked.clear()
        found = null.problem.fit((CATALOGUE["parameter_error"]("hinge.damping"),), np.array([0.05]), null.fit.x)
        return found.fit, len(asked)

    (again, few), _ = fitted(), monkeypatch.setattr(AugmentedModel, "may_jump", False)
    fresh, many = fitted()
    assert few < many
    assert again.theta[0] == pytest.approx(fresh.theta[0], abs=1e-5) and again.theta[0] == pytest.approx(0.3, abs=0.03)
    assert again.cost == pytest.approx(fresh.cost, rel=1e-5)


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
    asked, step = [], PlantModel.step
    monkeypatch.setattr(PlantModel, "step", lambda self, *given: asked.append(1) or step(self, *given))
    found, _ = responses.columns(effect, starts)
    assert len(asked) <= 1
    monkeypatch.setattr(AugmentedModel, "may_jump", False)
    alone, _ = responses.columns(effect, starts)
    size = np.abs(alone).max(axis=(0, 2))
    assert np.all(size > 0) and np.all(np.abs(found - alone).max(axis=(0, 2)) < 0.15 * size)


@pytest.mark.parametrize("steps_itself", [True, False])
def test_retuning_alone_has_no_more_steps_than_its_folds_where_slopes_are_dear(monkeypatch, null, steps_itself):
    most, fit = [], _ode.output_error
    monkeypatch.setattr(_ode, "output_error", lambda *given, **how: most.append(how["max_steps"]) or fit(*given, **how))
    monkeypatch.setattr(AugmentedModel, "may_jump", steps_itself)
    _, tuned = null.baselines(null.problem.record)
    assert set(most) == {_ode.REFIT_STEPS if steps_itself else _ode.FIT_STEPS}
    assert tuned.fit.theta[0] == pytest.approx(np.log(1.3), abs=0.1)  # the damping, by its ratio
