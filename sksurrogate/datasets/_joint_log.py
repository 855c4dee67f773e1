"""Logs of robot joints as X, y and groups, whatever they were written with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate.datasets._log_lerobot import INFO, read_lerobot_log
from sksurrogate.datasets._log_mcap import read_mcap_log
from sksurrogate.datasets._log_rows import Rows, rows_of
from sksurrogate.datasets._log_streams import Asked, Record
from sksurrogate.datasets._log_tables import read_csv_log, read_npz_log
from sksurrogate.exceptions import DataError, MissingExtraError, require

#: Endings of files that are no log, and what makes one of them.
CONVERT = {
    ".db3": "a ROS 2 recording in SQLite: convert it to MCAP with  ros2 bag convert",
    ".bag": "a ROS 1 recording: convert it to MCAP with  mcap convert",
    ".parquet": "one file of a folder of LeRobot: give the folder that holds meta/ and data/",
    ".h5": "HDF5: write its arrays to an NPZ (numpy.savez)",
    ".hdf5": "HDF5: write its arrays to an NPZ (numpy.savez)",
}


@dataclass(frozen=True, eq=False)
class JointLog:
    """A joint log in the data convention.

    Attributes
    ----------
    X : DataFrame or ndarray (n_samples, n_inputs)
        Inputs; with a last column ``"time"`` (s) where rows are not equally spaced.
    y : DataFrame or ndarray (n_samples, n_outputs)
        Outputs; nan where nothing was measured.
    groups : ndarray (n_samples,)
        Label of the run of every row.
    inputs, outputs : tuple of str
        Names of the columns, without that of the time.
    time : str, int or None
        What ``GapDiagnoser(time=...)`` and ``CalibratedSimulator(time=...)`` take: the column of the time in X, its place where
        X is an array, or None where rows are ``dt`` apart.
    dt : float
        Time between two rows, s: the usual one where rows are not equally spaced.
    stamps : ndarray (n_samples,)
        Time of every row, s: from the first reading on (MCAP), or as in the file.
    notes : tuple of str
        What was left out, sorted or moved.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from sksurrogate.datasets import load_joint_log
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "log.csv"
    ...     _ = file.write_text("time,motor,elbow.pos\\n0.0,1,0.5\\n0.1,1,0.6\\n0.2,0,0.6\\n")
    ...     log = load_joint_log(file, inputs=["motor"], as_frame=False)
    >>> log
    JointLog: 1 run, 3 rows 0.1 s apart; inputs: motor; outputs: elbow.pos
    """

    X: Any
    y: Any
    groups: np.ndarray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    time: str | int | None
    dt: float
    stamps: np.ndarray
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        runs = len(np.unique(self.groups))
        apart = "apart" if self.time is None else "apart as a rule, with their times"
        lines = [
            f"JointLog: {runs} run{'s' if runs > 1 else ''}, {len(self.groups)} rows {self.dt:g} s {apart}; "
            f"inputs: {', '.join(self.inputs) or 'none'}; outputs: {', '.join(self.outputs)}"
        ]
        return "\n".join([*lines, *self.notes])


def load_joint_log(
    path: Any,
    *,
    inputs: Sequence[str] | Mapping[str, str] | None = None,
    outputs: Sequence[str] | Mapping[str, str] | None = None,
    readings: str | Sequence[str] | None = None,
    commands: str | Sequence[str] | None = None,
    dt: float | None = None,
    time: str | None = None,
    run: str | None = None,
    pause: float = 10.0,
    clock: str = "auto",
    degrees: str | Sequence[str] = (),
    as_frame: bool = True,
) -> JointLog:
    """Read a joint log from CSV, NPZ, MCAP or a folder of LeRobot.

    ``load_joint_log(path, inputs=arm.inputs, outputs=arm.outputs, dt=arm.dt)`` fits a simulator ``arm``. Its result goes into
    a diagnosis as ``GapDiagnoser(arm, time=log.time).fit(log.X, log.y, groups=log.groups)``.

    Parameters
    ----------
    path : path
        ``.csv``, ``.txt`` or ``.tsv`` with a header; ``.npz`` with arrays by the names of signals, or with tables; ``.mcap``
        of ROS 2, ROS 1 or JSON messages, or a folder of such files that belong to one recording; a folder of LeRobot
        (version 2 or 3) with ``meta/info.json``.
    inputs : list of str, or dict of str -> str, optional
        Inputs by name, in the order wanted; a dict gives the name in the log of each. By default all signals of
        ``commands``; needed for CSV and for NPZ without tables. ``[]``: none.
    outputs : list of str, or dict of str -> str, optional
        Outputs, in the same way. By default ``<joint>.pos`` and ``<joint>.vel`` of every joint, and in a folder of LeRobot
        or a table of an NPZ all signals of ``readings``.
    readings : str or list of str, optional
        Where outputs are: topics of MCAP (by default the only one of joint states), features of LeRobot
        (``"observation.state"``), tables of an NPZ (``"y"``).
    commands : str or list of str, optional
        Where inputs are: topics of MCAP (by default the effort in ``readings``), features of LeRobot (``"action"``), tables of an
        NPZ (``"X"``).
    dt : float, optional
        Time between rows, s: that of the simulator. By default that of the readings. A larger one takes the reading nearest to
        every row, a smaller one leaves rows without a reading. Needed where CSV or NPZ have no time.
    time : str, optional
        Column of a CSV or array of an NPZ with the time, s; by default ``time``, ``timestamp`` or ``t``, if there is one.
    run : str, optional
        Column of a CSV or array of an NPZ with the labels of the runs; by default ``run`` or ``episode_index``, if there is one.
    pause : float, default=10
        A pause of more than so many usual steps between two readings starts a new run, where the log has no labels.
    clock : {"auto", "header", "log"}, default="auto"
        Times of MCAP messages. ``"header"``: the stamp in the header, the time of recording where there is none; ``"log"``: the
        time of recording; ``"auto"``: headers, if all messages that are read have a stamp, else the time of recording for all.
    degrees : str or list of str, default=()
        Inputs and outputs that are in degrees and become radians, by name or pattern: ``"*.pos"``.
    as_frame : bool, default=True
        Whether X and y are pandas frames (extra ``frames``), whose columns a diagnosis finds by name; else arrays.

    Returns
    -------
    JointLog
        ``X, y, groups, inputs, outputs, time, dt, stamps, notes``.

    Raises
    ------
    DataError
        The file is not there, damaged or of another format; a signal, topic, feature or array is not in it (the message lists those
        that are); an input is missing in a row of a table; two readings of a joint at one time differ; time does not increase in a
        table; no two readings follow the first command; the readings do not fit to ``dt``.
    MissingExtraError
        mcap, mcap-ros2-support, mcap-ros1-support or pyarrow (extra ``robots``), or pandas, is not installed.

    Notes
    -----
    **Names.** Joint states of ROS are called ``<joint>.pos``, ``<joint>.vel``, ``<joint>.effort``, as in
    :class:`~sksurrogate.physics.MuJoCoSimulator`. An input ``elbow`` is the only one of ``elbow.effort``, ``elbow.pos``, ``elbow.vel``
    that the commands have; an output ``elbow.pos`` may be called ``elbow`` in the log. Signals without names (``Float64MultiArray``,
    arrays of an NPZ) are called ``source[0]``, ``source[1]``, ...; a list of names is taken in their order. A name that two topics
    share is ``topic:name``.

    **Rows.** A row is a reading. Its input is the command in force from there to the next row; where commands come in between, their
    mean over the row, so that the integral of a force is kept. Readings that stand on an even grid to 0.1 % of a step become rows
    that are ``dt`` apart, with nan in y where one is missing; else X has a column ``time``. In a table (and where the inputs are
    the effort of the readings) it is unknown what acted in a gap: then X has that column, too, and the diagnosis decides.

    **Messages.** Those out of order are sorted. Readings before the first command are left out. A message may lack joints (nan in y;
    a command goes on). The same reading twice at one time counts once. Of several topics, the one with most readings gives the rows;
    a reading of another moves to the row that is nearer than half a step. ``notes`` tells what was done.

    References
    ----------
    MCAP, https://mcap.dev; LeRobot, https://github.com/huggingface/lerobot; ROS, sensor_msgs/JointState.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> from sksurrogate.datasets import load_joint_log
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "log.npz"
    ...     np.savez(file, q=np.zeros((100, 2)), tau=np.ones((100, 2)), time=0.01 * np.arange(100))
    ...     log = load_joint_log(
    ...         file, readings="q", commands="tau", inputs=["motor1", "motor2"], outputs=["shoulder.pos", "elbow.pos"]
    ...     )
    >>> log
    JointLog: 1 run, 100 rows 0.01 s apart; inputs: motor1, motor2; outputs: shoulder.pos, elbow.pos
    >>> log.X.columns.tolist(), log.time
    (['motor1', 'motor2'], None)
    """
    for name, value in (("dt", dt), ("pause", pause)):
        if value is not None and not (isinstance(value, (int, float, np.number)) and 0.0 < value < np.inf):
            raise DataError(f"{name}={value!r}: expected a number above 0.")
    if clock not in ("auto", "header", "log"):
        raise DataError(f"clock={clock!r}: expected 'auto', 'header' or 'log'.")
    if as_frame:
        _check_pandas()
    asked = Asked(inputs, outputs, _listed(readings), _listed(commands), time, run, dt, clock)
    record = _record(Path(path), asked)
    rows = rows_of(record, dt, pause)
    return _log(record, rows, _listed(degrees), as_frame)


def _record(path: Path, asked: Asked) -> Record:
    """The log, by what the path is."""
    if not path.exists():
        raise DataError(f"path={str(path)!r}: there is no such file or folder in {Path.cwd()}.")
    ending = path.suffix.lower()
    files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    if path.is_dir() and (path / INFO).exists():
        _refuse(asked, "a folder of LeRobot", "time", "run", "clock")
        return read_lerobot_log(path, asked)
    if files and (path.is_dir() or ending == ".mcap"):
        _refuse(asked, "an MCAP file", "time", "run")
        return read_mcap_log(files, asked)
    if path.is_dir():
        raise DataError(
            f"path={str(path)!r} is a folder without {INFO.as_posix()} (LeRobot) and without .mcap files: name the file."
        )
    _refuse(asked, "a file without messages", "clock")
    if ending == ".npz":
        return read_npz_log(path, asked)
    if ending in (".csv", ".txt", ".tsv"):
        return read_csv_log(path, asked)
    other = CONVERT.get(ending, "no format that is read: .csv, .npz, .mcap, or a folder of LeRobot")
    raise DataError(f"path={str(path)!r} is {other}.")


def _refuse(asked: Asked, what: str, *arguments: str) -> None:
    """Arguments that a format has no use for are a mistake."""
    for name in arguments:
        if getattr(asked, name) not in (None, "auto"):
            raise DataError(
                f"{name}={getattr(asked, name)!r}: the log is {what}, which does not take it; leave it out."
            )


def _log(record: Record, rows: Rows, degrees: Sequence[str], as_frame: bool) -> JointLog:
    """The result, in radians, as frames or arrays."""
    X, y, inputs, outputs = rows.X, rows.y, record.inputs, record.outputs
    for pattern in degrees:
        if not any(fnmatchcase(name, pattern) for name in (*inputs, *outputs)):
            raise DataError(f"degrees: no signal is called {pattern!r}; they are {[*inputs, *outputs]}.")
    for values, names in ((X, inputs), (y, outputs)):
        columns = [j for j, name in enumerate(names) if any(fnmatchcase(name, pattern) for pattern in degrees)]
        values[:, columns] = np.deg2rad(values[:, columns])
    never = np.isnan(y).all(axis=0)
    if never.any():
        raise DataError(
            f"outputs: {outputs[int(np.argmax(never))]!r} has no number in the rows of the log: leave it out of outputs."
        )
    time: str | int | None = None
    table, names_of_table = X, list(inputs)
    if not rows.even:
        table, names_of_table = np.column_stack([X, rows.t]), [*inputs, "time"]
        time = "time" if as_frame else len(inputs)
    if as_frame:
        frame = require("pandas", "frames").DataFrame
        table, y = frame(table, columns=names_of_table), frame(y, columns=list(outputs))
    return JointLog(table, y, rows.groups, inputs, outputs, time, rows.dt, rows.t, rows.notes)


def _check_pandas() -> None:
    """Frames need pandas: said before minutes of reading."""
    try:
        require("pandas", "frames")
    except MissingExtraError as error:
        raise MissingExtraError(f"as_frame=True: {error}, or give as_frame=False.") from error


def _listed(names: str | Sequence[str] | None) -> tuple[str, ...]:
    return () if names is None else (names,) if isinstance(names, str) else tuple(names)
