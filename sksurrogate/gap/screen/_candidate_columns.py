"""The columns of the screen: every candidate at all its starting values, some in a second process where one is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sksurrogate._parallel._parallel_map import side_by_side
from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._probe import probe_of
from sksurrogate.gap.screen._responses import LARGEST_CHANGE, Responses
from sksurrogate.gap.screen._shortlist import Shortlist
from sksurrogate.gap.screen._slopes import Slopes
from sksurrogate.gap.screen._unseen_starts import moved_through, unseen_starts

#: Numbers of the states at all samples that are integrated at once: two megabytes, and a few temporary arrays of this size.
AT_ONCE = 250_000


@dataclass(frozen=True, eq=False)
class Column:
    """One candidate at one starting value."""

    effect: BaseEffect
    theta: np.ndarray  #: (n_parameters,)
    column: np.ndarray  #: (n_outputs, n_samples): the change of the outputs that it causes
    hidden: np.ndarray | None  #: (n_hidden, n_samples): its hidden states along the smoothed trajectory
    evident: bool  #: Whether the measurements show it whatever the model says
    through: np.ndarray  #: (n_unseen, n_outputs, n_samples): what unseen initial states do through it


#: A column but its effect: what travels between processes.
_Message = tuple[np.ndarray, np.ndarray, np.ndarray | None, bool, np.ndarray]


def largest(change: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Largest change over the noise of any output, (n_starts,), of changes (n_outputs, n_starts, n_samples); nan where one is nan.

    >>> largest(np.array([[[1.0, -3.0], [0.0, np.nan]], [[0.5, 0.0], [1.0, 1.0]]]), np.array([2.0, 0.1]))
    array([ 5., nan])
    """
    return np.asarray(np.max(np.maximum(change.max(axis=2), -change.min(axis=2)) / sd[:, None], axis=0))


@dataclass(frozen=True, eq=False)
class CandidateColumns:
    """Candidates at all their starting values, those with one shape, or those of a short list."""

    s: Responses  #: The linearisation of the base
    #: Second and further parameters, where they are known, instead of those of the starting values
    shape: tuple[float, ...]
    chosen: Shortlist | None  #: Starting values by the effect's key
    #: Of the starting magnitude, for effects that are linear in theirs: a small one gives the slope also where the plant is not linear
    share: float = 1.0

    @cached_property
    def unseen(self) -> np.ndarray:
        """Initial states that the base does not show."""
        return unseen_starts(self.s)

    @cached_property
    def slopes(self) -> Slopes:
        """Slopes of the log likelihood in the signals."""
        return Slopes(self.s)

    def of_all(self, candidates: Sequence[BaseEffect], second: WorkerProcess | None) -> list[Column]:
        """The columns of several candidates, with another process where there is one."""
        found = side_by_side(self.of, candidates, second)
        for effect in [effect for effect, columns in zip(candidates, found) if columns is None]:
            self.ask_why(effect)
        return [Column(effect, *message) for effect, columns in zip(candidates, found) for message in columns or ()]

    def of(self, effect: BaseEffect) -> list[_Message] | None:
        """Its columns; None where the model has no number for any."""
        s = self.s
        starts, n_evident = self.starts(effect)
        if not starts:
            return []
        theta = np.array(starts, dtype=float).reshape(len(starts), len(effect.parameters)).T
        out, paths = self.responses(effect, theta)
        size = largest(out, s.problem.sd)
        refused = np.flatnonzero(~(size < LARGEST_CHANGE)).tolist()
        other_sign = effect.linear and effect.either_sign(s.problem.plant.inputs)
        if refused and other_sign:  # with which it may be in range
            theta[0, refused] *= -1.0
            out[:, refused], others = self.responses(effect, theta[:, refused])
            paths = [others[refused.index(k)] if k in refused else path for k, path in enumerate(paths)]
            size = largest(out, s.problem.sd)
        if np.isnan(size).all():
            return None
        columns, n = np.ascontiguousarray(out.transpose(1, 0, 2)), len(s.smoothed.x)
        return [
            (
                theta[:, k],
                columns[k],
                paths[k][n:].copy() if len(paths[k]) > n else None,
                bool(k < n_evident) and not self.shape,
                moved_through(s, self.unseen, effect, theta[:, k]),
            )
            for k in np.flatnonzero((size > 0.0) & (size < LARGEST_CHANGE))
        ]

    def ask_why(self, effect: BaseEffect) -> None:
        """Let the model take up what the simulator gives at the first starting value."""
        with self.s.problem.model.watched():
            self.responses(effect, np.array(self.starts(effect)[0][:1], dtype=float).T)

    def responses(self, effect: BaseEffect, theta: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """What :meth:`Responses.columns` gives, some starting values at a time: memory does not grow with their number."""
        at_once, record = max(AT_ONCE // self.s.smoothed.x.size, 1), self.s.problem.record
        out, paths = np.empty((len(record.y), theta.shape[1], record.n_samples)), []
        for a in range(0, theta.shape[1], at_once):
            out[:, a : a + at_once], along = self.s.columns(effect, theta[:, a : a + at_once])
            paths += along
        return out, paths

    def starts(self, effect: BaseEffect) -> tuple[list[tuple[float, ...]], int]:
        """Starting values, and how many of the first are evident."""
        s, chosen = self.s, self.chosen
        evident, starts = [], [] if chosen is None else chosen.get(effect.key, [])
        jumps = bool(effect.scan(tuple(1.0 for _ in effect.parameters)))
        if chosen is None or effect.kind == "output" or jumps:
            probe = probe_of(s.problem, effect, s.smoothed.x, s.problem.rate, self.slopes.of if jumps else None)
            evident = effect.evident(probe)
            starts = effect.starts(probe) if chosen is None or jumps else starts
        starts = list(dict.fromkeys([*evident, *starts]))
        if self.shape:
            starts = list(dict.fromkeys((start[0], *self.shape) for start in starts))
        if effect.linear:
            starts = [(self.share * start[0], *start[1:]) for start in starts]
        return starts, len(evident)
