"""How a diagnosis begins: the backend that a simulator's access allows, its search, and the questions about what has no name."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from sksurrogate._parallel._pickled import can_be_shared
from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.effects._allowed import allowed_effects, closed_places
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import build_effects, left_out
from sksurrogate.effects._input import RememberingActuator, rounding_down
from sksurrogate.effects._levelling import levelled
from sksurrogate.effects._sensor import SensorDelay
from sksurrogate.effects._still import driven_effects
from sksurrogate.effects._structure import kinematic_states
from sksurrogate.effects._unsettled import in_motion
from sksurrogate.exceptions import SimulatorError, SurrogateError
from sksurrogate.gap._pipeline import DiagnosisPipeline
from sksurrogate.gap._progress import Progress
from sksurrogate.gap._state import Settings
from sksurrogate.gap.decide._access import BaseAccess
from sksurrogate.gap.decide._ode_access import OdeAccess
from sksurrogate.gap.decide._trajectory_access import TrajectoryAccess
from sksurrogate.gap.fit._build import build_problem, build_trajectory
from sksurrogate.gap.fit._evidence import C
from sksurrogate.gap.fit._jumps import JUMPS_NOTE, rows_that_jump, starts_behind
from sksurrogate.gap.fit._known_parameters import KnownParameters
from sksurrogate.gap.fit._neighbours import is_near
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.fit._other_unit import other_unit
from sksurrogate.gap.fit._record_parts import excerpt, searched_samples
from sksurrogate.gap.fit._rounding import rounds_a_display
from sksurrogate.gap.fit._trajectory import TrajectoryBackend, TrajectoryCandidate
from sksurrogate.gap.fit._unstable import UNSTABLE_NOTE, followed_rows, in_pieces, largest_growth
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.search._trajectory_search import TrajectorySearch
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._not_finite import finite_along
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Runs

#: Seconds of a call from which some thousand calls take several minutes.
SLOW_CALL = 0.1


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked, checked."""

    diagnoser: Settings
    plant: Plant
    runs: Runs
    whole: Record  #: All of the runs
    free: tuple[str, ...]  #: Parameters that are re-tuned
    known: KnownParameters
    seed: int
    progress: Progress

    @property
    def labels(self) -> list[Any]:
        """Of the runs."""
        return [run.label for run in self.runs]

    @cached_property
    def effects(self) -> Any:
        """Candidates as they were asked for."""
        asked = self.diagnoser.effects
        return list(asked) if isinstance(asked, Iterator) else asked


def begin_ode(task: Task) -> DiagnosisPipeline[OdeCandidate]:
    """Of a simulator with a right-hand side or a step."""
    plant, whole, diagnoser = task.plant, task.whole, task.diagnoser
    searched = searched_samples(len(whole.y))
    record, rows = excerpt(whole, searched)
    model = PlantModel(plant)
    model.probe(record.u[:, 0])
    _say_slow(model, record)
    kinematic = kinematic_states(model)
    balances = tuple(name for name in plant.states if name not in kinematic) or plant.states
    library = _allowed(_candidates(task, balances), task)
    with _right_unit(model, record), finite_along(model, whole, task.labels):
        build = partial(build_problem, model, free=task.free, balances=balances, known=task.known)
        problem, smoothed = build(record)
        pieces = []
        if rows_that_jump(problem, smoothed.x).any():
            path = smoothed.x if len(rows) == whole.n_samples else build(whole)[1].x
            whole = whole.cut(starts_behind(rows_that_jump(replace(problem, record=whole), path), whole.starts))
            record, rows = excerpt(whole, searched)
            problem, smoothed = build(record, path=path[:, rows])
            pieces.append(JUMPS_NOTE.format(n=len(whole.starts) - len(task.labels)))
        most = largest_growth(problem.sd, record.spread)
        length = followed_rows(smoothed.A, problem.scale, record.starts, most)
        if length is not None:
            whole = in_pieces(whole, length)
            record, rows = excerpt(whole, searched)
            problem, smoothed = build(record)
            pieces.append(UNSTABLE_NOTE.format(rows=int(whole.lengths.max())))
    fixed = diagnoser.simulator, plant, model, record, *library
    apart = diagnoser.n_jobs is None and can_be_shared(diagnoser.simulator, library)
    common = {**_common(task), "second": WorkerProcess(fixed, apart)}
    later = WorkerProcess(fixed, apart, later=True)
    late = {e.key: e for e in library if e.late or (task.effects is None and _acts_from_afar(e, problem))}
    late = late if len(late) < len(library) else {}  # effects that were asked for alone are asked at once
    search = OdeSearch(problem, library, smoothed.x, lost=model.raised, later=later, later_asked=late, **common)
    closed = closed_places(diagnoser.exclude, diagnoser.plausible, plant)
    access = OdeAccess(search, task.seed, whole, closed, pieces)
    return _prepared(task, search, access, rows)


def begin_trajectory(task: Task) -> DiagnosisPipeline[TrajectoryCandidate]:
    """Of a simulator with ``simulate`` alone; SimulatorError where none of the effects that were asked for can be tested."""
    plant, whole, effects = task.plant, task.whole, task.effects
    wanted = [e for e in _candidates(task, ()) if e.access == "trajectory"]
    _check_asked(plant, effects, wanted)
    with np.errstate(all="ignore"):
        problem = build_trajectory(plant, whole, task.free, task.labels, task.known)
    testable = _testable(problem, wanted)
    _check_asked(plant, effects, testable)
    library = _allowed(testable, task)
    search = TrajectorySearch(problem, library, lost=problem.simulations.raised, **_common(task))
    closed = closed_places(task.diagnoser.exclude, task.diagnoser.plausible, plant)
    access = TrajectoryAccess(search, task.seed, len(testable) < len(wanted), closed)
    return _prepared(task, search, access, np.arange(whole.n_samples), left_out(effects, testable))


def _say_slow(model: PlantModel, record: Record) -> None:
    """Warn where one call takes :data:`SLOW_CALL` seconds, before minutes go by."""
    seconds = model.seconds_of_a_call(record.u[:, record.starts])
    if seconds > SLOW_CALL:
        warnings.warn(
            f"One call of the simulator's {model.plant.access} takes {seconds:.1f} s, and a diagnosis makes some thousand calls; the "
            "comparison of the simulator with the data, some hundred calls, is finished whatever time_limit says. Let it take many "
            "points at once (x of shape (n_states, n_points)), leave out what only matters to other results, or give a fast model "
            "of it: sksurrogate.compose.StateSpaceRegressor, fitted to its runs.",
            RuntimeWarning,
            stacklevel=2,
        )


def _acts_from_afar(effect: BaseEffect, problem: OdeBackend) -> bool:
    """Whether a signal that drives an effect is far from the balance in which it acts, or an input that a sensor shows past the plant."""
    if effect.kind == "output":
        return effect.variable in problem.plant.inputs
    return effect.kind == "state" and not is_near(problem.near, effect.location, effect.signals)


def _candidates(task: Task, balances: Sequence[str]) -> list[BaseEffect]:
    """All effects, and further forms of some.

    A memory may be in motion where a run begins, or an actuator at rest before a first step; a sensor may be early where clocks are
    apart; a drift may level off, and a quantizer round down.
    """
    earliest, record = -float(task.diagnoser.clock_offset), task.whole
    duration = float(record.dt * np.max(record.lengths))
    stepped = {name for name, u in zip(task.plant.inputs, record.u) if np.any(u[record.starts])}
    found: list[BaseEffect] = []
    for one in build_effects(task.plant, balances, task.effects):
        if type(one) is SensorDelay and earliest < one.earliest:
            one = SensorDelay(one.location, one.variable, earliest)
        found.append(one)
        if isinstance(one, RememberingActuator) and one.before is None and one.location in stepped:
            found.append(type(one)(one.location, one.variable, before=0.0))
        further = levelled(one, duration), rounding_down(one), in_motion(one, task.plant)
        found += [form for form in further if form is not None]
    return found


def _allowed(effects: list[BaseEffect], task: Task) -> list[BaseEffect]:
    """Effects that neither the user nor the record rules out: not of inputs that stand still and, unless asked for, not the rounding of a display."""
    library = allowed_effects(effects, task.diagnoser.exclude, task.diagnoser.plausible, task.plant)
    driven = driven_effects(library, task.effects, task.plant, task.whole)
    if task.effects is not None:
        return driven
    return [effect for effect in driven if not rounds_a_display(effect, task.plant, task.whole)]


def _common(task: Task) -> dict[str, Any]:
    """Options that every search gets."""
    diagnoser = task.diagnoser
    return {"tolerance": float(diagnoser.tolerance), "n_jobs": diagnoser.n_jobs, "report": task.progress.say}


def _prepared(
    task: Task, search: BaseSearch[C], access: BaseAccess[C], rows: np.ndarray, untestable: Sequence[str] = ()
) -> DiagnosisPipeline[C]:
    """All stages of a search."""
    n_samples = search.problem.record.n_samples
    task.progress.begin()
    task.progress.say(f"{len(search.library)} candidates on {n_samples} samples of {len(task.runs)} run(s)")
    return DiagnosisPipeline(task.diagnoser, search, access, task.labels, rows, untestable)


@contextmanager
def _right_unit(model: PlantModel, record: Record) -> Iterator[None]:
    """Where the simulator fails along the data, the error says whether another unit would do."""
    try:
        yield
    except SimulatorError as error:
        raise type(error)(f"{str(error).rstrip('.')}. {other_unit(model, record).sentence}".rstrip()) from error


def _check_asked(plant: Plant, effects: Any, kept: list[BaseEffect]) -> None:
    """Say so where no effect that was asked for can be tested."""
    asked = left_out(effects, kept)
    if kept or not asked:
        return
    name = type(plant.simulator).__name__
    raise SimulatorError(
        f"effects={asked}: none of them can be tested with {name}, which gives trajectories only; expected one or more on its "
        "inputs (where it answers others than those in X), outputs or parameters, for example effects=['sensor_bias']. "
        "Leave effects out for all of these, or give the simulator rhs or step."
    )


def _testable(problem: TrajectoryBackend, effects: list[BaseEffect]) -> list[BaseEffect]:
    """Effects that this simulator lets one try: a table knows its own inputs only."""
    u = problem.record.u
    middle = u.mean(axis=1, keepdims=True)
    other = np.where(np.ptp(u, axis=1, keepdims=True) > 0, middle + 0.99 * (u - middle), u + 1e-6)  # in their range
    try:
        problem.simulations.simulated(other, {}, problem.x0)
    except SurrogateError:
        return [effect for effect in effects if effect.kind != "input"]
    except Exception:  # a candidate that fails is lost, not all on the inputs
        return effects
    return effects
