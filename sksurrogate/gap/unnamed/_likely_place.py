"""The likely place of what has no name: where the evidence of a law puts it, else where a free signal is likeliest."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sksurrogate.gap.fit._ode import OdeBackend
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE
from sksurrogate.gap.unnamed._curve_shapes import CERTAIN, OUT_OF_REACH
from sksurrogate.gap.unnamed._latent_force import LatentForce, Place, features, forest
from sksurrogate.gap.unnamed._law_evidence import LawBeside
from sksurrogate.gap.unnamed._law_shapes import AND_ITS_PAST

#: R2 from which a force counts as predicted, by how much states must tell it better than the likely input to clear that, and
#: by how much they may where the two places push alike.
PREDICTED, CLEARLY, AS_WELL = 0.3, 0.1, 0.02
#: R2 from which an input that does not push like the likely balance tells the force better than all signals.
TOLD_BY_ITSELF = 0.5


def likely_place(found: Sequence[Place], predictability: Callable[[str, str], tuple[float, float]]) -> tuple[str, str]:
    """Location and kind of the place with most evidence; of a balance and an input that pushes it, the one that tells the force.

    Parameters
    ----------
    found : sequence of Place
        Likeliest first.
    given : callable (balance, input) -> (float, float)
        R2 of the force in a balance from the input alone, and from all states and inputs.
    """
    best = found[0]
    state = next((place for place in found if place.kind == "state"), best)
    if state.log_likelihood > best.log_likelihood - NATS_THAT_SETTLE:
        best = state
    if best.kind == "input" and state.log_likelihood > best.log_likelihood - OUT_OF_REACH:
        alone, everything = predictability(state.location, best.location)
        if everything > PREDICTED and alone < everything - CLEARLY:
            best = state
    elif best.kind == "state":
        inputs = [(*predictability(best.location, place.location), place) for place in found if place.kind == "input"]
        telling = [
            (alone, place.location)
            for alone, everything, place in inputs
            if alone
            > (max(PREDICTED, everything - AS_WELL) if push_alike(place, best) else max(TOLD_BY_ITSELF, everything))
        ]
        if telling:
            return max(telling)[1], "input"
    return best.location, best.kind


def place_of_law(law: LawBeside | None, found: Sequence[Place], inputs: Sequence[str]) -> tuple[str, str] | None:
    """Location and kind of a law that is certain; of one of an input in the balance that it pushes, the input."""
    if law is None or law.gain < CERTAIN:
        return None
    signal = law.variable.removesuffix(AND_ITS_PAST)
    if law.kind == "state" and signal in inputs:
        here = next((place for place in found if (place.location, place.kind) == (law.location, "state")), None)
        there = next((place for place in found if (place.location, place.kind) == (signal, "input")), None)
        if here is not None and there is not None and push_alike(here, there):
            return signal, "input"
    return law.location, law.kind


def push_alike(one: Place, other: Place) -> bool:
    """Whether an input and a balance are the same place to the data."""
    return abs(one.log_likelihood - other.log_likelihood) < 1e-9


def force_predictability(
    problem: OdeBackend, latent: LatentForce, balance: str, name: str, random_state: int
) -> tuple[float, float]:
    """R2 of the force in a balance from one input, now and a few samples ago, and from all states and inputs."""
    b, i = problem.balances.index(balance), problem.plant.inputs.index(name)
    record, u = problem.record, problem.record.u[i]
    past = [u[record.back(k)] for k in (1, 3)]
    own = np.stack([u, *(u - v for v in past), np.sign(u - past[0])], axis=1)
    force, size = latent.force[[b]], latent.size[[b]]
    everything, _ = features(problem, latent.x)
    alone, all_told = (float(forest(record, force, size, Z, random_state)[0]) for Z in (own, everything))
    return alone, all_told
