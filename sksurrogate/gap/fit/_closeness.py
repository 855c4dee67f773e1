"""How far a free run is from the data: every level at which the diagnosis changes its question, once.

Levels of ``Evidence.left``, the RMS of the residual over the sensor noise of the fit (the worst output), nearest first.
"""

#: At the noise: no other set is looked for beside a name, names leave no law, and the law in their place is not asked for.
#: Many names that leave more stand in for one that is missing. A simulator this near has no gap that a correction could learn.
AT_THE_NOISE = 1.02
#: Names this near are all, where no further effect passes: pairs are not tried. Nothing is left to place: a rough look at the
#: places will do, and a noise fit has taken no law for a force.
SETTLED = 1.15
#: A residual below this may be white noise; up to here pairs are tried where no further effect passes.
NEARLY_WHITE = 1.5
#: From here on the places of a gap are distinguished by the law that fits there, and a certain curve adds no name.
NEAR = 2.0
#: Far from the data: no noise model holds, and candidates are distinguished by size.
FAR = 5.0

# Share of the gap, in amplitude.
#: What leaves more than this leaves most of the gap.
MOST_LEFT = 0.5
#: Names that leave more than this explain less of the gap's power than they leave. Such names do not stand: they fall before they are
#: weighed, or at their certificate.
HALF_THE_POWER = 0.5**0.5
#: A disturbance that moves an output by more than this share of its deviation is not waved through as noise.
LARGEST_DISTURBANCE = 0.10

# Standard deviations.
#: Chance alone leaves a mean by more than this once in several hundred cases.
BEYOND_CHANCE = 3.0

# Levels of the cost over the number of measured values.
#: Sizes, not likelihoods, tell candidates apart; a limit is fitted from another start too.
FAR_BY_COST = 5.0
#: Bases further off are screened with all starting values, and fitted again.
OUT_OF_SIGHT = 100.0


def is_at_noise(cost: float, n_values: int) -> bool:
    """Whether a fit leaves no more than the noise.

    >>> is_at_noise(1040.0, 1000), is_at_noise(1041.0, 1000)
    (True, False)
    """
    return cost <= AT_THE_NOISE**2 * n_values


def below_noise(left: float, n_values: int) -> bool:
    """Whether a fit leaves less than the noise would by chance: the noise is at its least, and what is left is of the numerics.

    >>> below_noise(0.97, 1000), below_noise(0.9, 1000)
    (False, True)
    """
    return left**2 < 1.0 - BEYOND_CHANCE * (2.0 / n_values) ** 0.5


def worth_following(best: float, n_values: int) -> float:
    """The cost that a fit must come to beside the ``best`` so far: near it, or to the noise where that is there.

    >>> worth_following(5000.0, 1000), worth_following(1001.0, 1000)
    (15000.0, 1040.4)
    """
    return AT_THE_NOISE**2 * n_values if is_at_noise(best, n_values) else 3.0 * best
