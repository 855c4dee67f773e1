"""Joint logs in a folder of LeRobot: Parquet files of frames, whose signals are named in meta/info.json."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate._close_names import did_you_mean
from sksurrogate.datasets._log_streams import Asked, Record, Stream, chosen, columns_by_name, distinct, shown
from sksurrogate.datasets._log_tables import table_record
from sksurrogate.exceptions import DataError, require

INFO = Path("meta", "info.json")
#: Features that hold readings and commands by default, and those that count frames.
READINGS, COMMANDS = "observation.state", "action"
EPISODE, FRAME, TIME = "episode_index", "frame_index", "timestamp"
#: Time in s by which stamps may differ from frames divided by the frame rate: LeRobot's own tolerance.
STAMP_TOLERANCE = 1e-4


def read_lerobot_log(folder: Path, asked: Asked) -> Record:
    """Frames of all episodes, of one file per episode (version 2) or of several episodes per file (version 3)."""
    info = _info(folder)
    fps, features = float(info["fps"]), info["features"]
    commands = asked.commands or ((COMMANDS,) if asked.inputs is None or len(asked.inputs) else ())
    readings = asked.readings or (READINGS,)
    for argument, keys in (("commands", commands), ("readings", readings)):
        for key in keys:
            _check_feature(argument, key, features)
    table = _frames(folder, [*readings, *commands])
    order = np.lexsort((table[FRAME], table[EPISODE]))
    table = {key: values[order] for key, values in table.items()}
    sides = []
    for argument, keys in (("inputs", commands), ("outputs", readings)):
        streams = distinct([_stream(key, features[key].get("names"), table[key]) for key in keys])
        known = list(dict.fromkeys(name for stream in streams for name in stream.names))
        pairs = chosen(argument, getattr(asked, argument), known, known, all(stream.numbered for stream in streams))
        columns = columns_by_name(streams, pairs)
        sides.append((tuple(pairs), np.array([*columns.values()], dtype=float).T.reshape(len(table[FRAME]), -1)))
    clock = table[FRAME] / fps
    if np.max(np.abs(table[TIME] - clock)) > STAMP_TOLERANCE + np.spacing(np.float32(np.max(clock))):
        clock = table[TIME]  # true stamps in the place of those of the frame rate
    (inputs, X), (outputs, y) = sides
    record = table_record(
        folder.name, X, y, inputs, outputs, clock, table[EPISODE].astype(int), None, float(f"{1.0 / fps:.9g}")
    )
    told, found = info.get("total_frames"), len(clock)
    if told is None or told == found:
        return record
    note = f"meta/info.json tells of {told} frames, the files hold {found}: the folder is not whole."
    return Record(record.parts, inputs, outputs, record.step, (note,))


def _info(folder: Path) -> dict[str, Any]:
    """What meta/info.json says."""
    try:
        info = json.loads((folder / INFO).read_text(encoding="utf-8"))
        if float(info["fps"]) > 0 and isinstance(info["features"], dict):
            return info
        problem = f"fps={info['fps']!r}, features={type(info['features']).__name__}"
    except (OSError, ValueError, KeyError, TypeError) as error:
        problem = f"{type(error).__name__}: {error}"
    raise DataError(
        f"{folder.name}/{INFO.as_posix()} does not say what the data are ({problem}): expected LeRobot's keys 'fps' and 'features'."
    )


def _check_feature(argument: str, key: str, features: dict[str, Any]) -> None:
    """A feature of numbers."""
    numbers = [name for name, feature in features.items() if _is_numbers(name, feature)]
    if key not in features:
        raise DataError(
            f"{argument}={key!r} is no feature of the log;{did_you_mean(key, numbers)} Its features of numbers are {shown(numbers)}."
        )
    if key not in numbers:
        raise DataError(
            f"{argument}={key!r} holds {features[key].get('dtype')} of shape {features[key].get('shape')}, expected a vector of numbers: "
            f"one of {shown(numbers)}."
        )


def _is_numbers(name: str, feature: Any) -> bool:
    kind, shape = str(feature.get("dtype")), feature.get("shape") or [1]
    return (
        kind.startswith(("float", "int"))
        and len(shape) == 1
        and name not in (EPISODE, FRAME, TIME, "index", "task_index")
    )


def _frames(folder: Path, keys: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns of all Parquet files under data/."""
    parquet = require("pyarrow.parquet", "robots")
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise DataError(f"{folder.name}/data holds no Parquet file: was the folder copied or downloaded whole?")
    wanted = list(dict.fromkeys([*keys, EPISODE, FRAME, TIME]))
    parts: dict[str, list[np.ndarray]] = {key: [] for key in wanted}
    for file in files:
        place = file.relative_to(folder).as_posix()
        try:
            there = parquet.read_schema(file).names
            table = parquet.read_table(file, columns=[key for key in wanted if key in there])
        except (OSError, ValueError) as error:  # pyarrow's errors are of these kinds
            if file.read_bytes()[:40].startswith(b"version https://git-lfs"):
                problem = "is a pointer of Git LFS: type  git lfs pull  in the folder"
            else:
                problem = f"cannot be read as Parquet ({error}): copy or download it again"
            raise DataError(f"{folder.name}/{place} {problem}.") from error
        for key in wanted:
            if key not in there:
                raise DataError(f"{folder.name}/{place} has no column {key!r}; its columns are {shown(there)}.")
            parts[key].append(_numbers(table.column(key), f"{folder.name}/{place}, column {key!r}"))
    widths = {key: {part.shape[1:] for part in listed} for key, listed in parts.items()}
    uneven = next((key for key, found in widths.items() if len(found) > 1), None)
    if uneven:
        raise DataError(f"{folder.name}: {uneven!r} has not the same width in all files: {sorted(widths[uneven])}.")
    return {key: np.concatenate(listed) for key, listed in parts.items()}


def _numbers(column: Any, where: str) -> np.ndarray:
    """Numbers (n,), or lists of numbers (n, width), of a column of Arrow; a missing number is nan."""
    column = column.combine_chunks()
    if "list" not in str(column.type):
        return np.asarray(column.to_numpy(zero_copy_only=False), dtype=float)
    widths = set(require("pyarrow.compute", "robots").list_value_length(column).to_pylist())
    if len(widths) > 1 or None in widths:
        raise DataError(f"{where}: rows hold lists of {sorted(widths, key=str)} numbers, expected one length.")
    return np.asarray(column.flatten().to_numpy(zero_copy_only=False), dtype=float).reshape(len(column), -1)


def _stream(key: str, names: Any, values: np.ndarray) -> Stream:
    """Signals of a feature, by their names where there is one for each."""
    values = values.reshape(len(values), -1)
    listed = _listed(names)
    if len(listed) == values.shape[1] == len(set(listed)):
        return Stream(key, tuple(listed), np.empty(0), values)
    return Stream(key, tuple(f"{key}[{j}]" for j in range(values.shape[1])), np.empty(0), values, numbered=True)


def _listed(names: Any) -> list[str]:
    """Names of a feature: a list, a list in a list, a dict of lists, or a dict of name to place.

    >>> _listed(["a", "b"]), _listed({"motors": ["a", "b"]}), _listed({"b": 1, "a": 0}), _listed(None)
    (['a', 'b'], ['a', 'b'], ['a', 'b'], [])
    """
    if isinstance(names, dict):
        if all(isinstance(place, int) for place in names.values()):
            return sorted(names, key=names.__getitem__)
        return [name for part in names.values() for name in _listed(part)]
    if isinstance(names, (list, tuple)):
        return [name for part in names for name in (_listed(part) if isinstance(part, (list, tuple)) else [str(part)])]
    return []
