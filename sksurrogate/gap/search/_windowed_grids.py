"""Sensors that read in steps in a part of the runs: the readings show the steps and the part, whatever the model says."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._onset import starting
from sksurrogate.gap.fit._rounding import QUANTIZATION, windowed_lattice
from sksurrogate.gap.search._expander import Expander
from sksurrogate.gap.search._fit_from_starts import fit_given
from sksurrogate.kernels.record import Record


def windowed_grid(effect: BaseEffect, record: Record, output: int) -> tuple[BaseEffect, np.ndarray] | None:
    """A quantisation within the part of the runs in which its output stands on a grid, with its values; None without one.

    ``output``: number of the output in the record.
    """
    found = windowed_lattice(record, output)
    if found is None:
        return None
    step, first, last = found
    edges = {"onset": first, "end": last}
    span = tuple(name for name, inner in (("onset", first > 0), ("end", last < record.lengths.max())) if inner)
    times = [record.dt * (edges[name] - 0.5) for name in span]  # half way between two readings
    return starting(effect, span), np.r_[step, times]


def look_for_windowed_grids(search: Expander) -> None:
    """Beside what stands, or in the place of a rounding among it: quantisations in the part of the runs where their steps are seen.

    To a likelihood the error of a rounding is noise: it shows in no free run, and the noise need not be uneven for it to be there.
    """
    outputs, record = search.problem.plant.outputs, search.problem.record
    for effect in [one for one in search.library if one.name == QUANTIZATION]:
        found = windowed_grid(effect, record, outputs.index(str(effect.location)))
        if found is None:
            continue
        stands = search.standing.candidate
        same = [
            i for i, one in enumerate(stands.effects) if one.name == QUANTIZATION and one.location == effect.location
        ]
        base = search.without(stands, same[0]) if same else stands
        if base is None:
            continue
        rounded = fit_given(base, [found], base)
        if not rounded:
            continue
        search.remember(rounded)
        top = search.best_polished(rounded)
        worth = search.order([top, stands])
        if 2.0 * (worth(top) - worth(stands)) > search.needed_gain(top.n_parameters - base.n_parameters):
            search.library.append(found[0])
            search.stand(top)
