"""An FMU on disk and in memory: unpacked once, opened once, put back to its start between runs."""

from __future__ import annotations

import atexit
import errno
import os
import re
import shutil
import tempfile
import zipfile
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate.exceptions import SimulatorError, require

#: Largest size of an unpacked unit, bytes.
_LARGEST_UNIT = 2_000_000_000
#: Most files in a unit.
_MOST_FILES = 20_000
#: (process, file, time of change, size, number) -> folder it was unpacked to; shared by all simulators of a process.
_UNPACKED: dict[tuple[int, str, int, int, int], str] = {}
#: Numbers of errors of the folder that a unit is unpacked to.
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.ENOENT)


def unpack(path: str) -> str:
    """Unpack once per process; members that would leave the folder or fill the disk are refused."""
    file = Path(path)
    if not file.is_file():
        raise SimulatorError(f"path={path!r} is not a file: give the path of an .fmu.")
    state = file.stat()
    key = (os.getpid(), str(file.resolve()), state.st_mtime_ns, state.st_size, state.st_ino)
    if (
        key in _UNPACKED and Path(_UNPACKED[key], "modelDescription.xml").exists()
    ):  # a computer may tidy its temporary folder meanwhile
        return _UNPACKED[key]
    try:
        folder = Path(tempfile.mkdtemp(prefix="sksurrogate-fmu-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            size = sum(member.file_size for member in members)
            if size > _LARGEST_UNIT or len(members) > _MOST_FILES:
                raise SimulatorError(
                    f"path={path!r} would unpack to {len(members)} files of {size} bytes, expected at most {_MOST_FILES} files "
                    f"of {_LARGEST_UNIT} bytes: this unit is not safe."
                )
            for member in members:
                if not (folder / member.filename).resolve().is_relative_to(folder.resolve()):
                    raise SimulatorError(
                        f"path={path!r} holds {member.filename!r}, which leaves its folder: this unit is not safe."
                    )
            archive.extractall(folder)
    except SimulatorError:
        raise
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise SimulatorError(f"path={path!r} is not a unit that can be unpacked ({error}).") from error
        raise SimulatorError(
            f"path={path!r} could not be unpacked into {tempfile.gettempdir()} ({error.strerror}): make room there, or set the "
            "environment variable TMPDIR to another folder."
        ) from error
    except Exception as error:  # a damaged or hostile archive fails in a dozen ways: zlib, names, encryption, offsets
        raise SimulatorError(
            f"path={path!r} is not a unit: an .fmu is a zip archive ({type(error).__name__}: {error})."
        ) from error
    _UNPACKED[key] = str(folder)
    return str(folder)


def describe(folder: str, path: Any) -> Any:
    """The model description of an unpacked unit."""
    fmpy = require("fmpy", "fmu")
    try:
        found = fmpy.read_model_description(folder)
    except Exception as error:  # missing, not XML, not of the schema, a version that FMPy does not know
        raise SimulatorError(
            f"path={os.fspath(path)!r}: its modelDescription.xml cannot be read ({type(error).__name__}: "
            f"{str(error)[:200]}): export the unit again, as FMI 2 or 3."
        ) from error
    for offer in (found.coSimulation, found.modelExchange):
        if offer is not None and re.search(r"[/\\]", str(offer.modelIdentifier)):
            raise SimulatorError(
                f"path={os.fspath(path)!r}: its binary is called {offer.modelIdentifier!r}, which leaves its folder: this unit is not "
                "safe."
            )
    return found


def equal_steps(times: np.ndarray) -> list[tuple[int, int]]:
    """First and last row of every stretch of equal steps; the last row of one is the first of the next.

    >>> equal_steps(np.array([0.0, 1.0, 2.0, 2.5, 3.0]))
    [(0, 2), (2, 4)]
    """
    widths = np.diff(times)
    rounding = 8 * np.finfo(float).eps * np.max(np.abs(times))
    turns = np.flatnonzero(np.abs(np.diff(widths)) > 1e-9 * np.abs(widths[1:]) + rounding) + 1
    edges = [0, *turns.tolist(), len(times) - 1]
    return list(zip(edges[:-1], edges[1:]))


class Messages:
    """The last words of a unit: they go into an error, not onto the screen."""

    def __init__(self) -> None:
        self._last: deque[str] = deque(maxlen=3)

    def keep(self, text: str) -> None:
        """Remember what the unit said."""
        if text not in self._last:
            self._last.append(text)

    def __str__(self) -> str:
        return f" The unit said: {' | '.join(self._last)}." if self._last else ""


def new_instance(folder: str, description: Any, kind: str, messages: Messages) -> Any:
    """An instance of an unpacked unit, whose log is kept."""

    def hear(*said: Any) -> None:
        messages.keep(said[-1].decode(errors="replace") if isinstance(said[-1], bytes) else str(said[-1]))

    simulation = require("fmpy", "fmu").simulation
    try:
        return simulation.instantiate_fmu(folder, description, fmi_type=kind, logger=hear)
    except Exception as error:  # no binary for this platform, one that cannot be loaded, a unit that refuses to begin
        raise SimulatorError(
            f"the unit {description.modelName!r} does not open ({type(error).__name__}: {error}).{messages} Export it again, for this "
            "platform."
        ) from error


class OpenUnit:
    """One instance of a unit and its way back to the start.

    The ways are tried in the order "state" (a copy of the state taken before the first run; only where the description
    offers it), "reset", "new" (another instance). Units exist whose copy or whose reset forgets a variable, so a way
    is used only after one run by it was equal, number by number, to the same run of a new instance; that is found out
    at the second run of a unit and kept for the process.
    """

    #: (folder, kind) -> ways not refuted yet, the first of them in use; and those found equal to a new instance.
    ways: dict[tuple[str, str], list[str]] = {}
    proven: set[tuple[str, str, str]] = set()

    def __init__(self, folder: str, description: Any, kind: str):
        self.folder, self.description, self.kind = folder, description, kind
        offer = description.coSimulation if kind == "CoSimulation" else description.modelExchange
        offered = ["state", "reset", "new"] if offer.canGetAndSetFMUstate else ["reset", "new"]
        self._left = self.ways.setdefault((folder, kind), offered)
        self.messages = Messages()
        self._open()

    @property
    def way(self) -> str:
        """How the next run gets its start: "state", "reset" or "new"."""
        return self._left[0]

    def _open(self) -> None:
        """A new instance, and the copy of its state where that is the way."""
        self.instance = new_instance(self.folder, self.description, self.kind, self.messages)
        self._state: Any = None
        self._used = False
        if self.way == "state":
            try:
                self._state = self.instance.getFMUState()
            except Exception:  # offered in words only, or not before the first step
                self._left.remove("state")

    def close(self) -> None:
        """Free the copy and the instance."""
        if self._state is not None:
            self.instance.freeFMUState(self._state)
            self._state = None
        self.instance.freeInstance()

    def run(self, once: Callable[[Any], np.ndarray]) -> np.ndarray:
        """Result of one run that begins at the unit's start."""
        if not self._used:
            self._used = True
            return once(self.instance)
        if (self.folder, self.kind, self.way) in self.proven:
            self._put_back()
            return once(self.instance)
        return self._prove(once)

    def _put_back(self) -> None:
        """To the start, by the way in use."""
        if self.way == "state" and self._state is not None:
            self.instance.setFMUState(self._state)
        else:  # an instance opened before the copy was refuted by another has none to go back to
            self.instance.reset()

    def _prove(self, once: Callable[[Any], np.ndarray]) -> np.ndarray:
        """A run by the way in use and again by a new instance; the way is kept if they are equal."""
        way = self.way
        found = None
        if way != "new":
            try:
                self._put_back()
                found = once(self.instance)
            except Exception:  # the same run of a new instance tells whether the way or the run is to blame
                found = None
        self.close()
        self._open()
        self._used = True
        expected = once(self.instance)
        if found is not None and np.array_equal(found, expected, equal_nan=True):
            self.proven.add((self.folder, self.kind, way))
        elif way != "new" and way in self._left:
            self._left.remove(way)
        return expected
