"""Reading a MuJoCo model from a path, a text or a model in memory."""

from __future__ import annotations

import copy
import os
from functools import lru_cache
from pathlib import Path
from typing import Any

from sksurrogate.exceptions import SimulatorError, require

__all__ = ["editable", "identity", "is_text", "read_model"]


def is_text(model: Any) -> bool:
    """Whether a string holds XML, not a path."""
    return isinstance(model, str) and model.lstrip().startswith("<")


def identity(model: Any) -> tuple[Any, ...]:
    """What tells one source from another; a file that has changed is another one."""
    if is_text(model):
        return ("text", model)
    if isinstance(model, (str, os.PathLike)):
        path = Path(os.fspath(model)).absolute()
        if not path.is_file():
            raise SimulatorError(
                f"model={os.fspath(model)!r}: there is no such file; give the path of an MJCF or URDF file, XML text "
                "(it starts with '<'), or a mujoco.MjModel."
            )
        state = path.stat()
        return ("file", str(path), state.st_mtime_ns, state.st_size)
    return ("model", id(model))


def read_model(model: Any) -> Any:
    """The compiled model, not to be written: files and texts are compiled once a process.

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
