"""Recordings as people have them: units in headers, other names, decimal commas, dates, swapped columns; options anywhere."""

import json
import re
import sys
import time

import numpy as np
import pytest

from sksurrogate import _swapped
from sksurrogate._argument_order import positionals_first
from sksurrogate._csv import read_csv, read_header
from sksurrogate._headers import assigned, columns_of, split_unit
from sksurrogate._swapped import swapped_columns
from sksurrogate.cli import main
from sksurrogate.exceptions import DataError
from sksurrogate.physics import ODESimulator

PLANT = """
from sksurrogate.physics import ODESimulator
def rhs(t, x, u, p):
    return [u[0] - p["k"] * x[0]]
plant = ODESimulator(rhs, states=["level"], inputs=["flow"], outputs=["level"], params={"k": 1.0}, dt=0.1)
"""


@pytest.fixture
def folder(tmp_path):
    """A recording with a sensor offset of 0.2 m, semicolons, decimal commas, dates, units and other names."""
    (tmp_path / "plant.py").write_text(PLANT)
    rng = np.random.default_rng(0)
    lines = ["clock [s];q (m^3/s);level [m];experiment"]
    for run in "ab":
        u, x = np.repeat(rng.uniform(0, 3, 20), 5), 0.5
        for k in range(100):
            moment = f"2026-03-01T10:0{k // 600}:{0.1 * (k % 600):04.1f}00"
            cells = [f"{u[k]:.6f}", f"{x + 0.2 + 0.003 * rng.normal():.6f}"]
            lines.append(";".join([moment, *(cell.replace(".", ",") for cell in cells), run]))
            x = u[k] + (x - u[k]) * np.exp(-0.1)
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_a_recording_as_people_have_it_is_diagnosed(folder, capsys):
    words = [
        "diagnose", "--effects", "sensor_bias", "linear_loss", f"{folder / 'plant.py'}:plant", "--columns",
        "flow=q (m^3/s)", str(folder / "data.csv"), "--run", "experiment", "--time", "clock", "--quiet", "--json",
        "--seed", "3", "--title", "Tank 4",
    ]  # fmt: skip
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert [effect["name"] for effect in found["effects"]] == ["sensor_bias"]
    assert found["effects"][0]["params"]["value"] == pytest.approx(0.2, abs=0.01)
    assert found["units"] == {"flow": "m^3/s", "level": "m", "time": "s"}
    origin = found["provenance"]
    assert origin["title"] == "Tank 4" and origin["seed"] == "3" and origin["effects"] == "sensor_bias, linear_loss"
    assert origin["files"] == [str(folder / "data.csv")] and origin["command"].startswith(
        "sksurrogate diagnose --effects"
    )


@pytest.mark.slow
@pytest.mark.parametrize("named", [True, False])
def test_a_column_of_runs_that_no_option_names_is_said_aloud(folder, capsys, named):
    words = ["diagnose", f"{folder / 'plant.py'}:plant", str(folder / "data.csv"), "--columns", "flow=q (m^3/s)"]
    assert main([*words, "--effects", "sensor_bias", "--quiet", *(["--run", "experiment"] if named else [])]) == 0
    said = [line for line in capsys.readouterr().err.splitlines() if "is not read" in line]
    assert len(said) == (0 if named else 1) and all("--run experiment" in line for line in said)


def test_the_exit_status_and_what_is_saved_tell_an_early_end(folder, capsys):
    words = [
        "diagnose",
        f"{folder / 'plant.py'}:plant",
        str(folder / "data.csv"),
        "--columns",
        "flow=q (m^3/s)",
        "--quiet",
    ]
    assert main([*words, "--run", "experiment", "--time-limit", "0.001", "--save", str(folder / "early.json")]) == 3
    assert json.loads((folder / "early.json").read_text())["complete"] is False
    shown = capsys.readouterr()
    assert "(interrupted)" in shown.out and "Warning:" not in shown.err


def test_an_interrupt_during_imports_is_said_in_one_line(tmp_path, capsys):
    (tmp_path / "slow.py").write_text("raise KeyboardInterrupt")
    (tmp_path / "data.csv").write_text("u,y\n1,2\n")
    assert main(["diagnose", f"{tmp_path / 'slow.py'}:plant", str(tmp_path / "data.csv"), "--quiet"]) == 130
    assert capsys.readouterr().err == "sksurrogate: interrupted before anything was known\n"


@pytest.mark.parametrize(
    ("given", "ordered"),
    [
        (["--free", "a", "b", "p.py:p", "d.csv"], ["p.py:p", "d.csv", "--free", "a", "b"]),
        (["p.py:p", "--free", "a", "b", "--run", "r", "d.csv"], ["p.py:p", "d.csv", "--free", "a", "b", "--run", "r"]),
        (["p.py:p", "d.csv", "--free", "a", "b"], ["p.py:p", "d.csv", "--free", "a", "b"]),
        (["--json", "p.py:p", "d.csv"], ["p.py:p", "d.csv", "--json"]),
        (["--json", "out.json", "p.py:p", "d.csv"], ["p.py:p", "d.csv", "--json", "out.json"]),
        (["--quiet", "p.py:p", "d.csv"], ["p.py:p", "d.csv", "--quiet"]),
        (["--html", "a.csv", "p.py:p", "d.csv"], ["p.py:p", "d.csv", "--html", "a.csv"]),
    ],
)
def test_simulator_and_data_stand_anywhere(given, ordered):
    assert positionals_first(["diagnose", *given]) == ["diagnose", *ordered]
    assert positionals_first(["blind", *given]) == ["blind", *given]


def test_decimal_commas_and_dates_are_read(tmp_path):
    (tmp_path / "d.csv").write_text("t;y\n2026-01-31 23:59:59,5;-1,5e1\n2026-02-01 00:00:00,0;,25\n")
    columns, _ = read_csv(tmp_path / "d.csv", ["y"], time="t")
    assert columns["y"].tolist() == [-15.0, 0.25] and columns["t"].tolist() == [0.0, 0.5]
    (tmp_path / "d.csv").write_text("t,y\n2026-01-31T23:59:59Z,1\n2026-02-01T01:00:00+01:00,2\n")
    assert read_csv(tmp_path / "d.csv", ["y"], time="t")[0]["t"].tolist() == [0.0, 1.0]
    assert read_header(tmp_path / "d.csv") == ["t", "y"]


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("t,u,y\n0,1,2\n0.1,1e-3,-2.50\n", {"time": "t"}),
        ("run;u;y\na;1,5;2\na ;-,25;3\n\nb;1e3;4\n", {"run": "run"}),
        ("run\tu\ty\n1\t1.5\t2\n2\t0.1234567890123456789\t3\n", {"run": "run"}),
        ("t;u;y\n2026-01-31 23:59:59,5;1,5;2\n2026-02-01 00:00:00,0;2;3\n", {"time": "t"}),
        ("t;u;y\n0,1;1,5;2\n0,2;2;3\n", {"time": "t"}),
        ("u,y,run\r\n1,2,\u00b5\r\n3,4,7\r\n", {"run": "run"}),
        ('u,y,run\n1,2,"a, b"\n3,4,7\n', {"run": "run"}),
        ("u;y\n1.5;2,5\n2;3\n", {}),
        ("\ufeffu,y\n1,2\n", {}),
        ("u,y,w\n1,2\n3,4,5\n", {}), ("u,y\n1,2,3\n", {}), ("u,y\n1,\n", {}), ("u,y\n1,nan\n", {}), ("u,y\n1_0,2\n", {}),
        ("u,y\n1,True\n", {}), ("u,y\n", {}), ("u,y\n,\n1,2\n", {}), ("u,y,y\n1,2,3\n", {}), ("t,u,y\n5 pm,1,2\n", {"time": "t"}),
        ("u,y\n1,2,\n3,4,\n", {}), ("u,y\n0x10,2\n", {}), ("u,y\n1,inf\n", {}), ("u,y\n1,2\n  \n3,4\n", {}),
    ],
)  # fmt: skip
def test_pandas_reads_what_the_reader_of_lines_reads(text, options, tmp_path, monkeypatch):
    (tmp_path / "d.csv").write_text(text, encoding="utf-8", newline="")

    def read():
        try:
            columns, labels = read_csv(tmp_path / "d.csv", ["u", "y"], **options)
        except DataError as error:
            return str(error)
        return {name: column.tolist() for name, column in columns.items()}, None if labels is None else labels.tolist()

    found = read()
    monkeypatch.setitem(sys.modules, "pandas", None)
    assert found == read()


def test_a_plain_recording_is_read_by_pandas(tmp_path, monkeypatch):
    pytest.importorskip("pandas")
    (tmp_path / "d.csv").write_text("run;t;u\n" + "".join(f"a;{k};{k},5\n" for k in range(50)))
    monkeypatch.setattr("sksurrogate._csv._read", None)  # the reader of lines is not asked
    columns, labels = read_csv(tmp_path / "d.csv", ["u"], run="run", time="t")
    assert columns["u"].tolist() == [k + 0.5 for k in range(50)] and columns["t"][-1] == 49 and set(labels) == {"a"}


def test_a_signal_is_found_behind_its_unit_and_never_guessed_between_two():
    assert columns_of(["w"], ["w [rad/s]"], {}) == {"w": "w [rad/s]"}
    assert columns_of(["w"], ["w", "w [rad/s]"], {}) == {"w": "w"}
    with pytest.raises(DataError, match=r"2 columns of the file may be 'w': .*--columns w=COLUMN"):
        columns_of(["w"], ["w [rpm]", "w [rad/s]"], {})
    assert columns_of(["w"], ["w [rpm]", "w [rad/s]"], {"w": "w [rpm]"}) == {"w": "w [rpm]"}
    assert columns_of(["w"], ["w", "other"], {"w": "other"}) == {"w": "other"}
    assert split_unit("f(x) [1]") == ("f(x)", "1")


def test_a_unit_in_the_option_stands_for_one_that_the_header_lacks(folder, capsys):
    text = (folder / "data.csv").read_text()
    (folder / "data.csv").write_text(text.replace("q (m^3/s)", "q", 1))
    words = [
        "diagnose",
        f"{folder / 'plant.py'}:plant",
        str(folder / "data.csv"),
        "--quiet",
        "--json",
        "--time-limit",
        "0.001",
    ]
    assert main([*words, "--run", "experiment", "--columns", "flow=q [m^3/s]"]) == 3
    assert json.loads(capsys.readouterr().out)["units"]["flow"] == "m^3/s"
    assert main([*words, "--columns", "flow=Q"]) == 2
    assert "--columns flow=Q: the file has no column 'Q'" in capsys.readouterr().err


def test_an_effect_that_is_not_in_the_catalogue_is_said_in_one_line(folder, capsys):
    words = ["diagnose", f"{folder / 'plant.py'}:plant", str(folder / "data.csv"), "--columns", "flow=q (m^3/s)"]
    assert main([*words, "--run", "experiment", "--effects", "sensor_bia"]) == 2
    assert capsys.readouterr().err.startswith(
        "sksurrogate: --effects: 'sensor_bia' is not in the catalogue; did you mean"
    )


@pytest.mark.parametrize("texts", [["speed"], ["sped=a"], ["speed=a", "speed=b"]])
def test_mistakes_in_columns(texts):
    with pytest.raises(DataError, match="--columns"):
        assigned(texts, ["speed"])


def test_another_unit_in_the_file_is_said_aloud(folder, capsys):
    plant = PLANT.replace("dt=0.1", 'dt=0.1, units={"level": "cm"}').replace('"flow"', '"q"')
    (folder / "plant.py").write_text(plant)
    words = [
        "diagnose",
        f"{folder / 'plant.py'}:plant",
        str(folder / "data.csv"),
        "--effects",
        "sensor_bias",
        "--quiet",
    ]
    assert main([*words, "--run", "experiment"]) == 0
    assert "'level' is in m in" in capsys.readouterr().err


def swapped_plant():
    def rhs(t, x, u, p):
        return [x[1], u[0] - 4 * x[0] - 0.4 * x[1] + 5 * u[1]]

    return ODESimulator(rhs, states=["q", "v"], inputs=["a", "b"], outputs=["q", "v"], params={}, dt=0.05)


def test_a_slow_simulator_is_not_simulated_for_its_columns(monkeypatch):
    """Each call takes the time that was meant for all of them."""
    calls = []

    def slow(t, x, u, p):
        calls.append(t)
        time.sleep(0.02)
        return (u[0] - x[0],)

    monkeypatch.setattr(_swapped, "LONGEST_COMPARISON", 0.02)
    plant = ODESimulator(slow, states=["a"], inputs=["u"], outputs=["a"], params={}, dt=0.1)
    U = np.random.default_rng(0).normal(size=(300, 1))
    assert swapped_columns(plant, U, U, ["u"], ["a"]) == [] and len(calls) < 300


def test_nothing_is_said_of_columns_where_a_simulator_returns_too_few_rows():
    class Short:
        def simulate(self, U):
            return U[:5]

    U = np.random.default_rng(0).normal(size=(300, 2))
    assert swapped_columns(Short(), U, U, ["a", "b"], ["q", "v"]) == []


def test_swapped_columns_are_suspected_and_others_are_not():
    plant, rng = swapped_plant(), np.random.default_rng(0)
    U = np.repeat(rng.normal(size=(30, 2)), 10, axis=0)
    Y = plant.simulate(U) + 0.05 * rng.normal(size=(300, 2))
    names = ["a", "b"], ["q", "v"]
    assert swapped_columns(plant, U, Y, *names) == []
    assert "the outputs 'q' and 'v' exchanged" in swapped_columns(plant, U, Y[:, ::-1], *names)[0]
    assert "the inputs 'a' and 'b' exchanged" in swapped_columns(plant, U[:, ::-1], Y, *names)[0]
    assert "with the inputs and the outputs exchanged" in swapped_columns(plant, Y, U, *names)[0]
    assert swapped_columns(plant, U, rng.normal(size=(300, 2)), *names) == []


TANKS = """
from sksurrogate.physics import ODESimulator
def rhs(t, x, u, p):
    return u[0] - p["k"] * x[0], p["k"] * x[0] - p["c"] * x[1]
plant = ODESimulator(rhs, states=["upper", "lower"], inputs=["flow"], outputs=["upper", "lower"],
                     params={"k": 0.5, "c": 0.4}, dt=0.5)
"""


def tanks_as_recorded(kind):
    """Lines of two runs: stamps with jitter, missing rows and cells, a clock that is ahead, a stamp that goes back.

    A spring-like loss of the upper tank is missing in the simulator, but for the clocks.
    """
    loss = 0.0 if kind == "clocks" else 0.03

    def rhs(t, x, u, p):
        return u[0] - 0.5 * x[0] - loss * x[0] ** 3, 0.5 * x[0] - 0.4 * x[1]

    fine = ODESimulator(rhs, states=["a", "b"], inputs=["u"], outputs=["a", "b"], params={}, dt=0.05)
    rng, lines = np.random.default_rng(5), ["run,t,flow,upper,lower"]
    for run in range(2):
        U = np.repeat(rng.uniform(0.2, 2, 20), 100)[:, None]
        Y, grid = fine.simulate(U, x0=[0.5, 0.3]), 0.05 * np.arange(2000)
        t = 0.5 * np.arange(199) + (0.05 * rng.integers(-2, 3, 199) if kind == "jitter" else 0.0)
        t[::10] = np.round(t[::10])  # the input moves at stamps
        t[0] = 0.0
        read = [np.interp(t, grid, Y[:, 0]), np.interp(t + 0.35 * (kind == "clocks"), grid, Y[:, 1])]
        a, b = np.array(read) + 0.005 * rng.normal(size=(2, 199))
        stamps = 1000.0 + t
        if kind == "mistake":
            stamps[100] -= 5.0
        for k in range(199):
            if kind != "gaps" or not 60 <= k < 70:
                cell = "" if kind == "gaps" and k % 3 else f"{b[k]:.5f}"
                lines.append(f"{run},{stamps[k]:.2f},{U[min(round(t[k] / 0.05), 1999), 0]:.4f},{a[k]:.5f},{cell}")
    return "\n".join(lines) + "\n"


def diagnosis_of_tanks(folder, kind):
    """The command for such a record, and its files."""
    (folder / "tanks.py").write_text(TANKS)
    (folder / "d.csv").write_text(tanks_as_recorded(kind))
    return ["diagnose", f"{folder / 'tanks.py'}:plant", str(folder / "d.csv"), "--run", "run", "--time", "t"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "options", "name", "place"),
    [
        ("jitter", [], "cubic_stiffness", "upper"),
        ("gaps", [], "cubic_stiffness", "upper"),
        ("clocks", ["--clock-offset", "1"], "sensor_delay", "lower"),
    ],
)
def test_stamps_gaps_and_clocks_as_a_file_has_them(tmp_path, capsys, kind, options, name, place):
    command = diagnosis_of_tanks(tmp_path, kind)
    effects = ["--effects", "cubic_stiffness", "sensor_gain", "sensor_delay", "linear_loss", "input_gain"]
    assert main([*command, *effects, *options, "--quiet", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert [(effect["name"], effect["location"]) for effect in report["effects"]] == [(name, place)]
    if kind == "clocks":
        assert report["effects"][0]["params"]["delay"] == pytest.approx(-0.35, abs=0.01)


def test_a_stamp_that_goes_back_is_named_with_its_row(tmp_path, capsys):
    command = diagnosis_of_tanks(tmp_path, "mistake")
    assert main([*command, "--quiet"]) == 2
    said = capsys.readouterr().err
    assert (
        "--time t, run 0: time does not increase after row 99 (1049.5 -> 1045): sort the rows, or name the run column"
        in said
    )
    assert "Row 0 is the first line below the header" in said


@pytest.mark.slow
def test_a_joint_log_stands_in_the_place_of_a_csv(folder, capsys):
    words = ["diagnose", f"{folder / 'plant.py'}:plant", "--effects", "sensor_bias", "linear_loss", "--quiet", "--json"]
    columns, runs = read_csv(folder / "data.csv", ["q (m^3/s)", "level [m]"], "experiment")
    q, level = columns.values()
    np.savez(folder / "log.npz", q=q, levels=level[:, None], label=runs)
    options = ["--columns", "flow=q", "--readings", "levels", "--run", "label"]
    assert main([*words, str(folder / "log.npz"), *options]) == 0
    found = json.loads(capsys.readouterr().out)
    assert main([*words, str(folder / "data.csv"), "--columns", "flow=q (m^3/s)", "--run", "experiment"]) == 0
    same = json.loads(capsys.readouterr().out)
    assert found["effects"] == same["effects"] and found["effects"][0]["name"] == "sensor_bias"


@pytest.mark.parametrize(
    "data, options, said",
    [
        ("data.csv", ["--commands", "u"], "--commands: .*data.csv is a CSV, which has columns alone"),
        ("log.npz", ["--columns", "flow=p"], r"inputs: the log has no signal 'p'; .*\['flow', 'level'\]"),
        ("none.mcap", [], "there is no such file or folder"),
        (".", [], "is a folder without meta/info.json"),
    ],
)
def test_mistakes_in_a_joint_log(folder, capsys, data, options, said):
    np.savez(folder / "log.npz", flow=np.ones(20), level=np.ones(20))
    assert main(["diagnose", f"{folder / 'plant.py'}:plant", str(folder / data), *options, "--quiet"]) == 2
    assert re.search(said, capsys.readouterr().err)
