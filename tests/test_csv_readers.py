"""Two readers, one answer: pandas, or line by line; and cells that must not be taken for something else."""

import re

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from sksurrogate import _csv
from sksurrogate.exceptions import DataError

cells = st.sampled_from(
    [
        "1",
        "2.5",
        "-3",
        "1e3",
        " 4 ",
        "",
        "nan",
        "NA",
        "inf",
        "1_0",
        "1,5",
        "a",
        "'1'",
        "+1",
        "1e400",
        ".5",
        "١",
        "1\xa0",
        "#",
        "-0",
        "1 2",
        "2024-01-01T00:00:00",
    ]
)
labels = st.sampled_from(["a", "b", "1", "1.0", "01", "", "\u00e4", "nan"])


def read(content, tmp_path, by_pandas, **named):
    file = tmp_path / "d.csv"
    file.write_bytes(content)
    with pytest.MonkeyPatch.context() as patch:
        if not by_pandas:
            patch.setattr(_csv, "_by_pandas", lambda *given: None)
        try:
            columns, runs = _csv.read_csv(file, ["u", "y"], gaps=["y"], **named)
        except DataError as error:
            return str(error)
    return {name: column.tolist() for name, column in columns.items()}, None if runs is None else runs.tolist()


@pytest.mark.slow
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(cells, cells, labels), min_size=1, max_size=4), st.sampled_from([",", ";", "\t"]),
    st.sampled_from(["\n", "\r\n", "\r"]), st.permutations(["u", "y", "run"]), st.sampled_from(["run", None]),
)  # fmt: skip
@example([("1", "2", ""), ("3", "4", "a")], ",", "\r", ["run", "u", "y"], None)  # pandas moved these cells to the left
def test_the_two_readers_agree(tmp_path, rows, delimiter, newline, header, run):
    pytest.importorskip("pandas")
    lines = [header, *([dict(zip(["u", "y", "run"], row))[name] for name in header] for row in rows)]
    content = newline.join(delimiter.join(line) for line in lines).encode()
    assert repr(read(content, tmp_path, True, run=run)) == repr(read(content, tmp_path, False, run=run))


def test_labels_that_are_not_utf8_are_not_one_run(tmp_path):
    content = "u,y,run\n1,2,M\u00e4r\n3,4,M\u00f6r\n".encode("latin-1")
    for by_pandas in (True, False):
        assert "line 2, column 'run': the run label 'M\ufffdr' is not UTF-8" in read(
            content, tmp_path, by_pandas, run="run"
        )


def test_a_run_label_stands_in_each_row(tmp_path):
    for by_pandas in (True, False):
        said = read(b"u,y,run\n1,2,a\n3,4,\n", tmp_path, by_pandas, run="run")
        assert "line 3, column 'run': the run label is empty" in said


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ("2024-01-01T00:00:00", "5", "line 3, column 't': '5' is no date and time as in the rows before"),
        ("5", "2024-01-01T00:00:00", "line 3, column 't': '2024-01-01T00:00:00' is a date or a clock"),
        ("2024-01-01T00:00:00Z", "2024-01-01T00:00:01", "line 3, column 't': .* is no date and time as in the rows"),
        (
            "2024-01-01T00:00:00",
            "2024-01-01T02:00:01+02:00",
            "line 3, column 't': .* is no date and time as in the rows",
        ),
    ],
)
def test_dates_and_numbers_are_not_one_clock(first, second, message, tmp_path):
    for by_pandas in (True, False):
        said = read(f"t,u,y\n{first},1,2\n{second},1,2\n".encode(), tmp_path, by_pandas, time="t")
        assert re.search(message, said)


def test_nanoseconds_are_kept(tmp_path):
    stamps = ["2024-01-01T00:00:00.100000000Z", "2024-01-01T00:00:00.1000009Z", "2024-01-01T00:00:01.100000250Z"]
    content = ("t,u,y\n" + "".join(f"{stamp},1,2\n" for stamp in stamps)).encode()
    for by_pandas in (True, False):
        columns, _ = read(content, tmp_path, by_pandas, time="t")
        assert columns["t"] == pytest.approx([0.0, 9e-7, 1 + 2.5e-7], abs=1e-10)
    assert np.all(np.diff(columns["t"]) > 0)


@pytest.mark.parametrize("by_pandas", [True, False])
def test_a_row_of_empty_cells_is_a_sample_unless_a_clock_stands_beside_it(by_pandas, tmp_path):
    said = read(b"u,y\n1,2\n\n,\n5,6\n", tmp_path, by_pandas)
    assert "line 4, column 'u': the cell is empty: fill it, or delete the row" in said
    assert read(b"u,y\n1,2\n,\n,\n", tmp_path, by_pandas) == ({"u": [1.0], "y": [2.0]}, None)
    timed = read(b"t,u,y\n0,1,2\n,,\n2,5,6\n", tmp_path, by_pandas, time="t")
    assert timed[0]["u"] == [1.0, 5.0] and timed[0]["t"] == [0.0, 2.0]
    (tmp_path / "d.csv").write_bytes(b"y,z\n1,2\n,\n5,6\n,\n")
    with pytest.MonkeyPatch.context() as patch:
        if not by_pandas:
            patch.setattr(_csv, "_by_pandas", lambda *given: None)
        columns, _ = _csv.read_csv(tmp_path / "d.csv", ["y", "z"], gaps=["y", "z"])
    np.testing.assert_array_equal(columns["y"], [1.0, np.nan, 5.0])


@pytest.mark.parametrize("by_pandas", [True, False])
def test_a_thousands_point_beside_decimal_commas_is_no_decimal(by_pandas, tmp_path):
    said = read(b"u;y\n1;999,5\n2;1.000\n", tmp_path, by_pandas)
    assert re.search(r"line 3, column 'y': '1.000' is written with '.', the rows before with ','", said)
    assert read(b"u;y\n1.5;2,5\n2.5;3,5\n", tmp_path, by_pandas)[0] == {"u": [1.5, 2.5], "y": [2.5, 3.5]}


@pytest.mark.parametrize("header", ["u\ty [m,s]", '"lev, a";y', "u;y(a,b,c)", "u,y"])
def test_commas_in_names_part_no_cells(header):
    assert _csv.delimiter_of(header) == ("\t" if "\t" in header else ";" if ";" in header else ",")
