"""When inputs act: a row too late, so that readings come before their cause, or joined between rows where the simulator holds them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from sklearn.base import clone

from sksurrogate.gap.faults._corrections import BaseFault, Names, Shifts
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, SETTLED, is_at_noise
from sksurrogate.gap.fit._evidence import CERTAIN, FEW_STEPS, estimate_noise
from sksurrogate.gap.results._data_faults import DataFault
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.kernels.record import Record

#: Single effects, the likeliest or the nearest, on top of which a fault is looked for.
MOST_SINGLES = 8


@dataclass(frozen=True, eq=False)
class JoinedInputs(BaseFault):
    """Inputs are samples of signals that move between the rows; the simulator holds them."""

    removed: float = np.nan  #: Share of the gap that goes with it

    @property
    def key(self) -> tuple[Any, ...]:
        return ("hold",)

    def corrected(self, record: Record) -> Record:
        """With inputs that are joined linearly."""
        return replace(record, joined=True)

    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """With the parameter of the simulator."""
        remedy = (
            'Give the simulator hold="foh", as augmented_ has it. If the inputs are held, the readings come half a row early, as those of '
            "a physics engine with semi-implicit steps: then give its steps (StepSimulator)."
        )
        return DataFault("hold", None, "input", tuple(names.labels), (), np.nan, self.removed, remedy=remedy)


def with_joined_inputs(simulator: Any) -> Any:
    """A simulator like this one whose inputs are joined linearly between rows; None where it has no such parameter."""
    try:
        return clone(simulator).set_params(hold="foh")
    except (AttributeError, TypeError, ValueError):
        return None


@dataclass(frozen=True, eq=False)
class _Retimed:
    """A model fitted with another timing of its inputs."""

    timing: BaseFault
    model: BaseCandidate
    gain: float  #: Nats by which it is likelier than what was named

    @property
    def n_parameters(self) -> int:
        """The timing is one."""
        return self.model.n_parameters + 1


def input_timing(search: BaseSearch[Any], n_runs: int, left_by_law: float = np.inf) -> BaseFault | None:
    """Another timing of the inputs with which effects are to be looked for again, after some were named; None where there is none.

    It is tried beside no effect, beside what was named, and beside one effect in the place of names that are several or leave more than
    the noise. It must be likelier than what was named; with as many parameters, by as much as a name must be. Of timings that leave
    nearly as little, the one whose model has the fewest parameters is taken: three effects may repair a wrong one.
    Where no input moves within a run the timing is another initial state, and nothing is asked.

    ``n_runs``: of the whole record.
    ``left_by_law``: RMS over the noise that one law leaves of the gap: a timing counts where it leaves nearly as little.
    """
    null, named = search.fitted_null.candidate, search.standing
    record = null.problem.record
    if np.array_equal(record.u, record.u[:, record.back(1)]):
        return None
    doubtful = named.left > AT_THE_NOISE or len(named.effects) > 1
    models = [null, named.candidate, *(search.first_round[:MOST_SINGLES] if doubtful else [])]
    n, can_join = named.candidate.n_parameters, _can_join(null)
    likelier = [
        one
        for model in models
        for one in _retimed(model, search, n_runs, can_join)
        if one.gain > (0.0 if one.n_parameters < n else 0.5 * CERTAIN)
    ]
    nearest = min([left_by_law**2, *(_size(one.model) for one in likelier)])
    near = [one for one in likelier if _size(one.model) <= SETTLED**2 * nearest]
    best = min(near, key=lambda one: (one.n_parameters, -one.gain), default=None)
    return None if best is None else best.timing


def _retimed(model: BaseCandidate, search: BaseSearch[Any], n_runs: int, can_join: bool) -> list[_Retimed]:
    """A model with inputs a row earlier, and with joined ones, which come half a row earlier.

    A plant that reacts faster than its simulator prefers earlier inputs, too. So inputs a row earlier must lead to the noise, and joined
    ones must leave less than both of the others.
    """
    late = Shifts(None, np.full(n_runs, -1))
    later, between = _refitted(model, late), _refitted(model, JoinedInputs()) if can_join else None
    found = []
    if later is not None and _comes_to_noise(later, search):
        found.append(_Retimed(late, later, _gain(later, search)))
    if between is not None and _size(between) < min(_size(model), np.inf if later is None else _size(later)):
        gap = max(_size(search.fitted_null.candidate) - 1.0, 1e-300)
        removed = min((_size(model) - _size(between)) / gap, 1.0)
        found.append(_Retimed(JoinedInputs(removed), between, _gain(between, search)))
    return found


def _can_join(model: BaseCandidate) -> bool:
    """Whether the simulator holds its inputs and could join them."""
    plant, record = model.problem.plant, model.problem.record
    held = plant.access == "rhs" and record.order_of_inputs(plant.hold) == 0
    return held and with_joined_inputs(plant.simulator) is not None


def _refitted(model: BaseCandidate, timing: BaseFault) -> BaseCandidate | None:
    """Fitted with another timing, from its nominal parameters: they were fitted to causes at other times."""
    nominal = model.at_nominal()
    return None if nominal is None else nominal.refitted(timing.corrected(model.problem.record))


def _size(model: BaseCandidate) -> float:
    """Mean square of the residual: a shift leaves readings without a cause."""
    return float(model.fit.cost) / model.problem.record.n_values


def _comes_to_noise(model: BaseCandidate, search: BaseSearch[Any]) -> bool:
    """Whether a model is at the noise, or as near to it as what was named."""
    near = np.clip(search.standing.candidate.fit.cost / search.n_values, 1.0, SETTLED**2)
    return is_at_noise(model.fit.cost / near, model.problem.record.n_values)


def _gain(model: BaseCandidate, search: BaseSearch[Any]) -> float:
    """Nats by which a model is likelier than what was named, the timing being one parameter more; by size far from the data."""
    named, price = search.standing, 0.5 * float(np.log(search.n_values))
    if search.is_far(model):
        return search.size_score(model) - search.size_score(named.candidate) - price
    likelihood = estimate_noise(model, named.noise, max_iterations=FEW_STEPS).log_likelihood
    # readings that a shift leaves without a cause count as the mean of the others
    likelihood *= search.n_values / model.problem.record.n_values
    own = likelihood - 0.5 * search.prior_cost(model) - search.price(model) - price
    return float(own - search.score(named.candidate))
