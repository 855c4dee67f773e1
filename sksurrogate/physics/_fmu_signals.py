"""What of a unit's description the equations need: places of signals, states, events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


class Unfit(Exception):
    """The unit gives no equations, or no steps, in this way; the sentence says why."""


@dataclass(frozen=True, eq=False)
class Signals:
    """Signals of a unit by value reference."""

    version: int  #: {2, 3}: of FMI
    states: tuple[str, ...]  #: Names of the continuous states in the order that the user gave, else that of the unit
    order: np.ndarray  #: int (n_states,): place of each of them in the unit
    #: inputs, outputs, params: value references
    inputs: np.ndarray
    outputs: np.ndarray
    params: np.ndarray
    state_references: np.ndarray  #: ndarray of uint32 (n_states,): in the order of ``states``
    start_inputs: np.ndarray  #: (n_inputs,): start values of the inputs
    n_indicators: int  #: Event indicators
    events: bool  #: Whether the unit has events of its own, or inputs that may only change at one
    completes_steps: bool  #: Whether the unit wants to hear of every step that is accepted


def read_signals(
    description: Any, kind: str, inputs: Sequence[str], outputs: Sequence[str], params: Sequence[str],
    initial: Sequence[str] | None,
) -> Signals:  # fmt: skip
    """Signals of a unit.

    ``kind`` {"ModelExchange", "CoSimulation"}.
    ``inputs, outputs, params``: known variables.
    ``initial``: variables that ``x0`` sets.
    Raises Unfit where a signal is not a real scalar, the unit names no states, or ``initial`` does not name them.
    """
    if not str(description.fmiVersion).startswith(("2", "3")):
        raise Unfit(f"FMI {description.fmiVersion} shows no equations here")
    known = {variable.name: variable for variable in description.modelVariables}
    found = [unknown.variable.derivative for unknown in description.derivatives]
    names = [variable.name for variable in found if variable is not None]
    if not names or len(names) != len(found):
        if kind == "ModelExchange" or not initial:
            raise Unfit("its model description names no continuous states" + ("" if kind == "ModelExchange" else "; name in initial=[...] the variables that are its states"))  # fmt: skip
        names = list(initial)
    wanted = list(names if initial is None else initial)
    if sorted(wanted) != sorted(names):
        raise Unfit(f"initial={wanted} are not its continuous states {names}; leave initial out to start at these")
    for name in (*inputs, *outputs, *params, *wanted):
        variable = known[name]
        if variable.type not in ("Real", "Float64") or variable.shape not in (None, ()):
            raise Unfit(
                f"variable {name!r} is {variable.type} of shape {tuple(variable.shape or ())}, not a real scalar"
            )

    def references(of: Sequence[str]) -> np.ndarray:
        return np.array([known[name].valueReference for name in of], dtype=np.uint32)

    exchange = kind == "ModelExchange"
    return Signals(
        version=2 if str(description.fmiVersion).startswith("2") else 3,
        states=tuple(wanted),
        order=np.array([names.index(name) for name in wanted], dtype=int),
        inputs=references(inputs),
        outputs=references(outputs),
        params=references(params),
        state_references=references(wanted),
        start_inputs=np.array([_number(known[name].start) for name in inputs], dtype=float),
        n_indicators=int(description.numberOfEventIndicators or 0),
        events=bool(description.numberOfEventIndicators) or any(known[n].variability != "continuous" for n in inputs),
        completes_steps=exchange and bool(description.modelExchange.needsCompletedIntegratorStep),
    )


def _number(start: Any) -> float:
    """A start value, 0 where there is none."""
    try:
        return float(start)
    except (TypeError, ValueError):
        return 0.0
