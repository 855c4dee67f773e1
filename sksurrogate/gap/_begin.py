"""How a diagnosis begins: the search that a simulator's access allows, and what can be asked inside; again on a record without its faults."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.effects._catalogue import build_effects, kinematic_states, left_out
from sksurrogate.effects._effect import BaseEffect
from sksurrogate.effects._exclude import excluded_places, without_excluded
from sksurrogate.effects._still import driven_effects
from sksurrogate.exceptions import SimulatorError, SurrogateError
from sksurrogate.gap._pipeline import DiagnosisPipeline
from sksurrogate.gap._progress import Progress
from sksurrogate.gap.decide._inside_ode import OdeInside
from sksurrogate.gap.decide._inside_trajectory import TrajectoryInside
from sksurrogate.gap.faults._book import first_look
from sksurrogate.gap.fit._build import build_problem, build_trajectory
from sksurrogate.gap.fit._known_parameters import KnownParameters
from sksurrogate.gap.fit._record_parts import SEARCHED_SAMPLES, excerpt
from sksurrogate.gap.fit._time_unit import other_unit_of_time
from sksurrogate.gap.fit._trajectory import TrajectoryBackend
from sksurrogate.gap.render._report import GapReport
from sksurrogate.gap.search._search import Search
from sksurrogate.gap.search._trajectory_search import TrajectorySearch
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._not_finite import finite_along
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Runs

__all__ = ["Task", "diagnosed"]


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked, checked."""

    diagnoser: Any
    effects: Any  #: Candidates as they were asked for
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

    @property
    def for_search(self) -> dict[str, Any]:
        """What every search is told."""
        diagnoser = self.diagnoser
        tolerance = float(diagnoser.tolerance)
        return {"tolerance": tolerance, "n_jobs": diagnoser.n_jobs, "report": self.progress.say}

    def pipeline(self, search: Any, inside: Any, rows: np.ndarray, **more: Any) -> DiagnosisPipeline[Any]:
        """All stages."""
        n_samples = search.problem.record.n_samples
        self.progress.say(f"{len(search.library)} candidates on {n_samples} samples of {len(self.runs)} run(s)")
        asked = {name: getattr(self.diagnoser, name) for name in ("correction", "time_limit", "include_law")}
        return DiagnosisPipeline(search, inside, self.labels, rows, **asked, **more)

    def candidates(self, effects: list[BaseEffect]) -> list[BaseEffect]:
        """Effects that are not ruled out, by the user or by inputs that stand still."""
        library = without_excluded(effects, self.diagnoser.exclude, self.plant)
        return driven_effects(library, self.effects, self.plant, self.whole)


def diagnosed(task: Task) -> tuple[DiagnosisPipeline[Any], GapReport]:
    """Diagnose, and again as long as a fault of the record is found; the pipeline of the last round."""
    book = first_look(task.plant, task.runs, task.whole)
    begin = begin_trajectory if task.plant.access == "trajectory" else begin_ode
    while True:
        pipeline = begin(replace(task, whole=book.record))
        pipeline.book = book
        with pipeline.search.second, pipeline.search.later:
            report = pipeline.run(task.progress)
        if report is not None:
            return pipeline, report
        book = pipeline.book


def begin_ode(task: Task) -> DiagnosisPipeline[Any]:
    """Of a simulator with a right-hand side or a step."""
    diagnoser, plant, whole = task.diagnoser, task.plant, task.whole
    record, rows = excerpt(whole, SEARCHED_SAMPLES)
    model = PlantModel(plant)
    model.probe(record.u[:, 0])
    kinematic = kinematic_states(model)
    balances = tuple(name for name in plant.states if name not in kinematic) or plant.states
    library = task.candidates(build_effects(plant, balances, task.effects))
    with _right_unit(model, record), finite_along(model, whole, task.labels):
        problem, smoothed = build_problem(plant, model, record, task.free, balances, task.known)
    fixed, apart = (diagnoser.simulator, plant, model, record, *library), diagnoser.n_jobs is None
    second, later = WorkerProcess(fixed, apart), WorkerProcess(fixed, apart, later=True)
    common = {**task.for_search, "second": second, "later": later, "lost": model.said}
    search = Search(problem, library, smoothed.x, **common)
    inside = OdeInside(search, task.seed, whole, excluded_places(diagnoser.exclude))
    return task.pipeline(search, inside, rows)


@contextmanager
def _right_unit(model: PlantModel, record: Record) -> Iterator[None]:
    """Where the simulator fails along the data, the error says whether another unit of time would do."""
    try:
        yield
    except SimulatorError as error:
        raise type(error)(f"{error} {other_unit_of_time(model, record)}".rstrip()) from error


def begin_trajectory(task: Task) -> DiagnosisPipeline[Any]:
    """Of a simulator with ``simulate`` alone.

    Raises
    ------
    SimulatorError
        None of the effects that were asked for can be tested.
    """
    plant, whole = task.plant, task.whole
    wanted = [e for e in build_effects(plant, (), task.effects) if e.access == "trajectory"]
    _check_asked(plant, task.effects, wanted)
    with np.errstate(all="ignore"):
        problem = build_trajectory(plant, whole, task.free, task.labels, task.known)
    testable = _testable(problem, wanted)
    _check_asked(plant, task.effects, testable)
    library = task.candidates(testable)
    search = TrajectorySearch(problem, library, lost=problem.simulations.raised, **task.for_search)
    inside = TrajectoryInside(search, task.seed, only_given=len(testable) < len(wanted))
    return task.pipeline(search, inside, np.arange(whole.n_samples), untestable=left_out(task.effects, testable))


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
