"""Laws of states, inputs, outputs and time in every balance, input, element and sensor, and what they move the outputs by."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from sksurrogate.effects._balance import ConstantBias
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._formula import Term
from sksurrogate.effects._law import law_effect
from sksurrogate.gap.fit._neighbours import is_near
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.gap.unnamed._elements import PARAMETER_STEP, elements_along
from sksurrogate.gap.unnamed._law_shapes import (
    AND_ITS_PAST,
    SignalForms,
    laws,
    of_time,
    over_sample,
    staircases,
    static,
    surfaces,
    varies,
)
from sksurrogate.kernels.disturbance import Disturbance


class PlacedSignal(NamedTuple):
    """Laws of one signal at a place, and what their functions move the outputs by (n_outputs, n, n_samples).

    The last is computed when it is asked for: all at once would be large.
    """

    location: str
    kind: str
    signal: SignalForms
    moved: Callable[[], np.ndarray]

    @property
    def place(self) -> tuple[str, str]:
        """Place and signal; a signal with its past is this signal."""
        return self.location, self.signal.variable.removesuffix(AND_ITS_PAST)


def in_all_places(base: OdeCandidate) -> Iterator[PlacedSignal]:
    """Laws of near states and inputs in every balance, of each input in its place, of an element's flow, of near outputs in every sensor.

    An input enters a sensor at once: by its past, which is its way through the plant, it would explain any balance that is off.
    """
    problem, D = base.problem, base.disturbance
    plant, record = problem.plant, problem.record
    moved = partial(response, D)
    x = base.states
    signals, names = np.concatenate([x, record.u]), [*plant.states, *plant.inputs]
    held = set() if record.order_of_inputs(plant.hold) else set(plant.inputs)
    raw = list(laws(record, signals, names, plant.inputs))
    of_signals = [
        law if law.signals[0] in held else law._replace(functions=over_sample(record, law.functions)) for law in raw
    ]
    times = list(of_time(record))
    acting = [*of_signals, *surfaces(record, signals, names, held), *times]
    for b, name in enumerate(problem.balances):
        for law in acting:
            if not is_near(problem.near, name, law.signals):
                continue
            yield PlacedSignal(name, "state", law, partial(moved, D.B[:, :, b].T, law.functions))
    for i, name in enumerate(plant.inputs):
        push, shown = input_gain(base, i)
        own = [law for law in raw if law.signals == [name]]
        for law in [*own, *staircases(record.u[i], name), *times]:
            yield PlacedSignal(name, "input", law, partial(moved, push, law.functions, shown, law.shown))
    named = {effect.location for effect in base.effects}
    # Beside names, a law of an element corrects the name of its own parameter.
    wanted = [name for name in plant.params if not named or name in named]
    for element in elements_along(problem.model, record, x, wanted):
        push = np.einsum("tib,b->it", D.B, element.direction[problem.rows_of_balances])
        law = SignalForms(element.parameter, *static(element.flow))
        law = law._replace(functions=over_sample(record, law.functions))
        yield PlacedSignal(element.parameter, "parameter", law, partial(moved, push, law.functions))
    readings = base.fit.y
    at_once = [SignalForms(name, *static(z)) for name, z in zip(plant.inputs, shown_inputs(base)) if varies(z)]
    of_readings = [*laws(record, readings, plant.outputs, plant.outputs), *at_once, *times]
    for o, name in enumerate(plant.outputs):
        for law in [*of_readings, *staircases(readings[o], name)]:
            if not is_near(problem.near, name, law.signals):
                continue
            yield PlacedSignal(name, "output", law, partial(reading, len(plant.outputs), o, law.functions))


def forms_of_places(base: OdeCandidate) -> Counter[tuple[str, str]]:
    """How many forms of laws there are of every signal at every place."""
    return Counter({one.place: len(one.signal.forms) for one in in_all_places(base)})


def shown_inputs(candidate: OdeCandidate) -> np.ndarray:
    """Inputs behind the actuators at the samples, as the sensors see them: (n_inputs, n_samples)."""
    return np.asarray(candidate.model.bind(candidate.fit.theta[:, None]).shown[:, 0])


def reading(n_outputs: int, o: int, f: np.ndarray) -> np.ndarray:
    """What functions (k, n_samples) in sensor o move the outputs by: (n_outputs, k, n_samples)."""
    out = np.zeros((n_outputs, *f.shape))
    out[o] = f
    return out


def input_gain(candidate: OdeCandidate, i: int, x: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """What a unit of input i moves the next states (n_states, n_samples) and this sample's outputs (n_outputs, n_samples) by.

    Along a path of the states, the free run by default.
    """
    problem = candidate.problem
    record, u = problem.record, problem.record.u.copy()
    step = STEP_OF_SLOPES * max(float(np.std(u[i])), 1e-9)
    u[i] += step
    theta, x = candidate.fit.theta[:, None], (candidate.fit.x if x is None else x)[:, None]
    given = candidate.model.bind(theta)
    shifted = replace(problem, record=record.with_inputs(u)).augmented(candidate.effects).bind(theta)
    with np.errstate(all="ignore"):
        return (shifted(x) - given(x))[:, 0] / step, (shifted.outputs(x) - given.outputs(x))[:, 0] / step


def response(
    D: Disturbance, push: np.ndarray, f: np.ndarray, shown: np.ndarray | None = None, now: np.ndarray | None = None
) -> np.ndarray:
    """What functions f (k, n_samples) move the outputs by, to first order: (n_outputs, k, n_samples).

    They act on the next states through ``push`` (n_states, n_samples), and on this sample's outputs through ``shown``, there by their
    values ``now`` where f are means over the samples.
    """
    with np.errstate(all="ignore"):
        moved = D.moved(push[:, None] * f)
    return moved if shown is None else moved + shown[:, None] * (f if now is None else now)


def push_at(null: OdeCandidate, x: np.ndarray, name: str, kind: str) -> np.ndarray:
    """Effect of a unit at an input or a further port, or of a parameter, over one sample on the states, (n_states, 1, n_samples)."""
    problem, plant = null.problem, null.problem.plant
    if kind == "parameter":
        return _pushed(null, x, law_effect(kind, name, (Term(),)), PARAMETER_STEP * size_at(problem, name, kind))
    if name in plant.inputs:
        return input_gain(null, plant.inputs.index(name), x)[0][:, None]
    return _pushed(null, x, ConstantBias(name), STEP_OF_SLOPES * max(problem.port_rate(name), 1e-9))


def size_at(problem: OdeBackend, name: str, kind: str) -> float:
    """Size of what counts as one at an input or a further port, or of a parameter."""
    plant = problem.plant
    if kind == "parameter":
        return abs(plant.params[name]) or 1.0
    at_input = name in plant.inputs
    return max(
        float(np.std(problem.record.u[plant.inputs.index(name)]) if at_input else problem.port_rate(name)), 1e-12
    )


def _pushed(null: OdeCandidate, x: np.ndarray, effect: BaseEffect, step: float) -> np.ndarray:
    """What a unit of the one parameter of an effect changes in the states over one sample, (n_states, 1, n_samples)."""
    pushed = null.problem.augmented((effect, *null.effects)).bind(np.r_[step, null.fit.theta][:, None])
    given, x = null.model.bind(null.fit.theta[:, None]), x[:, None]
    with np.errstate(all="ignore"):
        return (pushed(x) - given(x)) / step
