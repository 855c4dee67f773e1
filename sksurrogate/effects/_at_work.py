"""Which effects are at work: their values in order, those that are absent, those that act in a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.exceptions import SimulatorError


def acting_in(effects: Sequence[Any], runs: Sequence[Sequence[Any] | None] | None, label: Any) -> list[int]:
    """Numbers of the effects that act in a run.

    ``runs``: for each effect the labels of its runs, None for all.
    Raises SimulatorError: ``runs`` has another length, or lists the run under the same text in another type.

    >>> acting_in(["lag", "gain"], [["b"], None], "a")
    [1]
    """
    listed = runs is None or (isinstance(runs, Sequence) and not isinstance(runs, str))
    if not listed:
        raise SimulatorError(f"runs={runs!r}: expected a list, with the labels of the runs (or None) for each effect.")
    some = [None] * len(effects) if runs is None else list(runs)
    if len(some) != len(effects):
        raise SimulatorError(f"runs has {len(some)} entries, effects {len(effects)}: give one for each effect.")
    text = next((labels for labels in some if isinstance(labels, str)), None)
    if text is not None:  # its letters are no labels
        raise SimulatorError(f"runs holds {text!r}, expected a list of labels for each effect; write [{text!r}].")
    for labels in some:
        alike = [one for one in labels or () if str(one) == str(label) and one != label]
        if alike:
            raise SimulatorError(f"label={label!r}: the runs are listed with {alike[0]!r}; give it in that type.")
    return [k for k, labels in enumerate(some) if labels is None or label in labels]


def paired(effects: Sequence[Any], values: Sequence[Any]) -> list[tuple[BaseEffect, Any]]:
    """Effects with their values.

    Raises SimulatorError where an entry is no effect, or there are not as many values.

    >>> from sksurrogate.effects import CATALOGUE
    >>> [(effect.name, given) for effect, given in paired([CATALOGUE["input_lag"]("u")], [{"time_constant": 0.1}])]
    [('input_lag', {'time_constant': 0.1})]
    """
    strange = next((one for one in effects if not isinstance(one, BaseEffect)), None)
    if strange is not None:
        raise SimulatorError(
            f"effects holds {strange!r}, expected effects with their places: CATALOGUE['linear_loss']('x', 'x') for one."
        )
    if len(effects) != len(values):
        raise SimulatorError(
            f"effects has {len(effects)} entries, values {len(values)}: give one dict for each effect."
        )
    return list(zip(effects, values))


def values_of(effect: BaseEffect, given: Any) -> tuple[float, ...]:
    """Parameters of an effect in their order, from a dict or a sequence."""
    names = [parameter.name for parameter in effect.parameters]
    if isinstance(given, Mapping):
        if set(given) != set(names):
            raise SimulatorError(f"values of {effect!r}: got {sorted(given)}, expected {names}.")
        given = [given[name] for name in names]
    try:
        numbers = tuple(float(value) for value in np.ravel(given))
    except (TypeError, ValueError):
        raise SimulatorError(f"values of {effect!r}: got {given!r}, expected numbers.") from None
    if len(numbers) != len(names):
        raise SimulatorError(f"values of {effect!r}: got {len(numbers)} numbers, expected {names}.")
    return numbers


def is_null(effect: BaseEffect, theta: tuple[float, ...]) -> bool:
    """Whether the effect is absent at these values: its magnitude is null and all it does is in proportion to it."""
    if not effect.parameters:
        return False
    nulls = tuple(parameter.null for parameter in effect.parameters)
    return theta == nulls or (effect.linear and not effect.acts_at_null and theta[0] == nulls[0])
