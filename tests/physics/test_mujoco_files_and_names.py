"""What a MuJoCo model is made of may change, and its elements may have odd names: never another one's numbers in silence."""

import gc
import os

import numpy as np
import pytest

from sksurrogate.datasets import simulate_experiments
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics import MuJoCoSimulator

mujoco = pytest.importorskip("mujoco")

ARM = """<mujoco><worldbody><body name="arm"><joint {joint} axis="0 1 0" damping="{damping}"/>
<geom type="sphere" size="0.05" pos="0 0 -0.5" mass="1"/>
<body name="hand" pos="0 0 -1"><joint {second} axis="0 1 0" damping="0.2"/>
<geom type="sphere" size="0.05" pos="0 0 -0.5" mass="1"/></body></body></worldbody>{more}</mujoco>"""
U = np.zeros((60, 0))
START = [0.5, -0.3, 0.0, 0.0]


def text(joint='name="a"', second='name="b"', damping=0.1, more=""):
    return ARM.format(joint=joint, second=second, damping=damping, more=more)


def ended(model):
    return MuJoCoSimulator(model, inputs=[]).simulate(U, START)[-1]


@pytest.mark.parametrize("kind", ["file", "included", "included by a text"])
def test_a_model_follows_its_files(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    part, whole = tmp_path / "part.xml", tmp_path / "whole.xml"
    whole.write_text('<mujoco><include file="part.xml"/></mujoco>')
    model = {"file": part, "included": whole, "included by a text": whole.read_text()}[kind]

    def kept():
        made = simulate_experiments(
            MuJoCoSimulator(model, inputs=["a"]), None, {"a": (0, 1)}, n_runs=2, n_samples=20, cache=tmp_path / "kept", random_state=0
        )  # fmt: skip
        return made.y[-1]

    part.write_text(text(damping=0.1))
    simulator = MuJoCoSimulator(model, inputs=[])
    before, stored = simulator.simulate(U, START)[-1], kept()
    part.write_text(text(damping=9.5))
    expected = ended(text(damping=9.5))
    assert not np.allclose(before, expected)
    assert np.array_equal(simulator.simulate(U, START)[-1], expected)
    assert np.array_equal(ended(model), expected)
    assert not np.allclose(kept(), stored)


def test_a_mesh_belongs_to_the_model(tmp_path):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    folder, whole = tmp_path / "meshes", tmp_path / "whole.xml"
    folder.mkdir()

    def written(size):
        points = "".join("v {} {} {}\n".format(*(size * corner)) for corner in corners)
        file = folder / "part.obj"
        file.write_text(points + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
        os.utime(file, (1e9 + 10 * size, 1e9 + 10 * size))  # MuJoCo keeps a mesh by its time in whole seconds

    whole.write_text(
        '<mujoco><asset><mesh name="m" file="part.obj"/></asset><compiler meshdir="meshes"/><worldbody><body name="b"><joint name="j"/>'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    written(0.1)
    simulator = MuJoCoSimulator(whole)
    assert simulator.params["b.mass"] == pytest.approx(1000 * 0.1**3 / 6)  # a corner of a cube, of water
    written(0.2)
    assert MuJoCoSimulator(whole).params["b.mass"] == pytest.approx(1000 * 0.2**3 / 6)
    assert simulator.params["b.mass"] == pytest.approx(1000 * 0.2**3 / 6)


@pytest.mark.slow
def test_a_model_in_memory_is_known_by_itself_and_not_by_its_place_in_memory():
    simulator = MuJoCoSimulator(mujoco.MjModel.from_xml_string(text()), inputs=[])
    for damping in np.linspace(0.2, 5.0, 20):
        simulator.simulate(U, START)
        simulator.model = None
        gc.collect()  # the next model may get the number of the last one
        simulator.model = mujoco.MjModel.from_xml_string(text(damping=damping))
        assert simulator.params["a.damping"] == pytest.approx(damping)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ({"joint": 'name="joint1"', "second": ""}, "joint1.pos"),
        ({"more": '<sensor><jointvel name="a.pos" joint="b"/></sensor>'}, "a.pos"),
        ({"more": '<sensor><jointvel name="a.pos" joint="a"/></sensor>'}, "a.pos"),
        ({"more": '<sensor><jointpos joint="a"/><jointpos name="sensor0" joint="b"/></sensor>'}, "sensor0"),
        ({"more": '<actuator><motor name="b.force" joint="a"/><motor name="b" joint="a"/></actuator>'}, "b.force"),
        ({"more": '<actuator><motor joint="a"/><motor name="actuator0" joint="b"/></actuator>'}, "actuator0"),
    ],
)
def test_one_name_for_two_elements_is_refused(given, name):
    with pytest.raises(SimulatorError, match=f"'{name}' stands for two .* give each a name of its own"):
        MuJoCoSimulator(text(**given)).simulate(np.zeros((3, 2)))


def test_a_sensor_may_have_the_name_of_the_state_that_it_reads():
    simulator = MuJoCoSimulator(text(more='<sensor><jointpos name="b.pos" joint="b"/></sensor>'), inputs=[])
    assert simulator.outputs == ["b.pos"] and simulator.simulate(U, START)[0] == START[1]


def test_a_joint_may_be_called_after_a_velocity():
    simulator = MuJoCoSimulator(text('name="a.velocity"', 'name="a.vel"'), outputs=["a.vel.vel"])
    assert simulator.ports == ["a.velocity", "a.vel"]
    pushed = simulator.rhs(0.0, np.zeros(4), [], {}, [0.0, 1.0]) - simulator.rhs(0.0, np.zeros(4), [], {}, [0.0, 0.0])
    assert pushed[3] > 0  # the push is felt where it enters


def test_a_name_that_is_no_text_and_wrong_shapes_are_said(tmp_path):
    file = tmp_path / "f.xml"
    file.write_bytes(text(joint='name="h\u00e4nge"').encode("latin-1"))
    with pytest.raises(SimulatorError, match="the name of joint 0 is not UTF-8"):
        MuJoCoSimulator(file).simulate(U)
    with pytest.raises(SimulatorError, match=r"outputs=\[\]: name at least one of"):
        MuJoCoSimulator(text(), outputs=[]).simulate(U)
    with pytest.raises(SimulatorError, match=r"X0 has shape \(2, 4\), expected \(4,\), or \(3, 4\)"):
        MuJoCoSimulator(text()).simulate_batch(np.zeros((3, 5, 0)), np.zeros((2, 4)))
    with pytest.raises(SimulatorError, match="is the time in seconds"):
        MuJoCoSimulator(text()).simulate(np.zeros((5, 0)), t=1e12 * np.arange(5))
