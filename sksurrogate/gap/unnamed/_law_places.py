"""Laws of states, inputs, outputs and time in every balance, input and sensor, and what they move the outputs by."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.unnamed._curve_shapes import Curve, channel, reading, response
from sksurrogate.gap.unnamed._law_shapes import AND_ITS_PAST, Law, laws, of_time, over_sample, staircases, surfaces


def in_all_places(base: OdeCandidate) -> Iterator[tuple[Curve, Law, str]]:
    """Laws of states and inputs in every balance, of each input in its place, of outputs in every sensor."""
    problem, D = base.problem, base.disturbance
    plant, record = problem.plant, problem.record
    moved = partial(response, D)
    x = base.fit.x[: len(plant.states)]
    signals, names = np.concatenate([x, record.u]), [*plant.states, *plant.inputs]
    held = set(plant.inputs) if plant.hold == "zoh" else set()
    raw = list(laws(record, signals, names, plant.inputs))
    of_signals = [
        law
        if law.variable.removesuffix(AND_ITS_PAST) in held
        else law._replace(functions=over_sample(record, law.functions))
        for law in raw
    ]
    times = list(of_time(record))
    acting = [*of_signals, *surfaces(record, signals, names, held), *times]
    for b, name in enumerate(problem.balances):
        for law in acting:
            moves = partial(moved, D.B[:, :, b].T, law.functions)
            yield Curve(name, law.variable, moves), law, "state"
    for i, name in enumerate(plant.inputs):
        push, shown = channel(base, i)
        own = [law for law in raw if law.variable.removesuffix(AND_ITS_PAST) == name]
        for law in [*own, *staircases(record.u[i], name), *times]:
            moves = partial(moved, push, law.functions, shown, law.shown)
            yield Curve(name, law.variable, moves), law, "input"
    readings = base.fit.y
    of_readings = [*laws(record, readings, plant.outputs, plant.outputs), *times]
    for o, name in enumerate(plant.outputs):
        for law in [*of_readings, *staircases(readings[o], name)]:
            moves = partial(reading, len(plant.outputs), o, law.functions)
            yield Curve(name, law.variable, moves), law, "output"
