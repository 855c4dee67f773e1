"""Whether a load, a gain or a named effect has another size in every run: its fit run by run, to first order, against one for all runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.gap.decide._choice_by_fold import white_grams
from sksurrogate.gap.fit._closeness import MOST_LEFT, NEARLY_WHITE
from sksurrogate.gap.fit._evidence import CERTAIN, C, Evidence, gain_by_size
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.kernels.linear_fit import linear_least_squares
from sksurrogate.kernels.run_columns import UNSEEN

#: What a plant may have otherwise in every run: a load, an offset or a gain of an actuator, a payload or another parameter.
CAUSES = ("constant_bias", "input_bias", "input_gain", "parameter_error")


class RunToRun(NamedTuple):
    """An effect whose size differs from run to run."""

    name: str
    location: str
    sizes: tuple[float, ...]  #: Of its first parameter, in every run
    closes: float  #: Share (power) of what is left that it closes so


def run_to_run(search: BaseSearch[C], final: Evidence[C]) -> RunToRun | None:
    """The effect that, with another size in every run, closes most of what is left; None where none is worth a size for each run.

    It is what is named, where one effect is; else a load, an offset, a gain or a parameter beside nothing.
    """
    record = search.problem.record
    if len(record.starts) < 2 or final.left < NEARLY_WHITE or len(final.effects) > 1:
        return None
    known = (one for keys, one in search.fitted.items() if len(keys) == 1 and one.effects[0].name in CAUSES)
    candidates = [final.candidate] if final.effects else list(known)
    left = float(np.sum(white_grams(final.candidate, record.starts)[:, 0, 0]))
    best, worth = None, CERTAIN + float(np.log(max(len(candidates), 1)))
    for candidate in candidates:
        rest, steps = fitted_by_run(white_grams(candidate, record.starts))
        price = 0.5 * steps.size * np.log(record.n_values)
        gain = gain_by_size(record.n_values, left / max(rest, 1e-300)) - price
        if gain > worth and rest < MOST_LEFT**2 * left:
            effect, first = candidate.effects[0], candidate.slice_of(0).start
            sizes = tuple(float(candidate.fit.theta[first] + step) for step in steps[:, first])
            best, worth = RunToRun(effect.name, str(effect.location), sizes, 1.0 - rest / left), gain
    return best


def fitted_by_run(grams: np.ndarray) -> tuple[float, np.ndarray]:
    """What is left, and the steps of the parameters (n_runs, n_theta), where every run has parameters of its own.

    ``grams`` (n_runs, 1 + n_theta, 1 + n_theta): of residual and sensitivities.

    >>> J, r = np.ones((2, 3)), np.array([[1.0, 1.0, 1.0], [-2.0, -2.0, -2.0]])  # a constant, and residuals of two runs
    >>> columns = np.stack([r, J], axis=1)
    >>> rest, steps = fitted_by_run(columns @ columns.transpose(0, 2, 1))
    >>> round(rest, 9), steps.ravel().tolist()
    (0.0, [1.0, -2.0])
    """
    steps = np.stack([linear_least_squares(G[1:, 1:], G[1:, 0], rcond=UNSEEN) for G in grams])
    return float(sum(G[0, 0] - G[1:, 0] @ step for G, step in zip(grams, steps))), steps


def differs(found: RunToRun, labels: Sequence[Any]) -> str:
    """What is said of it."""
    sizes = ", ".join(f"{size:.3g} in run {label!r}" for size, label in zip(found.sizes, labels))
    return (
        f"From run to run the gap differs as {found.name} at {found.location} does with another size in each: {sizes} (to first order). "
        f"That closes {100 * found.closes:.0f} % of what is left. Where the runs have another load, payload or temperature, give it to the "
        "simulator as an input or a parameter of each run, or diagnose runs that are alike."
    )
