"""Free runs and fits of simulators whose own step jumps: balls that bounce, legs on the ground."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.kernels.output_error import output_error
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.windows import run_by_samples
from sksurrogate.physics import MuJoCoSimulator, ODESimulator
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._mujoco_engine import Engine
from sksurrogate.physics._simulator import describe

DT = 0.02


class Ball:
    """A ball that bounces on a table which takes some of its speed."""

    states, inputs, outputs, dt = ["height", "speed"], ["push"], ["height"], DT
    params = {"rebound": 0.8}
    x0 = np.array([0.3, 0.0])

    def step(self, t, x, u, p, dt):
        speed = x[1] + dt * (u[0] - 9.81)
        height = x[0] + dt * speed
        return np.stack([np.abs(height), np.where(height < 0.0, -p["rebound"] * speed, speed)])

    def simulate(self, U, x0=None, t=None):
        x, out = np.array(self.x0 if x0 is None else x0), []
        for u in U:
            out.append(x[:1])
            x = self.step(0.0, x, u, self.params, self.dt)
        return np.array(out)


LEG = """<mujoco><option timestep="0.002" integrator="implicitfast"/><default><geom friction="0.9 0.1 0.1"/></default><worldbody>
<geom name="floor" type="plane" size="5 5 0.1"/><body pos="0 0 0.33"><joint name="height" type="slide" axis="0 0 1" damping="0.5"/>
<geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.05"/><body><joint name="hip" axis="0 1 0" damping="0.3" armature="0.01"/>
<geom name="foot" type="capsule" fromto="0 0 0 0 0 -0.28" size="0.04"/></body></body></worldbody>
<actuator><motor name="hip" joint="hip" gear="6"/></actuator></mujoco>"""


def record_of(simulator, n_runs, n_samples, noise, x0=None):
    """Held random inputs, and what a simulator gives with noise."""
    rng = np.random.default_rng(3)
    U = np.repeat(rng.uniform(-1.0, 1.0, (n_runs, n_samples // 15, 1)), 15, axis=1)
    Y = [simulator.simulate(u, x0) for u in U]
    readings = [y + noise * rng.normal(size=y.shape) for y in Y]
    return Record.from_runs(list(U), readings, [simulator.dt * np.arange(n_samples)] * n_runs, simulator.dt)


def test_a_run_that_begins_in_a_jump_is_no_stiff_plant():
    """A spring with a preload, at rest in its middle: from there on x'' = 0.8 - x - 0.5 x', with its solution."""

    def rhs(t, x, u, p):
        return x[1], u[0] - x[0] - 0.5 * x[1] - 0.2 * np.sign(x[0])

    spring = ODESimulator(rhs, states=["x", "v"], inputs=["u"], outputs=["x"], params={}, dt=0.1)
    U, t, w = np.ones((100, 1)), 0.1 * np.arange(100), np.sqrt(1.0 - 0.25**2)
    known = 0.8 * (1.0 - np.exp(-0.25 * t) * (np.cos(w * t) + 0.25 / w * np.sin(w * t)))
    assert spring.simulate(U)[:, 0] == pytest.approx(known, abs=5e-4)  # the first substep begins without the preload
    assert spring.substeps(U) <= 48


def test_a_fit_goes_on_where_a_bounce_lets_no_correction_settle():
    ball = Ball()
    record = record_of(ball, 3, 90, 1e-4)
    inner = PlantModel(describe(ball))
    inner.probe(np.zeros(1))
    model = FitModel(inner, ["rebound"], record, 1, np.array([0.2, 1.0]))

    def fitted(start):
        theta = np.array([start])
        x = run_by_samples(model.bind(theta[:, None]), np.tile(ball.x0[:, None], 3), record.starts, record.lengths)
        bounds = np.array([0.0]), np.array([1.0])
        return output_error(model, theta, x, np.array([1e-4]), unit=np.ones(1), bounds=bounds, open_steps=0, fallback=x)

    near, far = fitted(0.795), fitted(0.7)
    assert near.theta[0] == pytest.approx(0.8, abs=1e-3) and near.cost < 1.5 * record.n_values
    assert far.n_iterations > 1 and abs(far.theta[0] - 0.8) < 0.02  # every bounce is a minimum of its own


def leg(effects, theta):
    pytest.importorskip("mujoco")
    simulator = MuJoCoSimulator(LEG, outputs=["height.pos", "hip.pos"], params=["hip.gear", "foot.friction"], dt=0.01)
    record = record_of(simulator, 2, 60, 0.0)
    model = AugmentedModel(PlantModel(describe(simulator)), effects, (), record, n_sub=1, scale=np.ones(4))
    return model.bind(np.array(theta)[:, None]), record, np.tile(simulator.x0[:, None], 2)


STRIBECK = CATALOGUE["stribeck_friction"]("hip.force", "hip.vel")
#: Laws at a joint, with and without hidden states, and their parameters.
LAWS = {
    "none": ([], []),
    "law": ([STRIBECK], [0.1, 0.2, 0.3]),
    "bristles": ([CATALOGUE["lugre_friction"]("hip.force", "hip.vel")], [20.0, 0.2, 0.3, 0.5]),
    "a mode beside a law": (
        [CATALOGUE["hidden_mode"]("hip.force", "hip.pos"), STRIBECK],
        [2.0, 30.0, 0.1, 0.1, 0.2, 0.3],
    ),
}


@pytest.mark.parametrize("effects, values", LAWS.values(), ids=LAWS)
def test_a_run_by_the_model_itself_is_its_steps_one_after_the_other(effects, values):
    effects = [CATALOGUE["parameter_error"]("hip.gear"), CATALOGUE["input_dead_zone"]("hip"), *effects]
    bound, record, x0 = leg(effects, [0.2, 0.1, *values])
    x0 = bound.start(x0[:, None])[:, 0]
    own, steps = bound.run(x0), run_by_samples(bound, x0, record.starts, record.lengths)
    assert np.abs(own[0]).max() > 1e-3  # the leg has moved on the ground
    assert np.allclose(own, steps, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize(
    "effects, values, at_once",
    [(*LAWS["none"], True), (*LAWS["law"], False), ([CATALOGUE["parameter_drift"]("hip.gear")], [0.1], False)],
)
def test_a_run_is_one_call_where_nothing_acts_within_its_steps(monkeypatch, effects, values, at_once):
    effects = [CATALOGUE["parameter_error"]("hip.gear"), CATALOGUE["input_dead_zone"]("hip"), *effects]
    bound, _, x0 = leg(effects, [0.2, 0.1, *values])
    asked, rollout = [], Engine._rollout
    monkeypatch.setattr(Engine, "_rollout", lambda *given: asked.append(1) or rollout(*given))
    assert bound.a.runs_at_once == at_once == (bound.run(x0) is not None and len(asked) == 1)


def test_runs_that_leave_the_numbers_are_nan():
    bound, _, x0 = leg([STRIBECK], [0.1, 0.2, 0.3])
    own = bound.run(np.where(np.arange(4)[:, None] == 3, np.nan, x0))
    assert np.isnan(own[:, [1, -1]]).all()


def test_it_does_not_run_by_itself_where_parameters_drift():
    bound, _, x0 = leg([CATALOGUE["parameter_drift"]("hip.gear")], [0.1])
    assert bound.run(x0) is None
