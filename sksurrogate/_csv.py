"""Reading a recording from CSV: numbers by column name, bounded, errors by line and column."""

from __future__ import annotations

import csv
import difflib
import io
import re
from array import array
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from sksurrogate.exceptions import DataError

#: A CSV larger than this is refused unread.
LARGEST_CSV = 512 * 2**20
#: A run label longer than this is not a label (and would blow up the array of labels).
LONGEST_LABEL = 200
#: A number with a decimal comma and nothing that groups digits; the beginning of a date.
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
DECIMAL_POINT = re.compile(DECIMAL_COMMA.pattern.replace(",", r"\."))
#: Cells that say that nothing was measured, in small letters.
NOT_MEASURED = frozenset({"", "nan", "na", "n/a", "null", "none"})
ISO_TIME = re.compile(r"\d{4}-\d{2}-\d{2}[T ]\d")


def read_csv(
    path: Any, wanted: Sequence[str], run: str | None = None, time: str | None = None, gaps: Sequence[str] = ()
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Columns of a CSV by name, as numbers; the run column as whole numbers, else as text.

    pandas reads it, if it is installed and every cell is plain; else lines are read one by one, and a mistake has its line.

    Parameters
    ----------
    path : path
        UTF-8 text with a header; comma, semicolon or tab between cells. A quoted cell ends in its line. At most 512 MiB. Decimal
        points; decimal commas too where cells are not separated by commas. Rows of empty cells at the end are left out, and
        with ``time`` everywhere.
    wanted : sequence of str
        Numeric columns.
    run : str, optional
        Column of run labels.
    time : str, optional
        Column of the time: numbers, or dates and times of ISO 8601, which become seconds from the first row.
    gaps : sequence of str, default=()
        Columns of ``wanted`` where a cell may be empty, or ``nan``, ``NA``, ``null``: nothing was measured, which becomes nan.

    Returns
    -------
    columns : dict of ndarray
    labels : ndarray or None

    Raises
    ------
    DataError
        A column is missing, a line is short or long, a value is not a number, a quotation mark is not closed in its line;
        the message names line and column.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "tank.csv"
    ...     _ = file.write_text("flow,level\\n1,2.5\\n1,\\n")
    ...     columns, labels = read_csv(file, ["flow", "level"], gaps=["level"])
    >>> columns["level"].tolist()
    [2.5, nan]
    """
    file = _text_file(path)
    plain = _by_pandas(file, wanted, run, time, gaps)
    if plain is not None:
        return plain
    with file.open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        return _read(stream, file.name, wanted, run, time, gaps)


def read_header(path: Any) -> list[str]:
    """Names of the columns of a CSV; empty where its first line cannot be read."""
    with _text_file(path).open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        first = stream.readline(2**16)
    try:
        return [cell.strip() for cell in next(csv.reader([first], delimiter=delimiter_of(first)), [])]
    except csv.Error:
        return []


def delimiter_of(header: str) -> str:
    """What stands between the cells of a header line: the most frequent outside of quotation marks and brackets, tab before semicolon before comma.

    >>> delimiter_of("u\\ty [m,s]"), delimiter_of('"lev, a";y'), delimiter_of("u,y")
    ('\\t', ';', ',')
    """
    bare = re.sub(r'"[^"]*"|\[[^\]]*\]|\([^)]*\)', "", header)
    return max("\t;,", key=bare.count if any(map(bare.count, "\t;,")) else header.count)


def _text_file(path: Any) -> Path:
    """The file, if it can be a CSV."""
    file = Path(path)
    if file.is_dir():
        raise DataError(f"data={str(path)!r} is a folder: name the CSV in it.")
    if not file.is_file():
        raise DataError(f"data={str(path)!r}: there is no such file in {Path.cwd()}.")
    size = file.stat().st_size
    if size == 0:
        raise DataError(f"{file.name} is empty: expected a header line and one line for each sample.")
    if size > LARGEST_CSV:
        raise DataError(f"data={str(path)!r} is larger than {LARGEST_CSV >> 20} MiB: use the Python interface for it.")
    with file.open("rb") as stream:
        head = stream.read(4096)
    if b"\0" in head:
        raise DataError(f"{file.name} is not UTF-8 text (a spreadsheet, or UTF-16?): save it as CSV, UTF-8.")
    return file


def _by_pandas(
    file: Path, wanted: Sequence[str], run: str | None, time: str | None, gaps: Sequence[str]
) -> tuple[dict[str, np.ndarray], np.ndarray | None] | None:
    """As :func:`_read` gives it; None without pandas, and where there are quotation marks or anything is amiss."""
    try:
        import pandas
    except ImportError:
        return None
    header, data = read_header(file), file.read_bytes()
    if data.count(b"\r") > data.count(b"\r\n"):
        return None  # where lines end with \r alone, pandas drops an empty first cell and moves the others
    named = [*dict.fromkeys([*wanted, *([time] if time else [])]), *([run] if run else [])]
    if b'"' in data or len(set(named)) < len(named) or any(header.count(column) != 1 for column in named):
        return None
    places = {column: header.index(column) for column in named}
    delimiter = delimiter_of(data.split(b"\n", 1)[0].decode(errors="replace"))
    try:
        frame = pandas.read_csv(
            io.BytesIO(data), sep=delimiter, header=None, names=range(len(header)), skiprows=1, index_col=False,
            usecols=sorted(set(places.values())), dtype=str, na_filter=False, encoding="utf-8-sig",
        )  # fmt: skip
    except (ValueError, pandas.errors.ParserWarning):
        return None
    if not len(frame) or data.count(delimiter.encode()) != (len(header) - 1) * (len(frame) + 1):
        return None  # a line is short, or there is none
    cells = {column: [str(cell).strip() for cell in frame[place]] for column, place in places.items()}
    if not any(texts[-1] for texts in cells.values()):
        return None  # perhaps what a spreadsheet leaves behind the last sample
    labels = cells.pop(run) if run else []
    columns = {column: _plain(texts, column == time, column in gaps, delimiter) for column, texts in cells.items()}
    if not all(map(len, columns.values())) or not all(map(_is_label, set(labels))):
        return None
    return columns, _labels(labels) if run else None


def _plain(cells: list[str], clock: bool, gaps: bool, delimiter: str) -> np.ndarray:
    """Finite numbers of a column, nan in its gaps, or seconds of its dates and times; empty where a cell is neither."""
    if clock and ISO_TIME.match(cells[0]):
        watch = _Clock()
        seconds = [watch.seconds(text) for text in cells]
        return np.empty(0) if None in seconds else np.array(seconds, dtype=float)
    if delimiter != ",":
        if {_decimal_mark(text) for text in cells} >= {",", "."}:
            return np.empty(0)
        cells = [text.replace(",", ".") if DECIMAL_COMMA.fullmatch(text) else text for text in cells]
    try:
        measured = [not gaps or text.lower() not in NOT_MEASURED for text in cells]
        values = np.array(
            [float("no number" if "_" in text else text) if m else np.nan for text, m in zip(cells, measured)]
        )
    except ValueError:
        return np.empty(0)
    return values if np.all(np.isfinite(values[measured])) else np.empty(0)


def _read(
    stream: TextIO, name: str, wanted: Sequence[str], run: str | None, time: str | None, gaps: Sequence[str]
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Header, then rows."""
    first = stream.readline(2**16)
    stream.seek(0)
    delimiter = delimiter_of(first)
    rows = _lines(csv.reader(stream, delimiter=delimiter, strict=True), name)
    header = [cell.strip() for cell in next(rows, (1, []))[1]]
    _check_header(header, name, wanted, run, time)
    wanted = [*wanted, *([time] if time and time not in wanted else [])]
    places = [header.index(column) for column in wanted]
    label_at = header.index(run) if run else None
    values, labels = array("d"), []
    clock, marks = _Clock(), dict.fromkeys(wanted, "")
    for line, row in _samples(rows, clock=time is not None):
        if len(row) != len(header):
            hint = "Are numbers written with decimal commas? " if len(row) > len(header) else ""
            raise DataError(
                f"{name}, line {line}: {len(row)} cells, expected {len(header)} as in the header. {hint}"
                f"Give the line one cell for each column, or leave it out. It reads {delimiter.join(row)[:60]!r}."
            )
        for j, column in zip(places, wanted):
            text = row[j]
            if delimiter != ",":
                mark = _decimal_mark(text.strip())
                marks[column] = marks[column] or mark
                if mark and mark != marks[column]:
                    raise DataError(
                        f"{name}, line {line}, column {column!r}: {_short(text)} is written with {mark!r}, the rows before with "
                        f"{marks[column]!r}: write all decimals in one way, and group no digits."
                    )
                text = text.replace(",", ".") if mark == "," else text
            if column in gaps and text.strip().lower() in NOT_MEASURED:
                values.append(np.nan)
                continue
            seconds = clock.seconds(text) if column == time else None
            if seconds is None and column == time and clock.first is not None:
                raise DataError(
                    f"{name}, line {line}, column {column!r}: {_short(text)} is no date and time as in the rows before; correct it, or "
                    "delete the row (and start a new run there)."
                )
            values.append(_number(text, column, name, line) if seconds is None else seconds)
        if label_at is not None:
            label = row[label_at].strip()
            if not _is_label(label):
                raise DataError(f"{name}, line {line}, column {run!r}: {_why_no_label(label)}")
            labels.append(label)
    if not values:
        raise DataError(f"{name} has a header and no rows.")
    table = np.array(values).reshape(-1, len(places))
    columns = {column: table[:, j] for j, column in enumerate(wanted)}
    return columns, _labels(labels) if label_at is not None else None


def _decimal_mark(text: str) -> str:
    """Of a number with decimals; empty where there is none."""
    return "," if DECIMAL_COMMA.fullmatch(text) else "." if DECIMAL_POINT.fullmatch(text) else ""


def _samples(rows: Iterator[tuple[int, list[str]]], clock: bool) -> Iterator[tuple[int, list[str]]]:
    """Rows without blank lines, and without the empty cells that a spreadsheet leaves behind the last sample.

    Empty cells between samples are a sample, unless a ``clock`` tells when the others were taken: without it those would move up.
    """
    empty: list[tuple[int, list[str]]] = []
    for line, row in rows:
        if any(cell.strip() for cell in row):
            yield from empty
            empty = []
            yield line, row
        elif len(row) > 1 and not clock:
            empty.append((line, row))


def _is_label(text: str) -> bool:
    """Whether a cell says which run its row belongs to."""
    return 0 < len(text) <= LONGEST_LABEL and "\ufffd" not in text


def _why_no_label(text: str) -> str:
    if not text:
        return "the run label is empty: write the label of the run in each of its rows."
    if len(text) > LONGEST_LABEL:
        return f"a run label of {len(text)} characters, expected at most {LONGEST_LABEL}; is this the run column?"
    return f"the run label {_short(text)} is not UTF-8, so that it cannot be told from others: save the file as UTF-8."


class _Clock:
    """Dates and times as seconds from the first one."""

    def __init__(self) -> None:
        self.first: tuple[datetime, float, bool] | None = None
        self.others = False

    def seconds(self, text: str) -> float | None:
        """None where the text is not a date and time of ISO 8601, or stands in a column of others, or beside those with a time zone
        without one."""
        found = None if self.others or not ISO_TIME.match(text.strip()) else _moment(text.strip())
        if found is None or (self.first and found[2] != self.first[2]):
            self.others = True
            return None
        self.first = self.first or found
        return (found[0] - self.first[0]).total_seconds() + (found[1] - self.first[1])


def _moment(text: str) -> tuple[datetime, float, bool] | None:
    """A time to the microsecond, the digits below that in seconds, and whether it says its time zone."""
    below = re.search(r"(?<=[.,]\d{6})\d+", text)
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    zone = moment.tzinfo is not None
    return moment if zone else moment.replace(tzinfo=UTC), float(f"0.{below[0]}") * 1e-6 if below else 0.0, zone


def _lines(reader: Any, name: str) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of every line; a cell that goes on in the next line would swallow samples in silence."""
    while True:
        line = reader.line_num + 1
        try:
            row = next(reader, None)
        except csv.Error as error:
            raise DataError(
                f"{name}, line {line}: not readable as CSV ({error}): close the quotation mark, or delete it."
            ) from error
        if row is None:
            return
        if reader.line_num > line:
            raise DataError(
                f"{name}, line {line}: a quotation mark opens a cell that goes on to line {reader.line_num}, expected one line a "
                "sample: close the quotation mark, delete it, or write the text in one line."
            )
        yield line, row


def _labels(cells: list[str]) -> np.ndarray:
    """Labels as written, or whole numbers where all are (``0.000e+00`` reads as run 0)."""
    text = np.array(cells)
    try:
        numbers = text.astype(float)
    except ValueError:
        return text
    whole = np.isfinite(numbers) & (numbers == np.round(numbers)) & (np.abs(numbers) < 2**53)
    return numbers.astype(int) if whole.all() and len(set(cells)) == len(np.unique(numbers)) else text


def _check_header(header: list[str], name: str, wanted: Sequence[str], run: str | None, time: str | None) -> None:
    """Every column is there, once."""
    options = {column: option for column, option in ((run, "--run"), (time, "--time")) if column}
    for column in dict.fromkeys([*wanted, *options]):
        if header.count(column) > 1:
            raise DataError(f"{name}: {header.count(column)} columns are called {column!r}: rename all but one.")
        if column not in header:
            if column in options and column not in wanted:
                way = f"Give {options[column]} one of these."
            else:
                way = f"Rename it there, or give its column to sksurrogate diagnose: --columns {column}=COLUMN."
            raise DataError(_missing(column, header, name, wanted, way))


def _missing(column: str, header: list[str], name: str, wanted: Sequence[str], way: str) -> str:
    """What to say of a column that is not there: the whole header may be the reason."""
    if not set(wanted) & set(header):
        numbers = sum(map(_is_number, header))
        if header and numbers > len(header) / 2:
            return f"{name}: the first line holds numbers, expected a header: add a line with the names {list(wanted)}."
        if len(header) == 1 and len(wanted) > 1 and all(word in header[0] for word in wanted):
            return (
                f"{name}: the header is one cell, {_short(header[0])}: cells are parted by commas, semicolons or "
                "tabs; save the file with one of these."
            )
    lower = {cell.lower(): cell for cell in header}
    close = difflib.get_close_matches(column.lower(), list(lower), n=1, cutoff=0.6)
    hint = f" Did you mean {lower[close[0]]!r}?" if close else ""
    if any("\ufffd" in cell for cell in header):
        hint += " The file is not UTF-8: save it so."
    return f"{name} has no column {column!r}; its columns are {header[:50]}.{hint} {way}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(text: str, column: str, file: str, line: int) -> float:
    """A finite number, or where it should be."""
    try:
        value = float("no number" if "_" in text else text)  # Python reads 1_5 as 15
    except ValueError:
        if not text.strip():
            problem = (
                "the cell is empty: fill it, or delete the row (and start a new run there); only outputs may be empty, where "
                "nothing was measured."
            )
        elif re.search(r"\d[-/:.]\d+[-/:.]\d", text):
            problem = (
                f"{_short(text)} is a date or a clock: give the time as a number, for example seconds from the start."
            )
        elif "," in text:
            problem = f"{_short(text)} is not a number. Decimal commas are read where cells are separated by semicolons or tabs."
        else:
            problem = f"{_short(text)} is not a number: correct it, or delete the row (and start a new run there)."
        raise DataError(f"{file}, line {line}, column {column!r}: {problem}") from None
    if not np.isfinite(value):
        raise DataError(f"{file}, line {line}, column {column!r}: {text!r} is not finite; fill or delete the row.")
    return value


def _short(text: str) -> str:
    """A cell as it can stand in a message."""
    return repr(text if len(text) <= 40 else text[:37] + "...")
