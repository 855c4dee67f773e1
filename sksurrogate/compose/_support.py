"""How much of a correction do runs support that it was not fitted to? Pure functions of left-out errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

#: Fewest blocks that a standard error is made of: with eight its own error is a quarter.
FEWEST_BLOCKS = 8
#: Probability with which a gain is at least what is called sure: the usual level of a one-sided test. Draws of blocks that
#: it is counted in: they tell a level of 5 % to 0.7 %.
SURE_GAIN, BLOCK_DRAWS = 0.95, 1000
#: Share of the squared error whose removal makes a correction the rule and the simulator the exception.
CLEARLY_CLOSED = 0.5
#: Shares of a correction that are compared: a step of a twentieth costs at most a 400th of the squared gap.
SHARES = np.linspace(0.0, 1.0, 21)


@dataclass(frozen=True)
class Support:
    """The share of a correction that left-out blocks support."""

    factor: float  #: Between 0 (the simulator alone) and 1 (the whole correction)
    #: Share of the simulator's squared error on left-out blocks that the correction removes at this factor
    closed: float
    standard_error: float  #: Of ``closed``, from leaving out one block after the other (jackknife)
    n_blocks: int
    sure: float = 0.0  #: What ``closed`` is at least with a probability of ``SURE_GAIN``


def block_powers(errors: Sequence[np.ndarray], ends: Sequence[tuple[int, int]], lengths: Sequence[int]) -> np.ndarray:
    """Sums of squares over blocks of rows: (n_factors, n_blocks, n_outputs).

    Runs are cut into equal blocks where they are fewer than ``FEWEST_BLOCKS``. Errors of the same rows, in free runs from
    several starts, are one block: they do not tell of different rows.

    ``errors`` (n_factors, n_rows, n_outputs).
    ``ends``: run of every error, and the row behind its last.
    ``lengths``: rows of every run.
    """
    cuts = max(1, -(-FEWEST_BLOCKS // len(lengths)))
    powers = np.zeros((len(errors[0]), len(lengths) * cuts, errors[0].shape[2]))
    seen = np.zeros(len(lengths) * cuts, bool)
    with np.errstate(over="ignore", invalid="ignore"):
        for error, (run, stop) in zip(errors, ends):
            edges = np.linspace(0, lengths[run], cuts + 1).astype(int)[1:-1]
            places = run * cuts + np.searchsorted(edges, np.arange(stop - error.shape[1], stop), side="right")
            for place in np.unique(places):
                powers[:, place] += np.sum(np.square(error[:, places == place]), axis=1)
                seen[place] = True
    return np.where(np.isfinite(powers), powers, np.inf)[:, seen]


def supported(power: np.ndarray, factors: np.ndarray) -> Support:
    """The factor whose sure gain is largest; 0 where none surely gains.

    The correction of all runs is better than those of the folds, which learned from fewer. So the whole correction is kept
    where it surely removes more than half of the squared error and no smaller share is better by more than one standard
    error of the difference.

    The gain of a factor is ``1 - sum_b P_b(factor) / sum_b P_b(0)``. Its standard error is the jackknife's over blocks, its
    sure part a quantile over blocks drawn anew. All of a gain is sure where all blocks gain the same share, whatever their
    sizes, and nothing where one block alone gains. Blocks that gain much beside blocks that gain little make the gain
    uncertain, but not its sign.

    ``power`` (n_factors, n_blocks): squared error of every block at every factor.
    ``factors`` (n_factors,): from 0 on.

    >>> import numpy as np
    >>> factors = np.linspace(0.0, 1.0, 5)
    >>> half_right = np.array([(1.0 - f) ** 2 + f**2 for f in factors])[:, None] * np.ones(8)
    >>> supported(half_right, factors).factor
    0.5
    """
    n = power.shape[1]
    if n < 2 or not np.all(np.isfinite(power[0])):
        return Support(0.0, 0.0, 0.0, n)
    with np.errstate(divide="ignore", invalid="ignore"):
        total = power.sum(axis=1)
        gain = 1.0 - total / total[0]
        rest = 1.0 - (total[:, None] - power) / (total[0] - power[0])
        error = _jackknife(rest - gain[:, None])
        sure = _sure(power, gain)
    sure = np.where(np.isfinite(sure), sure, -np.inf)
    best, whole = int(np.argmax(sure)), len(factors) - 1
    if not sure[best] > 0.0:
        return Support(0.0, 0.0, 0.0, n)
    if sure[whole] > CLEARLY_CLOSED:
        behind = gain[best] - gain[whole]
        if behind <= _jackknife((rest[best] - rest[whole] - behind)[None])[0]:
            best = whole
    return Support(float(factors[best]), float(gain[best]), float(error[best]), n, float(sure[best]))


def _sure(power: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Lower ends of the gains over blocks drawn anew, (n_factors,); of normal gains those of Student's t."""
    n = power.shape[1]
    drawn = np.random.default_rng(0).multinomial(n, np.full(n, 1.0 / n), size=BLOCK_DRAWS)
    alone = np.maximum(drawn @ power[0], 1e-12 * np.sum(power[0]))
    low = np.quantile(1.0 - (drawn @ power.T) / alone[:, None], 1.0 - SURE_GAIN, axis=0)
    few = student.ppf(SURE_GAIN, n - 1) / norm.ppf(SURE_GAIN) * np.sqrt(n / (n - 1))
    return gain - few * (gain - low)


def _jackknife(moved: np.ndarray) -> np.ndarray:
    """Standard errors from what leaving out one block changes, (n_values, n_blocks)."""
    n = moved.shape[1]
    return np.sqrt((n - 1) / n * np.sum(moved**2, axis=1))
