"""Files are written whole or not at all, and the command line hands over what it has, whatever breaks."""

import ast
import io
import json
import os
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import joblib
import numpy as np
import pytest
from sklearn.linear_model import LinearRegression

import sksurrogate
from sksurrogate._files import append_line, beside, write_text
from sksurrogate.blind import BlindResult
from sksurrogate.cli import main
from sksurrogate.datasets import make_reactor, simulate_experiments
from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.export import to_c, to_onnx
from sksurrogate.gap.render._report import GapReport
from sksurrogate.gap.results._provenance import Provenance

resource = pytest.importorskip("resource")
ROOT = Path(sksurrogate.__file__).parent


@contextmanager
def full_disk(size=64):
    """No file of this process may grow beyond ``size`` bytes, as on a disk that is full."""
    kept = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, kept[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, kept)


def lagged():
    return AugmentedSimulator(make_reactor(), [CATALOGUE["input_lag"]("u")], [{"time_constant": 0.05}])


def line():
    return LinearRegression().fit([[0.0], [1.0]], [1.0, 3.0])


WRITERS = {
    "save_augmented": lambda path: save_augmented(lagged(), path),
    "report": lambda path: GapReport.to_html(None, path),
    "blind": lambda path: BlindResult((), True).to_html(path),
    "to_c": lambda path: to_c(line(), path),
    "to_onnx": lambda path: to_onnx(line(), path),
}
EXTRA = {"to_c": "casadi", "to_onnx": "onnx"}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_full_disk_leaves_the_file_that_was_there(writer, tmp_path, monkeypatch):
    pytest.importorskip(EXTRA.get(writer, "numpy"))
    monkeypatch.setattr("sksurrogate.gap.render._report.html_page", lambda report: "<html>" + 200 * "x")
    file = tmp_path / "kept.json"
    file.write_text("the controller reads this")
    WRITERS[writer](tmp_path / "once")  # whatever is loaded or made at the first call
    with full_disk(), pytest.raises(OSError):
        WRITERS[writer](file)
    assert file.read_text() == "the controller reads this"
    assert {path.name for path in tmp_path.iterdir()} == {"kept.json", "once"}
    WRITERS[writer](file)
    assert file.read_bytes() == (tmp_path / "once").read_bytes()


@pytest.mark.slow
def test_every_writer_of_the_package_writes_beside():
    own = {"blind/_seal.py", "blind/_solve.py", "_files.py"}  # a new file of its own name; a pipe; the helper
    for path in ROOT.rglob("*.py"):
        place = path.relative_to(ROOT).as_posix()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or place in own:
                continue
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            modes = [*node.args, *(k.value for k in node.keywords if k.arg == "mode")]
            texts = [m.value for m in modes if isinstance(m, ast.Constant) and isinstance(m.value, str)]
            nowhere = [ast.unparse(argument) for argument in node.args[:1]] == ["os.devnull"]
            opened = name in ("open", "fdopen") and not nowhere and any(set(text) & set("wax+") for text in texts)
            method = name in ("write_text", "write_bytes") and isinstance(node.func, ast.Attribute)
            assert not (opened or method), f"{place}, line {node.lineno}: use sksurrogate._files"


def test_links_permissions_and_pipes_stay_what_they_are(tmp_path):
    real = tmp_path / "real.txt"
    real.write_text("old")
    real.chmod(0o640)
    (tmp_path / "link.txt").symlink_to(real)
    write_text(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink() and real.read_text() == "new"
    assert real.stat().st_mode & 0o777 == 0o640
    os.mkfifo(tmp_path / "pipe")
    read = []
    thread = threading.Thread(target=lambda: read.append((tmp_path / "pipe").read_text()))
    thread.start()
    write_text(tmp_path / "pipe", "through")
    thread.join(10)
    assert read == ["through"] and (tmp_path / "pipe").is_fifo()
    with pytest.raises(IsADirectoryError, match="is a folder, expected the name of a file"):
        write_text(tmp_path, "x")
    with pytest.raises(KeyboardInterrupt), beside(real) as part:
        part.write_text("half")
        raise KeyboardInterrupt
    assert real.read_text() == "new" and len(list(tmp_path.iterdir())) == 3


def test_lines_of_two_writers_do_not_mix(tmp_path):
    file = tmp_path / "rows.jsonl"
    file.write_text('{"broken": ')
    rows = [json.dumps({"row": k, "text": 20_000 * chr(97 + k)}) for k in range(8)]  # longer than a buffer
    threads = [threading.Thread(target=append_line, args=(file, row)) for row in rows]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(row for row in file.read_text().splitlines() if row) == sorted([*rows, '{"broken": '])
    append_line(tmp_path / "new.jsonl", "{}")
    assert (tmp_path / "new.jsonl").read_text() == "{}\n"


def test_a_damaged_batch_is_simulated_again(tmp_path):
    how = {"n_runs": 2, "n_samples": 9, "cache": tmp_path, "random_state": 0}
    ranges = {"y": (4.0, 6.0)}, {"u": (0.1, 0.2)}
    whole = simulate_experiments(make_reactor(), *ranges, **how)
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:40])
    with pytest.warns(RuntimeWarning, match=r"is damaged \(\w+\): its runs are simulated again"):
        again = simulate_experiments(make_reactor(), *ranges, **how)
    np.testing.assert_array_equal(again.y, whole.y)
    assert len(joblib.load(file)) == 2 and list(tmp_path.iterdir()) == [file]


@dataclass
class Found:
    """Stands for a report."""

    verdict: str = "explained"
    complete: bool = True
    notes: tuple[str, ...] = ()
    provenance: Provenance = field(default_factory=Provenance)

    def __str__(self):
        return "VERDICT ≥ explained"

    def to_html(self, path):
        write_text(path, "page" * 100)

    def to_json(self, path=None):
        return "{}"


class Diagnosed:
    """Stands for a diagnosis."""

    fits = 0

    def __init__(self, simulator, **settings):
        self.augmented_, self.report_ = lagged(), Found()

    def fit(self, X, y, groups=None, **settings):
        type(self).fits += 1


@pytest.fixture
def command(tmp_path, monkeypatch):
    monkeypatch.setattr("sksurrogate.gap.GapDiagnoser", Diagnosed)
    monkeypatch.setattr(Diagnosed, "fits", 0)
    (tmp_path / "plant.py").write_text("from sksurrogate.datasets import make_reactor\nplant = make_reactor()\n")
    (tmp_path / "d.csv").write_text("u,y\n" + "0.1,5.0\n" * 9)
    monkeypatch.chdir(tmp_path)
    return ["diagnose", "plant.py:plant", "d.csv", "--save", "better.json", "--html", "gap.html", "--quiet"]


def saved(path="better.json"):
    return [effect.name for effect in load_augmented(make_reactor(), path).effects] == ["input_lag"]


def stdout_on(path):
    return os.fdopen(os.open(path, os.O_WRONLY), "w")


def test_a_broken_pipe_costs_nothing(command, monkeypatch, capfd):
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as stream:
        monkeypatch.setattr("sys.stdout", stream)
        assert main(command) == 1
    assert saved() and Path("gap.html").exists() and capfd.readouterr().err == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_behind_the_output_costs_nothing(command, monkeypatch, capfd):
    with stdout_on("/dev/full") as stream:
        monkeypatch.setattr("sys.stdout", stream)
        assert main(command) == 1
    assert saved() and "could not be printed (No space left on device)" in capfd.readouterr().err


def test_a_letter_that_the_terminal_does_not_know_is_replaced(command, monkeypatch):
    shown = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr("sys.stdout", shown)
    assert main(command) == 0 and saved()
    assert shown.buffer.getvalue().startswith(b"VERDICT ? explained")


def test_a_closed_output_and_a_closed_error_stream_cost_nothing(command, monkeypatch):
    monkeypatch.setattr("sys.stdout", None)
    monkeypatch.setattr("sys.stderr", None)
    assert main(command) == 0 and saved()


@pytest.mark.parametrize("option", ["--html", "--save"])
def test_a_target_that_cannot_be_written_is_said_before_the_work(option, command, capsys, tmp_path, monkeypatch):
    (tmp_path / "shut").mkdir()
    assert main([*command, option, "shut"]) == 2
    assert f"{option} shut is a folder: name a file in it" in capsys.readouterr().err
    assert main([*command, "--save", "gap.html"]) == 2
    assert "are the same file: give two names" in capsys.readouterr().err
    monkeypatch.setattr("tempfile.TemporaryFile", lambda dir: os.open("/nowhere/x", os.O_RDONLY))
    assert main([*command[:3], option, "x"]) == 2
    assert f"{option} x cannot be written (No such file or directory)" in capsys.readouterr().err
    assert Diagnosed.fits == 0


@pytest.mark.parametrize("option", ["--html", "--save"])
@pytest.mark.parametrize(("file", "name"), [("plant.py", "the simulator"), ("./d.csv", "the data")])
def test_a_result_is_not_written_over_what_was_read(option, file, name, command, capsys):
    before = Path(file).read_bytes()
    assert main([*command, option, file]) == 2
    assert f"{option} {file} and {name} are the same file: give two names" in capsys.readouterr().err
    assert Path(file).read_bytes() == before and Diagnosed.fits == 0


def test_two_results_do_not_share_a_file_but_may_share_a_stream(command, capsys):
    assert main([*command, "--json", "better.json"]) == 2
    assert "--json better.json and --save are the same file: give two names" in capsys.readouterr().err
    Path("rows.jsonl").write_text("{}")
    assert main(["blind", "--resume", "rows.jsonl", "--html", "rows.jsonl"]) == 2
    assert "--html rows.jsonl and --resume are the same file: give two names" in capsys.readouterr().err
    assert main([*command, "--html", os.devnull, "--save", os.devnull]) == 0


def test_what_does_not_fit_on_the_disk_is_kept_elsewhere(command, monkeypatch, capsys, tmp_path):
    Path("better.json").write_text("the controller reads this")
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))

    def full(path):
        if path.parent == tmp_path:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr("sksurrogate._files._on_disk", full)
    assert main(command) == 1
    shown = capsys.readouterr()
    (place,) = (tmp_path / "tmp").rglob("better.json")
    assert saved(place) and f"not written to better.json (No space left on device); it is in {place}" in shown.err
    assert "VERDICT" in shown.out and f"augmented simulator: {place}" in shown.out
    assert Path("better.json").read_text() == "the controller reads this" and not Path("gap.html").exists()


def test_what_fits_nowhere_is_printed(command, monkeypatch, capsys):
    def full(path):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("sksurrogate._files._on_disk", full)
    assert main(command) == 1
    out = capsys.readouterr().out
    assert json.loads(out[out.index("{") :])["effects"][0]["name"] == "input_lag"


def test_an_interrupted_demo_begins_no_other_diagnosis(monkeypatch, capsys):
    def interrupted():
        return SimpleNamespace(title="first", ending="", report=SimpleNamespace(complete=False, to_html=str))

    def unwanted():
        raise AssertionError("nobody wants it")

    monkeypatch.setattr("sksurrogate.demo.story_actuator_and_sensor", interrupted)
    monkeypatch.setattr("sksurrogate.demo.story_linearised", unwanted)
    assert main(["demo"]) == 130 and "Example 1: first" in capsys.readouterr().out


def test_the_demo_says_before_its_work_that_there_is_no_folder(tmp_path, capsys):
    (tmp_path / "file").write_text("x")
    assert main(["demo", "--html", str(tmp_path / "file")]) == 2
    assert "no folder can be made there" in capsys.readouterr().err
