"""Simulators that jump at impacts: free runs start again behind them."""

import numpy as np
import pytest

from sksurrogate.effects._model import AugmentedModel
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._jumps import rows_that_jump
from sksurrogate.kernels.record import Record
from sksurrogate.physics import MuJoCoSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

pytest.importorskip("mujoco")

DT, N = 0.02, 120
CART = """<mujoco><compiler autolimits="true"/><option timestep="0.004"/><default><geom contype="0" conaffinity="0"/></default>
<worldbody><body><joint name="rail" type="slide" axis="1 0 0" {} damping="0.8"/><geom type="box" size="0.1 0.06 0.05" mass="0.9"/>
<body><joint name="hinge" axis="0 1 0" damping="0.004"/><geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.012" mass="0.25"/>
</body></body></worldbody><actuator><motor name="push" joint="rail" gear="5"/></actuator></mujoco>"""


def cart(stops=True, **params):
    model = CART.format('range="-0.3 0.3"' if stops else "")
    simulator = MuJoCoSimulator(model, outputs=["rail.pos", "hinge.pos"], dt=DT)
    return simulator.set_params(**{f"params__{name}": value for name, value in params.items()})


def inputs(n_runs):
    return np.repeat(np.random.default_rng(0).uniform(-1, 1, (n_runs, N // 20, 1)), 20, axis=1)


def problem_of(simulator, U, Y):
    record = Record.from_runs(list(U), list(Y), [DT * np.arange(N)] * len(U), DT)
    model = PlantModel(describe(simulator))
    model.probe(np.zeros(1))
    return build_problem(model, record, (), ["rail.vel", "hinge.vel"])


def test_the_samples_in_which_a_cart_hits_its_stop_jump_and_no_others():
    """A cart that rests against the stop does not jump, nor does one that leaves it or turns round."""
    simulator, U, rng = cart(), inputs(4), np.random.default_rng(1)
    X = [simulator.simulate_states(u)[0] for u in U]
    problem, _ = problem_of(simulator, U, [x[:, :2] + 1e-3 * rng.normal(size=(N, 2)) for x in X])
    path = np.concatenate(X).T
    at_stop = np.abs(path[0]) > 0.3
    speed = np.abs(path[2])
    hits = np.flatnonzero(at_stop[1:] & ~at_stop[:-1] & (speed[:-1] > 0.1) & (np.arange(1, 4 * N) % N != 0))
    jumps = np.flatnonzero(rows_that_jump(problem, path))
    assert len(hits) > 3 and np.sum(at_stop) > 2 * len(hits)
    assert set(hits) <= set(jumps) and all(np.min(np.abs(hits - row)) <= 1 for row in jumps)


def test_a_cart_without_stops_does_not_jump():
    simulator, U, rng = cart(stops=False), inputs(2), np.random.default_rng(1)
    X = [simulator.simulate_states(u)[0] for u in U]
    problem, _ = problem_of(simulator, U, [x[:, :2] + 1e-4 * rng.normal(size=(N, 2)) for x in X])
    assert not rows_that_jump(problem, np.concatenate(X).T).any()


def test_runs_of_any_lengths_are_those_of_each_alone():
    simulator, lengths = cart(), np.array([40, 3, 160, 1, 35, 90])
    starts, n, u = np.cumsum(lengths) - lengths, int(lengths.sum()), inputs(3).reshape(1, -1)
    record = Record(u[:, :n], np.zeros((2, n)), DT * np.arange(n), starts, DT)
    model = AugmentedModel(PlantModel(describe(simulator)), (), (), record, n_sub=1, scale=np.ones(4))
    x0 = np.random.default_rng(0).normal(scale=0.1, size=(4, len(lengths)))
    run = model.bind(np.zeros((0, 1))).run(x0)
    for a, m, start in zip(starts, lengths, x0.T):
        alone, _ = simulator.simulate_states(record.u[0, a : a + m, None], start)
        np.testing.assert_array_equal(run[:, a : a + m], alone.T)


@pytest.mark.slow
def test_dry_friction_of_a_cart_that_hits_its_stops_is_named():
    simulator, real, U, rng = cart(), cart(**{"hinge.frictionloss": 0.01}), inputs(4), np.random.default_rng(2)
    Y = [real.simulate(u) + 1e-3 * rng.normal(size=(N, 2)) for u in U]
    effects = ["coulomb_friction", "linear_loss", "sensor_bias", "input_gain"]
    diagnoser = GapDiagnoser(simulator, effects=effects, n_jobs=1, random_state=0)
    report = diagnoser.fit(U.reshape(-1, 1), np.concatenate(Y), groups=np.repeat(np.arange(4), N)).report_
    assert report.verdict == "explained"
    assert [(e.name, e.location) for e in report.effects] == [("coulomb_friction", "hinge")]
    assert report.effects[0].params["level"] == pytest.approx(0.01, rel=0.02)
    assert any("start again behind" in note for note in report.notes)
    assert diagnoser.initial_states_.shape == (4, 4)
