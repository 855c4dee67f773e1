"""Plants that are disturbed by more than counts as noise: what no candidate follows is taken for the disturbance, and all is asked again.

Far from the data candidates are told apart by how near they come, and a disturbance that pushes the plant decides that. Once its size is
known, likelihoods hold again: a force is part of the noise, and the effect that is there needs less of it than others.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sksurrogate.gap._pipeline import DiagnosisPipeline
from sksurrogate.gap._progress import Progress
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import FAR, HALF_THE_POWER, LARGEST_DISTURBANCE
from sksurrogate.gap.fit._evidence import Evidence, estimate_noise
from sksurrogate.gap.fit._ode import OdeBackend
from sksurrogate.gap.render._notes import disturbed
from sksurrogate.gap.rounds._some_runs import Answer, Begin, asked_again, is_late
from sksurrogate.gap.search._related_forms import hardly_more
from sksurrogate.kernels.disturbance import Noise
from sksurrogate.kernels.record import Record
from sksurrogate.runs import Runs

#: Sets of each number of effects that are compared beside a disturbance: the nearest.
NEAREST = 4


def under_disturbance(begin: Begin, runs: Runs, record: Record, first: Answer, progress: Progress) -> Answer | None:
    """The diagnosis with what the likeliest candidate leaves as a known disturbance.

    None where names or a law explain the gap without it, where less is left than counts as noise anyway, where nothing is named under it
    that comes hardly less near on runs left out than the first answer did, and where what is named closes less of what the simulator misses there than
    the disturbance makes up.

    ``first``: the diagnosis as usual.
    """
    pipeline, report = first
    remains = np.nanmin([report.shrink.after, report.shrink.after_law, np.inf])
    is_open = report.verdict in ("unknown", "partial") and remains >= LARGEST_DISTURBANCE
    if not is_open or not report.complete or is_late(pipeline, progress):
        return None
    left = disturbance_left(pipeline)
    if left is None:
        return None
    pipeline.search.report("under a disturbance of the plant")
    disturbed_record = replace(record, disturbance=np.hypot(record.disturbance, left))
    answer = asked_again(partial(begin, runs, disturbed_record), progress)
    if answer is None:
        return None
    again, said = answer
    after, before = said.shrink.after, said.shrink.before
    if after > HALF_THE_POWER * before or after**2 > hardly_more(remains**2, before**2):
        return None
    note = disturbed(dict(zip(said.outputs, left / record.spread)))
    return again, replace(said, notes=(note, *said.notes), data=report.data)


def disturbance_left(pipeline: DiagnosisPipeline[Any]) -> np.ndarray | None:
    """RMS (n_outputs,) that the likeliest set of effects leaves beside a disturbance of any size.

    None where the noise of the sensors or of usual disturbances makes up what the nearest leaves, where no effect is likelier than none, and
    for a simulator without states: through ``simulate`` alone no force in a balance is known.
    """
    search = pipeline.search
    known = isinstance(search.problem, OdeBackend) and search.fitted and not pipeline.access.other_unit.sentence
    if not known or pipeline.null.left < FAR:
        return None
    by_cost = sorted(search.fitted.values(), key=lambda one: one.fit.cost)
    level = _left(by_cost[0])
    if np.max(level / search.problem.record.spread) < LARGEST_DISTURBANCE:
        return None
    sizes = {len(one.effects) for one in by_cost if one.effects}
    nearest = [one for n in sizes for one in [c for c in by_cost if len(c.effects) == n][:NEAREST]]
    judged = [_beside(one, level, pipeline.null.noise) for one in (pipeline.null.candidate, *nearest)]
    prices = [0.5 * one.candidate.n_parameters * np.log(search.n_values) for one in judged]
    best = max(zip(judged, prices), key=lambda pair: pair[0].log_likelihood - pair[1])[0].candidate
    return _left(best) if best.effects else None


def _left(candidate: BaseCandidate) -> np.ndarray:
    """RMS of the residual (n_outputs,)."""
    return candidate.problem.record.rms(candidate.residual)


def _beside(candidate: Any, level: np.ndarray, start: Noise) -> Evidence[Any]:
    """A candidate where a disturbance moves the outputs by ``level`` (n_outputs,) and more counts as noise."""
    problem = candidate.problem
    known = replace(problem, record=replace(problem.record, disturbance=level))
    if problem.caps is not None:
        more = known.largest_disturbance / problem.largest_disturbance
        known = replace(known, caps=(more * problem.caps[0], more * problem.caps[1]))
    return estimate_noise(known.candidate(candidate.effects, candidate.fit), start)
