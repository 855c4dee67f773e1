"""Retuned models as MJCF: what is written must simulate as the simulator that wrote it."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, starting
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics import MuJoCoSimulator

mujoco = pytest.importorskip("mujoco")

CART = """<mujoco>
  <!-- a cart with a pole -->
  <compiler angle="radian"/>
  <default><joint damping="0.123456789"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1" pos="0 0 -0.5"/>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" frictionloss="0.2"/>
      <geom name="box" type="box" size="0.2 0.1 0.1" density="80.123456789"/>
      <body name="pole" pos="0 0 0.1">
        <joint name="pin" axis="0 1 0" stiffness="0.5"/>
        <geom name="rod" type="capsule" size="0.02" fromto="0 0 0 0.1234567 0 0.6" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="drive" joint="rail" gear="2"/>
    <position name="servo" joint="pin" kp="3" dampratio="0.7"/>
    <velocity name="brake" joint="rail" kv="0.4"/>
    <general name="plain" joint="pin" biastype="affine" gainprm="2" biasprm="0 -2 -0.1"/>
  </actuator>
</mujoco>"""

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="bar">
    <inertial><origin xyz="0 0 -0.2"/><mass value="1.2"/><inertia ixx="0.02" iyy="0.02" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="hinge" type="revolute">
    <parent link="base"/><child link="bar"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="10" velocity="5"/>
    <dynamics damping="0.1" friction="0"/>
  </joint>
</robot>"""


def other(simulator, factor=1.37):
    """The same simulator with every parameter moved; the friction of geoms stays below its sense."""
    moved = {f"params__{name}": factor * value + (value == 0) * 0.07 for name, value in simulator.params.items()}
    return simulator.set_params(**moved)


def compare(simulator, written, rtol):
    U = np.random.default_rng(0).normal(size=(50, len(simulator.inputs)))
    Y, other = simulator.simulate(U), MuJoCoSimulator(written, inputs=simulator.inputs, dt=simulator.dt).simulate(U)
    np.testing.assert_allclose(other, Y, rtol=rtol, atol=rtol * np.abs(Y).max())


def test_every_parameter_is_written_in_the_users_own_text():
    simulator = other(MuJoCoSimulator(CART, dt=0.01))
    assert len(simulator.params) == 2 * 4 + 3 + 4 + 5 + 3 * 3
    text = simulator.to_mjcf()
    compare(simulator, text, 1e-9)
    assert "<!-- a cart with a pole -->" in text and 'density="80.123456789"' in text and "dampratio" not in text


def test_nothing_changed_leaves_the_numbers_alone():
    text = MuJoCoSimulator(CART).to_mjcf()
    compare(MuJoCoSimulator(CART, dt=0.01), text, 1e-14)
    assert 'damping="0.123456789"' in text and text.count("damping") == 1


def test_a_servo_keeps_its_gains_when_a_mass_changes():
    simulator = MuJoCoSimulator(CART, dt=0.01).set_params(**{"params__pole.mass": 0.5})
    compare(simulator, simulator.to_mjcf(), 1e-9)


def test_bodies_whose_inertia_is_that_of_their_geoms_by_a_compile_option():
    forced = CART.replace('angle="radian"', 'angle="radian" inertiafromgeom="true"')
    simulator = MuJoCoSimulator(forced, dt=0.01).set_params(**{"params__pole.mass": 0.5})
    compare(simulator, simulator.to_mjcf(), 1e-4)  # written by MuJoCo, six digits


def test_elements_without_a_name_and_urdf_are_written_by_mujoco(tmp_path):
    simulator = MuJoCoSimulator(CART.replace(' name="pin"', "").replace('joint="pin"', 'joint="rail"'), dt=0.01)
    simulator.set_params(**{"params__joint1.damping": 0.4})
    compare(simulator, simulator.to_mjcf(), 1e-4)
    path = tmp_path / "arm.urdf"
    path.write_text(URDF)
    arm = MuJoCoSimulator(path, inputs=["hinge"], dt=0.01)
    assert arm.simulate(np.ones((50, 1)))[-1, 0] > 0.05
    arm.set_params(**{"params__hinge.damping": 0.6, "params__hinge.frictionloss": 0.02})
    compare(arm, arm.to_mjcf(), 1e-4)


def test_files_are_found_from_where_the_patch_is_written(tmp_path):
    vertices = "\n".join(f"v {x} {y} {z}" for x in (0, 0.1) for y in (0, 0.2) for z in (0, 0.3))
    faces = "\n".join(f"f {a} {b} {c}" for a, b, c in [(1, 2, 3), (2, 4, 3), (5, 7, 6), (6, 7, 8), (1, 5, 2), (2, 5, 6), (3, 4, 7), (4, 8, 7), (1, 3, 5), (3, 7, 5), (2, 6, 4), (4, 6, 8)])  # fmt: skip
    home, away = tmp_path / "home", tmp_path / "away"
    (home / "parts").mkdir(parents=True)
    away.mkdir()
    (home / "parts" / "block.obj").write_text(f"{vertices}\n{faces}\n")
    part = '<mujoco><asset><mesh name="block" file="block.obj"/></asset></mujoco>'
    (home / "assets.xml").write_text(part)
    main = """<mujoco><compiler meshdir="parts"/><include file="assets.xml"/><worldbody><body name="body">
      <joint name="hinge" axis="0 1 0"/><geom type="mesh" mesh="block"/></body></worldbody></mujoco>"""
    (home / "model.xml").write_text(main)
    simulator = MuJoCoSimulator(home / "model.xml", dt=0.01).set_params(**{"params__hinge.damping": 0.1})
    text = simulator.to_mjcf(away / "model.xml")
    assert "../home/parts" in text and "../home/assets.xml" in text
    compare(simulator, away / "model.xml", 1e-9)
    simulator.to_mjcf(home / "patched.xml")
    compare(simulator, home / "patched.xml", 1e-9)


def test_a_compiled_model_cannot_be_patched():
    simulator = MuJoCoSimulator(mujoco.MjModel.from_xml_string(CART))
    with pytest.raises(SimulatorError, match="no longer holds the XML that a patch needs"):
        simulator.to_mjcf()


def test_what_mjcf_cannot_say_is_an_error():
    bounded = CART.replace('angle="radian"', 'angle="radian" boundmass="0.25"')
    simulator = MuJoCoSimulator(bounded).set_params(**{"params__pole.mass": 0.2})
    with pytest.raises(SimulatorError, match=r"MJCF cannot hold these values of params \(pole.mass\): compile options"):
        simulator.to_mjcf()


# ---- effects that are parameters ------------------------------------------------------------------------------------
def test_errors_of_parameters_and_gains_of_motors_are_parameters():
    simulator = MuJoCoSimulator(CART, dt=0.01)
    effects = [
        CATALOGUE["parameter_error"]("pole.mass"),
        CATALOGUE["parameter_error"]("pin.frictionloss"),  # 0 in the model: an absolute change
        CATALOGUE["input_gain"]("drive"),
        CATALOGUE["input_gain"]("servo"),
        CATALOGUE["input_delay"]("drive"),
    ]
    values = [{"relative_error": 0.2}, {"relative_error": 0.03}, {"relative_error": -0.1}, {"relative_error": 0.1}, {"delay": 0.02}]  # fmt: skip
    own, left = simulator.as_parameters(effects, values)
    assert left == [3, 4]  # a servo of another gain on its target alone, a delay
    assert own.params["pole.mass"] == pytest.approx(0.36) and own.params["drive.gear"] == pytest.approx(1.8)
    U = np.random.default_rng(0).normal(size=(50, 4))
    added = AugmentedSimulator(simulator, effects[:3], values[:3]).simulate(U)
    np.testing.assert_allclose(own.simulate(U), added, atol=1e-6)  # tolerance of the solver, cold at every sample
    compare(own, own.to_mjcf(), 1e-9)


def test_what_acts_for_a_time_alone_is_no_parameter():
    simulator = MuJoCoSimulator(CART, dt=0.01)
    late = [starting(CATALOGUE["input_gain"]("drive")), starting(CATALOGUE["parameter_error"]("pole.mass"), ("end",))]
    values = [{"relative_error": -0.1, "onset": 0.2}, {"relative_error": 0.2, "end": 0.3}]
    own, left = simulator.as_parameters(late, values)
    assert left == [0, 1] and own.params == simulator.params


def test_friction_laws_at_a_port_are_parameters_of_the_joint():
    simulator = MuJoCoSimulator(CART, dt=0.01)
    viscous, dry = CATALOGUE["linear_loss"]("pin", "pin.vel"), CATALOGUE["coulomb_friction"]("pin", "pin.vel")
    own, left = simulator.as_parameters([viscous, dry], [{"coefficient": 0.05}, {"level": 0.02}])
    assert left == []
    x = np.array([[0.1, 0.1], [0.2, -0.3], [0.5, 0.5], [3.0, -4.0]])
    u, forces = np.zeros((4, 2)), np.zeros((2, 2))
    forces[1] = -0.05 * x[3] - 0.02 * np.sign(x[3])
    added = simulator.rhs(0.0, x, u, simulator.params, forces=forces)
    np.testing.assert_allclose(own.rhs(0.0, x, u, own.params), added, atol=1e-6)  # tolerance of the solver
    elsewhere = CATALOGUE["linear_loss"]("pin", "rail.vel")
    assert simulator.as_parameters([elsewhere], [{"coefficient": 0.05}])[1] == [0]
