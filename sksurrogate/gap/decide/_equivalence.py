"""What these data can and cannot tell apart, and the experiment that would."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.effects._effect import BaseEffect
from sksurrogate.gap.decide._experiment import leaves_the_range, name_of, suggestion
from sksurrogate.gap.fit._evidence import Evidence, estimate_noise, judged_under
from sksurrogate.gap.fit._prior import prior_cost
from sksurrogate.gap.fit._problem import Candidate
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.gap.search._fits import taken_out
from sksurrogate.gap.search._nested import NESTED
from sksurrogate.gap.search._search import EQUAL, Search
from sksurrogate.gap.search._stopping import is_stack
from sksurrogate.kernels.output_error import free_run
from sksurrogate.kernels.record import Record

__all__ = ["Slot", "equivalents", "next_experiment"]

#: Rivals further than this under the final noise are not judged under their own; nor are more than this many.
MAY_CATCH_UP, MOST_JUDGED = 40.0, 8
#: Squares of errors over the noise within which the named effect, fitted as its rivals are, came as near again.
CLOSE = 0.5
#: Nats by which a form with more parameters may be less likely than the named one and yet be of its class.
NEARLY_AS_LIKELY = 1.0
#: Rivals fitted from where the others stand, with the effect of a slot taken out.
MOST_ANEW = 6
#: Initial states are pushed by this share of their size for sensitivities.
PUSH_OF_START = 1e-4
#: Outputs closer than this share of the noise are the same prediction.
SAME_PREDICTION = 0.02


@dataclass(eq=False)
class Slot:
    """One named effect and the rivals that could stand in its place.

    Attributes
    ----------
    index : int
    twins : list of Candidate
        Rivals with another effect in this slot that these data cannot reject.
    identical : list of bool
        Whether the prediction of each twin is the same within a fraction of the noise.
    """

    index: int
    twins: list[Candidate]
    identical: list[bool]


def equivalents(search: Search, final: Evidence) -> list[Slot]:
    """Refit every other rival in each slot under the final noise model; those within :data:`EQUAL` are its class."""
    slots = []
    for i in range(len(final.effects)):
        base = search.begun.candidate if len(final.effects) == 1 else search.without(final.candidate, i)
        if base is None:
            slots.append(Slot(i, [], []))
            continue
        slots.append(_slot(search, final, base, i))
    return slots


def _slot(search: Search, final: Evidence, base: Candidate, i: int) -> Slot:
    """The class of one slot: fitted with the numerics of the search, the near ones again with those of the final rival."""
    named = final.candidate
    fine = named.problem
    own = named.effects[i].key
    level = judged_under(named, [final.noise]).log_likelihood - 0.5 * prior_cost(named)
    few = search.is_far(named) or is_stack(final)
    rivals = (
        search.expand(base, 8, 2, thorough=False)
        if few
        else search.expand(base, 24, 10, siblings=True, best=final.fit.cost)
    )
    if len(final.effects) == 1:  # those of the search may have begun at other re-tuned parameters
        rivals.extend(search.first_round)
    if not few and (len(final.effects) > 1 or search.problem.free):
        rest = taken_out(named, i)  # the others and the free parameters, fitted again alone, may have run away
        rivals.extend([] if rest is None else search.anew(rest, final.noise, MOST_ANEW, 0, final.fit.cost))
    rivals = list({rival.keys: rival for rival in sorted(rivals, key=lambda r: -r.fit.cost)}.values())
    mine = [r.fit.cost for r in rivals if r.effects[-1].key == own]
    same_numerics = search.searching(base).numerics == fine.numerics
    reach = min([final.fit.cost, *mine]) if same_numerics else max([final.fit.cost, *mine])
    found = []
    for rival in rivals:
        if rival.fit.cost > 1.5 * reach + 50.0 * EQUAL:
            continue
        if not same_numerics:
            again = fine.fit(rival.effects, rival.fit.theta, rival.fit.x, open_steps=0, max_steps=8, settled=True)
            rival = again or rival
        value = judged_under(rival, [final.noise]).log_likelihood - 0.5 * prior_cost(rival)
        if rival.effects[-1].key != own:
            found.append((value, rival))
        elif rival.fit.cost < final.fit.cost + CLOSE:  # readings in steps have slopes that promise what no fit keeps
            level = min(level, value)
    found = _with_own_noise(search, final, level, found)
    twins, identical = [], []
    size = len(final.effects[i].parameters)
    for value, rival in found:
        same = predicts_the_same(rival, final)
        # With more parameters a form must be as likely, and predict something else than a limit that is never reached.
        more = len(rival.effects[-1].parameters) > size
        if more and (same or value < level - NEARLY_AS_LIKELY):
            if richer(rival.effects[-1], final.effects[i]):
                search.richer.setdefault(final.effects[i].key, []).append(rival.effects[-1].key)
        else:
            twins.append(rival)
            identical.append(same)
    return Slot(i, twins, identical)


def predicts_the_same(rival: Candidate, final: Evidence) -> bool:
    """Whether no output differs by more than :data:`SAME_PREDICTION` of its noise."""
    apart = np.sqrt(np.mean((rival.fit.y - final.fit.y) ** 2, axis=1)) / final.noise.sigma
    return bool(np.max(apart) < SAME_PREDICTION)


def richer(effect: BaseEffect, simple: BaseEffect) -> bool:
    """Whether an effect is a richer form of a simple one: at its place, in its variable."""
    same = effect.location == simple.location and simple.variable in (effect.variable, None)
    return same and simple.name in NESTED.get(effect.name, ())


def _with_own_noise(
    search: Search, final: Evidence, level: float, found: list[tuple[float, Candidate]]
) -> list[tuple[float, Candidate]]:
    """The rivals within :data:`EQUAL`, best first; near ones are judged under their own noise, as the final rival is.

    Those that predict the same, with free parameters as likely, are in it whatever a force or an initial state would do.
    """
    found.sort(key=lambda item: -item[0])
    judged = []
    for rank, (value, rival) in enumerate(found):
        missing = 2.0 * (level - value)
        if EQUAL < missing <= MAY_CATCH_UP and rank < MOST_JUDGED:
            again = search.judge(estimate_noise(rival, final.noise, final.curvature, max_iterations=8))
            value = max(value, again.log_likelihood - 0.5 * prior_cost(rival))
        cheap = prior_cost(rival) <= prior_cost(final.candidate) + EQUAL
        if 2.0 * (level - value) <= EQUAL or (cheap and predicts_the_same(rival, final)):
            judged.append((value, rival))
    return sorted(judged, key=lambda item: -item[0])


@dataclass(frozen=True, eq=False)
class _Experiment:
    """A variation of the record's first run."""

    name: str
    u: np.ndarray
    x0: np.ndarray


def _experiments(rival: Candidate) -> list[_Experiment]:
    """Inputs a user could apply: larger, smaller, shifted, faster, slower; other initial states."""
    problem = rival.problem
    record = problem.record
    a = int(record.starts[0])
    n = int(min(record.lengths[0], 400))
    u = record.u[:, a : a + n]
    x0 = rival.fit.x[: rival.model.n_nominal, a]
    mean = u.mean(axis=1, keepdims=True)
    spread = np.max(np.abs(u - mean), axis=1, keepdims=True)
    index = np.arange(n)
    experiments = [
        _Experiment("the same run again", u, x0),
        _Experiment("a run with inputs of twice the amplitude", mean + 2 * (u - mean), x0),
        _Experiment("a run with inputs of half the amplitude", mean + 0.5 * (u - mean), x0),
        _Experiment("a run with inputs shifted up by their amplitude", u + spread, x0),
        _Experiment("a run with inputs twice as fast", u[:, (2 * index) % n], x0),
        _Experiment("a run with inputs half as fast", u[:, index // 2], x0),
        _Experiment(
            "a run without input, from a large initial state", np.broadcast_to(mean, u.shape), x0 + 2 * problem.scale
        ),
        _Experiment(
            "a run with a step in every input", np.where(index < n // 4, mean - 0.5 * spread, mean + spread), x0
        ),
    ]
    for i, name in enumerate(problem.plant.inputs if len(problem.plant.inputs) > 1 else ()):
        only = np.repeat(mean, n, axis=1)
        only[i] = u[i]
        experiments.append(_Experiment(f"a run in which only {name} moves", only, x0))
    return experiments


def _responses(rival: Candidate, experiments: Sequence[_Experiment]) -> np.ndarray:
    """States of a rival in every experiment, (n_states, n_experiments, n_samples); nan where it diverges."""
    problem = rival.problem
    n = experiments[0].u.shape[1]
    count = len(experiments)
    record = Record(
        np.concatenate([e.u for e in experiments], axis=1),
        np.zeros((len(problem.record.y), n * count)),
        np.tile(problem.record.dt * np.arange(n), count),
        n * np.arange(count),
        problem.record.dt,
    )
    model = replace(problem, record=record).augmented(rival.effects)
    theta = rival.fit.theta
    with np.errstate(all="ignore"):
        bound = model.bind(theta[:, None])
        x0 = bound.start(np.stack([e.x0 for e in experiments], axis=1)[:, None])[:, 0]
        x = free_run(model, theta, x0)
        y = bound.outputs(x[:, None])[:, 0]
    hidden = [i for i, name in enumerate(problem.plant.states) if name not in problem.plant.outputs]
    return np.concatenate([y, x[hidden]]).reshape(-1, count, n)


def next_experiment(final: Evidence, slots: Sequence[Slot]) -> NextExperiment | None:
    """Which experiment separates the tied rivals best, in expected nats of log likelihood."""
    slot = max(slots, key=lambda s: len(s.twins), default=None)
    if slot is None or not slot.twins:
        return None
    problem = final.candidate.problem
    rivals = [final.candidate, *slot.twins[:5]]
    names = [name_of(final.effects[slot.index]), *(name_of(r.effects[-1]) for r in slot.twins[:5])]
    experiments = _experiments(final.candidate)
    count, n = len(experiments), len(problem.plant.states)
    pushed = [replace(e, x0=e.x0 + step) for step in PUSH_OF_START * np.diag(problem.scale) for e in experiments]
    try:
        first, *others = [
            _responses(rival, experiments if k else [*experiments, *pushed]) for k, rival in enumerate(rivals)
        ]
    except (FloatingPointError, np.linalg.LinAlgError):
        return None
    m = len(problem.record.y)
    extra = [s for s in problem.plant.states if s not in problem.plant.outputs]
    hidden = [problem.plant.states.index(s) for s in extra]
    sd = np.concatenate([final.noise.sigma, 0.01 * problem.scale[hidden]])
    # Initial states are fitted to the new run: what they can imitate separates nothing.
    starts = (first[:, count:].reshape(len(first), n, count, -1) - first[:, None, :count]) / PUSH_OF_START
    apart: dict[str, np.ndarray] = {}
    for e, experiment in enumerate(experiments):
        differences = [first[:m, e] - other[:m, e] for other in others]
        apart[experiment.name] = _separations(differences, starts[:m, :, e], sd[:m])
    for h, state in enumerate(extra):
        seen = [*range(m), m + h]
        differences = [first[seen, 0] - other[seen, 0] for other in others]
        apart[f"a sensor for {state}, inputs as they were"] = _separations(differences, starts[seen][:, :, 0], sd[seen])
    apart = {name: value for name, value in apart.items() if np.isfinite(value).any()}
    if not apart:
        return None
    beyond = {e.name for e in experiments if leaves_the_range(e.u, problem.record.u)}
    return suggestion(apart, names, beyond)


def _separations(differences: Sequence[np.ndarray], starts: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Nats that part the final effect from every tied rival, initial states fitted to each; nan where a run breaks.

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
