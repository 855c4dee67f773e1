"""A simulator with effects as text: names and numbers, no code."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.effects._effect import BaseEffect
from sksurrogate.effects._simulator import AugmentedSimulator
from sksurrogate.exceptions import DataError

__all__ = ["load_augmented", "save_augmented"]

#: A file of names and numbers is small; a larger one is refused unread.
LARGEST = 2**20


def save_augmented(augmented: AugmentedSimulator, path: Any, **notes: Any) -> None:
    """Write effects, their values and re-tuned parameters as JSON; the simulator itself is not stored.

    Parameters
    ----------
    augmented : AugmentedSimulator
        As ``augmented_`` of a diagnosis.
    path : path
    **notes : object
        Further entries for the reader, for example ``verdict="explained"``.

    See Also
    --------
    load_augmented : the way back.

    Examples
    --------
    >>> import os, tempfile
    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
    >>> slow = AugmentedSimulator(make_reactor(), [CATALOGUE["input_lag"]("u")], [{"time_constant": 0.05}])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_augmented(slow, os.path.join(folder, "better.json"))
    ...     load_augmented(make_reactor(), os.path.join(folder, "better.json")).values
    [{'time_constant': 0.05}]
    """
    scale = augmented.scale
    text = {
        **notes,
        "effects": [
            {
                "name": effect.name,
                "location": effect.location,
                "variable": effect.variable,
                "params": {p.name: float(v) for p, v in zip(effect.parameters, _values(effect, values))},
            }
            for effect, values in zip(augmented.effects, augmented.values)
        ],
        "params": {name: float(value) for name, value in (augmented.params or {}).items()},
        "scale": None if scale is None else [float(size) for size in np.ravel(scale)],
        "sharpness": float(augmented.sharpness),
    }
    Path(path).write_text(json.dumps(text, indent=2) + "\n", encoding="utf-8")


def _values(effect: BaseEffect, values: Any) -> list[float]:
    """Values in the order of the effect's parameters."""
    return [values[p.name] for p in effect.parameters] if hasattr(values, "keys") else list(values)


def load_augmented(simulator: Any, path: Any, effects: Any = ()) -> AugmentedSimulator:
    """The simulator with the effects and parameters of a file. Nothing in the file is executed.

    Parameters
    ----------
    simulator : object with ``simulate``
        The nominal simulator, from your own code.
    path : path
        Written by :func:`save_augmented` or ``sksurrogate diagnose --save``.
    effects : sequence of BaseEffect classes, optional
        Effects of your own that the file may name.

    Returns
    -------
    AugmentedSimulator

    Raises
    ------
    DataError
        The file is not such a file, or names an effect that is not known.

    Examples
    --------
    >>> import os, tempfile
    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
    >>> slow = AugmentedSimulator(make_reactor(), [CATALOGUE["input_lag"]("u")], [{"time_constant": 0.05}])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = os.path.join(folder, "slow.json")
    ...     save_augmented(slow, file)
    ...     again = load_augmented(make_reactor(), file)
    >>> U = [[0.15], [0.2], [0.2]]
    >>> bool((again.simulate(U) == slow.simulate(U)).all())
    True
    """
    file = Path(path)
    if not file.is_file():
        raise DataError(f"path={str(path)!r}: there is no such file; write it with save_augmented or diagnose --save.")
    if file.stat().st_size > LARGEST:
        raise DataError(
            f"path={str(path)!r} has {file.stat().st_size} bytes, expected at most {LARGEST}: not such a file."
        )
    known = {**CATALOGUE, **{own.name: own for own in effects}}
    try:
        text = json.loads(file.read_text(encoding="utf-8"))
        built, values = [], []
        for entry in text["effects"]:
            if entry["name"] not in known:
                raise DataError(
                    f"{file.name}: effect {entry['name']!r} is not in the catalogue; pass its class in effects=[...]."
                )
            kind = known[entry["name"]]
            built.append(kind(entry["location"], entry["variable"]))
            values.append({p.name: float(entry["params"][p.name]) for p in kind.parameters})
        retuned = {str(name): float(value) for name, value in text["params"].items()}
        scale = None if text.get("scale") is None else np.array(text["scale"], dtype=float)
        sharpness = float(text.get("sharpness", 500.0))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DataError(
            f"{file.name}: not a file of save_augmented ({type(error).__name__}: {error}); write it again."
        ) from error
    return AugmentedSimulator(simulator, built, values, retuned or None, scale=scale, sharpness=sharpness)
