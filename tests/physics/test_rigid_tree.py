"""Equations of motion of trees of hinges and slides: against MuJoCo point by point, and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from sksurrogate.physics import MuJoCoSimulator
from sksurrogate.physics._components import rotation, solved, transposed, turned
from sksurrogate.physics._mujoco_engine import AGREEMENT, FEWEST
from sksurrogate.physics._mujoco_equations import MuJoCoEquations
from sksurrogate.physics._mujoco_points import Points
from sksurrogate.physics._rigid_tree import Inertia, Link, bias, mass_matrix

mujoco = pytest.importorskip("mujoco")

#: Anchors beside the origin, oblique axes and frames, a slide and a hinge in one body, two arms, a welded body, springs, a servo,
#: actuators with ranges.
TREE = """<mujoco><option timestep="0.004" gravity="0.3 -1 -9.6" {option}/><worldbody>
<body name="cart" pos="0.1 0.2 0.3" quat="0.9 0.1 0.3 -0.2"><joint name="rail" type="slide" axis="1 0.2 0" damping="0.4"/>
<joint name="yaw" axis="0.1 0 1" pos="0.02 0.01 0" stiffness="2" springref="20" {limit}/>
<geom type="box" size="0.1 0.05 0.02" mass="1.1" {still}/>
<body name="upper" pos="0 0.2 0.1"><joint name="lift" axis="0 1 0" pos="0 0 0.03" ref="15" armature="0.02" damping="0.1"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0.1 0 -0.4" mass="0.6" {still}/>
<body name="hand" pos="0.1 0 -0.4" euler="20 10 0"><geom type="sphere" size="0.04" pos="0 0 -0.05" mass="0.2" {still}/></body>
</body>
<body name="side" pos="0 -0.2 0"><joint name="spin" axis="0 0.6 0.8" {friction}/>
<geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 -0.1" mass="0.4" {still}/></body>
</body></worldbody>
<tendon><fixed name="cord"><joint joint="lift" coef="0.02"/><joint joint="spin" coef="-0.03"/></fixed></tendon><actuator>
<general name="pull" tendon="cord" gainprm="3" biastype="affine" biasprm="0.1 -2 {cord}" gear="1.2"/>
<motor name="push" joint="rail" gear="3" ctrlrange="-1 1" ctrllimited="true"/>
<position name="servo" joint="lift" kp="12" kv="0.3"/>
<velocity name="pace" joint="spin" kv="0.2" forcerange="-0.1 0.1" forcelimited="{forces}"/>
</actuator></mujoco>"""
PLAIN = {
    "cord": "-0.5",
    "option": "",
    "limit": "",
    "friction": "",
    "still": 'contype="0" conaffinity="0"',
    "forces": "true",
}
INTEGRATORS = ("Euler", "RK4", "implicitfast")


def engine_of(**changes):
    """The engine of the tree with other attributes."""
    return MuJoCoSimulator(TREE.format(**{**PLAIN, **changes}))._engine()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_tree_moves_as_in_mujoco_whatever_its_parameters(integrator):
    implicit = integrator == "implicitfast"
    engine = engine_of(
        option=f'integrator="{integrator}"', forces="false" if implicit else "true", cord="0" if implicit else "-0.5"
    )
    equations = MuJoCoEquations.of(engine.origin, engine.parameters)
    at = equations.random_points(3 * FEWEST)
    after = equations.step(at, 5, engine.timestep)
    assert {
        "yaw.stiffness",
        "spin.armature",
        "upper.mass",
        "side.load",
        "lift.frictionloss",
        "servo.kp",
        "pace.kv",
        "push.gear",
    } <= set(at.p)
    for mine, theirs in (
        (equations.rates(at), engine._rates(at)),
        (after, engine._points("step", at, 5, engine.timestep)[0]),
    ):
        assert np.isfinite(theirs).all() and np.isfinite(mine).all()
        error = np.abs(mine - theirs).max(axis=0) / np.abs(theirs).max()
        assert error.max() < AGREEMENT and np.median(error) < 1e-14
    assert engine._equations is not None


def test_contacts_that_are_switched_off_are_none():
    """Then the option of the model says so, whatever its geoms."""
    text = TREE.format(**{**PLAIN, "still": ""}).replace(
        "/><worldbody>", '><flag contact="disable"/></option><worldbody>'
    )
    assert MuJoCoSimulator(text)._engine()._equations is not None


@pytest.mark.parametrize(
    "changes",
    [
        {"option": 'integrator="implicit"'},
        {"option": 'density="1.2"'},
        {"still": ""},
        {"option": 'integrator="implicitfast"', "cord": "0"},
    ],
    ids=["another integrator", "a fluid", "contacts", "a clipped force in an implicit step"],
)
def test_mujoco_is_asked_where_the_equations_do_not_hold(changes):
    assert engine_of(**changes)._equations is None


def test_points_at_an_end_stop_are_asked_of_mujoco():
    engine = engine_of(limit='range="-40 40" limited="true"')
    at = engine._equations.random_points(2 * FEWEST)
    at.x[1] *= 1.3  # some beyond 40 degrees
    outside = np.abs(at.x[1]) > np.deg2rad(40)
    assert outside.any() and not outside.all()
    np.testing.assert_array_equal(engine.rates(at)[:, outside], engine._rates(at.some(outside)))
    np.testing.assert_allclose(engine.rates(at), engine._rates(at), rtol=1e-7, atol=1e-9)
    own = engine._points("step", at, 4, engine.timestep)[0]
    np.testing.assert_allclose(engine.step(at, 4 * engine.timestep), own, rtol=1e-7, atol=1e-9)


def test_a_dry_friction_holds_a_joint_or_slides_it_as_in_mujoco():
    """A joint at rest under a torque below the friction, at it, and beyond; through the engine, what the equations leave open too."""
    engine = engine_of(friction='frictionloss="0.2"')
    at = engine._equations.random_points(4 * FEWEST)
    at = Points(at.t, at.x, at.controls, at.forces, {"lift.frictionloss": np.linspace(0.0, 3.0, 4 * FEWEST)})
    at.x[4:, ::2] = 0.0
    at.x[4:, 1::4] *= 1e-3
    np.testing.assert_allclose(engine.rates(at), engine._rates(at), rtol=1e-6, atol=1e-6)
    without = Points(at.t, at.x, at.controls, at.forces, {"spin.frictionloss": 0.0})
    held = np.abs(engine.rates(at)[6, ::2]) < 0.2 * np.abs(engine.rates(without)[6, ::2])  # MuJoCo's friction is soft
    assert held.any() and not held.all()


def test_what_a_model_cannot_have_is_nan_by_both():
    engine = engine_of()
    mass = np.where(np.arange(FEWEST) < 5, -1.0, 2.0)
    at = Points(np.zeros(FEWEST), np.ones((8, FEWEST)), np.zeros((4, FEWEST)), None, {"upper.mass": mass})
    at.x[0, 7], at.controls[2, 8] = np.nan, np.inf
    lost = np.isnan(engine.rates(at)).any(axis=0)
    assert np.flatnonzero(lost).tolist() == [0, 1, 2, 3, 4, 7, 8]
    np.testing.assert_array_equal(lost, np.isnan(engine._rates(at)).any(axis=0))


def test_two_point_masses_on_rods_have_the_equations_of_the_textbook():
    rng = np.random.default_rng(3)
    (m1, m2), (l1, l2), g = (1.3, 0.7), (0.8, 0.5), 9.81
    (q1, q2), (v1, v2) = rng.normal(0, 2, (2, 2, 50))

    def rod(m, length):
        return Inertia(
            m, (0.0, 0.0, -m * length), ((m * length**2, 0.0, 0.0), (0.0, m * length**2, 0.0), (0.0, 0.0, 0.0))
        )

    straight = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    about = (0.0, 1.0, 0.0)
    links = [Link(-1, True, about, straight, (0.0, 0.0, 0.0)), Link(0, True, about, straight, (0.0, 0.0, -l1))]
    inertia = [rod(m1, l1), rod(m2, l2)]
    places = [link.place(q) for link, q in zip(links, (q1, q2))]
    (M11,), (M21, M22) = mass_matrix(links, inertia, places)
    coupling = m2 * l1 * l2
    np.testing.assert_allclose(M11, (m1 + m2) * l1**2 + m2 * l2**2 + 2 * coupling * np.cos(q2))
    np.testing.assert_allclose(M21, m2 * l2**2 + coupling * np.cos(q2))
    assert pytest.approx(m2 * l2**2) == M22
    b1, b2 = bias(links, inertia, places, [v1, v2], (0.0, 0.0, -g))
    weight = m2 * g * l2 * np.sin(q1 + q2)
    np.testing.assert_allclose(b2, coupling * np.sin(q2) * v1**2 + weight, atol=1e-12)
    expected = -coupling * np.sin(q2) * (2 * v1 * v2 + v2**2) + (m1 + m2) * g * l1 * np.sin(q1) + weight
    np.testing.assert_allclose(b1, expected, atol=1e-12)


def test_a_planar_arm_has_no_component_across_its_plane():
    R = rotation((0.0, 1.0, 0.0), np.linspace(0, 1, 5))
    assert R[0][1] == R[1][0] == R[1][2] == R[2][1] == 0.0 and R[1][1] == 1.0


def test_a_rotation_keeps_lengths_and_is_undone_by_its_transpose():
    R = rotation((0.36, 0.48, 0.8), np.linspace(-3, 3, 7))
    np.testing.assert_allclose(np.broadcast_arrays(*turned(transposed(R), turned(R, (1.0, 2.0, 3.0))))[2], 3.0)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_symmetric_equations_are_solved_at_every_point(n):
    rng = np.random.default_rng(n)
    B = rng.normal(size=(20, n, n))
    A, b = B @ B.transpose(0, 2, 1) + np.eye(n), rng.normal(size=(20, n))
    x = solved([[A[:, i, j] for j in range(i + 1)] for i in range(n)], list(b.T))
    np.testing.assert_allclose(np.transpose(x), np.linalg.solve(A, b[..., None])[..., 0])
