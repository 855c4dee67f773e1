"""The likely place of what has no name: where the evidence of a law puts it, else where a free signal is likeliest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._closeness import NEAR
from sksurrogate.gap.fit._evidence import CERTAIN, OUT_OF_REACH, Evidence
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE
from sksurrogate.gap.unnamed._channel import Place, fit_signal
from sksurrogate.gap.unnamed._channels import Channels
from sksurrogate.gap.unnamed._latent_force import LatentForce, features, forest, latent_force, paths
from sksurrogate.gap.unnamed._law_evidence import LawBeside
from sksurrogate.gap.unnamed._law_places import input_push
from sksurrogate.gap.unnamed._law_shapes import AND_ITS_PAST
from sksurrogate.kernels.disturbance import Disturbance
from sksurrogate.kernels.output_error import linearise

#: Places that are compared by the law that fits there.
COMPARED = 3
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


def places(null: OdeCandidate, rough: bool = False) -> list[Place]:
    """Likelihood of the null with a free latent signal in one place at a time: every balance, input and sensor.

    Its size is fitted from two correlation times, the white noise with it; ``rough``, where no place is the likely one, from
    one and with the white noise of differences.
    """
    problem, theta, model = null.problem, null.fit.theta, null.model
    record, units = problem.record, problem.force_unit()
    found: list[Place] = []
    with np.errstate(all="ignore"):
        x = next(paths(null, problem))
        lin = linearise(model, theta, x, problem.units((), theta))
        whole = problem.disturbance_along(model, theta, x, lin.A, problem.balances)
        r, forces, C = record.residual(lin.y), whole.B.transpose(1, 2, 0), whole.C.transpose(1, 2, 0)

        def likelihood(push: np.ndarray, unit: float, sensor: int | None = None) -> float:
            D = Disturbance(lin.A, push, C, record.starts, whole.start_sd, whole.slack, record.known)
            return fit_signal(D, r, problem.sd, record.spread, unit, sensor, rough=rough)[1]

        for b, name in enumerate(problem.balances):
            found.append(Place(name, "state", likelihood(forces[:, b : b + 1], units[b])))
        for i, name in enumerate(problem.plant.inputs):
            push = input_push(null, x, i)
            twin = _same_push(push, forces)
            if twin is not None:
                found.append(Place(name, "input", found[twin].log_likelihood))
            elif np.any(push):
                found.append(Place(name, "input", likelihood(push, max(float(np.std(record.u[i])), 1e-12))))
        for j, name in enumerate(problem.plant.outputs):
            found.append(Place(name, "output", likelihood(forces[:, :1], units[0], j)))
    return sorted(found, key=lambda place: -place.log_likelihood)


def _same_push(push: np.ndarray, forces: np.ndarray) -> int | None:
    """The balance whose force moves the states as an input does (n_states, 1, n_samples), up to one factor; else None."""
    for b in range(forces.shape[1]):
        force = forces[:, b]
        size = float(np.sum(force**2))
        left = push[:, 0] - force * (float(np.sum(push[:, 0] * force)) / max(size, 1e-300))
        if np.sum(left**2) < 1e-4 * np.sum(push**2):
            return b
    return None


def places_by_law(channels: Channels, found: Sequence[Place]) -> list[Place]:
    """The most likely places again, each with the law of states and inputs that fits there and a force for the rest.

    A free force follows the gap from many places; a law of states and inputs follows it from the right one.
    """
    if not found:
        return []
    distinct: list[Place] = []
    for place in found:
        if not any(abs(place.log_likelihood - other.log_likelihood) < 1e-9 for other in distinct):
            distinct.append(place)
    again = {}
    for place in distinct[:COMPARED]:
        drafts = channels.drafts(place.location, place.kind)
        if drafts and np.isfinite(drafts[0].level):
            again[place.log_likelihood] = drafts[0].level
    if len(again) < 2:
        return list(found)
    # The others stay as far below as they were.
    drop = max(again) - max(again.values())
    lowest = min(again.values())
    out = [
        replace(p, log_likelihood=again[p.log_likelihood])
        if p.log_likelihood in again
        else replace(p, log_likelihood=min(p.log_likelihood - drop, lowest))
        for p in found
    ]
    return sorted(out, key=lambda place: -place.log_likelihood)


def gap_and_places(null: Evidence, channels: Channels, closed: bool) -> tuple[LatentForce, list[Place]]:
    """The force on top of the simulator, and the places it may come from; a rough look where names have ``closed`` the gap."""
    found = places(null.candidate, rough=closed)
    if not closed and null.left > NEAR:
        found = places_by_law(channels, found)
    return latent_force(null, quiet_sensors=True), found
