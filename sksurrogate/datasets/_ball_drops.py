"""Balls dropped from a bridge: a recording whose authors publish a spreadsheet."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from sklearn.utils import Bunch

from sksurrogate._files import write_bytes, write_text
from sksurrogate.datasets._recordings import home, retrieved
from sksurrogate.exceptions import DataError

_BALLS_SHA256 = "33a67ebecee6af978ed76bc7d5e6d3baa9f440370771a420cc7f68ba49b0ce6d"
_BALLS_COLUMNS = ["ball", "drop", "time_s", "height_m", "velocity_m_s"]
_BALLS_TEXT = """Balls dropped from a bridge (real).

Eleven balls, each dropped twice from about 48 m; heights from video, about 15 Hz. Drop 1 trains, drop 2 tests. The first
samples of a drop are unreliable (release by hand).

B. de Silva, D. Higdon, S. Brunton, J. N. Kutz, Discovery of physics from data: universal laws and discrepancies,
Frontiers in Artificial Intelligence 2020.
"""


def fetch_ball_drops(data_home: Any = None, *, download_if_missing: bool = True, url: str | None = None) -> Bunch:
    """Balls dropped from a bridge: height against time, eleven balls, two drops each.

    Parameters
    ----------
    data_home : path, optional
        Folder with ``ball_drops/ball_drops.csv``; default scikit-learn's data home, in ``sksurrogate``.
    download_if_missing : bool, default=True
        Whether to fetch ``url`` where the file is not there (extra ``data``).
    url : str, optional
        Address of the CSV: ball, drop, time_s, height_m, velocity_m_s. The authors publish a spreadsheet
        (github.com/briandesilva/discovery-of-physics-from-data, data/Ball_drops_data.xls); there is no CSV to be fetched
        by default.

    Returns
    -------
    Bunch
        ``ball`` (n_rows,) of str, ``drop`` of int, ``time`` in s, ``height`` in m, ``velocity`` in m/s; ``Ts`` = 1/15 s;
        ``names`` of the balls; ``DESCR``.

    Raises
    ------
    DataError
        As in :func:`fetch_cascaded_tanks`.

    Examples
    --------
    >>> from sksurrogate.datasets import fetch_ball_drops
    >>> data = fetch_ball_drops()   # doctest: +SKIP
    >>> data.height.shape   # doctest: +SKIP
    (n_rows,)
    """
    path = home(data_home) / "ball_drops" / "ball_drops.csv"
    note = path.with_suffix(".ours")
    if not path.exists() and download_if_missing and url is not None:
        with retrieved(url, path.parent, "ball_drops.download") as file:
            content = file.read_bytes()
        _drops(content, url)
        write_text(note, f"sha256 {hashlib.sha256(content).hexdigest()} from {url}\n")
        write_bytes(path, content)
    if not path.exists():
        raise DataError(
            f"{path} is not there: save the authors' spreadsheet there as CSV with the columns {_BALLS_COLUMNS}, or give url= "
            "of such a file."
        )
    content = path.read_bytes()
    noted = note.read_bytes().decode(errors="replace").split()[1:2] if note.exists() else []
    if hashlib.sha256(content).hexdigest() not in [_BALLS_SHA256, *noted]:
        raise DataError(
            f"{path} is damaged (its checksum is not the known one): delete it and put the right file there."
        )
    ball, drop, (time, height, velocity) = _drops(content, str(path))
    return Bunch(
        ball=ball, drop=drop, time=time, height=height, velocity=velocity, Ts=1 / 15,
        names=list(dict.fromkeys(ball.tolist())), DESCR=_BALLS_TEXT,
    )  # fmt: skip


def _drops(content: bytes, where: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Balls, numbers of the drop, and time, height, velocity (3, n_rows) of a CSV."""
    try:
        lines = [line.split(",") for line in content.decode("utf-8-sig").splitlines() if line.strip()]
        if len(lines) > 1 and lines[0] == _BALLS_COLUMNS and all(len(line) == 5 for line in lines):
            numbers = np.array([line[2:] for line in lines[1:]], dtype=float).T
            if np.all(np.isfinite(numbers)):
                return (
                    np.array([line[0] for line in lines[1:]]), np.array([int(line[1]) for line in lines[1:]]), numbers,
                )  # fmt: skip
        said = f"expected finite numbers in lines of {len(_BALLS_COLUMNS)} cells"
    except ValueError as error:  # not UTF-8, or not numbers
        said = str(error)
    raise DataError(f"{where} has not the columns {_BALLS_COLUMNS} of numbers ({said}): give url= of the right file.")
