"""The experiment that would tell apart what these data cannot, and the sentence beside each name that says when they part."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from sksurrogate.effects._effect import BaseEffect
from sksurrogate.exceptions import SurrogateError
from sksurrogate.gap.decide._equivalence import Slot
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.gap.fit._trajectory import TrajectoryCandidate
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE, TIED_LISTED, NextExperiment
from sksurrogate.gap.results._table import Table
from sksurrogate.kernels.output_error import free_run
from sksurrogate.kernels.record import Record


def name_of(effect: BaseEffect) -> str:
    """Readable name of an effect."""
    window = f" with an {effect.key[3]}" if len(effect.key) > 3 else ""
    return f"{effect.name} at {effect.location}" + (f" in {effect.variable}" if effect.variable else "") + window


def leaves_the_range(u: np.ndarray, recorded: np.ndarray) -> bool:
    """Whether inputs (n_inputs, n_samples) go where no recorded input was.

    Examples
    --------
    >>> recorded = np.array([[0.0, 1.0, 0.5]])
    >>> leaves_the_range(0.5 * recorded, recorded), leaves_the_range(2.0 * recorded, recorded)
    (False, True)
    """
    low, high = recorded.min(axis=1, keepdims=True), recorded.max(axis=1, keepdims=True)
    room = 1e-9 * (high - low)
    return bool(np.any(u < low - room) or np.any(u > high + room))


def suggestion(apart: Mapping[str, np.ndarray], names: Sequence[str], beyond: Collection[str] = ()) -> NextExperiment:
    """The experiment that parts a named effect best from the tied candidate that is hardest to tell.

    Twins that none parts are left out where another can be determined. Of experiments that settle it those come first whose inputs
    stay where inputs were recorded.

    Parameters
    ----------
    apart : dict of ndarray (n_rivals,)
        For every experiment the nats that part the named effect from each candidate; nan where they are not known.
    names : sequence of str
        The named effect, then its candidates.
    beyond : collection of str
        Experiments whose inputs leave the recorded range.
    """
    most = np.nanmax(np.where(np.isfinite(list(apart.values())), list(apart.values()), -1.0), axis=0)
    settled = np.flatnonzero(most >= NATS_THAT_SETTLE) if np.any(most >= NATS_THAT_SETTLE) else np.arange(len(most))
    rows: list[dict[str, Any]] = []
    for experiment, values in apart.items():
        known = [int(k) for k in settled if np.isfinite(values[k])]
        hardest = min(known, key=lambda k: values[k], default=None)
        if hardest is not None:
            between = f"{names[0]} and {names[1 + hardest]}"
            within = experiment not in beyond
            rows.append(
                {"experiment": experiment, "gain": float(values[hardest]), "between": between, "within": within}
            )
    rows.sort(key=lambda row: (not (row["within"] and row["gain"] >= NATS_THAT_SETTLE), -row["gain"]))
    best = rows[0]
    if best["gain"] < NATS_THAT_SETTLE:
        sentence = (
            f"No variation of the inputs tried here separates {', '.join(names)}: they predict the same. "
            "Only another sensor or knowledge of the plant can decide."
        )
        return NextExperiment(sentence, Table(tuple(rows)), names[0])
    gain = f"{best['gain']:.0f}" if best["gain"] < 1000 else "more than 1000"
    sentence = (
        f"To tell {best['between']} apart, record {best['experiment']}: expected separation {gain} nats (3 are enough)."
    )
    if not best["within"]:
        sentence += " Its inputs leave the recorded range: make sure that the plant allows them."
    same = [names[1 + k] for k in range(len(most)) if k not in settled]
    if same:
        sentence += f" None of the simulated experiments separates {', '.join(same)} from {names[0]}."
    parted = tuple(names[1 + int(k)] for k in settled if apart[best["experiment"]][k] >= NATS_THAT_SETTLE)
    return NextExperiment(sentence, Table(tuple(rows)), names[0], parted)


def when_they_part(
    named: str,
    tied: Sequence[str],
    same: bool,
    experiment: NextExperiment | None,
    richer: Sequence[str] = (),
    among: str = "of the catalogue",
) -> str:
    """The sentence beside a name.

    Parameters
    ----------
    tied : sequence of str
        Candidates that these data cannot tell from it.
    same : bool
        Whether all of them predict the same.
    experiment : NextExperiment or None
        What was computed to part the effect that it is about.
    richer : sequence of str
        Forms that contain the named one and fit no better.
    among : str
        Which effects were compared.
    """
    if not tied and richer:
        return f"Only richer forms ({', '.join(richer)}) explain these data as well; nothing in the data needs them."
    if not tied:
        return f"No other effect {among} explains these data as well."
    listed = _first(tied)
    how = "predict the same" if same else "explain these data equally well"
    return f"{named} and {listed} {how} on the range that was reached; {_part(named, tied, experiment)}."


def _part(named: str, tied: Sequence[str], experiment: NextExperiment | None) -> str:
    """What parts them, of those that were asked for."""
    if experiment is None:
        return "no experiment that parts them was found"
    if experiment.named != named:
        return f"no experiment was computed for this pair (the suggested one concerns {experiment.named})"
    if not experiment.parted:
        return "they part in none of the experiments tried here"
    record = experiment.options[0]["experiment"]
    if set(tied) <= set(experiment.parted):
        return f"they part with {record}"
    return f"with {record} it parts from {_first(experiment.parted)}; nothing is known to part the rest"


def _first(names: Sequence[str]) -> str:
    """The first of some names."""
    return ", ".join(names[:TIED_LISTED]) + (" and more" if len(names) > TIED_LISTED else "")


#: Samples of an experiment, and tied candidates that are compared.
LONGEST_EXPERIMENT, MOST_TIED = 400, 5
#: Nats that part what is named from every tied candidate, by experiment.
Apart: TypeAlias = dict[str, np.ndarray]


def next_experiment(final: Evidence, slots: Sequence[Slot]) -> NextExperiment | None:
    """Which experiment separates the tied candidates best, in expected nats of log likelihood."""
    slot = max(slots, key=lambda s: len(s.twins), default=None)
    if slot is None or not slot.twins:
        return None
    record, tied = final.candidate.problem.record, slot.twins[:MOST_TIED]
    varied = variations(record, final.candidate.problem.plant.inputs)
    separate: Any = of_ode if isinstance(final.candidate, OdeCandidate) else of_trajectories
    apart = {name: value for name, value in separate(final, tied, varied).items() if np.isfinite(value).any()}
    if not apart:
        return None
    names = [name_of(final.effects[slot.index]), *(name_of(candidate.effects[-1]) for candidate in tied)]
    beyond = {name for name, u in varied.items() if leaves_the_range(u, record.u)}
    return suggestion(apart, names, beyond)


def variations(record: Record, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Inputs (n_inputs, n_samples) that a user could apply instead of those of the first run."""
    a, n = int(record.starts[0]), int(min(record.lengths[0], LONGEST_EXPERIMENT))
    u, index = record.u[:, a : a + n], np.arange(n)
    mean = u.mean(axis=1, keepdims=True)
    spread = np.max(np.abs(u - mean), axis=1, keepdims=True)
    varied = {
        "the same run again": u,
        "a run with inputs of twice the amplitude": mean + 2 * (u - mean),
        "a run with inputs of half the amplitude": mean + 0.5 * (u - mean),
        "a run with inputs shifted up by their amplitude": u + spread,
        "a run with inputs twice as fast": u[:, (2 * index) % n],
        "a run with inputs half as fast": u[:, index // 2],
        "a run with a step in every input": np.where(index < n // 4, mean - 0.5 * spread, mean + spread),
    }
    for i, name in enumerate(names if len(names) > 1 else ()):
        only = np.repeat(mean, n, axis=1)
        only[i] = u[i]
        varied[f"a run in which only {name} moves"] = only
    return varied


# ---- through simulate alone -----------------------------------------------------------------------------------------
def of_trajectories(
    final: Evidence[TrajectoryCandidate], tied: Sequence[TrajectoryCandidate], varied: Mapping[str, np.ndarray]
) -> Apart:
    """By the simulator's own runs."""
    problem, named, out = final.candidate.problem, final.candidate, {}
    for label, u in varied.items():
        at = problem.over_inputs(np.ascontiguousarray(u))
        try:
            first = at.outputs(named.effects, named.fit.theta)
            others = [at.outputs(candidate.effects, candidate.fit.theta) for candidate in tied]
        except SurrogateError:
            continue
        weight = (problem.sd / final.noise.sigma)[:, None]
        gains = [0.5 * float(np.sum(at.without_starts(((first - y) * weight)[None]) ** 2)) for y in others]
        if np.all(np.isfinite(gains)):
            out[label] = np.array(gains)
    return out


# ---- through the right-hand side ------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class _Experiment:
    """A variation of the record's first run."""

    name: str
    u: np.ndarray
    x0: np.ndarray


def of_ode(final: Evidence[OdeCandidate], tied: Sequence[OdeCandidate], varied: Mapping[str, np.ndarray]) -> Apart:
    """By free runs, from another initial state too, and with a sensor more."""
    named, problem = final.candidate, final.candidate.problem
    experiments, n = _experiments(named, varied), len(problem.plant.states)
    count = len(experiments)
    pushed = [replace(e, x0=e.x0 + step) for step in STEP_OF_SLOPES * np.diag(problem.scale) for e in experiments]
    try:
        first = _responses(named, [*experiments, *pushed])
        others = [_responses(candidate, experiments) for candidate in tied]
    except (FloatingPointError, np.linalg.LinAlgError):
        return {}
    m = len(problem.record.y)
    extra = [s for s in problem.plant.states if s not in problem.plant.outputs]
    hidden = [problem.plant.states.index(s) for s in extra]
    sd = np.concatenate([final.noise.sigma, 0.01 * problem.scale[hidden]])
    # Initial states are fitted to the new run: what they can imitate separates nothing.
    starts = (first[:, count:].reshape(len(first), n, count, -1) - first[:, None, :count]) / STEP_OF_SLOPES
    apart: Apart = {}
    for e, experiment in enumerate(experiments):
        differences = [first[:m, e] - other[:m, e] for other in others]
        apart[experiment.name] = _separations(differences, starts[:m, :, e], sd[:m])
    for h, state in enumerate(extra):
        seen = [*range(m), m + h]
        differences = [first[seen, 0] - other[seen, 0] for other in others]
        apart[f"a sensor for {state}, inputs as they were"] = _separations(differences, starts[seen][:, :, 0], sd[seen])
    return apart


def _experiments(candidate: OdeCandidate, varied: Mapping[str, np.ndarray]) -> list[_Experiment]:
    """The variations from the initial state of the first run, and no input from a large one."""
    x0 = candidate.fit.x[: candidate.model.n_nominal, int(candidate.problem.record.starts[0])]
    found = [_Experiment(name, u, x0) for name, u in varied.items()]
    u = found[0].u
    still = np.broadcast_to(u.mean(axis=1, keepdims=True), u.shape)
    large = _Experiment("a run without input, from a large initial state", still, x0 + 2 * candidate.problem.scale)
    return [*found[:6], large, *found[6:]]


def _responses(candidate: OdeCandidate, experiments: Sequence[_Experiment]) -> np.ndarray:
    """States of a candidate in every experiment, (n_states, n_experiments, n_samples); nan where it diverges."""
    problem = candidate.problem
    n = experiments[0].u.shape[1]
    count = len(experiments)
    record = Record(
        np.concatenate([e.u for e in experiments], axis=1),
        np.zeros((len(problem.record.y), n * count)),
        np.tile(problem.record.dt * np.arange(n), count),
        n * np.arange(count),
        problem.record.dt,
    )
    model = replace(problem, record=record).augmented(candidate.effects)
    theta = candidate.fit.theta
    with np.errstate(all="ignore"):
        bound = model.bind(theta[:, None])
        x0 = bound.start(np.stack([e.x0 for e in experiments], axis=1)[:, None])[:, 0]
        x = free_run(model, theta, x0)
        y = bound.outputs(x[:, None])[:, 0]
    hidden = [i for i, name in enumerate(problem.plant.states) if name not in problem.plant.outputs]
    return np.concatenate([y, x[hidden]]).reshape(-1, count, n)


def _separations(differences: Sequence[np.ndarray], starts: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Nats that part the final effect from every tied candidate, initial states fitted to each; nan where a run breaks.

    ``differences`` of predictions (n_outputs, n_samples), ``starts`` what the initial states move (n_outputs, n_states,
    n_samples).
    """
    J = (starts / sd[:, None, None]).transpose(0, 2, 1).reshape(-1, starts.shape[1])
    out = np.full(len(differences), np.nan)
    for k, difference in enumerate(differences):
        d = (difference / sd[:, None]).reshape(-1)
        if np.all(np.isfinite(d)) and np.all(np.isfinite(J)):
            d = d - J @ np.linalg.lstsq(J, d, rcond=1e-8)[0]
            out[k] = 0.5 * float(d @ d)
    return out
