"""A load at the tip of a link: as the compiler of MuJoCo would have it, and named by a diagnosis."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap._diagnose import _known
from sksurrogate.physics import MuJoCoSimulator
from sksurrogate.physics._simulator import describe

mujoco = pytest.importorskip("mujoco")

#: The last link is bent out of its frame, so that its inertia has no axis of the frame, and carries a site.
ARM = """<mujoco><worldbody>
<body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.2"/>
  <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="1"/>
  <body name="lower" pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" damping="0.1"/><site name="mark" pos="0.05 0 -0.1"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.1 0.05 -0.3" mass="0.7"/>{}</body></body></worldbody>
<actuator><motor name="a" joint="shoulder"/><motor name="b" joint="elbow"/></actuator>
<sensor><framepos name="at" objtype="site" objname="mark"/></sensor></mujoco>"""
BALL = '<geom type="sphere" size="0.0001" pos="0.1 0.05 -0.3" mass="0.4"/>'
OUTPUTS = ["shoulder.pos", "elbow.pos", "at.x", "at.z"]


def arm(text=None, **params):
    found = MuJoCoSimulator(text or ARM.format(""), outputs=OUTPUTS, dt=0.01)
    return found.set_params(params={**found.params, **params}) if params else found


def inputs(n=200, seed=0):
    return np.repeat(np.random.default_rng(seed).uniform(-2, 2, (n // 20, 2)), 20, axis=0)


def test_a_load_is_what_the_compiler_makes_of_a_mass_at_the_tip():
    U = inputs()
    real, light = arm(ARM.format(BALL)).simulate(U), arm().simulate(U)
    assert np.abs(real - light).max() > 0.1
    assert np.allclose(arm(**{"lower.load": 0.4}).simulate(U), real, atol=1e-6)  # the ball has a radius


def test_mass_and_load_of_a_body_are_set_together_and_taken_back():
    U, simulator = inputs(), arm(ARM.format(BALL.replace("0.4", "0.3")).replace('mass="0.7"', 'mass="0.9"'))
    both = arm(**{"lower.mass": 0.9, "lower.load": 0.3})
    assert np.allclose(both.simulate(U), simulator.simulate(U), atol=1e-6)
    x, u = np.zeros((4, 3)), np.ones((2, 3))
    loads = np.array([0.3, 0.0, 0.3])
    after = both.step(0.0, x, u, {"lower.mass": 0.7, "lower.load": loads}, 0.01)
    assert np.array_equal(after[:, 0], after[:, 2])
    assert np.array_equal(after[:, 1], arm().step(0.0, x, u, {}, 0.01)[:, 1])


def test_a_model_with_a_load_is_written_and_read_again():
    U, simulator = inputs(), arm(**{"lower.load": 0.4})
    read = MuJoCoSimulator(simulator.to_mjcf(), outputs=OUTPUTS, dt=0.01)
    assert read.params["lower.mass"] == pytest.approx(1.1) and read.params["lower.load"] == 0.0
    assert np.allclose(read.simulate(U), simulator.simulate(U), atol=1e-9)


def test_bodies_that_carry_others_and_those_whose_tip_is_their_origin_have_no_load():
    assert [name for name in arm().params if name.endswith(".load")] == ["lower.load"]
    ball = MuJoCoSimulator(
        '<mujoco><worldbody><body name="ball"><freejoint name="free"/><geom size="0.1" mass="1"/></body></worldbody></mujoco>'
    )
    assert not [name for name in ball.params if name.endswith(".load")]


def test_damping_friction_and_armature_are_fitted_within_what_they_can_be():
    names = ["elbow.damping", "elbow.frictionloss", "elbow.armature", "lower.load"]
    small = MuJoCoSimulator(ARM.format(""), outputs=OUTPUTS[:2], params=names, dt=0.01)
    assert small.own_bounds() == dict.fromkeys(names[:3], (0.0, np.inf))
    known = _known({"elbow.armature": (-1.0, 1.0)}, None, plant := describe(small))  # what the user says goes before
    errors = [CATALOGUE["parameter_error"](name) for name in names]
    low, high = known.bounds_of(plant.params, errors, names, 1.0)
    assert low[:4].tolist() == [-1.0, 0.0, -1.0, -np.inf]  # relative where the model has a value
    assert low[5:].tolist() == [0.0, -1.0, -np.inf] and high[4 + 1] == np.inf


def test_a_model_with_a_negative_damping_of_its_own_keeps_it():
    driven = MuJoCoSimulator(
        ARM.replace('damping="0.1"', 'damping="-0.1"').format(""), params=["elbow.damping"], dt=0.01
    )
    assert driven.own_bounds() == {}
