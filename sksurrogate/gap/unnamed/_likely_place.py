"""The likely place of what has no name: where the evidence of a law puts it, else where a free signal is likeliest."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._closeness import NEAR
from sksurrogate.gap.fit._evidence import CERTAIN, Evidence
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE
from sksurrogate.gap.unnamed._channel import Place, fit_signal
from sksurrogate.gap.unnamed._channels import Channels
from sksurrogate.gap.unnamed._law_left import LawLeft
from sksurrogate.gap.unnamed._law_places import push_at, size_at
from sksurrogate.gap.unnamed._smoothed_path import paths

#: Places that are compared by the law that fits there.
COMPARED = 3


def likely_place(found: Sequence[Place]) -> tuple[str, str]:
    """Location and kind of the place with most evidence; a balance before an input that explains the gap as well.

    ``found``: likeliest first.

    >>> likely_place([Place("valve", "input", -10.0), Place("level", "state", -10.0), Place("level", "output", -90.0)])
    ('level', 'state')
    """
    best = found[0].log_likelihood
    state = next(
        (place for place in found if place.kind == "state" and place.log_likelihood > best - NATS_THAT_SETTLE), found[0]
    )
    return state.location, state.kind


def place_of_law(law: LawLeft | None, found: Sequence[Place], inputs: Sequence[str]) -> tuple[str, str] | None:
    """Location and kind of a law that is certain; of one of an input in the balance that it pushes, the input."""
    if law is None or law.gain < CERTAIN:
        return None
    own = law.signal, "input"
    at_the_input = (
        (place.location, place.kind) == own for place in found if place.to_the_data == (law.location, law.kind)
    )
    if law.signal in inputs and any(at_the_input):
        return own
    return law.location, law.kind


def distinct(found: Iterable[Place]) -> list[Place]:
    """Places that the data distinguish: of an input and the balance that it alone pushes the first.

    >>> [place.location for place in distinct([Place("level", "state", -3.0), Place("valve", "input", -3.0, "level")])]
    ['level']
    """
    first: dict[tuple[str, str], Place] = {}
    for place in found:
        first.setdefault(place.to_the_data, place)
    return list(first.values())


def places(null: OdeCandidate, rough: bool = False) -> list[Place]:
    """Likelihood of the null with a free latent signal in one place at a time: every balance, input and sensor.

    Further ports, and parameters that move several balances (a law of one that moves a single one is a law of that balance), too.
    Its size is fitted from two correlation times, the white noise with it; ``rough``, where no place is the likely one, at
    balances, inputs and sensors alone, from one and with the white noise of differences.
    """
    problem = null.problem
    record, units = problem.record, problem.force_unit()
    found: list[Place] = []
    with np.errstate(all="ignore"):
        x = next(paths(null, problem))
        about = null.along(x)
        whole, r = about.disturbance, about.residual
        forces = whole.B.transpose(1, 2, 0)

        def likelihood(push: np.ndarray, unit: float, sensor: int | None = None, rough: bool = rough) -> float:
            return fit_signal(whole.with_forces(push), r, problem.sd, record.spread, unit, sensor, rough=rough)[1]

        for b, name in enumerate(problem.balances):
            found.append(Place(name, "state", likelihood(forces[:, b : b + 1], units[b])))
        for name in problem.plant.inputs if rough else problem.plant.ports:
            push = push_at(null, x, name, "input")
            twin = _same_push(push, forces)
            if twin is not None:
                found.append(Place(name, "input", found[twin].log_likelihood, problem.balances[twin]))
            elif np.any(push):
                found.append(Place(name, "input", likelihood(push, size_at(problem, name, "input"))))
        acting = {} if rough else pushes_of_parameters(null, x)
        sizes = {name: size_at(problem, name, "parameter") for name in acting}
        first = sorted(acting, key=lambda name: -likelihood(acting[name], sizes[name], rough=True))
        for name in first[:COMPARED]:
            found.append(Place(name, "parameter", likelihood(acting[name], sizes[name])))
        for j, name in enumerate(problem.plant.outputs):
            found.append(Place(name, "output", likelihood(forces[:, :1], units[0], j)))
    return sorted(found, key=lambda place: -place.log_likelihood)


def pushes_of_parameters(null: OdeCandidate, x: np.ndarray) -> dict[str, np.ndarray]:
    """What a unit of each parameter moves the states by over one sample along a path, of those that move several balances."""
    problem, found = null.problem, {}
    for name in problem.plant.params if problem.plant.access == "rhs" else ():
        push = push_at(null, x, name, "parameter")
        if np.isfinite(push).all() and np.sum(np.any(push[problem.rows_of_balances], axis=(1, 2))) > 1:
            found[name] = push
    return found


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
    again: dict[tuple[str, str], float] = {}
    for place in distinct(found)[:COMPARED]:
        drafts = channels.drafts(place.location, place.kind)
        if drafts and np.isfinite(drafts[0].level):
            again[place.to_the_data] = drafts[0].level
    if len(again) < 2:
        return list(found)
    # The others stay as far below as they were.
    before = max(place.log_likelihood for place in found if place.to_the_data in again)
    drop, lowest = before - max(again.values()), min(again.values())
    levels = (again.get(place.to_the_data, min(place.log_likelihood - drop, lowest)) for place in found)
    out = [replace(place, log_likelihood=level) for place, level in zip(found, levels)]
    return sorted(out, key=lambda place: -place.log_likelihood)


def places_of_gap(null: Evidence, channels: Channels, closed: bool) -> list[Place]:
    """The places that the gap may come from; a rough look where names have ``closed`` it."""
    found = places(null.candidate, rough=closed)
    return places_by_law(channels, found) if not closed and null.left > NEAR else found
