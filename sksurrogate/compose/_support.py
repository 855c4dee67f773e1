"""How much of a correction do runs support that it was not fitted to? Pure functions of left-out errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["SHARES", "Support", "block_powers", "supported"]

#: Fewest blocks that a standard error is made of: with eight its own error is a quarter.
FEWEST_BLOCKS = 8
#: Share of the squared error whose removal makes a correction the rule and the simulator the exception.
CLEARLY_CLOSED = 0.5
#: Shares of a correction that are compared: a step of a twentieth costs at most a 400th of the squared gap.
SHARES = np.linspace(0.0, 1.0, 21)


@dataclass(frozen=True)
class Support:
    """The share of a correction that left-out blocks support.

    Attributes
    ----------
    factor : float
        Between 0 (the simulator alone) and 1 (the whole correction).
    closed : float
        Share of the simulator's squared error on left-out blocks that the correction removes at this factor.
    standard_error : float
        Of ``closed``, from leaving out one block after the other (jackknife).
    n_blocks : int
    """

    factor: float
    closed: float
    standard_error: float
    n_blocks: int


def block_powers(errors: list[np.ndarray]) -> np.ndarray:
    """Sums of squares over blocks of rows: (n_factors, n_blocks, n_outputs).

    Parameters
    ----------
    errors : list of ndarray (n_factors, n_rows, n_outputs)
        One a left-out piece. Few pieces are cut, so that there are at least ``FEWEST_BLOCKS`` blocks.
    """
    cuts = max(1, -(-FEWEST_BLOCKS // max(len(errors), 1)))
    blocks = [part for error in errors for part in np.array_split(error, min(cuts, error.shape[1]), axis=1)]
    with np.errstate(over="ignore", invalid="ignore"):
        powers = np.stack([np.sum(np.square(part), axis=1) for part in blocks], axis=1)
    return np.where(np.isfinite(powers), powers, np.inf)


def supported(power: np.ndarray, factors: np.ndarray) -> Support:
    """The factor whose gain, less one standard error of it, is largest; 0 where no factor gains more than its error.

    The correction of all runs is better than those of the folds, which learned from fewer. So the whole correction is kept
    where it removes more than half of the squared error for certain (one standard error) and no smaller share is better by
    more than one standard error of the difference.

    The gain of a factor is ``1 - sum_b P_b(factor) / sum_b P_b(0)``. Its standard error is the jackknife's over blocks:
    it vanishes where all blocks gain the same share, whatever their sizes, and is as large as the gain where one block
    alone gains.

    Parameters
    ----------
    power : ndarray (n_factors, n_blocks)
        Squared error of every block at every factor.
    factors : ndarray (n_factors,)
        From 0 on.

    Examples
    --------
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
        lower = gain - _jackknife(rest - gain[:, None])
    lower = np.where(np.isfinite(lower), lower, -np.inf)
    best, whole = int(np.argmax(lower)), len(factors) - 1
    if not lower[best] > 0.0:
        return Support(0.0, 0.0, 0.0, n)
    if lower[whole] > CLEARLY_CLOSED:
        behind = gain[best] - gain[whole]
        if behind <= _jackknife((rest[best] - rest[whole] - behind)[None])[0]:
            best = whole
    return Support(float(factors[best]), float(gain[best]), float(gain[best] - lower[best]), n)


def _jackknife(moved: np.ndarray) -> np.ndarray:
    """Standard errors from what leaving out one block changes, (n_values, n_blocks)."""
    n = moved.shape[1]
    return np.sqrt((n - 1) / n * np.sum(moved**2, axis=1))
