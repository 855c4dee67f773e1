"""Inputs written a row too late: every reading comes before its cause, which no effect of a plant can do."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.gap.faults._corrections import Shifts
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, SETTLED, is_at_noise
from sksurrogate.gap.fit._evidence import CERTAIN, FEW_STEPS, estimate_noise
from sksurrogate.gap.search._base import BaseSearch

#: Single effects, the likeliest or the nearest, on top of which a fault is looked for.
MOST_SINGLES = 8


def inputs_late(search: BaseSearch[Any], n_runs: int) -> Shifts | None:
    """A shift of all runs by one row with which effects are to be looked for again, after some were named; None where there is none.

    Beside no effect, beside what was named, or beside one effect in the place of names that are several or leave more than the noise, it
    comes to the noise and is likelier. Where no input moves within a run a shift is another initial state, and none is looked for.

    ``n_runs``: of the whole record.
    """
    record = search.fitted_null.candidate.problem.record
    if np.array_equal(record.u, record.u[:, record.back(1)]):
        return None
    named, shift = search.standing, Shifts(None, np.full(n_runs, -1))
    doubtful = named.left > AT_THE_NOISE or len(named.effects) > 1
    models = [search.fitted_null.candidate, named.candidate, *(search.first_round[:MOST_SINGLES] if doubtful else [])]
    best = max(_score(_shifted(model, shift), search) for model in models)
    return shift if best > search.score(named.candidate) + 0.5 * CERTAIN else None


def _shifted(model: BaseCandidate, shift: Shifts) -> BaseCandidate | None:
    """Fitted to the shifted record, from its nominal parameters: they were fitted to causes that come too late."""
    nominal = model.at_nominal()
    return None if nominal is None else nominal.refitted(shift.corrected(model.problem.record))


def _score(shifted: BaseCandidate | None, search: BaseSearch[Any]) -> float:
    """As that of a set of effects, the shift being one parameter more; -inf above the noise and what was named."""
    near = np.clip(search.standing.candidate.fit.cost / search.n_values, 1.0, SETTLED**2)
    if shifted is None or not is_at_noise(shifted.fit.cost / near, shifted.problem.record.n_values):
        return -np.inf
    likelihood = estimate_noise(shifted, search.standing.noise, max_iterations=FEW_STEPS).log_likelihood
    # readings that the shift leaves without a cause count as the mean of the others
    likelihood *= search.n_values / shifted.problem.record.n_values
    return float(likelihood - 0.5 * search.prior_cost(shifted) - search.price(shifted) - 0.5 * np.log(search.n_values))
