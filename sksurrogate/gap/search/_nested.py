"""Effects whose forms contain one another, and two of them that are one law between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from scipy.optimize import least_squares

from sksurrogate.effects._effect import BalanceEffect, BaseEffect, HiddenEffect
from sksurrogate.gap.fit._ode import OdeCandidate

#: A simpler form is named where the richer one removes hardly more than this share of the gap's power.
HARDLY_ANY = 5e-4
#: A form that leaves so many times more than is allowed before it is polished leaves too much afterwards.
UNPOLISHED = 10.0

#: Forms that contain a simpler one.
NESTED = {
    "stribeck_friction": ("coulomb_friction",),
    "asymmetric_friction": ("coulomb_friction",),
    "lugre_friction": ("coulomb_friction",),
    "hysteresis": ("coulomb_friction",),
    "end_stop": ("state_saturation",),
    "overflow": ("state_saturation",),
    "power_law": ("linear_loss", "quadratic_loss", "quadratic_drag", "cubic_stiffness", "sqrt_leak"),
    "parameter_step": ("parameter_error",),
    "step_disturbance": ("constant_bias",),
    "hidden_relaxation": ("linear_loss",),
}


def hardly_more(cost: float, gap: float) -> float:
    """The cost that leaves hardly more than this one of a gap's power."""
    return cost + HARDLY_ANY * gap


def simpler(effect: BaseEffect, name: str, library: Sequence[BaseEffect]) -> list[BaseEffect]:
    """The candidates of a simpler form's name that an effect may come down to."""
    same = [e for e in library if e.name == name and e.location == effect.location]
    return [e for e in same if e.variable in (effect.variable, None)]


def richer(effect: BaseEffect, simple: BaseEffect) -> bool:
    """Whether an effect is a richer form of a simple one: at its place, in its variable."""
    same = effect.location == simple.location and simple.variable in (effect.variable, None)
    return same and simple.name in NESTED.get(effect.name, ())


def related(one: BaseEffect, other: BaseEffect) -> bool:
    """Whether two effects at one place, in one variable, nest each other or a form in common."""
    forms = {one.name, *NESTED.get(one.name, ())} & {other.name, *NESTED.get(other.name, ())}
    same = one.variable == other.variable or None in (one.variable, other.variable)
    return bool(forms) and one.location == other.location and same and one.name != other.name


#: A law is the sum of two where it differs by less than this share of its deviation (RMS); and its fit is where theirs is
#: with less than so many times their cost: kinks of larger jumps are smoothed further.
SAME_FORCE, LITTLE_MORE = 0.01, 1.3


def folded(candidate: OdeCandidate) -> OdeCandidate | None:
    """A candidate with two of its effects as one, fitted from their sum; None where no two are such, or the fit does not get there.

    Of two forms of one variable in one balance, of which one contains the other, the richer may be their sum along the path.
    """
    for i, j in permutations(range(len(candidate.effects)), 2):
        own = together(candidate, i, j) if contains(candidate.effects[i], candidate.effects[j]) else None
        if own is not None:
            theta = candidate.fit.theta.copy()
            theta[candidate.slice_of(i)] = own
            effects, values = replace(candidate, fit=replace(candidate.fit, theta=theta)).without_effect(j)
            one = candidate.problem.fit(effects, values, candidate.fit.x[: candidate.model.n_nominal], open_steps=0)
            return one if one is not None and one.fit.cost < LITTLE_MORE * candidate.fit.cost else None
    return None


def force_of(candidate: OdeCandidate, k: int, theta: np.ndarray) -> np.ndarray:
    """What effect k adds to its balance along the path, (n_samples,)."""
    model, record = candidate.model, candidate.problem.record
    width = model.wires[k].width or 0.0
    return model.force_of(k, record.t, candidate.fit.x[:, None], record.u[:, None], list(theta[:, None]), width)[0]


def contains(rich: BaseEffect, simple: BaseEffect) -> bool:
    """Whether a law of a balance has the form of another one among its own."""
    laws = all(isinstance(e, BalanceEffect) and not isinstance(e, HiddenEffect) for e in (rich, simple))
    return laws and rich.variable == simple.variable and richer(rich, simple)


def together(candidate: OdeCandidate, i: int, j: int) -> np.ndarray | None:
    """Values with which effect i is effects i and j together, along the path; None where it has none."""
    own = candidate.theta_of(i)
    wanted = force_of(candidate, i, own) + force_of(candidate, j, candidate.theta_of(j))
    low, high = (bound[candidate.slice_of(i)] for bound in candidate.problem.bounds(candidate.effects))
    size = np.std(wanted) or 1.0
    begin = np.clip(own, low, high)
    found = least_squares(
        lambda theta: (force_of(candidate, i, theta) - wanted) / size,
        begin,
        bounds=(low, high),
        x_scale="jac",
        max_nfev=50,
    )
    return found.x if np.mean(found.fun**2) < SAME_FORCE**2 else None
