"""Real recordings, fetched on demand: from a local folder where they are there, else from the official archive."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

import numpy as np
from scipy.io import loadmat
from sklearn.datasets import get_data_home
from sklearn.utils import Bunch

from sksurrogate._files import beside
from sksurrogate.exceptions import DataError, require

#: An archive larger than this is refused unread.
LARGEST_ARCHIVE = 64 * 2**20


@dataclass(frozen=True)
class _Source:
    """Where a recording comes from and what it is known by."""

    url: str
    file: str  #: SHA-256 of the known file
    numbers: str  #: That of its signals (:func:`_numbers`), which another copy in another container shares
    signals: tuple[str, ...]
    constants: dict[str, float]  #: Sample time or frequency: known, so that no file needs to be believed


_TANKS = _Source(
    "https://data.4tu.nl/file/d4810b78-6cdd-48fe-8950-9bd601e5f47f/3b697e42-01a4-4979-a370-813a456c36f5",
    "3b3c9dc94a63cb7de087a848f70927c58a468ce2bf4e5ca81b669d9edaab6703",
    "89f7d1c4af80cca55de63c1deba2586af91b1059cc5b419920eecc8a658e78ed",
    ("uEst", "yEst", "uVal", "yVal"),
    {"Ts": 4.0},
)
_SILVERBOX = _Source(
    "https://drive.google.com/uc?export=download&id=17iS-6oBUUgrmiAcrZoG9S5sOaljZnDSy",
    "695451dda52ded9054dcf3ce00f5f66e2725bc6d7a9e531aa45b1610f5aadc1d",
    "94847e2ae4063731dd9ffbd1c581491d59ca3a5c485ba8fb32c61d7a05262470",
    ("V1", "V2"),
    {"fs": 1e7 / 2**14},
)
_EXCHANGER = _Source(
    "https://raw.githubusercontent.com/vitorpq/NNLearning/35c13fe266f6ab22003cbbb00c5429133e320543/data/exchanger.dat",
    "a1d69c4101774805c5c93258b9c06fd840db83ac9fe96a0af0193dd85d7175b0",
    "f6a9c111c259aea613d34a6ea4d11d6dfc10be9f85bc2d12221ff2599352f549",
    ("q", "th"),
    {"Ts": 1.0},
)

_EXCHANGER_TEXT = """Liquid-saturated steam heat exchanger (real, DaISy).

Water is heated by saturated steam through a copper tube. ``q`` liquid flow, ``th`` outlet temperature in degrees Celsius,
4000 samples each, sample time 1 s; steam and inlet temperatures are not recorded. Train: the first 3000 samples, test: the
last 1000.

S. Bittanti, L. Piroddi, Nonlinear identification and control of a heat exchanger: a neural network approach, Journal of
the Franklin Institute 1997; DaISy, Database for the Identification of Systems, KU Leuven.
"""
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
        Another address of the same archive.

    Returns
    -------
    Bunch
        ``uEst``, ``yEst``, ``uVal``, ``yVal`` in volts, (1024,) each; ``Ts`` = 4.0 s; ``DESCR``.

    Raises
    ------
    DataError
        The file is damaged, not there and not to be downloaded, or the download failed.

    Notes
    -----
    A file that is there is known by its SHA-256. What is downloaded is known by its numbers: a checksum of the signals to five
    digits must be the known one, whatever the archive around them.

    Examples
    --------
    >>> from sksurrogate.datasets import fetch_cascaded_tanks
    >>> data = fetch_cascaded_tanks()   # doctest: +SKIP
    >>> data.yEst.shape   # doctest: +SKIP
    (1024,)
    """
    arrays = _fetch("cascaded_tanks", "cascaded_tanks.npz", _TANKS, data_home, download_if_missing, url, _convert_tanks)
    return Bunch(
        **{k: arrays[k].ravel() for k in ("uEst", "yEst", "uVal", "yVal")},
        **_TANKS.constants,
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

    Examples
    --------
    >>> from sksurrogate.datasets import fetch_silverbox
    >>> data = fetch_silverbox()   # doctest: +SKIP
    >>> data.V2.shape   # doctest: +SKIP
    (131072,)
    """
    arrays = _fetch(
        "silverbox", "silverbox_SNLS80mV.npz", _SILVERBOX, data_home, download_if_missing, url, _convert_silverbox
    )
    middle = 40650 + int(0.75 * (127400 - 40650))
    return Bunch(
        V1=arrays["V1"].ravel(),
        V2=arrays["V2"].ravel(),
        **_SILVERBOX.constants,
        train=slice(40650, middle),
        test_multisine=slice(middle, 127400),
        test_arrow=slice(100, 40575),
        DESCR=_SILVERBOX_TEXT,
    )


def fetch_heat_exchanger(data_home: Any = None, *, download_if_missing: bool = True, url: str | None = None) -> Bunch:
    """Steam heat exchanger: outlet temperature against liquid flow, 4000 samples.

    Parameters
    ----------
    data_home, download_if_missing, url
        As in :func:`fetch_cascaded_tanks`; the file is ``heat_exchanger/heat_exchanger.npz``, the address that of a text
        with three columns (sample, flow, temperature).

    Returns
    -------
    Bunch
        ``q`` flow, ``th`` degrees Celsius, (4000,) each; ``Ts`` = 1.0 s; slices ``train``, ``test``; ``DESCR``.

    Raises
    ------
    DataError
        As in :func:`fetch_cascaded_tanks`.

    Examples
    --------
    >>> from sksurrogate.datasets import fetch_heat_exchanger
    >>> data = fetch_heat_exchanger()   # doctest: +SKIP
    >>> data.th.shape   # doctest: +SKIP
    (4000,)
    """
    path = home(data_home) / "heat_exchanger" / "heat_exchanger.npz"
    if path.exists() or not download_if_missing:
        arrays = _known(path, _EXCHANGER)
    else:
        with retrieved(url or _EXCHANGER.url, path.parent, "exchanger.dat") as text:
            arrays = _convert_exchanger(text)
        _keep(path, arrays, _EXCHANGER, url)
    return Bunch(
        q=arrays["q"].ravel(), th=arrays["th"].ravel(), **_EXCHANGER.constants,
        train=slice(0, 3000), test=slice(3000, 4000), DESCR=_EXCHANGER_TEXT,
    )  # fmt: skip


def _numbers(arrays: dict[str, np.ndarray], names: Sequence[str]) -> str:
    """Checksum of signals to five digits, in which every copy of a recording agrees."""
    digest = hashlib.sha256()
    for name in names:
        signal = np.asarray(arrays[name], dtype=float).ravel() + 0.0  # no minus zero
        digest.update("".join(np.char.mod("%.4e ", signal)).encode())
    return digest.hexdigest()


def home(data_home: Any) -> Path:
    """Folder of the recordings."""
    return Path(data_home) if data_home is not None else Path(get_data_home()) / "sksurrogate"


def _known(path: Path, source: _Source) -> dict[str, np.ndarray]:
    """Arrays of the known file, or of another with its numbers."""
    if not path.exists():
        raise DataError(f"{path} is not there: put it there, or leave download_if_missing=True.")
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {key: data[key] for key in data.files}
        same = hashlib.sha256(path.read_bytes()).hexdigest() == source.file
        if same or _numbers(arrays, source.signals) == source.numbers:
            return arrays
    except Exception:  # a damaged archive fails in a dozen ways
        pass
    raise DataError(f"{path} is damaged (its checksum is not the known one): delete it, and it is fetched again.")


def _keep(path: Path, arrays: dict[str, np.ndarray], source: _Source, url: str | None) -> None:
    """Store what was downloaded, if it is the recording."""
    found = _numbers(arrays, source.signals)
    if found != source.numbers:
        raise DataError(
            f"{url or source.url} holds other numbers than the known recording (their checksum is {found[:12]}..., expected "
            f"{source.numbers[:12]}...): nothing is kept. Give url= of the right archive, or put the known file at {path}."
        )
    constants = {name: np.array([value]) for name, value in source.constants.items()}
    with beside(path) as part:
        np.savez(part, **arrays, **constants)  # type: ignore[arg-type]


def _convert_exchanger(path: Path) -> dict[str, np.ndarray]:
    """From the text, whose columns are parted by blanks, commas or semicolons."""
    try:
        text = path.read_text(encoding="utf-8").replace(";", " ").replace(",", " ")
        table = np.loadtxt(io.StringIO(text))
    except ValueError as error:
        raise DataError(f"{path.name} is not a table of numbers ({error}): not the heat exchanger.") from error
    if table.shape != (4000, 3):
        raise DataError(f"{path.name} has shape {table.shape}, expected (4000, 3): not the heat exchanger.")
    return {"q": table[:, 1], "th": table[:, 2]}


def _fetch(
    name: str,
    file: str,
    source: _Source,
    data_home: Any,
    download: bool,
    url: str | None,
    convert: Callable[[zipfile.ZipFile], dict[str, np.ndarray]],
) -> dict[str, np.ndarray]:
    """The arrays: from the local file where its checksum is right, else converted from the archive and stored there."""
    path = home(data_home) / name / file
    if path.exists() or not download:
        return _known(path, source)
    with retrieved(url or source.url, path.parent, "archive.zip") as archive:
        if archive.stat().st_size > LARGEST_ARCHIVE or not zipfile.is_zipfile(archive):
            raise DataError(
                f"{url or source.url} did not give the archive (not a zip file, or broken off): try again later, or give url=."
            )
        with zipfile.ZipFile(archive) as content:
            if sum(entry.file_size for entry in content.infolist()) > 4 * LARGEST_ARCHIVE:
                raise DataError(
                    f"{url or source.url} unpacks to more than {4 * LARGEST_ARCHIVE >> 20} MiB: not the official archive."
                )
            try:
                arrays = convert(content)
            except DataError:
                raise
            except Exception as error:  # a damaged zip or MATLAB file, or another one, fails in a dozen ways
                raise DataError(
                    f"{url or source.url} is not the official archive ({type(error).__name__}: {error}): give url= of the right one."
                ) from error
    _keep(path, arrays, source, url)
    return arrays


@contextmanager
def retrieved(url: str, folder: Path, file: str) -> Iterator[Path]:
    """A file fetched with pooch, which keeps only whole downloads; it goes when the block ends, so that the next address is asked.

    A file of this computer (``file:``) is read where it is.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(
            f"data_home: the folder {folder} cannot be made ({error.strerror}): give data_home= of another one."
        ) from error
    if url.startswith("file:"):
        own = Path(url2pathname(urlsplit(url).path))
        if not own.is_file():
            raise DataError(f"url={url!r}: there is no file {own}.")
        yield own
        return
    pooch = require("pooch", "data")
    try:
        path = Path(pooch.retrieve(url, known_hash=None, path=folder, fname=file, progressbar=False))
    except Exception as error:
        raise DataError(
            f"could not download {url} ({type(error).__name__}: {error}). Are you offline? Fetch the archive by hand and give "
            f"url='file:///...', or put the converted file under data_home."
        ) from error
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def _member(archive: zipfile.ZipFile, ending: str) -> dict[str, Any]:
    """A MATLAB file in an archive, by the end of its name; nothing is unpacked to disk."""
    for entry in archive.namelist():
        if entry.lower().endswith(ending.lower()):
            return loadmat(io.BytesIO(archive.read(entry)))
    raise DataError(f"the archive holds no {ending}; it holds {archive.namelist()[:8]}.")


def _convert_tanks(archive: zipfile.ZipFile) -> dict[str, np.ndarray]:
    """From dataBenchmark.mat."""
    content = _member(archive, "dataBenchmark.mat")
    arrays = {key: np.asarray(content[key], dtype=float).ravel() for key in _TANKS.signals}
    if any(len(signal) != 1024 for signal in arrays.values()):
        raise DataError("the archive's records are not 1024 samples long: not the cascaded tanks.")
    return arrays


def _convert_silverbox(archive: zipfile.ZipFile) -> dict[str, np.ndarray]:
    """From SNLS80mV.mat."""
    content = _member(archive, "SNLS80mV.mat")
    arrays = {key: np.asarray(content[key], dtype=float).ravel() for key in ("V1", "V2")}
    if len(arrays["V1"]) < 127400:
        raise DataError("the archive's record is too short: not the Silverbox.")
    return arrays
