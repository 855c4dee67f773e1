"""Inputs written a row too late: every reading comes before its cause, which no effect of a plant can do."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.gap.faults._corrections import Shifts
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, SETTLED, is_at_noise
from sksurrogate.gap.fit._evidence import CERTAIN, FEW_STEPS, estimate_noise
from sksurrogate.gap.search._base import BaseSearch

#: Share of what the simulator alone leaves above the noise that a shift takes, to be tried where names leave something.
MOST_OF_THE_GAP = 0.5
#: Single effects, the likeliest or the nearest, on top of which a fault is looked for.
MOST_SINGLES = 8


def inputs_late(search: BaseSearch[Any], n_runs: int) -> Shifts | None:
    """A shift of all runs by one row with which effects are to be looked for again, after some were named; None where there is none.

    Beside no effect, beside what was named, or beside one effect in the place of several, it comes to the noise and is likelier. Or names
    leave more than the noise, and the simulator alone leaves less than half with it.

    ``n_runs``: of the whole record.
    """
    named, shift = search.standing, Shifts(None, np.full(n_runs, -1))
    alone = _Shifted(shift, search.fitted_null.candidate)
    if named.left > AT_THE_NOISE and alone.taken > MOST_OF_THE_GAP:
        return shift
    singles = search.first_round[:MOST_SINGLES] if len(named.effects) > 1 else []
    beside = [alone, *(_Shifted(shift, model) for model in (named.candidate, *singles))]
    return shift if max(one.score(search) for one in beside) > search.score(named.candidate) + 0.5 * CERTAIN else None


@dataclass(frozen=True, eq=False)
class _Shifted:
    """A model fitted to the shifted record, from its nominal parameters: they were fitted to causes that come too late."""

    shift: Shifts
    before: BaseCandidate

    @cached_property
    def after(self) -> BaseCandidate | None:
        """None where it has no free run."""
        nominal = self.before.at_nominal()
        return None if nominal is None else nominal.refitted(self.shift.corrected(self.before.problem.record))

    @property
    def taken(self) -> float:
        """Share of the excess over the noise that the shift takes."""
        before, after = self.before, self.after
        if after is None:
            return 0.0
        left = after.fit.cost - after.problem.record.n_values
        return 1.0 - left / max(before.fit.cost - before.problem.record.n_values, 1.0)

    def score(self, search: BaseSearch[Any]) -> float:
        """As that of a set of effects, the shift being one parameter more; -inf above the noise and what was named."""
        after, named = self.after, search.standing.candidate.fit.cost / search.n_values
        near = np.clip(named, 1.0, SETTLED**2)
        if after is None or not is_at_noise(after.fit.cost / near, after.problem.record.n_values):
            return -np.inf
        likelihood = estimate_noise(after, search.standing.noise, max_iterations=FEW_STEPS).log_likelihood
        # readings that the shift leaves without a cause count as the mean of the others
        likelihood *= search.n_values / after.problem.record.n_values
        return float(likelihood - 0.5 * search.prior_cost(after) - search.price(after) - 0.5 * np.log(search.n_values))
