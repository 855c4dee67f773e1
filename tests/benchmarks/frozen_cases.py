"""The cases that are frozen: blind cases by seed, some of them through ``simulate`` alone, the recordings, the demo."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from recordings import NAMES, problem

from sksurrogate import demo
from sksurrogate.blind import PLANTS, draw
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import BaseSimulator

__all__ = ["CASES", "Asked", "Task"]

#: Seed of all blind cases.
SEED = 30
#: Arm -> number of cases, the arms in which the diagnosis takes longest less often.
COUNTS = {
    "none": 27, "unexcited": 27, "coloured": 27, "disturbed": 27, "effect": 28, "time": 27, "region": 27, "sizes": 27,
    "weak": 27, "detuned": 28, "effect_disturbed": 28, "two": 28, "outside": 24, "outside_disturbed": 24, "novel": 24,
}  # fmt: skip
#: Plants, from those whose diagnosis is quick to those where it is slow.
ORDER = (
    "reactor", "vehicle", "rlc_circuit", "oscillator", "cascaded_tanks", "cooled_reactor", "two_rooms", "pendulum",
    "battery", "mixing_tank", "heat_exchanger", "dc_motor", "two_mass_drive", "bioprocess", "quarter_car",
)  # fmt: skip
#: Blind cases of plants with two or three states, by arm, asked once more through ``simulate`` alone: most with an effect on an
#: input, a sensor or a parameter, or with none.
AGAIN: dict[str, tuple[int, ...]] = {
    "none": (4, 7, 9, 11), "unexcited": (2, 3, 9, 10), "coloured": (2, 4, 5, 9, 11), "disturbed": (3, 6, 7, 10),
    "effect": (2, 3, 8, 11), "time": (5, 6, 7, 8, 9), "region": (4, 6, 8), "sizes": (3, 5, 9, 10),
    "weak": (4, 5, 6, 7, 9, 11), "detuned": (2, 3, 7, 8, 10), "effect_disturbed": (2, 4, 8), "two": (5, 6, 8),
    "outside": (2, 3, 5, 7), "outside_disturbed": (4, 6, 10), "novel": (2, 3, 4),
}  # fmt: skip


@dataclass(frozen=True)
class Asked:
    """A diagnosis that is ready to be made: ``diagnose`` gives the report; ``facts`` say what it is about."""

    diagnose: Callable[[], Any]
    facts: dict[str, Any]


@dataclass(frozen=True)
class Task:
    """A case of the list; ``prepare`` draws or reads it."""

    id: str
    group: str
    facts: dict[str, Any]
    prepare: Callable[[], Asked]


class SimulateAlone(BaseSimulator):
    """A simulator of which nothing is reached but its free runs, its names and its parameters.

    Several runs go at once through ``simulate_batch``: the answers are about the diagnosis, not about the integrator's speed.
    """

    def __init__(self, hidden: Any, with_start: bool):
        self.hidden = hidden
        self.with_start = with_start
        self.inputs, self.outputs, self.dt, self.hold = hidden.inputs, hidden.outputs, hidden.dt, hidden.hold
        self.params = dict(hidden.params)
        if with_start:
            self.x0 = list(hidden.x0)

    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run."""
        return np.asarray(self._tuned().simulate(U, x0, t))

    def simulate_batch(self, U: Any, X0: Any = None, t: Any = None) -> np.ndarray:
        """Free runs of runs of one length."""
        return np.asarray(self._tuned().simulate_batch(U, X0, t))

    def _tuned(self) -> Any:
        """The simulator behind, with the present parameters."""
        return self.hidden.set_params(**{f"params__{name}": value for name, value in self.params.items()})


def entropy(k: int) -> int:
    """Entropy of case k, as ``run_blind_check`` has it."""
    return int(np.random.SeedSequence([SEED, k]).generate_state(1, np.uint64)[0])


def fingerprint(*arrays: Any) -> str:
    """Twelve hexadecimal digits that stand for the data."""
    return hashlib.sha256(b"".join(np.ascontiguousarray(a, dtype=float).tobytes() for a in arrays)).hexdigest()[:12]


def diagnosed(simulator: Any, X: Any, y: Any, groups: Any, free: Any = (), effects: Any = None) -> Any:
    """The report of a diagnosis in one process."""
    diagnoser = GapDiagnoser(simulator, effects=effects, free_params=free, n_jobs=1, random_state=0)
    return diagnoser.fit(X, y, groups=groups).report_


def blind(arm: str, plant: str, k: int, alone: bool) -> Asked:
    """A blind case; every other one through ``simulate`` alone gives its nominal start."""
    case = draw(arm, entropy(k), plant=PLANTS[plant])
    question = case.question
    simulator, effects = question.simulator, question.effects
    if alone:
        simulator = SimulateAlone(simulator, with_start=k % 2 == 0)
    facts = {
        "truths": [[truth.name, truth.location, truth.variable] for truth in case.truths],
        "data": fingerprint(question.X, question.y, question.groups),
    }
    asked = (simulator, question.X, question.y, question.groups, question.free_params, effects)
    return Asked(partial(diagnosed, *asked), facts)


def recorded(name: str) -> Asked:
    """A recording."""
    one = problem(name)
    asked = (one.simulator, one.X, one.y, one.groups, one.free)
    return Asked(partial(diagnosed, *asked), {"data": fingerprint(one.X, one.y, one.groups)})


def summary(story: str) -> Asked:
    """A story of the demo."""
    demo.GapDiagnoser = partial(GapDiagnoser, n_jobs=1)  # type: ignore[misc, assignment]
    return Asked(lambda: getattr(demo, story)().report, {})


def _blind_task(arm: str, k: int) -> Task:
    """Case k of an arm: each plant once, then on from another plant in each arm."""
    arms, n = list(COUNTS), len(ORDER)
    plant = ORDER[k % n if k < n else (k + arms.index(arm)) % n]
    facts = {"arm": arm, "plant": plant, "seed": entropy(k), "access": "rhs"}
    return Task(f"blind/{arm}/{k:02d}", arm, facts, partial(blind, arm, plant, k, False))


def _again(task: Task) -> Task:
    """The same case through ``simulate`` alone."""
    arm, plant, k = task.facts["arm"], task.facts["plant"], int(task.id.rsplit("/", 1)[1])
    facts = {**task.facts, "access": "trajectory"}
    return Task(task.id.replace("blind/", "alone/"), "alone", facts, partial(blind, arm, plant, k, True))


def _cases() -> tuple[Task, ...]:
    """All of them; the blind ones in rounds over the arms."""
    rounds = range(max(COUNTS.values()))
    blinds = [_blind_task(arm, k) for k in rounds for arm, count in COUNTS.items() if k < count]
    known = {task.id: task for task in blinds}
    alone = [_again(known[f"blind/{arm}/{k:02d}"]) for arm, numbers in AGAIN.items() for k in numbers]
    stories = [
        Task(f"demo/{name}", "demo", {"access": "rhs"}, partial(summary, f"story_{name}"))
        for name in ("actuator_and_sensor", "linearised")
    ]
    names = NAMES if os.environ.get("SKSURROGATE_DATA") else ()
    real = [Task(f"recording/{name}", "recording", {"access": "rhs"}, partial(recorded, name)) for name in names]
    return (*blinds, *alone, *stories, *real)


#: Every case, in the order in which it is asked.
CASES = _cases()
