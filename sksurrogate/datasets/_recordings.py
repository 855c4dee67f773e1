"""Real recordings, fetched on demand: from a local folder where they are there, else from the official archive."""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from sklearn.datasets import get_data_home
from sklearn.utils import Bunch

from sksurrogate.exceptions import DataError, require

__all__ = ["fetch_cascaded_tanks", "fetch_silverbox"]

#: An archive larger than this is refused unread.
LARGEST_ARCHIVE = 64 * 2**20

_TANKS = (
    "https://data.4tu.nl/file/d4810b78-6cdd-48fe-8950-9bd601e5f47f/3b697e42-01a4-4979-a370-813a456c36f5",
    "3b3c9dc94a63cb7de087a848f70927c58a468ce2bf4e5ca81b669d9edaab6703",
)
_SILVERBOX = (
    "https://drive.google.com/uc?export=download&id=17iS-6oBUUgrmiAcrZoG9S5sOaljZnDSy",
    "695451dda52ded9054dcf3ce00f5f66e2725bc6d7a9e531aa45b1610f5aadc1d",
)

_TANKS_TEXT = """Cascaded tanks with overflow (real laboratory data).

A pump lifts water into an upper tank that drains into a lower tank; only the lower level is measured (volts). For large
inputs both tanks overflow. ``uEst``, ``yEst`` train, ``uVal``, ``yVal`` test, 1024 samples each, sample time 4 s; the
unknown initial state is the same for both.

M. Schoukens, P. Mattsson, T. Wigren, J.-P. Noel, Cascaded tanks benchmark, 4TU.ResearchData, doi 10.4121/12960104.
"""
_SILVERBOX_TEXT = """Silverbox (real electronic circuit, a Duffing oscillator).

``V1`` input, ``V2`` output in volts, 131072 samples at 610.35 Hz. Test "arrow": samples 100..40575; multisine part
40650..127400, first three quarters train, the rest test.

T. Wigren, J. Schoukens, Three free data sets for development and benchmarking in nonlinear system identification,
European Control Conference 2013.
"""


def fetch_cascaded_tanks(data_home: Any = None, *, download_if_missing: bool = True, url: str | None = None) -> Bunch:
    """Cascaded tanks with overflow: 1024 training and 1024 test samples.

    Parameters
    ----------
    data_home : path, optional
        Folder with ``cascaded_tanks/cascaded_tanks.npz``; default scikit-learn's data home, in ``sksurrogate``.
    download_if_missing : bool, default=True
        Whether to fetch the official archive where the file is not there (extra ``data``).
    url : str, optional
        Another address of the archive.

    Returns
    -------
    Bunch
        ``uEst``, ``yEst``, ``uVal``, ``yVal`` in volts, (1024,) each; ``Ts`` = 4.0 s; ``DESCR``.

    Raises
    ------
    DataError
        The file is damaged, not there and not to be downloaded, or the download failed.
    """
    arrays = _fetch("cascaded_tanks", "cascaded_tanks.npz", _TANKS, data_home, download_if_missing, url, _convert_tanks)
    return Bunch(
        **{k: arrays[k].ravel() for k in ("uEst", "yEst", "uVal", "yVal")},
        Ts=float(arrays["Ts"].ravel()[0]),
        DESCR=_TANKS_TEXT,
    )


def fetch_silverbox(data_home: Any = None, *, download_if_missing: bool = True, url: str | None = None) -> Bunch:
    """Silverbox: an electronic oscillator with a hardening spring.

    Parameters
    ----------
    data_home, download_if_missing, url
        As in :func:`fetch_cascaded_tanks`; the file is ``silverbox/silverbox_SNLS80mV.npz``.

    Returns
    -------
    Bunch
        ``V1``, ``V2`` in volts, (131072,) each; ``fs`` in Hz; slices ``train``, ``test_multisine``, ``test_arrow``; ``DESCR``.

    Raises
    ------
    DataError
        As in :func:`fetch_cascaded_tanks`.
    """
    arrays = _fetch(
        "silverbox", "silverbox_SNLS80mV.npz", _SILVERBOX, data_home, download_if_missing, url, _convert_silverbox
    )
    middle = 40650 + int(0.75 * (127400 - 40650))
    return Bunch(
        V1=arrays["V1"].ravel(),
        V2=arrays["V2"].ravel(),
        fs=float(arrays["fs"].ravel()[0]),
        train=slice(40650, middle),
        test_multisine=slice(middle, 127400),
        test_arrow=slice(100, 40575),
        DESCR=_SILVERBOX_TEXT,
    )


def _fetch(
    name: str,
    file: str,
    source: tuple[str, str],
    data_home: Any,
    download: bool,
    url: str | None,
    convert: Callable[[zipfile.ZipFile], dict[str, np.ndarray]],
) -> dict[str, np.ndarray]:
    """The arrays: from the local file where its checksum is right, else converted from the archive and stored there."""
    home = Path(data_home) if data_home is not None else Path(get_data_home()) / "sksurrogate"
    path = home / name / file
    if path.exists():
        if hashlib.sha256(path.read_bytes()).hexdigest() != source[1] and not (path.with_suffix(".ours")).exists():
            raise DataError(
                f"{path} is damaged (its checksum is not the known one): delete it, and it is fetched again."
            )
        with np.load(path, allow_pickle=False) as data:
            return {key: data[key] for key in data.files}
    if not download:
        raise DataError(f"{path} is not there: put it there, or leave download_if_missing=True.")
    archive = _download(url or source[0], home / name)
    with zipfile.ZipFile(archive) as content:
        if sum(entry.file_size for entry in content.infolist()) > 4 * LARGEST_ARCHIVE:
            raise DataError(
                f"{archive} unpacks to more than {4 * LARGEST_ARCHIVE >> 20} MiB: not the official archive."
            )
        arrays = convert(content)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)  # type: ignore[arg-type]
    path.with_suffix(".ours").write_text(
        "converted from the official archive; numpy's file differs from the known one\n"
    )
    return arrays


def _download(url: str, folder: Path) -> Path:
    """Fetch an archive with pooch, which writes to a temporary file and keeps only whole downloads."""
    pooch = require("pooch", "data")
    folder.mkdir(parents=True, exist_ok=True)
    try:
        archive = Path(pooch.retrieve(url, known_hash=None, path=folder, fname="archive.zip", progressbar=False))
    except Exception as error:
        raise DataError(
            f"could not download {url} ({type(error).__name__}: {error}). Are you offline? Fetch the archive by hand and give "
            f"url='file:///...', or put the converted file under data_home."
        ) from error
    if archive.stat().st_size > LARGEST_ARCHIVE or not zipfile.is_zipfile(archive):
        os.remove(archive)
        raise DataError(
            f"{url} did not give the archive (not a zip file, or broken off): try again later, or give url=."
        )
    return archive


def _member(archive: zipfile.ZipFile, ending: str) -> dict[str, Any]:
    """A MATLAB file in an archive, by the end of its name; nothing is unpacked to disk."""
    for entry in archive.namelist():
        if entry.lower().endswith(ending.lower()):
            return loadmat(io.BytesIO(archive.read(entry)))
    raise DataError(f"the archive holds no {ending}; it holds {archive.namelist()[:8]}.")


def _convert_tanks(archive: zipfile.ZipFile) -> dict[str, np.ndarray]:
    """From dataBenchmark.mat."""
    content = _member(archive, "dataBenchmark.mat")
    arrays = {key: np.asarray(content[key], dtype=float).ravel() for key in ("uEst", "yEst", "uVal", "yVal", "Ts")}
    if any(len(arrays[key]) != 1024 for key in ("uEst", "yEst", "uVal", "yVal")):
        raise DataError("the archive's records are not 1024 samples long: not the cascaded tanks.")
    return {**arrays, "Ts": arrays["Ts"][:1]}


def _convert_silverbox(archive: zipfile.ZipFile) -> dict[str, np.ndarray]:
    """From SNLS80mV.mat."""
    content = _member(archive, "SNLS80mV.mat")
    arrays = {key: np.asarray(content[key], dtype=float).ravel() for key in ("V1", "V2")}
    if len(arrays["V1"]) < 127400:
        raise DataError("the archive's record is too short: not the Silverbox.")
    return {**arrays, "fs": np.array([1e7 / 2**14])}
