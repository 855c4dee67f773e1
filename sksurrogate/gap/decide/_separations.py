"""How far experiments would separate tied candidates, in expected nats: by free runs of the simulator with each of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from sksurrogate.exceptions import SurrogateError
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.gap.fit._trajectory import TrajectoryCandidate
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.linear_fit import linear_least_squares
from sksurrogate.kernels.record import Record

#: Nats that part what is named from every tied candidate, by experiment.
Separations: TypeAlias = dict[str, np.ndarray]


# ---- through simulate alone -----------------------------------------------------------------------------------------
def of_trajectories(
    final: Evidence[TrajectoryCandidate], tied: Sequence[TrajectoryCandidate], varied: Mapping[str, np.ndarray]
) -> Separations:
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


def of_ode(
    final: Evidence[OdeCandidate], tied: Sequence[OdeCandidate], varied: Mapping[str, np.ndarray]
) -> Separations:
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
    apart: Separations = {}
    for e, experiment in enumerate(experiments):
        differences = [first[:m, e] - other[:m, e] for other in others]
        apart[experiment.name] = _separations(differences, starts[:m, :, e], sd[:m])
    for h, state in enumerate(extra):
        seen = [*range(m), m + h]
        differences = [first[seen, 0] - other[seen, 0] for other in others]
        apart[f"the same runs with {state} measured too"] = _separations(differences, starts[seen][:, :, 0], sd[seen])
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
            d = d - J @ linear_least_squares(J, d, rcond=1e-8)
            out[k] = 0.5 * float(d @ d)
    return out
