"""A simulator with effects as text: names and numbers, no code."""

from __future__ import annotations

import inspect
import json
import warnings
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate._files import write_text
from sksurrogate.effects._arguments import as_arguments, as_text, listed
from sksurrogate.effects._at_work import acting_in, paired, values_of
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import CATALOGUE, check_place
from sksurrogate.effects._law import InputLawEffect, LawEffect, MemoryLawEffect, ParameterLawEffect, SensorLawEffect
from sksurrogate.effects._onset import Starting, starting
from sksurrogate.effects._parts import Parameter
from sksurrogate.effects._simulator import AugmentedSimulator
from sksurrogate.effects._smooth import KINK_SHARPNESS
from sksurrogate.effects._trajectory import retuned_simulator
from sksurrogate.exceptions import DataError
from sksurrogate.physics._simulator import describe

#: A file of names and numbers is small; a larger one is refused unread.
LARGEST_FILE = 2**20


def save_augmented(augmented: AugmentedSimulator, path: Any, **notes: Any) -> None:
    """Write effects, their values and re-tuned parameters as JSON; the simulator itself is not stored.

    With a path that ends in ``.xml`` and a simulator that writes its own model (``MuJoCoSimulator``), the model is written with all
    effects that it can express. A warning, and a comment at its end, list the other effects.

    Parameters
    ----------
    augmented : AugmentedSimulator
        As ``augmented_`` of a diagnosis.
    path : path
    **notes : object
        Further entries for the reader, for example ``verdict="explained"``.

    Raises
    ------
    DataError
        An effect has a constructor argument that is not a number, text, list, tuple or dict of those, or a value that is not
        finite or beyond its bounds; a note cannot be written; the text is larger than :func:`load_augmented` reads.
    OSError
        The disk is full, or ``path`` is a folder or in none; a file that was there is as it was.

    See Also
    --------
    load_augmented : Reads such a file.

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
    if str(path).lower().endswith(".xml"):
        _write_model(augmented, path)
        return
    write_text(path, augmented_text(augmented, **notes))


def _write_model(augmented: AugmentedSimulator, path: Any) -> None:
    """The simulator's own model with the effects that are parameters of it."""
    simulator = augmented.simulator
    if not callable(getattr(simulator, "as_parameters", None)) or not callable(getattr(simulator, "to_mjcf", None)):
        raise DataError(
            f"path={str(path)!r}: {type(simulator).__name__} does not write its own model; give a path that ends in .json, "
            "or use MuJoCoSimulator for a model in MJCF."
        )
    tuned = retuned_simulator(simulator, augmented.retuned)
    values = [
        {p.name: float(v) for p, v in zip(e.parameters, values_of(e, given))}
        for e, given in paired(augmented.effects, augmented.values)
    ]
    patched, left = tuned.as_parameters(augmented.effects, values)
    patched.to_mjcf(path)
    if not left:
        return
    rest = "; ".join(
        f"{augmented.effects[k].name} at {augmented.effects[k].location} "
        f"({', '.join(f'{name} {value:.6g}' for name, value in values[k].items())})"
        for k in left
    )
    write_text(path, Path(path).read_text(encoding="utf-8").rstrip() + f"\n<!-- not in this model: {rest} -->\n")
    warnings.warn(
        f"{path} does not hold {rest}: use the simulator with its effects for these.", UserWarning, stacklevel=3
    )


def augmented_text(augmented: AugmentedSimulator, **notes: Any) -> str:
    """What :func:`save_augmented` writes."""
    scale, runs = augmented.scale, augmented.runs or [None] * len(augmented.effects)
    acting_in(augmented.effects, runs, None)  # refuses runs of other effects
    _check_fits(augmented)
    inputs = describe(augmented.simulator).inputs
    for note, value in notes.items():
        try:
            json.dumps(value)
        except (TypeError, ValueError) as error:
            raise DataError(
                f"{note}={value!r} cannot be written as JSON ({error}): give it as text or a number."
            ) from error
    text = {
        **notes,
        "effects": [
            {
                "name": effect.name,
                "class": type(effect).__name__,
                "location": effect.location,
                "variable": effect.variable,
                "arguments": as_text(effect),
                **({"window": list(effect.span)} if isinstance(effect, Starting) else {}),
                "params": _checked(effect, values_of(effect, values), inputs),
                **({} if labels is None else {"runs": [_label(one) for one in labels]}),
            }
            for (effect, values), labels in zip(paired(augmented.effects, augmented.values), runs)
        ],
        "params": {name: float(value) for name, value in (augmented.params or {}).items()},
        "scale": None if scale is None else [float(size) for size in np.ravel(scale)],
        "sharpness": float(augmented.sharpness),
    }
    written = json.dumps(text, indent=2) + "\n"
    if len(written) > LARGEST_FILE:  # ASCII: a byte a character
        raise DataError(
            f"the effects and notes make {len(written)} bytes, load_augmented reads at most {LARGEST_FILE}: give shorter arguments "
            "and notes, or keep the simulator with skops or joblib."
        )
    return written


def _check_fits(augmented: AugmentedSimulator) -> None:
    """What names something that the simulator does not have is not written: it could not be read again."""
    plant = describe(retuned_simulator(augmented.simulator, augmented.retuned))
    for effect, _ in paired(augmented.effects, augmented.values):
        if plant.inputs and plant.outputs:
            check_place(effect, plant)


def load_augmented(simulator: Any, path: Any, effects: Any = ()) -> AugmentedSimulator:
    """The simulator with the effects and parameters of a file. Nothing in the file is executed.

    Parameters
    ----------
    simulator : object with ``simulate``
        The nominal simulator, from your own code.
    path : path
        Written by :func:`save_augmented` or ``sksurrogate diagnose --save``.
    effects : sequence of BaseEffect classes or instances, optional
        Effects of your own that the file may name; an instance lends arguments that the file does not hold. The catalogue
        and the laws of ``report.missing_term.effects`` are known.

    Returns
    -------
    AugmentedSimulator

    Raises
    ------
    DataError
        The file is not such a file, names an effect that is not known or that does not take its arguments, or holds what
        is never written: a key twice, a value that is not a finite number or beyond its bounds.

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
    if file.stat().st_size > LARGEST_FILE:
        raise DataError(
            f"path={str(path)!r} has {file.stat().st_size} bytes, expected at most {LARGEST_FILE}: not such a file."
        )
    own = _own(effects)
    try:
        text = json.loads(file.read_text(encoding="utf-8"), object_pairs_hook=_once)
        built, values, runs, inputs = [], [], [], describe(simulator).inputs
        for entry in listed(text["effects"]):
            effect = _built(entry, own, file.name)
            built.append(effect)
            values.append(_numbers(effect, entry["params"], file.name, inputs))
            runs.append([_label(one) for one in listed(entry["runs"])] if "runs" in entry else None)
            _check_new(built, runs)
        retuned = {name: _finite(value, f"params: {name}") for name, value in text["params"].items()}
        scale = (
            None
            if text.get("scale") is None
            else np.array([_positive(size, "scale") for size in listed(text["scale"])])
        )
        sharpness = _positive(text.get("sharpness", KINK_SHARPNESS), "sharpness")
    except DataError:
        raise
    except (ValueError, OverflowError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DataError(
            f"{file.name}: not a file of save_augmented ({type(error).__name__}: {error}); write it again."
        ) from error
    some = runs if any(labels is not None for labels in runs) else None
    return AugmentedSimulator(simulator, built, values, retuned or None, some, scale=scale, sharpness=sharpness)


def _check_new(built: list[BaseEffect], runs: list[list[Any] | None]) -> None:
    """An effect acts in a run once."""
    effect, labels = built[-1], runs[-1]
    for other, others in zip(built[:-1], runs):
        shared = labels is None or others is None or set(labels) & set(others)
        if shared and other.key == effect.key and as_text(other) == as_text(effect):
            raise ValueError(f"effect {effect.name!r} at {effect.location!r} is listed twice")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object; the reader of Python keeps the last of two entries of one name in silence."""
    names = [name for name, _ in pairs]
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise ValueError(f"{twice[0]!r} is listed twice")
    return dict(pairs)


def _finite(value: Any, name: str) -> float:
    """A number of JSON; true is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(float(value)):
        raise ValueError(f"{name}={_short(value)}, expected a finite number")
    return float(value)


def _label(value: Any) -> str | int | float:
    """The label of a run as JSON has it."""
    label = value.item() if isinstance(value, np.generic) else value
    if isinstance(label, str) or (
        isinstance(label, int | float) and not isinstance(label, bool) and np.isfinite(label)
    ):
        return label
    raise DataError(f"runs: {_short(value)} is not the label of a run; expected a text or a finite number.")


def _positive(value: Any, name: str) -> float:
    """A number above 0."""
    size = _finite(value, name)
    if not size > 0:
        raise ValueError(f"{name}={size:g}, expected a number above 0")
    return size


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _numbers(effect: BaseEffect, given: Any, file: str, inputs: Collection[str]) -> dict[str, float]:
    """Values of an effect by name."""
    names = [parameter.name for parameter in effect.parameters]
    if sorted(given) != sorted(names):
        raise ValueError(f"effect {effect.name!r} has the params {sorted(given)}, expected {names}")
    for name in names:  # a limit that is never reached is infinite
        if isinstance(given[name], bool) or not isinstance(given[name], (int, float)):
            raise ValueError(f"effect {effect.name!r}: {name}={_short(given[name])}, expected a number")
    try:
        found = _checked(effect, [given[name] for name in names], inputs)
        if {"onset", "end"} <= set(found) and found["end"] <= found["onset"]:
            raise DataError(
                f"effect {effect.name!r} at {effect.location!r}: end={found['end']:g}, expected a time after its "
                f"onset={found['onset']:g}."
            )
        return found
    except DataError as error:
        raise DataError(f"{file}: {error}") from None


def _checked(effect: BaseEffect, values: Sequence[Any], inputs: Collection[str]) -> dict[str, float]:
    """Values by name: within the bounds of an effect in a plant with these inputs."""
    low = [parameter.low for parameter in effect.parameters]
    if effect.either_sign(inputs):
        low[0] = -np.inf
    return {p.name: _within(effect, p, least, v) for p, least, v in zip(effect.parameters, low, values)}


def _within(effect: BaseEffect, parameter: Parameter, low: float, value: Any) -> float:
    """A value that is finite, or the one at which the effect is absent, and within the bounds, rounding apart."""
    number = float(value)
    slack = 1e-9 * max(abs(bound) for bound in (low, parameter.high, 1e-3) if np.isfinite(bound))
    fits = low - slack <= number <= parameter.high + slack
    if not fits or not (np.isfinite(number) or number == parameter.null):
        raise DataError(
            f"effect {effect.name!r} at {effect.location!r}: {parameter.name}={number:g}, expected a finite number from "
            f"{low:g} to {parameter.high:g}."
        )
    return number


def _own(effects: Any) -> list[tuple[type[BaseEffect], dict[str, Any]]]:
    """Classes that the caller knows, each with the arguments that its instance lends; the last one given comes first."""
    if inspect.isclass(effects) or isinstance(effects, BaseEffect):
        effects = [effects]
    given = [] if effects is None else list(effects) if isinstance(effects, Iterable) else [effects]
    found: list[tuple[type[BaseEffect], dict[str, Any]]] = []
    for item in given:
        if isinstance(item, BaseEffect):
            found.insert(0, (type(item), item.get_params(deep=False)))
        elif inspect.isclass(item) and issubclass(item, BaseEffect):
            found.insert(0, (item, {}))
        else:
            raise DataError(
                f"effects: {item!r} is neither a subclass of BaseEffect nor an instance of one; write for example "
                "effects=[MyEffect]. Effects of the catalogue need not be given."
            )
    return found


def _built(entry: Any, own: list[tuple[type[BaseEffect], dict[str, Any]]], file: str) -> BaseEffect:
    """An effect of the file: of the class that wrote it, else one of the same name."""
    name, written = entry["name"], entry.get("class")
    for what in ("location", "variable"):
        if not isinstance(entry[what], (str, type(None))):
            raise ValueError(f"{what}={_short(entry[what])}, expected a name or null")
    alike = [(kind, lent) for kind, lent in own if kind.name == name]
    packaged = [CATALOGUE.get(name), LawEffect, MemoryLawEffect, InputLawEffect, ParameterLawEffect, SensorLawEffect]
    known = [(kind, lent) for kind, lent in own if kind.__name__ == written]
    known += [(kind, {}) for kind in packaged if kind is not None and kind.__name__ == written]
    known += alike
    if written is None:  # a file of before classes were written
        known += [(kind, {}) for kind in packaged[:1] if kind is not None]
    if not known:
        raise DataError(f"{file}: effect {name!r} is not in the catalogue; pass its class in effects=[...].")
    kind, lent = known[0]
    arguments = {
        **lent,
        **as_arguments(entry.get("arguments", {})),
        "location": entry["location"],
        "variable": entry["variable"],
    }
    taken = inspect.signature(kind).parameters
    foreign = [argument for argument in arguments if argument not in taken]
    if foreign:
        raise DataError(
            f"{file}: effect {name!r} was saved with {foreign[0]}={arguments[foreign[0]]!r}, which {kind.__name__} does not take "
            f"(it takes {list(taken)}); pass the class that was saved, {written!r}, in effects=[...]."
        )
    missing = [n for n, p in taken.items() if p.default is p.empty and n not in arguments]
    if missing:
        raise DataError(
            f"{file}: effect {name!r} was saved without {missing[0]}, which {kind.__name__} needs; pass an instance that has it "
            "in effects=[...]."
        )
    return starting(kind(**arguments), entry["window"]) if entry.get("window") else kind(**arguments)
