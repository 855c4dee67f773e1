"""How candidates are fitted from the starts that the screen found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import HiddenEffect, LimitEffect, SensorEffect
from sksurrogate.effects._law import AnyLaw
from sksurrogate.effects._onset import Starting
from sksurrogate.gap.fit._build import nominal_run
from sksurrogate.gap.fit._closeness import FAR_BY_COST, NEAR
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.screen._pairs import Pair
from sksurrogate.gap.screen._screen import Start
from sksurrogate.gap.screen._sticking import sticks_in
from sksurrogate.gap.search._restart import line_searched
from sksurrogate.kernels.free_runs import run_near
from sksurrogate.kernels.output_error import Fit

#: A candidate whose screen leaves this many times more than the best's is not fitted.
LEAVES_TOO_MUCH = 40.0
#: Effects whose expected gains differ by less than this share predict the same along the base: friction of one sign is a bias.
SAME_GAIN = 1e-5
#: Starts of an effect whose prediction jumps, and the share by which they differ at least.
MOST_APART, APART = 3, 0.02
#: Substeps with which dry friction that sticks is fitted.
STICKING_SUBSTEPS = 8
#: Numerics matter where they move the free run by this much of the noise; where it is not near to the data by this share of its
#: error.
MOVED_BY_NUMERICS, MOVED_OF_ERROR = 0.03, 0.3
#: Sharpness at which the search for the step of a quantization begins: flanks of a quarter of a step.
SOFT = 4.0
#: Shares of a start that are tried, one after the other, where its free run does not stay finite.
NEARER = (1.0, 0.3, 0.1)


def fit_added(base: OdeCandidate, starts: Sequence[Start], best: float) -> OdeCandidate | None:
    """Fit a base with one effect more, from the best of several starts; one that cannot come near to the others is abandoned."""
    found: OdeCandidate | None = None
    problem = base.problem
    values = [base.theta_of(i) for i in range(len(base.effects))]
    if any(sticks_in(problem, (*base.effects, start.effect), [*values, start.theta]) for start in starts):
        problem = problem.at(replace(problem.numerics, n_sub=max(problem.numerics.n_sub, STICKING_SUBSTEPS)))
    for start in starts:
        smaller = (start.effect.smaller(start.theta, share) for share in NEARER[1:])
        for own in [start.theta, *(own for own in smaller if own is not None)]:
            theta = base.theta_with(own)
            near = best if found is None else min(best, found.fit.cost)
            try:
                candidate = fit_last(problem, (*base.effects, start.effect), theta, start.x, base.fit, near)
            except (np.linalg.LinAlgError, FloatingPointError):  # a candidate that breaks the arithmetic is out
                candidate = None
            if candidate is not None:
                break
        found = cheapest([found, candidate])
    if found is not None and (found.fit.cost < 3.0 * best or isinstance(found.effects[-1], Starting)):
        for i in reversed(range(len(found.effects))):  # a step of the base may have made up for what is new
            found = line_searched(found, i)
    return found


def fit_pair(base: OdeCandidate, pair: Pair, x: np.ndarray, best: float) -> OdeCandidate | None:
    """Fit a base with two effects more at once, from a smoothed trajectory ``x`` with the hidden states of the base."""
    (first, second, _), problem = pair, base.problem
    n, theta = len(problem.plant.states), base.theta_with(np.concatenate([first.theta, second.theta]))
    whole = np.concatenate([x, first.x[n:], second.x[n:]])
    try:
        candidate = problem.fit((*base.effects, *pair.effects), theta, whole, best=best)
    except (np.linalg.LinAlgError, FloatingPointError):  # a candidate that breaks the arithmetic is out
        return None
    return candidate and line_searched(candidate)


def fit_last(
    problem: OdeBackend, effects: Sequence[BaseEffect], theta: np.ndarray, x: np.ndarray, base: Fit, best: float
) -> OdeCandidate | None:
    """Fit effects of which the last is new, from a smoothed trajectory ``x``, else from the free run of a ``base`` without it.

    A reading that jumps is fitted as a soft staircase first, and from the free run: smoothed states follow the steps. One
    that hides the sign is fitted from the simulator's own run too: states read off it have the wrong sign in places. A step of an
    input is fitted from the free run too, and an effect that begins or jumps: they must not follow a path that is not a free run yet.
    """
    last, run = effects[-1], base.x[: len(problem.plant.states)]
    place = problem.augmented(effects).slice_of(len(effects) - 1)
    if isinstance(last, SensorEffect) and last.folds:
        tries, own = [problem.fit(effects, theta, x, best=best, fallback=run)], nominal_run(problem)
        if np.isfinite(own).all():
            tries.append(problem.fit(effects, theta, own, best=best, open_steps=0))
        return cheapest(tries)
    if isinstance(last, LimitEffect):
        return fit_limit(problem, effects, theta, x, base, best)
    steps = bool(last.scan(list(theta[place])))
    if steps and last.kind == "output":
        soft = problem.at(replace(problem.numerics, sharpness=SOFT)).fit(effects, theta, run, open_steps=0, max_steps=8)
        return soft and soft.resumed(problem, max_steps=12)
    found = problem.fit(effects, theta, x, best=best, fallback=run)
    jumps = steps or any(parameter.jumps for parameter in last.parameters)
    return cheapest([found, problem.fit(effects, theta, run, open_steps=0)]) if jumps else found


def fit_given(
    base: OdeCandidate, given: Sequence[tuple[BaseEffect, np.ndarray]], named: OdeCandidate
) -> list[OdeCandidate]:
    """A base with each of some effects, fitted from given values along the free run of a ``named`` set; without those that run away."""
    fit, x = named.problem.fit, named.states
    tries = [fit((*base.effects, one), base.theta_with(theta), x, open_steps=0) for one, theta in given]
    return [candidate for candidate in tries if candidate is not None]


def fit_part(
    problem: OdeBackend, base: OdeCandidate, law: AnyLaw, values: np.ndarray, shares: Sequence[float] = NEARER
) -> OdeCandidate | None:
    """Fit a law on top of a base from a part of its coefficients, along the run of the base: from so small a part that it starts no worse."""
    n = len(law.terms)
    for share in shares:
        theta = base.theta_with(np.r_[share * values[:n], values[n:]])
        found = problem.fit((*base.effects, law), theta, base.states, open_steps=0)
        if found is not None and found.fit.cost < base.fit.cost:
            return found
    return None


def fit_limit(
    problem: OdeBackend, effects: Sequence[BaseEffect], theta: np.ndarray, x: np.ndarray, base: Fit, best: float
) -> OdeCandidate | None:
    """Fit effects of which the last is a limit: from a smoothed trajectory, and where that leads nowhere from where runs began.

    Beyond a limit states have no slopes, and initial states of a base that knew of no limit and is far from the data have
    made up for it: the free run begins where the simulator's own does.
    """
    found = problem.fit(effects, theta, x, best=best, fallback=base.x[: len(problem.plant.states)])
    model = problem.augmented(effects)
    near = min(base.cost, np.inf if found is None else found.fit.cost) < FAR_BY_COST * problem.record.n_values
    if near or problem.run is None or model.n_states > len(problem.run):
        return found
    with np.errstate(all="ignore"):
        own = run_near(model, theta, problem.run)
    other = problem.fit(effects, theta, own, open_steps=0) if np.isfinite(own).all() else None
    return cheapest([found, other])


def cheapest(tries: Sequence[OdeCandidate | None]) -> OdeCandidate | None:
    """Of several fits the one nearest to the data, the first of equal ones; None where none came to an end."""
    return min(
        (candidate for candidate in tries if candidate is not None),
        key=lambda candidate: candidate.fit.cost,
        default=None,
    )


def best_starts(starts: Sequence[Start], n_white: int, n_forced: int, n_values: int) -> list[list[Start]]:
    """The best candidates by either score, hopeless ones left out; for each its best starts (two where it is not linear).

    Of an effect whose prediction jumps three starts that lie apart: neighbours lead to one value.
    """
    by_effect: dict = {}
    if not starts:
        return []
    for start in starts:
        by_effect.setdefault((*start.effect.key, type(start.effect), start.effect.at_rest), []).append(start)
    for group in by_effect.values():
        group.sort(key=lambda s: (not s.evident, -s.white))
    white = first_places({key: max(s.white for s in group) for key, group in by_effect.items()}, n_white)
    forced = first_places({key: max(s.forced for s in group) for key, group in by_effect.items()}, n_forced)
    least = max(min(s.left for s in starts), 1.0 * n_values)
    hopeful = [key for rank, key in enumerate(white) if rank < 6 or by_effect[key][0].left < LEAVES_TOO_MUCH * least]
    evident = [key for key in by_effect if by_effect[key][0].evident]
    chosen = list(dict.fromkeys([*evident, *hopeful, *forced]))
    out = []
    for key in chosen:
        group = by_effect[key]
        if group[0].effect.scan(tuple(group[0].theta)):
            out.append(apart(group, MOST_APART))
            continue
        n = 1 if group[0].effect.linear and not isinstance(group[0].effect, HiddenEffect) else 2
        n = 3 if isinstance(group[0].effect, LimitEffect) else n
        picked = group[:n]
        first = max(group, key=lambda s: s.forced)
        if not group[0].effect.linear and all(first is not p for p in picked):
            picked.append(first)
        out.append(picked)
    return out


def first_places(expected: Mapping[Any, float], n: int) -> list[Any]:
    """The keys of the ``n`` largest values; those that share a value, as twins by form do, share a place, twice ``n`` at most.

    >>> first_places({"bias": 5.0, "friction": 5.0, "loss": 4.0, "delay": 1.0}, 2)
    ['bias', 'friction', 'loss']
    """
    order = sorted(expected, key=lambda key: -expected[key])[: 2 * n]
    places = 0
    for i, key in enumerate(order):
        places += i == 0 or not np.isclose(expected[key], expected[order[i - 1]], rtol=SAME_GAIN, atol=0.0)
        if places > n:
            return order[:i]
    return order


def apart(group: Sequence[Start], most: int) -> list[Start]:
    """The first starts whose magnitudes differ by :data:`APART`, evident ones all."""
    picked = [start for start in group if start.evident]
    for start in group:
        near = any(abs(start.theta[0] / other.theta[0] - 1.0) < APART for other in picked)
        if len(picked) < most and not near:
            picked.append(start)
    return picked


def mean_start(x: np.ndarray, starts: np.ndarray, n: int) -> np.ndarray:
    """Trajectory whose first rows are the mean of the first n."""
    out = x.copy()
    for a in starts:
        out[:, a] = x[:, a : a + n].mean(axis=1)
    return out


def open_null(problem: OdeBackend, theta: np.ndarray, x: np.ndarray) -> OdeCandidate:
    """A null that has no finite free run: the output stays at its mean, so that anything finite is better."""
    record = problem.record
    y = np.repeat(record.level[:, None], record.n_samples, axis=1)
    cost = float(np.sum((record.residual(y) / problem.sd[:, None]) ** 2))
    return problem.candidate((), Fit(theta, x, y, cost, 0, False, None))


def numerics_matter(finer: OdeBackend, candidate: OdeCandidate) -> bool:
    """Whether shorter steps and sharper kinks move the free run by a share of the noise, or far from the data of what is left."""
    shifted = finer.candidate(candidate.effects, candidate.fit).frozen(candidate.fit.theta, near=True)
    if shifted is None:
        return False
    change = np.sqrt(np.mean(((shifted.fit.y - candidate.fit.y) / finer.sd[:, None]) ** 2))
    error = np.sqrt(candidate.fit.cost / finer.record.n_values)
    return bool(change > (MOVED_BY_NUMERICS if error < NEAR else MOVED_OF_ERROR * error))
