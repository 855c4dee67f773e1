"""Every named effect with its parameters, intervals, share, probability, and the effects that cannot be distinguished from it."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._ports import at_port
from sksurrogate.gap.decide._equivalence import Slot
from sksurrogate.gap.decide._equivalence import richer as richer_form
from sksurrogate.gap.decide._experiment import name_of, when_they_part
from sksurrogate.gap.decide._partial_results import PartialResults
from sksurrogate.gap.decide._reported import reported
from sksurrogate.gap.fit._evidence import C, Evidence
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.search._base import BaseSearch

__all__ = ["estimates"]


def estimates(search: BaseSearch[C], final: Evidence[C], found: PartialResults, among: str) -> list[EffectEstimate]:
    """The effects of what stands, in the order of the search; nan for what is not known yet."""
    best = found.fitted or final
    low, high = found.bounds or (final.fit.theta * np.nan, final.fit.theta * np.nan)
    out = []
    for i, effect in enumerate(final.effects):
        rows = final.candidate.slice_of(i)
        slot = found.slots[i] if i < len(found.slots) else Slot(i, [], [])
        params, ends = reported(effect, best.fit.theta[rows], low[rows], high[rows])
        ahead = [candidate.effects[-1] for candidate in slot.twins if richer_form(candidate.effects[-1], effect)]
        others = [candidate.effects[-1] for candidate in slot.twins if candidate.effects[-1] not in ahead]
        tied = [name_of(other) for other in others]
        twins = [k for twin in slot.twins if (k := twin.effects[-1].key) not in final.candidate.keys]
        contained = [*(form.key for form in ahead), *search.richer.get(effect.key, [])]
        richer = [k for k in dict.fromkeys(contained) if k not in final.candidate.keys]
        out.append(
            EffectEstimate(
                effect.name,
                str(effect.location),
                effect.variable,
                float(found.shares[i]) if found.shares else float("nan"),
                params,
                ends,
                found.probabilities[i] if found.probabilities else float("nan"),
                [(str(k[0]), str(k[1]), k[2]) for k in dict.fromkeys([*twins, *richer])],
                when_they_part(
                    name_of(effect), tied, all(slot.identical), found.experiment, sorted({k[0] for k in richer}), among
                ),
                [(str(k[0]), str(k[1]), k[2]) for k in richer],
                at_port(effect, search.problem.plant),
            )
        )
    return out
