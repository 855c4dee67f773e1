"""Reading a MuJoCo model from a path, a text or a model in memory."""

from __future__ import annotations

import copy
import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

from sksurrogate.exceptions import SimulatorError, require

#: What a text names: included models, meshes, textures, and their folders.
_NAMED = re.compile(r"""\b(?:file|meshdir|texturedir|assetdir)\s*=\s*["']([^"']+)["']""")
#: Text or path, and working folder -> files that it was made of, and their stamps.
_SEEN: dict[tuple[str, str], tuple[list[Path], tuple[Any, ...]]] = {}


def is_text(model: Any) -> bool:
    """Whether a string holds XML, not a path."""
    return isinstance(model, str) and model.lstrip().startswith("<")


def identity(model: Any) -> tuple[Any, ...]:
    """What tells one source from another; where a file has changed, or one that it includes, it is another one."""
    if not isinstance(model, (str, os.PathLike)):
        return ("model", _Same(model))
    if is_text(model):  # no path is made of a text: every question asks for it
        source = ("text", str(model))
    else:
        path = Path(os.fspath(model)).absolute()
        if not path.is_file():
            raise SimulatorError(
                f"model={os.fspath(model)!r}: there is no such file; give the path of an MJCF or URDF file, XML text "
                "(it starts with '<'), or a mujoco.MjModel."
            )
        source = ("file", str(path))
    key = (source[1], os.getcwd())
    files, known = _SEEN.get(key, ([], None))
    stamps = tuple(map(_stamp, files))
    if stamps != known:
        files = files_of(model)
        stamps = tuple(map(_stamp, files))
        _SEEN[key] = (files, stamps)
    return (*source, stamps)


class _Same:
    """A model in memory as a key: equal to itself alone, which is kept, so that no other one gets its number."""

    def __init__(self, model: Any):
        self.model = model

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.model is self.model

    def __hash__(self) -> int:
        return id(self.model)


def _stamp(file: Path) -> tuple[Any, ...]:
    """What changes with a file."""
    try:
        state = file.stat()
    except OSError:
        return (str(file),)
    return (str(file), state.st_mtime_ns, state.st_size, state.st_ino)


def files_of(model: Any) -> list[Path]:
    """Files that a model is made of: its own, those that it includes, meshes and textures; none of a model in memory."""
    if not isinstance(model, (str, os.PathLike)):
        return []
    own = [] if is_text(model) else [Path(os.fspath(model)).absolute()]
    folders = [own[0].parent if own else Path.cwd()]
    names, found, texts = (list(_NAMED.findall(str(model))) if not own else []), list(own), list(own)
    while True:
        before = (len(folders), len(found))
        while texts:
            names += _names_in(texts.pop())
        # Resolved: "../parts" from every folder that it leads to would be a new one without end.
        for file in ((folder / name).resolve() for name in names for folder in list(folders)):
            if file.is_dir() and file not in folders:
                folders.append(file)
            elif file.is_file() and file not in found:
                found.append(file)
                texts.append(file)
        if before == (len(folders), len(found)):
            return found


def _names_in(file: Path) -> list[str]:
    """Names of other files in an XML; none in a mesh, a picture, or a compiled model."""
    if file.suffix.lower() not in (".xml", ".urdf", ".mjcf"):
        return []
    return _NAMED.findall(file.read_text(encoding="utf-8", errors="replace"))


def read_model(model: Any) -> Any:
    """The compiled model, not to be written: files and texts are compiled once per process.

    Parameters
    ----------
    model : path, str or ``mujoco.MjModel``

    Returns
    -------
    ``mujoco.MjModel``

    Raises
    ------
    MissingExtraError
        MuJoCo is not installed.
    SimulatorError
        There is no such file, MuJoCo cannot read it, or the model has no joint.
    """
    mujoco = require("mujoco", "mujoco")
    if isinstance(model, mujoco.MjModel):
        found = copy.copy(model)
    elif isinstance(model, (str, os.PathLike)):
        found = _compiled(identity(model))
    else:
        way = (
            "; give model.compile(), or model.to_xml(), which can be written back" if hasattr(model, "compile") else ""
        )
        raise SimulatorError(
            f"model={model!r}: expected the path of an MJCF or URDF file, XML text, or a mujoco.MjModel, not "
            f"{type(model).__name__}{way}."
        )
    if found.nv == 0:
        raise SimulatorError("model has no joint: nothing in it moves. Add a <joint> or a <freejoint> to a body.")
    return found


@lru_cache(maxsize=8)
def _compiled(source: tuple[Any, ...]) -> Any:
    """A text or a file, compiled."""
    load = require("mujoco", "mujoco").MjModel
    try:
        if source[0] == "text":
            return load.from_xml_string(source[1])
        return (load.from_binary_path if source[1].endswith(".mjb") else load.from_xml_path)(source[1])
    except ValueError as error:
        where = "the XML text" if source[0] == "text" else repr(source[1])
        raise SimulatorError(f"model: MuJoCo cannot read {where}: {' '.join(str(error).split())}") from error


def editable(model: Any) -> Any:
    """The model as ``mujoco.MjSpec``, which writes MJCF.

    Raises
    ------
    SimulatorError
        There is no XML behind it.
    """
    spec = require("mujoco", "mujoco").MjSpec
    if is_text(model):
        return spec.from_string(model)
    if isinstance(model, (str, os.PathLike)) and not os.fspath(model).endswith(".mjb"):
        return spec.from_file(str(Path(os.fspath(model)).absolute()))
    raise SimulatorError(
        "model is compiled (a mujoco.MjModel or a file .mjb): it no longer holds the XML that a patch needs. "
        "Make the simulator from the MJCF or URDF file, or from its text."
    )
