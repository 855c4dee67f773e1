"""Variables of a unit by name: what may be an input, what can be set."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from sksurrogate.exceptions import SimulatorError


def variables(description: Any, path: Any, given: Sequence[str] | None, causality: str) -> list[str]:
    """Names as given, each of them known and once, else by causality."""
    known = {variable.name: variable for variable in description.modelVariables}
    names = [v.name for v in description.modelVariables if v.causality == causality] if given is None else list(given)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise SimulatorError(f"the unit {path!s} has no variable {unknown[0]!r}; it has {sorted(known)[:30]}.")
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise SimulatorError(f"variable {twice[0]!r} of the unit {path!s} is listed twice; list each name once.")
    if causality == "output" and not names:
        raise SimulatorError(f"outputs={names}: name variables of the unit {path!s}: {sorted(known)[:30]}.")
    return names


def check_driven(
    description: Any, path: Any, inputs: list[str], params: Collection[str], initial: Collection[str]
) -> None:  # fmt: skip
    """A unit takes values over time of its inputs and tunable parameters; what is driven is set by nothing else."""
    known = {variable.name: variable for variable in description.modelVariables}
    for name in inputs:
        if known[name].causality != "input" and known[name].variability != "tunable":
            raise SimulatorError(
                f"inputs={inputs}: {name!r} of the unit {path!s} is no input ({known[name].causality}); its inputs are "
                f"{variables(description, path, None, 'input')}."
            )
        if name in params or name in initial:
            raise SimulatorError(
                f"inputs and {'params' if name in params else 'initial'} both name {name!r} of the unit {path!s}: leave it out of one "
                "of them."
            )


def check_settable(description: Any, path: Any, names: list[str]) -> None:
    """A unit ignores start values of what it calculates itself: that must not pass in silence."""
    for variable in description.modelVariables:
        if (
            variable.name in names
            and variable.causality in ("output", "local")
            and variable.initial not in ("exact", "approx")
        ):
            raise SimulatorError(
                f"variable {variable.name!r} cannot be set: the unit {path!s} calculates it. Name in initial=[...] a start parameter "
                'or a variable with initial="exact".'
            )
