"""Files from strangers: whatever they hold, the readers answer with their own error, quickly, and run nothing."""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from sksurrogate.cli import read_csv
from sksurrogate.datasets import make_reactor
from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.exceptions import DataError

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
