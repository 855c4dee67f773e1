"""The command line: a diagnosis end to end, and mistakes with their way out."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

from sksurrogate.cli import load_simulator, main, read_csv
from sksurrogate.effects import load_augmented
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
    command = [
        "diagnose",
        f"{folder / 'plant.py'}:plant",
        str(folder / "data.csv"),
        "--run",
        "experiment",
        "--time",
        "time",
    ]
    assert main([*command, "--html", str(folder / "gap.html"), "--save", str(folder / "better.json"), "--quiet"]) == 0
    out = capsys.readouterr().out
    assert "VERDICT  explained" in out and "sensor bias" in out
    saved = json.loads((folder / "better.json").read_text())
    assert saved["params"] == {"k": 1.0}
    # An offset of this sensor and one of the input predict the same once the initial state is unknown.
    assert saved["effects"][0]["name"] in ("sensor_bias", "input_bias", "constant_bias")
    page = (folder / "gap.html").read_text()
    assert "<svg" in page and "http" not in page


@pytest.mark.slow
def test_the_report_as_json(folder, capsys):
    command = ["diagnose", f"{folder / 'plant.py'}:plant", str(folder / "data.csv"), "--run", "experiment", "--quiet"]
    assert main([*command, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["schema"] == "sksurrogate.gap-report/1" and printed["verdict"] == "explained"
    assert main([*command, "--json", str(folder / "report.json")]) == 0
    assert "VERDICT" in capsys.readouterr().out
    written = json.loads((folder / "report.json").read_text())
    assert written["effects"] == printed["effects"]
    assert main([*command, "--json", str(folder / "no" / "report.json")]) == 2
    assert "--json" in capsys.readouterr().err


def test_a_sensor_with_gaps_gets_the_same_name(folder, capsys):
    lines = (folder / "data.csv").read_text().splitlines()
    gaps = [line if k % 5 else re.sub(r",[^,]*(,[ab])$", r",\1", line) for k, line in enumerate(lines[1:], start=2)]
    (folder / "gaps.csv").write_text("\n".join([lines[0], *gaps]) + "\n")
    assert ",,a" in (folder / "gaps.csv").read_text()
    command = ["diagnose", f"{folder / 'plant.py'}:plant", str(folder / "gaps.csv"), "--run", "experiment", "--quiet"]
    assert main([*command, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["verdict"] == "explained"
    assert printed["effects"][0]["name"] in ("sensor_bias", "input_bias", "constant_bias")


def test_what_a_simulator_prints_is_no_part_of_the_report(folder, capsys):
    chatty = PLANT.replace("    return", '    print("one step")\n    return').replace(
        "plant = ", 'print("loaded")\nplant = '
    )
    (folder / "chatty.py").write_text(chatty)
    command = ["diagnose", f"{folder / 'chatty.py'}:plant", str(folder / "data.csv"), "--run", "experiment", "--quiet"]
    assert main([*command, "--effects", "sensor_bias", "--jobs", "1", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["verdict"] == "explained"
    assert err.startswith("loaded\none step")


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [[], ["--jobs", "1"], ["--jobs", "2"]])
def test_what_a_library_prints_past_python_is_no_part_of_the_report(folder, jobs):
    """A library in C writes to the descriptor, or to a buffer of its own that is full at any time."""
    talk = """
    os.write(1, b"past python ")
    ctypes.CDLL(None).printf(b"in a buffer ")
    print("printed")
    print("complaint", os.getpid(), file=sys.stderr)
    return"""
    (folder / "library.py").write_text("import ctypes, os, sys" + PLANT.replace("\n    return", talk))
    words = ["diagnose", str(folder / "library.py") + ":plant", str(folder / "data.csv"), "--run", "experiment"]
    command = [*words, "--effects", "sensor_bias", "quadratic_loss", *jobs, "--json"]
    code = "import sys; from sksurrogate.cli import main; sys.exit(main(sys.argv[1:]))"
    done = subprocess.run([sys.executable, "-c", code, *command], capture_output=True, text=True)
    assert done.returncode == 0 and json.loads(done.stdout)["verdict"] == "explained"
    assert all(text in done.stderr for text in ("past python", "in a buffer", "printed", "[gap]"))
    workers = {line.split()[-1] for line in done.stderr.splitlines() if "complaint" in line}
    assert len(workers) == 1  # a worker runs the same simulator


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [[], ["--jobs", "2"]])
def test_a_simulator_that_warns_does_so_once(folder, jobs):
    """Each time with another text, in every process."""
    (folder / "odd.py").write_text(
        "import warnings, numpy as np"
        + PLANT.replace("    return", '    warnings.warn(f"odd {np.mean(x[0])}")\n    return')
    )
    words = ["diagnose", str(folder / "odd.py") + ":plant", str(folder / "data.csv"), "--run", "experiment", "--quiet"]
    code = "import sys; from sksurrogate.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, *words, "--effects", "sensor_bias", "quadratic_loss", *jobs]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0
    assert len(done.stderr.splitlines()) == 1 and done.stderr.startswith("sksurrogate: odd ")


def test_a_simulator_that_always_raises_is_named_with_its_line(folder, capsys):
    (folder / "away.py").write_text(PLANT.replace("    return [", "    raise RuntimeError('no licence')\n    return ["))
    assert main(["diagnose", f"{folder / 'away.py'}:plant", str(folder / "data.csv"), "--quiet"]) == 2
    err = capsys.readouterr().err
    assert (
        "fails in line 4 of away.py, `raise RuntimeError('no licence')`: RuntimeError: no licence. See that its" in err
    )


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("return [u[0] - p['q'] * x[0]]", "line 4 of away.py, `return [u[0] - p['q'] * x[0]]`: rhs(t, x, u, p) failed"),
        ("return [float(str(x))]", "line 4 of away.py, `return [float(str(x))]`: rhs(t, x, u, p) failed at t=0"),
        ("if t > 3.0: raise ValueError('stuck')\n    return [u[0] - x[0]]",
         "last raised ValueError: stuck (line 4 of away.py, `if t > 3.0: raise ValueError('stuck')`), at t=3.0"),
    ],
)  # fmt: skip
def test_what_a_right_hand_side_raises_is_told_with_its_line(body, said, folder, capsys):
    (folder / "away.py").write_text(PLANT.replace('return [u[0] - p["k"] * x[0]]', body))
    assert main(["diagnose", f"{folder / 'away.py'}:plant", str(folder / "data.csv"), "--quiet"]) == 2
    assert said in capsys.readouterr().err


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


@pytest.mark.parametrize("quoted", [False, True])  # pandas does not read a file with quotation marks
def test_empty_cells_of_an_output_are_not_measured(tmp_path, quoted):
    first = '"1"' if quoted else "1"
    (tmp_path / "d.csv").write_text(f"flow,level\n{first},2\n2,\n3,NaN\n4,na\n5,6.5\n")
    columns, _ = read_csv(tmp_path / "d.csv", ["flow", "level"], gaps=["level"])
    np.testing.assert_array_equal(columns["level"], [2.0, np.nan, np.nan, np.nan, 6.5])
    with pytest.raises(DataError, match=r"line 3, column 'level': the cell is empty: .*only outputs may be empty"):
        read_csv(tmp_path / "d.csv", ["flow", "level"])
    (tmp_path / "d.csv").write_text(f"flow,level\n{first},2\n2,\n3,open\n")
    with pytest.raises(DataError, match="line 4, column 'level': 'open' is not a number"):
        read_csv(tmp_path / "d.csv", ["flow", "level"], gaps=["level"])
    (tmp_path / "d.csv").write_text(f"flow,level\n{first},2\n,3\n")
    with pytest.raises(DataError, match="line 3, column 'flow': the cell is empty"):
        read_csv(tmp_path / "d.csv", ["flow", "level"], gaps=["level"])


MISTAKES = {
    "empty": ("", r"is empty: expected a header line"),
    "only a header": ("flow,level\n", r"has a header and no rows"),
    "no header": (
        "1.0,2.0\n3.0,4.0\n",
        r"the first line holds numbers, .*add a line with the names \['flow', 'level'\]",
    ),
    "twice": ("flow,flow,level\n1,2,3\n", r"2 columns are called 'flow': rename all but one"),
    "capitals": ("Flow,Level\n1,2\n", r"no column 'flow'; .*Did you mean 'Flow'\?"),
    "long line": ("flow,level\n1,2,3\n", r"line 2: 3 cells, expected 2 .*decimal commas\?"),
    "short line": ("flow,level\n1\n", r"line 2: 1 cells, expected 2"),
    "decimal comma": ('flow,level\n"1,5",2\n', r"'1,5' is not a number. Decimal commas are read where .* semicolons"),
    "grouped digits": ("flow;level\n1.234,5;2,5\n", r"'1.234,5' is not a number"),
    "empty cell": ("flow,level\n1,2\n,3\n", r"line 3, column 'flow': the cell is empty: fill it, or delete the row"),
    "word": ("flow,level\n1,open\n", r"line 2, column 'level': 'open' is not a number: correct it"),
    "underscore": ("flow,level\n1_5,2\n", r"line 2, column 'flow': '1_5' is not a number: correct it"),
    "infinite": ("flow,level\n1,inf\n", r"line 2, column 'level': 'inf' is not finite"),
    "open quote": ('flow,level\n1,"2\n' + "x" * 200_000, r"not readable as CSV .*quotation mark"),
    "quote that closes rows below": (
        'flow,level,note\n1,2,"a\n3,4,b\n5,6,c"\n7,8,d\n',
        r"line 2: a quotation mark opens a cell that goes on to line 4, expected one line a sample",
    ),
    "quote that never closes": ('flow,level,note\n1,2,"a\n3,4,b\n', r"line 2: not readable as CSV .*close the quot"),
    "quote in the header": ('flow,level,"note\n1,2,a\n3,4,"b\n', r"line 1: not readable as CSV"),
    "header of two lines": ('flow,level,"no\nte"\n1,2,a\n', r"line 1: a quotation mark .* goes on to line 2"),
    "number behind a quote": ('flow,level\n1,2\n"1"5,3\n', r"line 3: not readable as CSV"),  # would be read as 15
    "utf-16": ("flow,level\n1,2\n".encode("utf-16"), r"not UTF-8 text .*save it as CSV, UTF-8"),
    "spreadsheet": (b"PK\x03\x04" + bytes(50), r"not UTF-8 text \(a spreadsheet"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_csv_with_a_mistake_gets_a_way_out(case, tmp_path):
    content, message = MISTAKES[case]
    (tmp_path / "d.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(DataError, match=message):
        read_csv(tmp_path / "d.csv", ["flow", "level"])


def test_quoted_cells_and_quotes_inside_a_cell_are_read(tmp_path):
    (tmp_path / "d.csv").write_text('flow,"a, b",run\r\n1,"5"" pipe","x"\r\n\r\n"2",6" pipe,"x"\r\n')
    columns, labels = read_csv(tmp_path / "d.csv", ["flow"], run="run")
    assert columns["flow"].tolist() == [1.0, 2.0] and labels.tolist() == ["x", "x"]


def test_a_giant_label_does_not_fill_the_memory(tmp_path):
    (tmp_path / "d.csv").write_text("flow,run\n" + "1,a\n" * 10 + "1," + "x" * 100_000 + "\n")
    with pytest.raises(DataError, match="run label of 100000 characters"):
        read_csv(tmp_path / "d.csv", ["flow"], run="run")


def test_a_large_file_is_refused_unread(tmp_path):
    with (tmp_path / "d.csv").open("wb") as file:
        file.truncate(600 * 2**20)
    with pytest.raises(DataError, match="larger than 512 MiB"):
        read_csv(tmp_path / "d.csv", ["flow"])


OPTIONS = {
    "run column": (["--run", "nope"], "no column 'nope'.*Give --run one of these"),
    "free parameter": (["--free", "kk"], r"no parameter 'kk'; it has \['k'\]"),
    "folder of the page": (["--html", "nowhere/x.html"], "there is no folder 'nowhere'; make it first"),
    "folder of the file": (["--save", "nowhere/x.json"], "there is no folder 'nowhere'; make it first"),
    "jobs": (["--jobs", "0"], "--jobs 0: give the number"),
    "seed": (["--seed", "-1"], "--seed -1: give a whole number from 0 to"),
    "time of another unit": (["--time", "ms"], r"--time ms: the usual step of the data is 100, .*milliseconds"),
    "time with a hole": (
        ["--time", "uneven"],
        "--time uneven, run None: 15 rows are spread over .* samples.*label the parts",
    ),
    "time runs back": (["--time", "back"], "--time back, run None: time does not increase after row 0"),
    "runs mixed up": (["--run", "mixed"], "run 'a' is in two pieces: rows 0..4 and again from row 10"),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_an_option_with_a_mistake_gets_a_way_out(case, folder, capsys):
    options, message = OPTIONS[case]
    lines = ["flow,level,ms,uneven,back,mixed"]
    lines += [f"{k % 3},{k % 2},{100 * k},{0.1 * k + 500 * (k > 7)},{-0.1 * k},{'ab'[k // 5 % 2]}" for k in range(15)]
    (folder / "d.csv").write_text("\n".join(lines))
    assert main(["diagnose", f"{folder / 'plant.py'}:plant", str(folder / "d.csv"), "--quiet", *options]) == 2
    assert re.search(message, capsys.readouterr().err.replace("\n", " "))


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (
            "import nothing_here",
            r"is read, in line 1 of plant.py, `import nothing_here`: ModuleNotFoundError.*Try  python",
        ),
        ("raise SystemExit(3)", "fails when it is read, in line 1 of plant.py.*: SystemExit"),
        ("k = 1\ndef plant(:", r"fails when it is read, in line 2 of plant.py, `def plant\(:`: SyntaxError"),
    ],
)
def test_a_simulator_file_that_fails(source, message, tmp_path):
    (tmp_path / "plant.py").write_text(source)
    with pytest.raises(SimulatorError, match=message):
        load_simulator(f"{tmp_path / 'plant.py'}:plant")


def test_a_class_is_no_simulator(folder, capsys):
    (folder / "cls.py").write_text("from sksurrogate.physics import ODESimulator\n")
    assert main(["diagnose", f"{folder / 'cls.py'}:ODESimulator", str(folder / "data.csv"), "--run", "experiment"]) == 2
    assert "simulator=ODESimulator is a class: give one simulator of it" in capsys.readouterr().err


def test_the_saved_file_is_the_augmented_simulator_again(folder):
    command = ["diagnose", f"{folder / 'plant.py'}:plant", str(folder / "data.csv"), "--run", "experiment", "--quiet"]
    assert main([*command, "--save", str(folder / "better.json")]) == 0
    plant = load_simulator(f"{folder / 'plant.py'}:plant")
    better = load_augmented(plant, folder / "better.json")
    columns, _ = read_csv(folder / "data.csv", ["flow", "level"])
    error = [
        model.simulate(columns["flow"][:150, None], x0=[0.5])[:, 0] - columns["level"][:150]
        for model in (plant, better)
    ]
    assert np.std(error[1]) < 0.3 * np.sqrt(np.mean(error[0] ** 2))


def test_run_labels_that_are_whole_numbers_read_as_such(tmp_path):
    (tmp_path / "d.csv").write_text("a,run\n1,0.000e+00\n2,0.000e+00\n3,1.000e+00\n")
    assert read_csv(tmp_path / "d.csv", ["a"], run="run")[1].tolist() == [0, 0, 1]
    (tmp_path / "d.csv").write_text("a,run\n1,007\n2,7\n")  # two labels, one number: kept as written
    assert read_csv(tmp_path / "d.csv", ["a"], run="run")[1].tolist() == ["007", "7"]


HEAD, ROWS = "time,flow,level,experiment", [f"{0.1 * k:.1f},{k % 3},{k % 5},{k // 6}" for k in range(12)]


@pytest.mark.parametrize(
    "lines, said",
    [
        (
            [line.replace(",", "|") for line in [HEAD, *ROWS]],
            r"header is one cell, 'time\|flow.*commas, semicolons or tab",
        ),
        ([line.replace(",", " ") for line in [HEAD, *ROWS]], "header is one cell, .*commas, semicolons or tabs"),
        (
            [f"01.02.2026 00:00:0{k},1,1,0" if k else HEAD for k in range(9)],
            "'01.02.2026 00:00:01' is a date or a clock",
        ),
        ([HEAD.replace("time", "clock"), *ROWS], "no column 'time'; .*Give --time one of these"),
        ([HEAD.replace("experiment", "run"), *ROWS], "no column 'experiment'; .*Give --run one of these"),
        (ROWS, r"first line holds numbers, expected a header: .*\['flow', 'level'\]"),
        (
            [HEAD, *ROWS[:6], "0.6,0,1,0", "0.7,1,2,0", "0.1,1,1,0"],
            r"(?s)time does not increase after row 7.*Row 0 is the first line",
        ),
        ([HEAD, *ROWS[:3], *ROWS[6:9], *ROWS[3:6]], "run 0 is in two pieces: rows 0..2 and again from row 6.*Row 0 is"),
    ],
)
def test_mistakes_in_a_recording(lines, said, tmp_path, capsys):
    (tmp_path / "plant.py").write_text(
        "from sksurrogate.physics import ODESimulator\n"
        "plant = ODESimulator(lambda t, x, u, p: [u[0] - x[0]], states=['level'], inputs=['flow'], outputs=['level'],\n"
        "                     params={'k': 1.0}, dt=0.1)\n"
    )
    (tmp_path / "d.csv").write_text("\n".join(lines) + "\n")
    arguments = [f"{tmp_path / 'plant.py'}:plant", str(tmp_path / "d.csv"), "--run", "experiment", "--time", "time"]
    assert main(["diagnose", *arguments, "--quiet"]) == 2
    assert re.search(said, capsys.readouterr().err)
