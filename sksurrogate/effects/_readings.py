"""What the sensors show of a model: with a memory along the path between the samples, at the stamps, then without one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.effects._families import SensorEffect
from sksurrogate.effects._onset import timed
from sksurrogate.effects._output_path import Outputs, output_path
from sksurrogate.effects._parts import SensorPath
from sksurrogate.kernels.sampling import read_between


def read_sensors(
    bound: Outputs,
    x: np.ndarray,
    raw: np.ndarray,
    sensors: Sequence[tuple[SensorEffect, list[np.ndarray]]],
    sharp: bool,
) -> np.ndarray:
    """Readings of sensors (effect, parameters), (n_outputs, n_columns, n_samples).

    ``x`` (n_states, n_columns, n_samples).
    ``raw`` (n_outputs, n_columns, n_samples): outputs along x.
    ``sharp``: whether readings that jump are not smoothed.
    """
    record, plant = bound.record, bound.a.plant
    outputs = plant.outputs
    sensors = sorted(sensors, key=lambda item: item[0].order)
    y = raw.copy()
    paths: dict[int, SensorPath] = {}
    for effect, values in sensors:
        if effect.memory:
            place = outputs.index(str(effect.location))
            path = paths.get(place) or output_path(bound, x, raw, place)
            own = timed(effect, record.t)
            follow = getattr(own, "follow_sharp", own.follow) if sharp else own.follow  # a window is sharp
            paths[place] = follow(path, values, record.dt, record.starts)
            y[place] = paths[place].y
    if record.offset is not None:
        shift = -record.offset[None] / record.dt
        for place in range(len(y)):
            path = paths.get(place) or output_path(bound, x, raw, place)
            between = path.y, path.right, path.left, path.before
            y[place] = read_between(*between, shift, record.dt, record.starts)[0]
        raw = y.copy()
    for effect, values in sensors:
        if not effect.memory:
            place = outputs.index(str(effect.location))
            given = (y[place], effect.beside(outputs, raw, plant.inputs, bound.shown), record.t, values)
            y[place] = (
                effect.read(*given) if sharp else effect.soft(*given, 1.0 / bound.a.sharpness, record.readings(place))
            )
    return y
