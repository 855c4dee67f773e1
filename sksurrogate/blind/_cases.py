"""A case: a plant, what is wrong with its simulator, the experiments; drawn from entropy."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.blind._big_plants import BIG_PLANTS
from sksurrogate.blind._choose import Chosen, Setting, as_truth, choose, disturbance, fine, make_setting, sized
from sksurrogate.blind._excite import initial_states, inputs
from sksurrogate.blind._gap import gap_beyond
from sksurrogate.blind._inexact import INEXACT
from sksurrogate.blind._march import Course, march
from sksurrogate.blind._plants import PLANTS, PlantSpec
from sksurrogate.blind._readings import readings
from sksurrogate.blind._truths import KINDS, Truth, remaining
from sksurrogate.exceptions import SurrogateError

#: Arm -> (what it asks, the right verdict).
ARMS: dict[str, tuple[str, str]] = {
    "effect": ("one effect", "explained"),
    "two": ("two effects", "explained"),
    "three": ("three effects", "explained"),
    "weak": ("one effect about as large as the noise", "either"),
    "inexact": ("one effect in a form that is not the catalogue's", "named"),
    "sizes": ("one effect, gap of 0.1 to 10 times the noise", "either"),
    "detuned": ("one effect, all parameters off by up to 8 % and free", "explained"),
    "effect_disturbed": ("one effect, coloured disturbance of 1 %", "explained"),
    "region": ("an effect in one region only", "explained"),
    "time": ("an effect from some time on", "explained"),
    "onset": (
        "an effect of the whole catalogue that begins within the runs, or a parameter error that ends",
        "explained",
    ),
    "outside": ("the effect and its twins deleted from the catalogue", "unknown"),
    "novel": ("an effect that no catalogue holds", "unknown"),
    "law": ("a law that no catalogue holds: a balance, an input, a sensor, two signals, the recent past", "unknown"),
    "outside_disturbed": ("as the two before, coloured disturbance of 1 %", "unknown"),
    "none": ("no effect", "none"),
    "spikes": ("no effect, one reading in fifty is off by 5 to 50 times the noise", "none"),
    "tails": ("no effect, noise of Student's t with three degrees of freedom", "none"),
    "trends": ("no effect, sensors that drift slowly or differ from run to run", "sensor"),
    "unequal": ("one effect, runs of unequal lengths", "explained"),
    "far": ("one effect, all parameters off by up to 20 % and free", "explained"),
    "big": ("one effect, plants of 6 to 12 states", "explained"),
    "disturbed": ("no effect, coloured disturbance of 1.5 %", "none"),
    "coloured": ("no effect, coloured sensor noise of 1.5 %", "none"),
    "unexcited": ("an effect that these data never reach", "none"),
}

#: Gap over noise, where it is not 5 to 50.
GAPS = {"weak": (0.4, 1.5), "sizes": (0.1, 10.0)}

#: Least and largest gap over noise that initial states cannot close, where it is not 4 and more.
REAL_GAPS = {"weak": (0.3, 1.6), "sizes": (0.0, 12.0)}

#: By how much all parameters of the simulator are off.
OFF = {"detuned": 0.08, "far": 0.20}

#: Coloured disturbance, as a share of the outputs.
DISTURBED = {"disturbed": 0.015, "effect_disturbed": 0.01, "outside_disturbed": 0.01}

#: Range of the runs beyond the range, over that of the test runs.
FAR_RANGE = 1.5

#: Attempts at a drawing.
ATTEMPTS = 60


@dataclass(frozen=True)
class Question:
    """All that a diagnosis gets.

    Attributes
    ----------
    simulator : ODESimulator
        Nominal, perhaps badly tuned.
    X, y, groups : ndarray
        Recorded runs, stacked.
    free_params : tuple of str or "all"
    effects : list of str or None
        What is left of the catalogue; None for all of it.
    X_test : ndarray (n_runs, n_samples, n_inputs)
        Inputs of held-out runs, to be predicted.
    x0_test : ndarray (n_runs, n_states)
    X_far, x0_far : ndarray, optional
        Of the arm ``law`` runs at 1.5 times the range, to be predicted too.
    time : int, optional
        Column of ``X`` that holds the stamps of samples that are not even.

    Examples
    --------
    >>> from sksurrogate.blind import draw
    >>> question = draw("none", 1).question
    >>> len(question.X) == len(question.y) == len(question.groups)
    True
    """

    simulator: Any
    X: np.ndarray
    y: np.ndarray
    groups: np.ndarray
    free_params: Any
    effects: list[str] | None
    X_test: np.ndarray
    x0_test: np.ndarray
    X_far: np.ndarray | None = None
    x0_far: np.ndarray | None = None
    time: int | None = None


@dataclass(frozen=True)
class Case:
    """A question with its answer.

    Attributes
    ----------
    arm : str
    question : Question
    truths : tuple of Truth
    facts : dict
        Plain data: plant, excitation, noise, gap and so on.
    y_test : ndarray (n_runs, n_samples, n_outputs)
        True outputs of the test runs, without noise.
    scale : ndarray (n_outputs,)
        Standard deviation of each output.
    states : ndarray (n_rows, n_states)
        True states of the recorded rows.
    plant : PlantSpec
    noise : ndarray (n_outputs,)
        Standard deviation of the white sensor noise.
    starts : ndarray (n_runs, n_states)
        True initial states of the recorded runs.
    unit : ndarray (n_plant_outputs,)
        Noise of each output of the plant, infinite for those not measured.
    y_far : ndarray (n_runs, n_samples, n_outputs), optional
        True outputs of the runs beyond the range; none where the plant does not hold there.

    Examples
    --------
    >>> from sksurrogate.blind import draw
    >>> case = draw("none", 1)
    >>> len(case.truths), case.facts["plant"] == case.plant.name
    (0, True)
    """

    arm: str
    question: Question
    truths: tuple[Truth, ...]
    facts: dict[str, Any]
    y_test: np.ndarray
    scale: np.ndarray
    states: np.ndarray
    plant: PlantSpec
    noise: np.ndarray
    starts: np.ndarray
    unit: np.ndarray
    y_far: np.ndarray | None = None


def draw(arm: str, entropy: int | None = None, *, plant: PlantSpec | None = None, runs: Any = None) -> Case:
    """Draw a case.

    Parameters
    ----------
    arm : str
        One of :data:`ARMS`.
    entropy : int, optional
        Seed of everything; fresh by default.
    plant : PlantSpec, optional
        Default: drawn too.
    runs : list of ndarray (n_samples, n_inputs), optional
        Recorded inputs to be used as they are, for a plant of the user's own.

    Returns
    -------
    Case

    Raises
    ------
    SurrogateError
        The arm is unknown, or no effect can be shown on this plant.

    Examples
    --------
    >>> case = draw("none", 1)
    >>> case.truths, case.question.X.shape[0] == case.question.y.shape[0]
    ((), True)
    """
    if arm not in ARMS:
        raise SurrogateError(f"arms: {arm!r} is unknown; use one or several of {list(ARMS)}.")
    seed = int(np.random.SeedSequence().entropy) if entropy is None else int(entropy)  # type: ignore[arg-type]
    rng = np.random.default_rng([seed, zlib.crc32(arm.encode())])
    for _ in range(ATTEMPTS):
        case = _attempt(rng, arm, seed, plant, runs)
        if case is not None:
            return case
    raise SurrogateError(f"arms: no case of {arm!r} could be drawn for {plant.name if plant else 'any plant'!r}.")


def _attempt(rng: np.random.Generator, arm: str, seed: int, given: PlantSpec | None, runs: Any) -> Case | None:
    """One try; None where the effect does not fit the plant or cannot be made large enough."""
    plants = BIG_PLANTS if arm == "big" else PLANTS
    plant = given or plants[str(rng.choice(list(plants)))]
    setting = make_setting(rng, plant, runs, arm)
    truths = None if setting is None else choose(rng, arm, setting)
    if setting is None or truths is None:
        return None
    effects = _sized(rng, arm, setting, truths)
    if effects is None:
        return None
    if arm in DISTURBED:
        setting.force = disturbance(rng, setting, DISTURBED[arm])
    course = march(
        plant, setting.U, setting.X0, effects, force=setting.force, policy=setting.controller, substeps=fine(effects)
    )
    gap = _gap(arm, setting, effects, course)
    return None if gap is None else _case(rng, arm, seed, setting, tuple(effects), course, gap)


def _sized(rng: np.random.Generator, arm: str, setting: Setting, truths: list[Chosen]) -> list[Truth] | None:
    """The effects at a size that makes the gap of the arm; None where one cannot."""
    if not truths or arm == "unexcited":
        return [as_truth(*one, 0.0) for one in truths]
    low, high = GAPS.get(arm, (5.0, 50.0))
    target = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    variants = [str(rng.choice(list(INEXACT[one[0]]))) if arm == "inexact" else "" for one in truths]
    tried = [sized(setting, *one, target, low, variant) for one, variant in zip(truths, variants)]
    effects = [one for one in tried if one is not None]
    return effects if len(effects) == len(tried) else None


def _gap(arm: str, setting: Setting, effects: list[Truth], course: Course) -> float | None:
    """The gap over the noise; None where it is not that of the arm, or the plant leaves where it holds."""
    plant, nominal = setting.plant, setting.nominal
    if setting.controller is not None:
        nominal = march(plant, course.inputs, setting.X0, substeps=8)
    far = np.abs(course.outputs).max() > 20 * np.abs(nominal.outputs).max() + 1.0
    if far or not np.isfinite(course.outputs).all() or not plant.holds(course.states):
        return None
    if effects and arm != "unexcited":
        gap, least = _real_gaps(setting, effects, course)
        low, high = REAL_GAPS.get(arm, (4.0, np.inf))
        return gap if low <= least <= gap <= high else None
    error = (course.outputs - nominal.outputs)[..., setting.read] / (setting.noise * setting.scale[setting.read])
    gap = float(np.sqrt(np.mean(error**2)))
    return None if arm == "unexcited" and gap > 0.02 else gap


def _real_gaps(setting: Setting, effects: list[Truth], course: Course) -> tuple[float, float]:
    """The gap over the noise that initial states cannot close: of all effects, and of the one that is missed least."""
    plant = setting.plant
    outputs = course.outputs
    if setting.force is not None:  # the effects alone
        outputs = march(plant, course.inputs, setting.X0, effects, substeps=8).outputs
    unit = _unit(setting)
    gap = gap_beyond(plant, course.inputs, setting.X0, outputs, unit)
    others = [[one for one in effects if one is not left_out] for left_out in effects] if len(effects) > 1 else []
    alone = [gap_beyond(plant, course.inputs, setting.X0, outputs, unit, truths=rest) for rest in others]
    return gap, min([gap, *alone])


def _unit(setting: Setting) -> np.ndarray:
    """Noise of each output, infinite for those not measured."""
    unit = np.full(len(setting.plant.outputs), np.inf)
    unit[setting.read] = setting.noise * setting.scale[setting.read]
    return unit


def _case(rng: np.random.Generator, arm: str, seed: int, setting: Setting, truths: tuple[Truth, ...], course: Course,
          gap: float) -> Case | None:  # fmt: skip
    """Readings, the test runs, the question and its answer."""
    plant, read = setting.plant, setting.read
    n_runs, n_samples, _ = setting.U.shape
    y = readings(rng, arm, setting, course)
    params = dict(plant.params)
    if arm in OFF:
        params = {name: value * (1 + rng.uniform(-OFF[arm], OFF[arm])) for name, value in params.items()}
    X_test, x0_test = _test_runs(rng, setting, truths)
    test = march(plant, X_test, x0_test, truths, substeps=12).outputs[..., read]
    if not np.isfinite(test).all():
        return None
    X_far, x0_far, y_far = _beyond(plant, X_test, x0_test, truths, read) if arm == "law" else (None, None, None)
    rows = np.arange(n_runs * n_samples)
    if arm == "unequal":
        lengths = np.maximum((n_samples * rng.uniform(0.3, 1.0, n_runs)).astype(int), 40)
        rows = np.flatnonzero(rows % n_samples < np.repeat(lengths, n_samples))
    counting = plant.simulator(params, setting.outputs, counting=True)
    question = Question(
        counting, np.concatenate(course.inputs)[rows], np.concatenate(y)[rows], rows // n_samples, "all" if arm in OFF else (),
        remaining([truth.name for truth in truths]) if arm in ("outside", "outside_disturbed") else None, X_test, x0_test,
        X_far, x0_far,
    )  # fmt: skip
    facts = {
        "arm": arm, "seed": seed, "plant": plant.name, "domain": plant.domain, "excitation": setting.excitation,
        "sensors": "all" if len(read) == len(plant.outputs) else "few", "noise": setting.noise, "n_runs": n_runs,
        "n_samples": n_samples, "n_states": len(plant.states), "repeats": setting.repeats, "gap_over_noise": gap,
        "truths": [truth.to_dict() for truth in truths],
    }  # fmt: skip
    return Case(
        arm, question, truths, facts, test, setting.scale[read], np.concatenate(course.states)[rows], plant,
        setting.noise * setting.scale[read], course.states[:, 0].copy(), _unit(setting), y_far,
    )  # fmt: skip


def _test_runs(rng: np.random.Generator, setting: Setting, truths: tuple[Truth, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (n_runs, n_samples, n_inputs) and initial states (n_runs, n_states) of the runs that are to be predicted."""
    plant, recorded = setting.plant, setting.excitation == "recorded"
    kind = "steps" if recorded or setting.excitation == "closed_loop" else setting.excitation
    X = setting.U[:2] if recorded else inputs(rng, plant, kind, 2, min(setting.U.shape[1], 300))
    x0 = initial_states(rng, plant, len(X))
    for truth in truths:
        if KINDS.get(truth.name) is not None and KINDS[truth.name].place == "limit":
            i = plant.states.index(truth.location)
            x0[:, i] = np.minimum(x0[:, i], truth.params["limit"])
    return X, x0


def _beyond(plant: PlantSpec, X: np.ndarray, x0: np.ndarray, truths: tuple[Truth, ...], read: list[int]) -> Any:
    """Runs at 1.5 times the range of inputs and initial states, with their outputs; none where the plant does not hold there."""
    about = 0.0 if plant.positive else X.mean(axis=(0, 1))
    centre = 0.0 if plant.positive else x0.mean(axis=0)
    X_far, x0_far = about + FAR_RANGE * (X - about), centre + FAR_RANGE * (x0 - centre)
    far, plain = (march(plant, X_far, x0_far, acting, substeps=12) for acting in (truths, ()))
    holds = all(np.isfinite(course.outputs).all() and plant.holds(course.states) for course in (far, plain))
    return (X_far, x0_far, far.outputs[..., read]) if holds else (None, None, None)
