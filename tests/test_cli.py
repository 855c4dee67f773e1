"""The command line: a diagnosis end to end, and mistakes with their way out."""

import json

import numpy as np
import pytest

from sksurrogate.cli import load_simulator, main, read_csv
from sksurrogate.exceptions import DataError, SimulatorError

PLANT = """
from sksurrogate.physics import ODESimulator
def rhs(t, x, u, p):
    return [u[0] - p["k"] * x[0]]
plant = ODESimulator(rhs, states=["level"], inputs=["flow"], outputs=["level"], params={"k": 1.0}, dt=0.1)
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "plant.py").write_text(PLANT)
    rng = np.random.default_rng(0)
    lines = ["time,flow,level,experiment"]
    for run in "ab":
        u = np.repeat(rng.uniform(0, 3, 30), 5)
        x = 0.5
        for k in range(150):
            lines.append(f"{0.1 * k:.1f},{u[k]},{x + 0.2 + 0.003 * rng.normal()},{run}")
            x = u[k] + (x - u[k]) * np.exp(-0.1)
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_a_diagnosis_end_to_end(folder, capsys):
    command = ["diagnose", f"{folder / 'plant.py'}:plant", str(folder / "data.csv"), "--run", "experiment", "--time", "time"]
    assert main([*command, "--html", str(folder / "gap.html"), "--save", str(folder / "better.json"), "--quiet"]) == 0
    out = capsys.readouterr().out
    assert "VERDICT  explained" in out and "sensor_bias" in out
    saved = json.loads((folder / "better.json").read_text())
    assert saved["params"] == {"k": 1.0}
    # An offset of this sensor and one of the input predict the same once the initial state is unknown.
    assert saved["effects"][0]["name"] in ("sensor_bias", "input_bias", "constant_bias")
    page = (folder / "gap.html").read_text()
    assert "<svg" in page and "http" not in page


def test_mistakes_name_line_and_column(folder, capsys):
    data = (folder / "data.csv").read_text()
    (folder / "bad.csv").write_text(data.replace("time,flow", "time,inflow", 1))
    assert main(["diagnose", f"{folder / 'plant.py'}:plant", str(folder / "bad.csv")]) == 2
    assert "no column 'flow'; its columns are ['time', 'inflow', 'level', 'experiment']" in capsys.readouterr().err
    (folder / "bad.csv").write_text("flow,level\n1.0,2.0\n1.0,oops\n")
    with pytest.raises(DataError, match="line 3, column 'level': 'oops' is not a number"):
        read_csv(folder / "bad.csv", ["flow", "level"])
    (folder / "bad.csv").write_text("flow,level\n1.0\n")
    with pytest.raises(DataError, match="line 2: 1 cells, expected 2"):
        read_csv(folder / "bad.csv", ["flow", "level"])
    with pytest.raises(SimulatorError, match="no 'plan'; simulators in it: \\['plant'\\]"):
        load_simulator(f"{folder / 'plant.py'}:plan")
    with pytest.raises(SimulatorError, match=r"write file\.py:name"):
        load_simulator("plant")


def test_semicolons_are_read(tmp_path):
    (tmp_path / "d.csv").write_text("a;b\n1;2\n3;4\n")
    columns, labels = read_csv(tmp_path / "d.csv", ["b"])
    assert columns["b"].tolist() == [2.0, 4.0] and labels is None
