"""When a search has gone far enough: sets that grow in vain, stacks of names."""

from __future__ import annotations

from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, FAR, HALF_THE_POWER, NEARLY_WHITE
from sksurrogate.gap.fit._evidence import Evidence

#: Sets that leave more than the first share of the gap (amplitude), and of the squared error of one effect less more than the
#: second, are surrogates for what is not in the catalogue: further names close no gap of which several have closed this little.
MUCH_LEFT, HARDLY_LESS = 0.3, 0.7
#: So many names that are not at the noise stand in for one that is missing: no candidate in the place of one of them changes that,
#: and no further name.
STACK = 3


def grows_in_vain(candidate: BaseCandidate, before: BaseCandidate, null: BaseCandidate) -> bool:
    """Whether a set far from the data leaves much of the gap, and its last effect took little of what was left ``before``."""
    return candidate.fit.cost > in_vain_from(before, null)


def in_vain_from(before: BaseCandidate, null: BaseCandidate) -> float:
    """The cost beyond which a set is no better than the one ``before``."""
    return max(MUCH_LEFT**2 * null.fit.cost, HARDLY_LESS * before.fit.cost)


def closes_by_size(candidate: Evidence, tolerated: float) -> bool:
    """Whether a set leaves less than the tolerated squared error (over the noise), further from the data than any noise model holds.

    There sizes tell candidates apart, not likelihoods: along a path that hardly any noise blurs a flexible law follows
    everything, and a limit that has acted shows nothing. A further name is below the practical bar, unless it leads on.
    """
    return candidate.left > FAR and candidate.fit.cost < tolerated


def leaves_most(candidate: Evidence, gap: float) -> bool:
    """Whether a set leaves more than half of a gap (squared error over the noise), and more than any noise."""
    return candidate.left > NEARLY_WHITE and candidate.fit.cost > HALF_THE_POWER**2 * gap


def is_stack(candidate: Evidence) -> bool:
    """Whether so many names leave so much that they stand in for one that is missing."""
    return len(candidate.effects) >= STACK and candidate.left > AT_THE_NOISE
