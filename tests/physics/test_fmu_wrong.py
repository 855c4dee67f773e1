"""Wrong arguments, and damaged or hostile units: an error that says what and where, and no number that means something else."""

import os
import re
import shutil
import tempfile
import zipfile

import numpy as np
import pytest

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics import FMUSimulator, _fmu_unit

pytest.importorskip("fmpy")
U = np.ones((20, 1))


def changed(unit, folder, change=lambda text: text, without=" ", more=()):
    """A copy of a unit with another description, without files whose name holds a word, or with further files."""
    target = folder / "changed.fmu"
    with zipfile.ZipFile(unit) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            if without not in name:
                content = old.read(name)
                new.writestr(name, change(content.decode()) if name.endswith(".xml") else content)
        for name, content in more:
            new.writestr(name, content)
    return target


@pytest.mark.parametrize("access", [None, "trajectory"])
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"inputs": ["angle"]}, "'angle' of the unit .* is no input .output.; its inputs are .'push'."),
        ({"inputs": ["g"]}, "'g' of the unit .* is no input .parameter."),
        ({"inputs": ["push", "push"]}, "'push' .* is listed twice"),
        ({"outputs": ["angle", "angle"]}, "'angle' .* is listed twice"),
        ({"outputs": []}, "outputs=.*: name variables of the unit"),
        ({"params": {"push": 2.0}}, "inputs and params both name 'push'"),
        ({"initial": ["push"], "x0": [1.0]}, "inputs and initial both name 'push'"),
        ({"params": {"der(angle)": 2.0}}, "cannot be set: the unit .* calculates it"),
        ({"params": {"torque": 2.0}}, "cannot be set: the unit .* calculates it"),
        ({"params": {"g": "nine"}}, "params: g='nine', expected a number"),
        ({"params": {"g": float("nan")}}, "params: g=nan, expected a number"),
        ({"params": ["g"]}, "params=.'g'.: expected a dict"),
    ],
)
def test_arguments_that_the_unit_would_ignore_are_refused(swing_unit, given, message, access):
    columns = len(given.get("inputs", [0]))
    with pytest.raises(SimulatorError, match=message):
        FMUSimulator(swing_unit, dt=0.05, access=access, **given).simulate(np.ones((20, columns)))


def test_a_unit_that_does_not_open_says_so(swing_unit, tmp_path):
    with pytest.raises(SimulatorError, match=r"'Swing' does not open .* Export it again, for this platform"):
        FMUSimulator(changed(swing_unit, tmp_path, without="binaries"), dt=0.05).simulate(U)


def test_a_binary_outside_its_folder_is_not_loaded(swing_unit, tmp_path):
    def named(text):
        return text.replace('modelIdentifier="Swing"', 'modelIdentifier="../../../elsewhere"')

    with pytest.raises(SimulatorError, match="leaves its folder: this unit is not safe"):
        FMUSimulator(changed(swing_unit, tmp_path, named), dt=0.05).simulate(U)


def test_a_unit_is_unpacked_again_where_the_temporary_folder_was_tidied(swing_unit):
    before = FMUSimulator(swing_unit, dt=0.05).simulate(U)
    shutil.rmtree(_fmu_unit.unpack(str(swing_unit)))
    assert np.array_equal(FMUSimulator(swing_unit, dt=0.05).simulate(U), before)


def test_another_unit_with_the_same_stamp_is_another_one(swing_unit, tmp_path):
    file = shutil.copy2(swing_unit, tmp_path / "unit.fmu")
    first = _fmu_unit.unpack(str(file))
    stamp = file.stat().st_mtime_ns
    shutil.copy(changed(swing_unit, tmp_path, lambda text: text.replace("fixed", "tunable")), file)
    os.utime(file, ns=(stamp, stamp))
    assert _fmu_unit.unpack(str(file)) != first


def test_no_room_is_no_fault_of_the_unit(swing_unit, tmp_path, monkeypatch):
    file = shutil.copy(swing_unit, tmp_path / "unit.fmu")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(SimulatorError, match=r"could not be unpacked into .*nowhere .* TMPDIR"):
        _fmu_unit.unpack(str(file))


def test_no_rows(ball_unit):
    with pytest.raises(SimulatorError, match=re.escape("U has no rows")):
        FMUSimulator(ball_unit, dt=0.05).simulate(np.zeros((0, 1)))
