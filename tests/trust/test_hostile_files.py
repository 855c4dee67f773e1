"""Files from strangers: whatever they hold, the readers answer with their own error, quickly, and run nothing."""

import io
import json
import pickle
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from sklearn.linear_model import Ridge

from sksurrogate.cli import read_csv
from sksurrogate.compose import RecursivePredictor
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.physics._fmu_unit import describe, unpack

FEW = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
cells = st.sampled_from(
    ["flow", "level", "1", "-2.5e3", "", "nan", "inf", '"', "1,5", "1_0", "\u0661", "0x1p3", " 7 ", "a"]
)
lines = st.lists(st.lists(cells, max_size=4).map(",".join), max_size=6).map("\n".join)


def reads_or_refuses(content, read):
    """Either numbers that are finite, or the package's own error."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "f"
        file.write_bytes(content)
        try:
            return read(file)
        except DataError:
            return None


@FEW
@given(st.binary(max_size=300) | lines.map(str.encode) | lines.map(lambda text: b"flow,level\n" + text.encode()))
@example(b"\xff\xfeflow")
@example(b"flow,level\n1,2\r3,4")
def test_any_bytes_as_csv(content):
    found = reads_or_refuses(content, lambda file: read_csv(file, ["flow", "level"], run=None))
    if found is not None:
        assert all(np.isfinite(column).all() for column in found[0].values())


values = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=True) | st.text(max_size=5) | st.sampled_from(["input_lag", "u"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["effects", "name", "location", "params", "scale", "x"]), inner, max_size=4)
    ),
    max_leaves=12,
)


@pytest.mark.slow
@FEW
@given(values.map(lambda value: json.dumps(value).encode()) | st.binary(max_size=100))
@example(b"[" * 100_000)
@example(b'{"effects": [{"name": "__import__", "location": "os", "variable": null, "params": {}}], "params": {}}')
def test_any_bytes_as_saved_simulator(content):
    found = reads_or_refuses(content, lambda file: load_augmented(make_reactor(), file))
    assert found is None or isinstance(found, AugmentedSimulator)


def test_a_large_saved_file_is_refused_unread(tmp_path):
    with (tmp_path / "f.json").open("wb") as file:
        file.truncate(2**21)
    with pytest.raises(DataError, match="expected at most 1048576"):
        load_augmented(make_reactor(), tmp_path / "f.json")


def test_what_is_saved_comes_back(tmp_path):
    effects = [CATALOGUE["input_lag"]("u"), CATALOGUE["coulomb_friction"]("y", "y"), CATALOGUE["sensor_bias"]("y")]
    values = [(0.05,), {"level": 0.3}, (0.2,)]
    first = AugmentedSimulator(make_reactor(), effects, values, {"feed": 4.5}, scale=[2.0], sharpness=50.0)
    save_augmented(first, tmp_path / "f.json", verdict="explained")
    again = load_augmented(make_reactor(), tmp_path / "f.json")
    U = np.linspace(0.1, 0.2, 40)[:, None]
    np.testing.assert_array_equal(again.simulate(U), first.simulate(U))
    assert json.loads((tmp_path / "f.json").read_text())["verdict"] == "explained"


def test_an_effect_of_ones_own_needs_its_class(tmp_path):
    text = {"effects": [{"name": "convection", "location": "y", "variable": "y", "params": {}}], "params": {}}
    (tmp_path / "f.json").write_text(json.dumps(text))
    with pytest.raises(DataError, match=r"'convection' is not in the catalogue; pass its class in effects=\[...\]"):
        load_augmented(make_reactor(), tmp_path / "f.json")


XML = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g"><CoSimulation modelIdentifier="m"/>
<ModelVariables><ScalarVariable name="y" valueReference="0" causality="output"><Real/></ScalarVariable></ModelVariables>
<ModelStructure><Outputs><Unknown index="1"/></Outputs></ModelStructure></fmiModelDescription>"""


def unit(*members):
    """An archive as bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return stream.getvalue()


def opens_or_refuses(content, folder):
    """Unpack and read the description, as far as it goes without running the unit's code."""
    file = Path(folder) / "u.fmu"
    file.write_bytes(content)
    try:
        return describe(unpack(str(file)), file)
    except SimulatorError as error:
        return str(error)


def test_a_sound_unit_is_described(tmp_path):
    found = opens_or_refuses(unit(("modelDescription.xml", XML)), tmp_path)
    assert not isinstance(found, str), found
    assert found.modelName == "m"


@pytest.mark.parametrize("name", ["../../evil.txt", "/evil.txt", "a/../../evil.txt"])
def test_a_unit_that_would_leave_its_folder_is_refused(name, tmp_path):
    said = opens_or_refuses(unit(("modelDescription.xml", XML), (name, "x")), tmp_path)
    assert "leaves its folder: this unit is not safe" in said
    assert not (tmp_path / "evil.txt").exists() and not (tmp_path.parent / "evil.txt").exists()


def test_a_unit_that_would_fill_the_disk_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("sksurrogate.physics._fmu_unit._LARGEST_UNIT", 10**6)
    said = opens_or_refuses(unit(("modelDescription.xml", XML), ("bomb", bytes(2 * 10**6))), tmp_path)
    assert "expected at most" in said and "not safe" in said


def test_a_size_in_the_header_that_lies_does_not_unpack_more(tmp_path):
    content = unit(("bomb", bytes(10**6)), ("modelDescription.xml", XML))
    lying = content.replace((10**6).to_bytes(4, "little"), (1000).to_bytes(4, "little"))
    assert lying != content
    assert "is not a unit" in opens_or_refuses(lying, tmp_path)


@pytest.mark.parametrize(
    "xml",
    [
        "",
        "no xml",
        '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><a>&x;</a>',
        '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "'
        + "z" * 1000
        + '">'
        + "".join(f'<!ENTITY b{k} "{f"&b{k - 1 if k else str()};" * 10}">' for k in range(9))
        + "]><a>&b8;</a>",
    ],
    ids=["empty", "text", "outside entity", "entities that multiply"],
)
def test_a_description_that_is_hostile(xml, tmp_path):
    said = opens_or_refuses(unit(("modelDescription.xml", xml)), tmp_path)
    assert isinstance(said, str) and "root:" not in said


SOUND = unit(("modelDescription.xml", XML), ("resources/a.txt", "a" * 50))


@FEW
@given(st.lists(st.tuples(st.integers(0, len(SOUND) - 1), st.integers(0, 255)), min_size=1, max_size=6))
def test_a_damaged_unit(places):
    damaged = bytearray(SOUND)
    for place, value in places:
        damaged[place] = value
    with tempfile.TemporaryDirectory() as folder:
        said = opens_or_refuses(bytes(damaged), folder)
    # described as before where the damage hit nothing that is read, else refused in words of our own
    assert getattr(said, "modelName", None) is not None or (isinstance(said, str) and said)


def test_a_pickle_is_no_saved_simulator(tmp_path):
    class Trap:
        def __reduce__(self):
            return Path(tmp_path / "trapped").touch, ()

    (tmp_path / "f.json").write_bytes(pickle.dumps(Trap()))
    with pytest.raises(DataError, match="not a file of save_augmented"):
        load_augmented(make_reactor(), tmp_path / "f.json")
    assert not (tmp_path / "trapped").exists()


def test_skops_refuses_what_it_was_not_allowed(tmp_path):
    skops = pytest.importorskip("skops.io")
    X, y, groups = make_reactor_runs(3, 40, random_state=0)
    model = RecursivePredictor(Ridge(), 2, 2).fit(X, y, groups=groups)
    stored = skops.dumps(model)
    own = [name for name in skops.get_untrusted_types(data=stored) if name.startswith("sksurrogate.")]
    assert skops.get_untrusted_types(data=stored) == own
    with pytest.raises(Exception, match=r"[Uu]ntrusted types"):
        skops.loads(stored)
    again = skops.loads(stored, trusted=own)
    np.testing.assert_array_equal(again.predict(X, groups=groups), model.predict(X, groups=groups))
