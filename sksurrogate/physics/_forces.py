"""Forces at the ports that a simulator offers beside its inputs: how its functions take them, and whether they do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._foreign import REFUSALS
from sksurrogate.physics._simulator import Plant, offered_ports

#: Forces of 0 change what a function gives by no more than this share: a contact solver begins where it ended.
UNMOVED = 1e-6


class _WithForces:
    """A function of a simulator with further ports, which takes what enters there as rows behind the inputs.

    ``function`` callable (t, x, u, p, ..., forces).
    ``places``: of the ports behind the inputs, among those that the simulator offers.
    """

    def __init__(self, function: Callable[..., Any], n_inputs: int, places: Sequence[int], n_offered: int):
        self.function, self.n_inputs, self.places, self.n_offered = function, n_inputs, list(places), n_offered

    def __call__(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], *extra: Any) -> Any:
        if len(u) == self.n_inputs:
            return self.function(t, x, u, p, *extra)
        forces = np.zeros((self.n_offered, *np.shape(u)[1:]), dtype=u.dtype)
        forces[self.places] = u[self.n_inputs :]
        return self.function(t, x, u[: self.n_inputs], p, *extra, forces)


def wired(plant: Plant) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """What lets a function of the simulator take forces at further ports; nothing where there are none."""
    further = plant.further_ports
    if not further:
        return lambda function: function
    offered = offered_ports(plant.simulator)
    places = [offered.index(name) for name in further]
    return lambda function: _WithForces(function, len(plant.inputs), places, len(offered))


def check_forces(plant: Plant, u: np.ndarray) -> None:
    """Ask the functions of a simulator with further ports for forces at these, at its initial state and inputs ``u`` (n_inputs,).

    Raises SimulatorError where one does not take forces as its last argument, or gives something else for forces of 0
        than without them.
    """
    offered = offered_ports(plant.simulator)
    for what in (plant.access, "output") if plant.further_ports else ():
        function = getattr(plant.simulator, what, None)
        if not callable(function):
            continue
        dt = (plant.dt,) if what == "step" else ()
        wanted = (
            f"the simulator offers ports={list(offered)}: give it {what}(t, x, u, p{', dt' if dt else ''}, forces=None), with forces "
            "(n_ports, ...)"
        )
        ask = partial(_answer, function, plant, u, *dt)
        try:
            without, unmoved, _ = ask(), ask(np.zeros(len(offered))), ask(np.ones(len(offered)))
        except Exception as error:
            raise SimulatorError(
                f"{what} fails with forces at its ports ({type(error).__name__}: {error}); {wanted}, or leave ports out."
            ) from error
        if without is None or unmoved is None:
            continue
        if without.shape != unmoved.shape or not np.allclose(
            without, unmoved, rtol=UNMOVED, atol=1e-12, equal_nan=True
        ):
            raise SimulatorError(
                f"{what} gives {unmoved.tolist()} for forces of 0 at its ports, and {without.tolist()} without forces: both must be "
                f"the same; {wanted}."
            )


def _answer(function: Callable[..., Any], plant: Plant, u: np.ndarray, *further: Any) -> np.ndarray | None:
    """At the initial state; None where the function refuses this point."""
    try:
        with np.errstate(all="ignore"):
            found = function(0.0, plant.x0.copy(), u.copy(), dict(plant.params), *further)
        return np.array([np.asarray(value, dtype=float).reshape(()) for value in np.atleast_1d(found)])
    except REFUSALS:
        return None
