"""Values from which an effect whose prediction jumps is fitted again."""

import numpy as np

from sksurrogate.effects import CATALOGUE, starting
from sksurrogate.gap.fit._rounding import alike
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._simulator import describe


def test_steps_that_round_alike_keep_the_onset_of_a_converter_that_begins_to_round():
    tank = ODESimulator(lambda t, x, u, p: [u[0] - x[0]], states=["h"], inputs=["q"], outputs=["h"], params={}, dt=0.1)
    y = 5.0 + 0.1 * np.sin(np.arange(60.0))[None]
    record = Record(np.zeros((1, 60)), y, 0.1 * np.arange(60.0), np.array([0]), 0.1)
    effect = starting(CATALOGUE["sensor_quantization"]("h"))
    found = alike(describe(tank), record, effect, (0.1, 3.0))
    assert found and all(len(theta) == len(effect.parameters) and theta[1] == 3.0 for theta in found)
    more = sorted(y.mean() / theta[0] - y.mean() / 0.1 for theta in found)
    assert np.allclose(more, [-2.0, -1.0, 1.0, 2.0])
