"""Copies of a MuJoCo model that hold other parameters: what is written into them, and what follows from it."""

import numpy as np
import pytest

from sksurrogate.physics import MuJoCoSimulator

mujoco = pytest.importorskip("mujoco")

ARM = """<mujoco><worldbody><body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.2" armature="0.01"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="1"/>
<body name="lower" pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" damping="0.1" armature="0.01"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.7"/></body></body></worldbody>
<actuator><motor name="lift" joint="shoulder" gear="2"/><position name="target" joint="elbow" kp="20" kv="1"/></actuator></mujoco>"""


def numbers(model):
    """All arrays of a model."""
    found = ((name, getattr(model, name)) for name in dir(model) if not name.startswith("_"))
    return {name: np.array(value) for name, value in found if isinstance(value, np.ndarray)}


@pytest.mark.parametrize("name", sorted(MuJoCoSimulator(ARM).params))
def test_a_copy_holds_all_that_follows_from_its_parameters(name):
    """Written after other values, and taken back: as MuJoCo computes it anew."""
    engine = MuJoCoSimulator(ARM)._engine()
    copies, value = engine._copies["step"], engine.parameters[name].value
    for given in ({name: value + 0.3}, {"upper.mass": 1.4}, {name: value + 0.2}):
        written = numbers(copies.get(0, given, engine.timestep))
        anew = numbers(engine.with_values(given))
        assert [key for key, array in anew.items() if not np.array_equal(written[key], array)] == []


def test_parameters_without_a_model_leave_no_log(tmp_path, monkeypatch, capfd):
    """A fit tries an inertia below 0: MuJoCo would write a file in the working folder, and a line on the screen."""
    monkeypatch.chdir(tmp_path)
    arm = MuJoCoSimulator(ARM, dt=0.01)
    x = np.repeat(arm.x0[:, None], 2, axis=1)
    arm.step(0.0, x, np.zeros((2, 2)), {"elbow.armature": np.array([-0.031, -5.0])}, 0.01)
    assert list(tmp_path.iterdir()) == [] and capfd.readouterr().err == ""
