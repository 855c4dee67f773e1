"""Dry friction that grows with the load: its form, where it is sought, what a simulator says of the load, recovery."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._catalogue import build_effects
from sksurrogate.effects._onset import starting
from sksurrogate.effects._parts import Probe
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import MuJoCoSimulator, ODESimulator
from sksurrogate.physics._simulator import describe

FRICTION = CATALOGUE["load_friction"]


def rates(t, x, u, p):
    return [x[1], (u[0] - p["b"] * x[1] - p["k"] * np.sin(x[0])) / p["J"]]


def joint(right_hand_side=rates):
    names = {"states": ["q", "v"], "inputs": ["torque"], "outputs": ["q"]}
    return ODESimulator(right_hand_side, **names, params={"J": 0.5, "b": 0.3, "k": 2.0}, dt=0.02)


def test_the_force_is_a_level_and_a_share_of_the_load_against_the_motion():
    load, v = np.array([0.0, 2.0, -2.0, 4.0]), np.array([1.0, -1.0, 1.0, 0.0])
    force = FRICTION("torque", "v").term(0.0, load, v, (0.25, 0.1), 0.0)
    np.testing.assert_allclose(force, [-0.1, 0.6, -0.6, 0.0])


def test_its_jump_is_smoothed_as_far_as_the_load_makes_it_jump():
    friction, h = FRICTION("torque", "v"), 0.1
    width = friction.smoothed((0.5, 0.0), 1e-3, h)
    v = 1e-9
    slopes = -friction.term(0.0, np.array([1e-3, 2.0, 20.0]), v, (0.5, 0.0), width) / v
    assert np.all(slopes * h < 2.001)  # an explicit step can follow
    np.testing.assert_allclose(slopes, [0.5, 20.0, 20.0], rtol=1e-6)


@pytest.mark.parametrize("v, load", [([1.0, 2.0, 3.0], [1.0, -2.0, 0.5]), ([1.0, -2.0, 3.0], [2.0, -2.0, 2.0])])
def test_it_is_not_asked_where_nothing_tells_it_from_simpler_forms(v, load):
    probe = Probe(np.array(v), np.array(load), 1.0, 0.1, 0.3, np.array([0]))
    assert FRICTION("torque", "v").starts(probe) == []
    moving = Probe(np.array([1.0, -2.0, 3.0]), np.array([1.0, -2.0, 0.5]), 1.0, 0.1, 0.3, np.array([0]))
    assert len(FRICTION("torque", "v").starts(moving)) == 2


def test_all_starts_are_as_large_at_the_load_as_it_usually_is():
    v, load = np.array([1.0, -2.0, 3.0, -1.0]), np.array([1.0, -2.0, 0.5, 3.0])
    friction, usual = FRICTION("torque", "v"), np.sqrt(np.mean(load**2))
    starts = friction.starts(Probe(v, load, 2.0, 0.1, 0.4, np.array([0])))
    # a tenth of the derivative, as a friction without a load
    np.testing.assert_allclose([friction.jump(theta, usual) for theta in starts], 0.2)


def test_a_simulator_with_it_is_one_whose_equations_have_it():
    friction = AugmentedSimulator(joint(), [FRICTION("torque", "v")], [{"coefficient": 0.2, "level": 0.15}])
    rng = np.random.default_rng(0)
    x, u = rng.normal(size=(2, 50)), rng.normal(size=(1, 50))
    expected = rates(0.0, x, u - (0.15 + 0.2 * np.abs(u)) * np.sign(x[1]), joint().params)
    np.testing.assert_allclose(friction.rhs(0.0, x, u, joint().params), expected, atol=1e-12)


ARM = """
<mujoco><option timestep="0.002"/><worldbody>
  <body><joint name="shoulder" axis="0 1 0" damping="0.1"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="1"/>
    <body pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.6" contype="0" conaffinity="0"/></body></body>
</worldbody><actuator>
  <motor name="drive" joint="shoulder" gear="3" ctrlrange="-1 1"/>
  <position name="servo" joint="elbow" kp="8" kv="0.4"/>
</actuator></mujoco>
"""


def test_what_the_drives_bring_is_what_mujoco_says():
    mujoco = pytest.importorskip("mujoco")
    arm, rng = MuJoCoSimulator(ARM), np.random.default_rng(1)
    x, u = rng.normal(size=(4, 20)), 2.0 * rng.normal(size=(2, 20))
    p = {**arm.params, "drive.gear": rng.uniform(2.0, 4.0, 20), "servo.kp": 5.0}
    forces = arm.drive_forces(x, u, p)
    for k in range(20):
        model = mujoco.MjModel.from_xml_string(ARM)
        model.actuator_gear[0, 0] = p["drive.gear"][k]
        model.actuator_gainprm[1, 0], model.actuator_biasprm[1, 1] = 5.0, -5.0
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = x[:2, k], x[2:, k], u[:, k]
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(forces[:, k], data.qfrc_actuator, atol=1e-12)


def test_a_model_whose_equations_are_not_written_has_no_such_law():
    pytest.importorskip("mujoco")
    free = MuJoCoSimulator(
        ARM.replace('<body><joint name="shoulder"', '<body><joint name="shoulder" range="-1 1" limited="true"')
    )
    loop = MuJoCoSimulator(
        ARM.replace("</actuator>", '</actuator><equality><joint joint1="shoulder" joint2="elbow"/></equality>')
    )
    assert hasattr(free, "drive_forces") and not hasattr(loop, "drive_forces")
    places = [build_effects(describe(arm), ["shoulder.vel", "elbow.vel"], "load_friction") for arm in (free, loop)]
    assert [effect.key for effect in places[0]] == [("load_friction", j, f"{j}.vel") for j in ("shoulder", "elbow")]
    assert {effect.location for effect in places[1]} == {"drive"}  # the motor, whose input is its load


@pytest.mark.slow
def test_it_is_found_and_not_given_where_the_friction_is_constant():
    def real(t, x, u, p):
        own = 0.2 * np.abs(u[0]) if p["grows"] else 0.25
        return rates(t, x, u - (0.15 + own) * np.tanh(x[1] / 1e-3), p)

    rng = np.random.default_rng(0)
    U = [2 * np.repeat(rng.uniform(-1, 1, 15), 12)[:, None] for _ in range(4)]
    X, groups = np.concatenate(U), np.repeat(range(4), 180)
    for grows, name in ((True, "load_friction"), (False, "coulomb_friction")):
        plant = joint(real)
        plant.params = {**plant.params, "grows": grows}
        y = np.concatenate([plant.simulate(u) for u in U])
        y = y + 0.003 * y.std() * rng.normal(size=y.shape)
        names = ["coulomb_friction", "stribeck_friction", "load_friction", "linear_loss", "input_gain"]
        report = GapDiagnoser(joint(), effects=names, random_state=0).fit(X, y, groups=groups).report_
        (found,) = report.effects
        assert (report.verdict, found.name) == ("explained", name)
        if grows:
            assert found.location == "torque" and found.variable == "v"
            for key, planted in (("coefficient", 0.2), ("level", 0.15)):
                low, high = found.intervals[key]
                assert abs(found.params[key] - planted) < 0.03 * planted and high - low < 0.1 * planted


@pytest.mark.slow
def test_it_may_begin_in_a_run():
    later = AugmentedSimulator(
        joint(), [starting(FRICTION("torque", "v"))], [{"coefficient": 0.2, "level": 0.1, "onset": 1.0}]
    )
    U = np.sin(np.arange(100) / 5.0)[:, None]
    plain, with_it = joint().simulate(U), later.simulate(U)
    assert np.allclose(plain[:50], with_it[:50], atol=1e-6) and np.abs(plain - with_it)[60:].max() > 0.01
